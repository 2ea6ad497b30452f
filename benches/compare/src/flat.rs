//! The main baseline: a map as flat arrays, without tiles to find, pin or load.
//!
//! Each level has one vertex table, one plane of depths and one plane of lattice visibilities for
//! each channel. The pixels are in tile order. Border tiles are padded, so that an index takes
//! shifts and adds only. A lookup computes the definition: one `partition_point` for each pixel,
//! the place between two vertices in f64, a weighted sum. It prefetches the vertices of all its
//! pixels before it searches the first, and does not branch on the result of a search. Both were
//! measured to pay.
//!
//! The arrays come in ordinary pages and, as a second baseline, in huge pages.

use std::hint::select_unpredictable;

use deepshadow::raw::Precision;
use deepshadow::{DsmFile, MapId, TileId};

use crate::queries::{Lookup, Queries, levels_of};

const SHIFT: u32 = 5;
const SIDE: usize = 1 << SHIFT;
const PIXELS: usize = SIDE * SIDE;

/// All levels of a map of `C` channels.
#[derive(Debug)]
pub struct Flat<const C: usize = 1> {
    levels: Vec<Level<C>>,
}

#[derive(Debug)]
struct Level<const C: usize> {
    width: i32,
    height: i32,
    /// Pixels in a row of tiles.
    tile_row: usize,
    /// First vertex of each pixel, and the number of vertices.
    start: Vec<u32>,
    z: Vec<f32>,
    /// A plane for each channel.
    k: [Vec<u16>; C],
    /// L.
    lattice: f64,
    /// 1 / L.
    unit: f64,
}

impl<const C: usize> Level<C> {
    fn of(file: &DsmFile, level: usize) -> Self {
        let info = file.level(MapId(0).level(level as u32)).expect("the level");
        let shape = info.shape;
        let mut out = Level {
            width: shape.width as i32,
            height: shape.height as i32,
            tile_row: shape.tiles_x() as usize * PIXELS,
            start: vec![0],
            z: Vec::new(),
            k: [const { Vec::new() }; C],
            lattice: 1.0,
            unit: 1.0,
        };
        let mut lattice = None;
        for ty in 0..shape.tiles_y() {
            for tx in 0..shape.tiles_x() {
                let tile = file
                    .tile(MapId(0).level(level as u32), TileId::new(tx, ty))
                    .expect("our own file");
                // A tile that is one vertex everywhere is stored without a lattice, and has 0 or 1
                // behind it here.
                let own = match tile.precision() {
                    Precision::Lattice(own) => own,
                    Precision::F32 => lattice.unwrap_or(1),
                };
                if tile.vertices() > 0 {
                    assert_eq!(*lattice.get_or_insert(own), own, "one lattice a level");
                }
                let (w, h) = shape.tile_extent(TileId::new(tx, ty));
                for i in 0..PIXELS as u32 {
                    let (x, y) = (i % SIDE as u32, i / SIDE as u32);
                    if x < w && y < h {
                        let f = tile.function((y * w + x) as usize);
                        out.z.extend_from_slice(f.depths());
                        for (i, c) in (0..f.len()).flat_map(|i| (0..C).map(move |c| (i, c))) {
                            let v = f.value(i, c % f.channels()) as f32;
                            let k = (v * f32::from(own)).round() as u16;
                            assert_eq!(f32::from(k) / f32::from(own), v, "a value of the lattice");
                            out.k[c].push(k);
                        }
                    }
                    out.start.push(out.z.len() as u32);
                }
            }
        }
        out.lattice = f64::from(lattice.unwrap_or(1));
        out.unit = 1.0 / out.lattice;
        out
    }

    /// Part of a pixel's index that its column decides.
    #[inline(always)]
    fn column(&self, x: i32) -> usize {
        let x = x.clamp(0, self.width - 1) as usize;
        (x >> SHIFT) * PIXELS + (x & (SIDE - 1))
    }

    /// Part of a pixel's index that its row decides.
    #[inline(always)]
    fn row(&self, y: i32) -> usize {
        let y = y.clamp(0, self.height - 1) as usize;
        (y >> SHIFT) * self.tile_row + (y & (SIDE - 1)) * SIDE
    }

    /// Where the vertices of `N` pixels stand. They are on their way from memory when this returns.
    #[inline(always)]
    fn ranges<const N: usize>(&self, pixels: [usize; N]) -> [(usize, usize); N] {
        pixels.map(|pixel| {
            // SAFETY: `pixel` is `row(y) + column(x)`, both clamped to the level, so it is below
            // the number of pixels of the padded tiles, and `start` has one entry more.
            let (first, last) = unsafe {
                let first = *self.start.get_unchecked(pixel) as usize;
                (first, *self.start.get_unchecked(pixel + 1) as usize)
            };
            let middle = (first + last) / 2;
            prefetch(self.z.as_ptr().wrapping_add(middle));
            for k in &self.k {
                prefetch(k.as_ptr().wrapping_add(middle));
            }
            (first, last)
        })
    }

    /// The function of the vertices `first..last`, from [`Level::ranges`] of this level, at depth
    /// `z`.
    #[inline(always)]
    fn value(&self, (first, last): (usize, usize), z: f32) -> [f64; C] {
        // SAFETY: the range comes from two neighbours in `start`, whose entries rise and end with
        // the length of `z` and `k` ([`Level::of`]); `lo` and `hi` are below `n`.
        unsafe {
            let depths = self.z.get_unchecked(first..last);
            let n = depths.len();
            if n == 0 {
                return [1.0; C];
            }
            // No branch on what the search finds: it is as good as random, and pixels of one lookup
            // could not overlap.
            let next = depths.partition_point(|&d| d < z);
            let (lo, hi) = (next.saturating_sub(1), next.min(n - 1));
            let z0 = f64::from(*depths.get_unchecked(lo));
            let z1 = f64::from(*depths.get_unchecked(hi));
            let t = (f64::from(z) - z0) / (z1 - z0);
            let t = select_unpredictable(lo == hi, 0.0, t);
            self.k.each_ref().map(|k| {
                let values = k.get_unchecked(first..last);
                let k1 = f64::from(*values.get_unchecked(hi));
                let k0 = f64::from(*values.get_unchecked(lo));
                let k0 = select_unpredictable(next == 0, self.lattice, k0);
                (k0 + (k1 - k0) * t) * self.unit
            })
        }
    }

    /// The vertices of the 2 x 2 pixels around a point, and how far it is on the way to the second
    /// column and row.
    #[inline(always)]
    fn window(&self, x: f32, y: f32) -> Window {
        let (x0, fx) = split(x);
        let (y0, fy) = split(y);
        let (c0, c1) = (self.column(x0), self.column(x0 + 1));
        let (r0, r1) = (self.row(y0), self.row(y0 + 1));
        (self.ranges([r0 + c0, r0 + c1, r1 + c0, r1 + c1]), fx, fy)
    }

    #[inline(always)]
    fn bilinear(&self, (ranges, fx, fy): Window, z: f32) -> [f64; C] {
        let v = ranges.map(|range| self.value(range, z));
        std::array::from_fn(|c| {
            let upper = v[0][c] * (1.0 - fx) + v[1][c] * fx;
            let lower = v[2][c] * (1.0 - fx) + v[3][c] * fx;
            upper * (1.0 - fy) + lower * fy
        })
    }

    #[inline(always)]
    fn gaussian(&self, x: f32, y: f32, z: f32) -> f64 {
        let (x0, fx) = split(x);
        let (y0, fy) = split(y);
        let columns = [-1, 0, 1, 2].map(|i| self.column(x0 + i));
        let rows = [-1, 0, 1, 2].map(|j| self.row(y0 + j));
        let ranges = self.ranges(std::array::from_fn::<_, 16, _>(|i| {
            rows[i / 4] + columns[i % 4]
        }));
        let (wx, sum_x) = gaussian_weights(fx);
        let (wy, sum_y) = gaussian_weights(fy);
        let mut sum = 0.0;
        for (line, w) in ranges.chunks_exact(4).zip(&wy) {
            let line = line
                .iter()
                .zip(&wx)
                .map(|(&range, w)| self.value(range, z)[0] * w);
            sum += w * line.sum::<f64>();
        }
        sum / (sum_x * sum_y)
    }
}

/// Vertices of 2 x 2 pixels, and where a point is among them.
type Window = ([(usize, usize); 4], f64, f64);

/// Has the line of memory at `at` fetched; any address will do.
#[inline(always)]
fn prefetch<T>(at: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch reads nothing that the program sees, and faults at no address; SSE is part
    // of x86-64.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(at.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

/// The pixel whose middle is at or before `x`, and how far `x` is on the way to the next one.
#[inline(always)]
fn split(x: f32) -> (i32, f64) {
    // Truncation is rounding down from 0 on.
    let first = (x + 0.5) as i32 - 1;
    (first, f64::from(x) - 0.5 - f64::from(first))
}

/// exp(-2 d^2) - exp(-8) at d = 1 + f, f, 1 - f, 2 - f; and their sum.
#[inline(always)]
fn gaussian_weights(f: f64) -> ([f64; 4], f64) {
    const E2: f64 = 0.135_335_283_236_612_7; // exp(-2)
    const E8: f64 = 0.000_335_462_627_902_511_8; // exp(-8)
    let (c, r) = ((-2.0 * f * f).exp(), (4.0 * f).exp());
    let w = [E2 * c / r, c, E2 * c * r, E8 * c * r * r].map(|w| w - E8);
    (w, (w[0] + w[1]) + (w[2] + w[3]))
}

/// Size and alignment of a huge page.
const HUGE: usize = 2 << 20;

/// A copy of an array in huge pages, where the system grants them.
fn in_huge_pages<T: Copy>(array: &[T]) -> Vec<T> {
    let room = array.len() + 2 * HUGE / size_of::<T>();
    let mut copy = Vec::<T>::with_capacity(room);
    #[cfg(target_os = "linux")]
    {
        use rustix::mm::{Advice, madvise};
        let memory = copy.as_mut_ptr().cast::<u8>();
        let offset = memory.align_offset(HUGE);
        let bytes = size_of_val(array).next_multiple_of(HUGE);
        // SAFETY: the range lies inside the allocation: `offset` is less than `HUGE`, `bytes` is at
        // most `HUGE` more than the array, and the room is two huge pages more. This advice changes
        // no contents. The benchmark also works if the system refuses it.
        let _ = unsafe { madvise(memory.add(offset).cast(), bytes, Advice::LinuxHugepage) };
    }
    copy.extend_from_slice(array);
    copy
}

impl<const C: usize> Flat<C> {
    /// A copy of all arrays in huge pages, where the system grants them.
    pub fn in_huge_pages(&self) -> Self {
        let level = |level: &Level<C>| Level {
            start: in_huge_pages(&level.start),
            z: in_huge_pages(&level.z),
            k: level.k.each_ref().map(|k| in_huge_pages(k)),
            ..*level
        };
        Flat {
            levels: self.levels.iter().map(level).collect(),
        }
    }

    /// The arrays of the first map of a file.
    pub fn of(file: &DsmFile) -> Self {
        let levels = 0..file.maps()[0].levels.len();
        Flat {
            levels: levels.map(|l| Level::of(file, l)).collect(),
        }
    }

    /// Bytes of all levels.
    pub fn bytes(&self) -> usize {
        let of = |l: &Level<C>| 4 * l.start.len() + 4 * l.z.len() + 2 * C * l.z.len();
        self.levels.iter().map(of).sum()
    }

    /// The function of one pixel.
    #[inline(always)]
    fn pixel(&self, x: f32, y: f32, z: f32) -> [f32; C] {
        let level = &self.levels[0];
        let [range] = level.ranges([level.row(y as i32) + level.column(x as i32)]);
        level.value(range, z).map(|v| v as f32)
    }

    /// 2 x 2 pixels of the base level.
    #[inline(always)]
    fn bilinear(&self, x: f32, y: f32, z: f32) -> [f32; C] {
        let level = &self.levels[0];
        level.bilinear(level.window(x, y), z).map(|v| v as f32)
    }

    /// 2 x 2 pixels of two levels, the second with weight `blend`.
    #[inline(always)]
    fn trilinear(
        &self,
        (fine, coarse, blend): (usize, usize, f64),
        x: f32,
        y: f32,
        z: f32,
    ) -> [f32; C] {
        let window = |l: usize| {
            let scale = f32::from_bits((127 - l as u32) << 23); // 2^-l
            self.levels[l].window(x * scale, y * scale)
        };
        let near = window(fine);
        if blend == 0.0 {
            return self.levels[fine].bilinear(near, z).map(|v| v as f32);
        }
        let far = window(coarse);
        let first = self.levels[fine].bilinear(near, z);
        let second = self.levels[coarse].bilinear(far, z);
        std::array::from_fn(|c| (first[c] + (second[c] - first[c]) * blend) as f32)
    }

    /// Any lookup; the level is chosen for each one, as a renderer does. The Gaussian has one
    /// channel.
    #[inline(always)]
    pub fn channels(&self, lookup: Lookup, width: f32, x: f32, y: f32, z: f32) -> [f32; C] {
        match lookup {
            Lookup::Pixel => self.pixel(x, y, z),
            Lookup::Bilinear | Lookup::Trilinear => {
                self.trilinear(levels_of(width, self.levels.len()), x, y, z)
            }
            Lookup::Gaussian => [self.levels[0].gaussian(x, y, z) as f32; C],
        }
    }

    /// Sum of the answers to all queries, the kind of lookup and its levels chosen once.
    pub fn sum(&self, lookup: Lookup, width: f32, queries: &Queries) -> f32 {
        let all = queries.iter();
        let sum = |v: [f32; C]| v.iter().sum::<f32>();
        match lookup {
            Lookup::Pixel => all.map(|(x, y, z)| sum(self.pixel(x, y, z))).sum(),
            Lookup::Bilinear if width <= 1.0 => {
                all.map(|(x, y, z)| sum(self.bilinear(x, y, z))).sum()
            }
            Lookup::Bilinear | Lookup::Trilinear => {
                let levels = levels_of(width, self.levels.len());
                all.map(|(x, y, z)| sum(self.trilinear(levels, x, y, z)))
                    .sum()
            }
            Lookup::Gaussian => all
                .map(|(x, y, z)| self.levels[0].gaussian(x, y, z) as f32)
                .sum(),
        }
    }
}

impl Flat {
    /// [`Flat::channels`] of the only one.
    #[inline(always)]
    pub fn lookup(&self, lookup: Lookup, width: f32, x: f32, y: f32, z: f32) -> f32 {
        self.channels(lookup, width, x, y, z)[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maps::Block;
    use crate::queries::Access;
    use crate::reference::Levels;
    use crate::scene::{DEPTHS, Hair};
    use deepshadow::Mips;

    #[test]
    fn flat_arrays_answer_what_the_stored_functions_say() {
        let block = Block::compress(32, &Hair::new(32, 2).curves(8), 0.03);
        let file = block.file(96, 64, Mips::Full);
        let (flat, levels) = (Flat::<1>::of(&file), Levels::of(&file));
        for access in Access::ALL {
            let queries = Queries::new(access, 2000, (96, 64), 0.0, DEPTHS);
            for (lookup, width) in [
                (Lookup::Pixel, 1.0),
                (Lookup::Bilinear, 1.0),
                (Lookup::Trilinear, 1.5),
                (Lookup::Trilinear, 40.0),
                (Lookup::Gaussian, 1.0),
            ] {
                for at @ (x, y, z) in queries.iter() {
                    let ours = f64::from(flat.lookup(lookup, width, x, y, z));
                    let exact = levels.stored(lookup, width, at);
                    assert!(
                        (ours - exact).abs() < 2f64.powi(-22),
                        "{lookup:?} at {at:?}"
                    );
                }
            }
        }
    }
}
