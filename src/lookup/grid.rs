//! The grid of pixels and tiles of one level: finds the window of pixels around a point, their
//! weights and their tiles.

use std::cell::Cell;

use super::descriptor::{Located, Split, Window};
use super::query::Border;
use crate::cache::Descriptor;
use crate::{Filter, LevelInfo};

/// Side in pixels of the window of a kernel that is one pixel wide.
#[inline(always)]
pub(super) fn side_of(filter: Filter) -> u32 {
    match filter {
        Filter::Nearest => 1,
        Filter::Box | Filter::Triangle => 2,
        Filter::Gaussian | Filter::CatmullRom => 4,
    }
}

/// The size, tiles and filter of one level.
pub(super) struct Grid {
    filter: Filter,
    border: Border,
    pub width: i32,
    pub height: i32,
    /// Upper clamp of coordinates. All places above it, and below -8, give the same answer.
    far: [f32; 2],
    /// A window lies inside the level if its first place, before it is rounded down to a pixel, is
    /// not below the first of these, and below the second along x and the third along y.
    inner: [f32; 3],
    /// Width of a pixel of level 0 in pixels of this level.
    pub scale: f32,
    /// Number of the first tile, counted from that of level 0.
    first_tile: usize,
    tiles_x: u32,
    /// Binary logarithm of a tile's side.
    shift: u32,
    pub hits: Cell<u64>,
}

/// One axis of a window that crosses borders of tiles or of the level: its places, clamped to the
/// level; whether each was inside or the border is clamped; and its first and last tile.
struct Cut<const N: usize> {
    places: [u32; N],
    inside: [bool; N],
    tiles: [u32; 2],
}

/// The tiles of a window: one or two each way.
#[derive(Clone, Copy)]
pub(super) struct Quad {
    /// Numbers of the tiles.
    pub tiles: [[usize; 2]; 2],
    /// How many rows and columns of them there are.
    pub size: [usize; 2],
}

impl Grid {
    /// Level number `l` of a map, whose tiles begin at number `first_tile`.
    pub fn new(
        l: usize,
        info: &LevelInfo,
        first_tile: usize,
        filter: Filter,
        border: Border,
    ) -> Self {
        let size = [info.shape.width, info.shape.height];
        let half = side_of(filter) as i32 / 2;
        let end = |side: u32| (side as i32 - half) as f32;
        Grid {
            filter,
            border,
            width: info.shape.width as i32,
            height: info.shape.height as i32,
            far: size.map(|side| side as f32 + 8.0),
            inner: [(half / 2) as f32, end(size[0]), end(size[1])],
            scale: 0.5f32.powi(l as i32),
            first_tile,
            tiles_x: info.shape.tiles_x(),
            shift: info.shape.tile_size.trailing_zeros(),
            hits: Cell::new(0),
        }
    }

    /// Counts hits: tiles that the sampler or the cache held.
    #[inline(always)]
    pub fn count(&self, hits: u64) {
        self.hits.set(self.hits.get() + hits);
    }

    /// The tile that holds the whole window of a kernel that is one pixel wide, the first pixel's
    /// place in the tile, and the weights; `None` unless there is one. `x` and `y` may be any
    /// numbers.
    #[inline(always)]
    pub fn near<const N: usize>(&self, x: f32, y: f32) -> Option<(usize, [u32; 2], Window<N>)> {
        let (mut x, mut y) = (x * self.scale, y * self.scale);
        if N > 1 {
            (x, y) = (x - 0.5, y - 0.5);
        }
        let [low, right, bottom] = self.inner;
        if !(x >= low && x < right && y >= low && y < bottom) {
            return None;
        }
        // SAFETY: they lie between 0 and 2^21.
        let (i, j) = unsafe { (x.to_int_unchecked::<i32>(), y.to_int_unchecked::<i32>()) };
        let window = Window {
            columns: weights(self.filter, x - i as f32),
            rows: weights(self.filter, y - j as f32),
        };
        let (i, j) = ((i - N as i32 / 4) as u32, (j - N as i32 / 4) as u32);
        let at = self.place([i, j]);
        if (at[0].max(at[1]) + N as u32 - 1) >> self.shift != 0 {
            return None;
        }
        Some((self.tile([i >> self.shift, j >> self.shift]), at, window))
    }

    /// First pixel and weights of the window of a kernel that is one pixel wide.
    #[inline(always)]
    pub fn window<const N: usize>(&self, x: f32, y: f32) -> ([i32; 2], Window<N>) {
        let (x, columns) = self.axis(self.filter, x, self.far[0]);
        let (y, rows) = self.axis(self.filter, y, self.far[1]);
        ([x, y], Window { columns, rows })
    }

    /// The tile of the window of `N` x `N` pixels from `origin`, and the first pixel's place in the
    /// tile; `None` unless one tile holds the whole window.
    #[inline(always)]
    pub fn tile_of<const N: usize>(&self, origin: [i32; 2]) -> Option<(usize, [u32; 2])> {
        let last = N as i32 - 1;
        let [x, y] = origin;
        // A negative number becomes a large unsigned number.
        let inside = |c: i32, side: i32| u64::from(c as u32) + (last as u64) < side as u64;
        let one = inside(x, self.width)
            && inside(y, self.height)
            && (N == 1 || ((x ^ (x + last)) | (y ^ (y + last))) >> self.shift == 0);
        let at = origin.map(|c| c as u32);
        one.then(|| (self.tile(at.map(|c| c >> self.shift)), self.place(at)))
    }

    /// The place of a pixel in its tile.
    #[inline(always)]
    fn place(&self, pixel: [u32; 2]) -> [u32; 2] {
        let mask = (1 << self.shift) - 1;
        [pixel[0] & mask, pixel[1] & mask]
    }

    #[inline(always)]
    fn tile(&self, [tx, ty]: [u32; 2]) -> usize {
        self.first_tile + ty as usize * self.tiles_x as usize + tx as usize
    }

    /// Number of a tile in its level.
    pub fn index_of(&self, tile: usize) -> u64 {
        (tile - self.first_tile) as u64
    }

    #[inline(always)]
    fn cut<const N: usize>(&self, origin: i32, side: i32) -> Cut<N> {
        let lit = self.border == Border::Lit;
        let own: [i32; N] = std::array::from_fn(|i| origin + i as i32);
        let clamped = own.map(|c| c.clamp(0, side - 1) as u32);
        Cut {
            places: clamped,
            inside: own.map(|c| !lit || (0..side).contains(&c)),
            tiles: [clamped[0], clamped[N - 1]].map(|c| c >> self.shift),
        }
    }

    /// The tiles of a window in several tiles; `None` if it lies outside a map with a lit border.
    #[inline(always)]
    pub fn quad<const N: usize>(&self, [x, y]: [i32; 2]) -> Option<Quad> {
        let (columns, rows) = (self.cut::<N>(x, self.width), self.cut::<N>(y, self.height));
        let within = columns.inside.contains(&true) && rows.inside.contains(&true);
        let size = |cut: &Cut<N>| 1 + usize::from(cut.tiles[0] != cut.tiles[1]);
        within.then(|| Quad {
            tiles: rows
                .tiles
                .map(|ty| columns.tiles.map(|tx| self.tile([tx, ty]))),
            size: [size(&rows), size(&columns)],
        })
    }

    /// The pixels of a window in the tiles of its [`Grid::quad`].
    #[inline(always)]
    pub fn split<'a, const N: usize>(
        &self,
        [x, y]: [i32; 2],
        window: Window<N>,
        quad: [[&'a Descriptor<'a>; 2]; 2],
    ) -> Split<'a, N> {
        let (columns, rows) = (self.cut::<N>(x, self.width), self.cut::<N>(y, self.height));
        let second =
            |cut: &Cut<N>, i: usize| usize::from(cut.places[i] >> self.shift != cut.tiles[0]);
        let pixel = |j: usize, i: usize| Located {
            tile: if columns.inside[i] && rows.inside[j] {
                quad[second(&rows, j)][second(&columns, i)]
            } else {
                Descriptor::LIT
            },
            at: self.place([columns.places[i], rows.places[j]]),
            window: Window::pixel(),
        };
        Split {
            pixels: std::array::from_fn(|j| std::array::from_fn(|i| pixel(j, i))),
            window,
        }
    }

    #[inline(always)]
    fn axis<const N: usize>(&self, filter: Filter, c: f32, far: f32) -> (i32, [f64; N]) {
        let c = c * self.scale;
        // Each line compiles to one instruction, and NaN becomes -8.
        let c = if c > -8.0 { c } else { -8.0 };
        let c = if c < far { c } else { far };
        if N == 1 {
            return (floor(c), [1.0; N]);
        }
        // The last pixel whose centre is at or below the coordinate, and the distance from that
        // centre; both are exact.
        let before = floor(c - 0.5);
        let f = c - 0.5 - before as f32;
        (before - N as i32 / 4, weights(filter, f))
    }
}

/// The weights of a window along one axis, whose centre lies `f` behind that of a pixel.
#[inline(always)]
fn weights<const N: usize>(filter: Filter, f: f32) -> [f64; N] {
    let weights = match (N, filter) {
        (1, _) => return [1.0; N],
        (2, _) => [1.0 - f64::from(f), f64::from(f), 0.0, 0.0],
        (_, Filter::CatmullRom) => catmull_rom(f),
        _ => gaussian(f),
    };
    let mut out = [0.0; N];
    out.copy_from_slice(&weights[..N]);
    out
}

/// The largest integer at or below `v`, without the library call of processors before SSE4.1. `v`
/// lies between -16 and 2^21.
#[inline(always)]
fn floor(v: f32) -> i32 {
    debug_assert!((-16.0..4e6).contains(&v));
    // The sum is exact and positive, so truncation rounds down.
    let shifted = f64::from(v) + 16.0;
    // SAFETY: `shifted` is in the range of i32. Only `axis` calls this function, and its clamp of
    // `v` leaves no NaN.
    unsafe { shifted.to_int_unchecked::<i32>() - 16 }
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
    // In f64, so that the weights add up to 1 within the rounding of an f32 answer.
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
