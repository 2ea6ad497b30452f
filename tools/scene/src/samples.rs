//! The sampling pattern: positions and times of a pixel's rays. It is jittered, and depends only on
//! the seed and the pixel (LV00, sections 3.2 and 5.5).

use std::ops::Range;

use wide::f32x8;

/// Number of lanes; the samples of a pixel are padded to a multiple of it.
pub const LANES: usize = 8;

/// The pattern of `n` rays in a pixel.
///
/// A pixel is divided into `n` cells of equal area, in about sqrt(`n`) rows. Each cell gets one
/// ray, at a position in it that depends only on the seed and the pixel. If the scene moves, each
/// ray also gets a time: one in each `n`th of the shutter, assigned to the cells at random.
#[derive(Clone, Debug)]
pub struct Pattern {
    seed: u64,
    /// Left, top, width and height of each cell, in pixels from the pixel's centre.
    cells: Vec<[f32; 4]>,
    timed: bool,
}

/// The rays of consecutive pixels.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Rays per pixel.
    pub count: usize,
    /// Position to the right of the pixel's centre, in pixels, -0.5 to 0.5; padded with NaN to
    /// whole groups of lanes.
    pub x: Vec<f32x8>,
    /// Position below the pixel's centre, likewise.
    pub y: Vec<f32x8>,
    /// Time, 0 to 1, ascending in each pixel; empty if nothing moves.
    pub time: Vec<f32x8>,
}

impl Pattern {
    /// A pattern of `n` rays.
    pub fn new(n: u32, seed: u64, timed: bool) -> Self {
        let rows = f64::from(n).sqrt().round().max(1.0) as u32;
        let mut cells = Vec::with_capacity(n as usize);
        for row in 0..rows {
            // Rows get as equal numbers of cells as possible; a row's height is its share of the
            // cells.
            let [first, next] =
                [row, row + 1].map(|r| (u64::from(n) * u64::from(r) / u64::from(rows)) as u32);
            let share = |k: u32| (f64::from(k) / f64::from(n)) as f32 - 0.5;
            for k in first..next {
                let width = 1.0 / (next - first) as f32;
                let left = (k - first) as f32 * width - 0.5;
                cells.push([left, share(first), width, share(next) - share(first)]);
            }
        }
        Pattern { seed, cells, timed }
    }

    /// Rays per pixel.
    pub fn count(&self) -> usize {
        self.cells.len()
    }

    /// Computes the rays of the pixels in some rows and columns, row by row.
    pub fn fill(&self, columns: Range<i32>, rows: Range<i32>, out: &mut Samples) {
        out.count = self.count();
        out.x.clear();
        out.y.clear();
        out.time.clear();
        for y in rows {
            for x in columns.clone() {
                self.pixel(x, y, out);
            }
        }
    }

    fn pixel(&self, x: i32, y: i32, out: &mut Samples) {
        let n = self.cells.len();
        let key = mix(self.seed ^ mix(u64::from(x as u32) << 32 | u64::from(y as u32)));
        let shuffled = self.timed.then(|| Permutation::new(n as u32, key));
        let mut lanes = [[f32::NAN; LANES]; 3];
        for i in 0..n {
            let cell = shuffled.as_ref().map_or(i, |p| p.at(i as u32) as usize);
            let dice = mix(key.wrapping_add((cell as u64 + 1).wrapping_mul(STEP)));
            let [left, top, width, height] = self.cells[cell];
            let lane = i % LANES;
            // Below 1/2 even after rounding: 1/2 belongs to the next pixel.
            let inside = |v: f32| v.min(0.5f32.next_down());
            lanes[0][lane] = inside(left + unit(dice >> 32) * width);
            lanes[1][lane] = inside(top + unit(dice & 0xffff_ffff) * height);
            if self.timed {
                let moment = mix(dice ^ STEP);
                // Below the next ray's interval even after rounding: the intervals of moving
                // triangles exclude their end, so a ray at time 1 would miss.
                let [at, next] = [unit(moment >> 32), 1.0].map(|t| (i as f32 + t) / n as f32);
                lanes[2][lane] = at.min(next.next_down());
            }
            if lane == LANES - 1 || i == n - 1 {
                out.x.push(f32x8::from(lanes[0]));
                out.y.push(f32x8::from(lanes[1]));
                if self.timed {
                    out.time.push(f32x8::from(lanes[2]));
                }
                lanes = [[f32::NAN; LANES]; 3];
            }
        }
    }
}

impl Samples {
    /// Groups of lanes per pixel.
    pub fn groups(&self) -> usize {
        self.count.div_ceil(LANES)
    }

    /// Position of ray `ray` of pixel `pixel`, from the pixel's centre.
    pub fn place(&self, pixel: usize, ray: usize) -> [f32; 2] {
        let (group, lane) = (pixel * self.groups() + ray / LANES, ray % LANES);
        [&self.x, &self.y].map(|axis| axis[group].as_array()[lane])
    }

    /// Time of ray `ray` of pixel `pixel`; 0 if nothing moves.
    pub fn moment(&self, pixel: usize, ray: usize) -> f32 {
        let group = pixel * self.groups() + ray / LANES;
        self.time
            .get(group)
            .map_or(0.0, |t| t.as_array()[ray % LANES])
    }
}

const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// Hashes `x` so that every bit of the result depends on every bit of `x` (the finaliser of
/// SplitMix64; Steele, Lea, Flood 2014).
pub(crate) fn mix(x: u64) -> u64 {
    let x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

/// The upper 24 of 32 bits as a number in [0, 1).
fn unit(bits: u64) -> f32 {
    (bits as u32 >> 8) as f32 * (1.0 / (1 << 24) as f32)
}

/// A permutation of 0..n without a table: an invertible hash on the next power of two, iterated
/// until its value is in range.
struct Permutation {
    n: u32,
    mask: u32,
    keys: [u32; 4],
}

impl Permutation {
    fn new(n: u32, key: u64) -> Self {
        let (a, b) = (mix(key ^ 0x5bd1), mix(key ^ 0xe995));
        Permutation {
            n,
            mask: n.next_power_of_two() - 1,
            keys: [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32],
        }
    }

    fn at(&self, i: u32) -> u32 {
        let half = (self.mask.count_ones() / 2).max(1);
        let mut i = i;
        loop {
            for key in self.keys {
                // Each step is invertible: an odd factor, an addition, a shift to the right.
                i = i.wrapping_mul(key | 1).wrapping_add(key >> 7) & self.mask;
                i ^= i >> half;
            }
            if i < self.n {
                return i;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rays(pattern: &Pattern, x: i32, y: i32) -> Vec<([f32; 2], f32)> {
        let mut samples = Samples::default();
        pattern.fill(x..x + 1, y..y + 1, &mut samples);
        (0..pattern.count())
            .map(|i| (samples.place(0, i), samples.moment(0, i)))
            .collect()
    }

    #[test]
    fn every_cell_and_every_interval_of_the_shutter_gets_one_ray() {
        for n in [1, 2, 3, 4, 7, 16, 64, 100, 255, 256, 4096] {
            let pattern = Pattern::new(n, 3, true);
            assert_eq!(pattern.count(), n as usize);
            let area: f32 = pattern.cells.iter().map(|c| c[2] * c[3]).sum();
            assert!((area - 1.0).abs() < 1e-4, "{n}: {area}");
            let rays = rays(&pattern, -5, 1 << 19);
            for cell in &pattern.cells {
                let inside =
                    |p: &[f32; 2]| (0..2).all(|a| (0.0..=cell[2 + a]).contains(&(p[a] - cell[a])));
                assert!(rays.iter().any(|(p, _)| inside(p)), "{n}: {cell:?}");
            }
            for (i, (p, t)) in rays.iter().enumerate() {
                assert_eq!((t * n as f32) as usize, i);
                assert!(p.iter().all(|p| (-0.5..0.5).contains(p)));
            }
        }
    }

    #[test]
    fn no_time_is_rounded_into_the_interval_of_the_next_ray() {
        // Late in the shutter, an f32 has few digits left for the position inside an interval, so
        // in some pixel a time rounds very close to the next interval.
        let pattern = Pattern::new(4096, 1, true);
        let mut samples = Samples::default();
        for row in 0..16 {
            pattern.fill(0..256, row..row + 1, &mut samples);
            for pixel in 0..256 {
                for ray in 2048..4096 {
                    let moment = f64::from(samples.moment(pixel, ray));
                    assert_eq!(
                        (moment * 4096.0) as usize,
                        ray,
                        "pixel {pixel} of row {row}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_pixel_has_the_same_rays_in_every_run_and_differs_from_its_neighbours() {
        let pattern = Pattern::new(16, 1, true);
        let mut samples = Samples::default();
        pattern.fill(10..13, 20..22, &mut samples);
        let alone = rays(&pattern, 11, 21);
        for (i, ray) in alone.iter().enumerate() {
            assert_eq!((samples.place(4, i), samples.moment(4, i)), *ray);
        }
        assert_ne!(alone, rays(&pattern, 12, 21));
        assert_ne!(alone, rays(&Pattern::new(16, 2, true), 11, 21));
    }

    #[test]
    fn rays_are_uniformly_distributed_over_many_pixels() {
        // With one ray per pixel, the mean of its position over many pixels is the centre, and its
        // variance that of a uniform distribution.
        let pattern = Pattern::new(1, 9, true);
        let mut samples = Samples::default();
        pattern.fill(0..200, 0..200, &mut samples);
        for axis in 0..2 {
            let at = |p: usize| f64::from(samples.place(p, 0)[axis]);
            let mean = (0..40000).map(at).sum::<f64>() / 40000.0;
            let square = (0..40000).map(|p| at(p).powi(2)).sum::<f64>() / 40000.0;
            assert!(
                mean.abs() < 0.01 && (square - 1.0 / 12.0).abs() < 0.002,
                "{mean} {square}"
            );
        }
    }
}
