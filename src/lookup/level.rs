//! One level of a map as lookups see it: which block of pixels a point looks at, what they weigh, and where they are.

use super::pins::TileKey;
use crate::{Filter, LevelInfo};

/// Where a pixel is: its tile, and its place in the tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Address {
    pub tile: TileKey,
    pub at: usize,
}

/// Pixels in a row of the block that a kernel of one pixel's width looks at.
fn side_of(filter: Filter) -> u32 {
    match filter {
        Filter::Nearest => 1,
        Filter::Box | Filter::Triangle => 2,
        Filter::Gaussian | Filter::CatmullRom => 4,
    }
}

/// What a lookup needs to know of a level.
#[derive(Clone)]
pub(super) struct Level {
    pub width: i32,
    pub height: i32,
    /// A block lies inside the level if its first pixel is before this.
    inside: [u32; 2],
    /// Beyond this, and beyond -8, all places are alike.
    far: [f32; 2],
    /// Pixels of this level in one of level 0.
    pub scale: f32,
    pub tiles_x: u32,
    pub hits: u64,
}

impl Level {
    /// Level number `l` of a map, for lookups with `filter`.
    pub fn new(l: usize, info: &LevelInfo, filter: Filter) -> Self {
        let size = [info.shape.width, info.shape.height];
        Level {
            width: info.shape.width as i32,
            height: info.shape.height as i32,
            inside: size.map(|side| (side + 1).saturating_sub(side_of(filter))),
            far: size.map(|side| side as f32 + 8.0),
            scale: 0.5f32.powi(l as i32),
            tiles_x: info.shape.tiles_x(),
            hits: 0,
        }
    }

    /// First pixel of the block of a kernel of one pixel's width, and the weights of its columns and rows.
    #[inline(always)]
    pub fn block<const N: usize>(
        &self,
        filter: Filter,
        x: f32,
        y: f32,
    ) -> ([i32; 2], [f64; N], [f64; N]) {
        let (x, wx) = self.axis(filter, x, self.far[0]);
        let (y, wy) = self.axis(filter, y, self.far[1]);
        ([x, y], wx, wy)
    }

    /// Whether the block of `N` x `N` pixels from (x, y) on lies in one tile.
    #[inline(always)]
    pub fn holds<const N: usize>(&self, [x, y]: [i32; 2], shift: u32) -> bool {
        let last = N as i32 - 1;
        // As unsigned numbers, what is negative is large.
        (x as u32) < self.inside[0]
            && (y as u32) < self.inside[1]
            && (N == 1 || ((x ^ (x + last)) | (y ^ (y + last))) >> shift == 0)
    }

    /// The tile of pixel (x, y), which must be one of the level.
    #[inline(always)]
    pub fn tile(&self, level: usize, [x, y]: [i32; 2], shift: u32) -> TileKey {
        TileKey::new(level, [x as u32 >> shift, y as u32 >> shift])
    }

    /// Where pixel (x, y) is, which must be one of the level: its tile, and its place in the tile.
    #[inline(always)]
    pub fn address(&self, level: usize, [x, y]: [i32; 2], shift: u32) -> Address {
        let mask = (1u32 << shift) - 1;
        let stride = (1 << shift).min(self.width as u32 - (x as u32 & !mask));
        Address {
            tile: self.tile(level, [x, y], shift),
            at: ((y as u32 & mask) * stride + (x as u32 & mask)) as usize,
        }
    }

    #[inline(always)]
    fn axis<const N: usize>(&self, filter: Filter, c: f32, far: f32) -> (i32, [f64; N]) {
        let c = c * self.scale;
        // In this form each is one instruction, and what is no number becomes -8.
        let c = if c > -8.0 { c } else { -8.0 };
        let c = if c < far { c } else { far };
        if N == 1 {
            return (floor(c), [1.0; N]);
        }
        // The pixel whose centre is at or before the point, and how far the point is behind it; exact.
        let before = floor(c - 0.5);
        let f = c - 0.5 - before as f32;
        if N == 2 {
            let f = f64::from(f);
            return (before, std::array::from_fn(|i| [1.0 - f, f][i % 2]));
        }
        let weights = match filter {
            Filter::CatmullRom => catmull_rom(f),
            _ => gaussian(f),
        };
        (before - 1, std::array::from_fn(|i| weights[i % 4]))
    }
}

/// The integer below `v`, which lies between -8 and 2^21 or is made to; without the library call that older processors need.
#[inline(always)]
fn floor(v: f32) -> i32 {
    debug_assert!((-16.0..4e6).contains(&v));
    // SAFETY: `v` is a number that an i32 holds: `axis` alone calls this, and has clamped it in a way that leaves no NaN.
    let i = unsafe { v.to_int_unchecked::<i32>() };
    i - i32::from(i as f32 > v)
}

/// exp(-2 d²) - exp(-8) at d = -1 - f, -f, 1 - f, 2 - f, their sum made 1.
#[inline(always)]
fn gaussian(f: f32) -> [f64; 4] {
    // exp(-2 (a - f)²) = exp(-2 a²) exp(-2 f²) exp(4 a f): two exponentials are enough.
    const E2: f32 = 0.135_335_28;
    const E8: f32 = 0.000_335_462_63;
    let (centre, e) = ((-2.0 * f * f).exp(), (4.0 * f).exp());
    let w = [
        E2 * centre / e,
        centre,
        E2 * centre * e,
        E8 * centre * e * e,
    ];
    // In f64, so that the weights of what is lit all around add up to light.
    let w = w.map(|w| f64::from((w - E8).max(0.0)));
    let part = 1.0 / ((w[0] + w[1]) + (w[2] + w[3]));
    w.map(|w| w * part)
}

/// The interpolating cubic at d = -1 - f, -f, 1 - f, 2 - f; their sum is 1.
#[inline(always)]
fn catmull_rom(f: f32) -> [f64; 4] {
    let f = f64::from(f);
    let (f2, f3) = (f * f, f * f * f);
    [
        f2 - 0.5 * (f3 + f),
        1.5 * f3 - 2.5 * f2 + 1.0,
        2.0 * f2 + 0.5 * f - 1.5 * f3,
        0.5 * (f3 - f2),
    ]
}
