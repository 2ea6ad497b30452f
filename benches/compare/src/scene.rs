//! Scenes whose filtered visibility is known: hair as strands over a wall, and smooth smoke.
//!
//! Coordinates are those of the deep map: one unit is one of its pixels.

use deepshadow::{Curve, Ray, Sweep};
use rayon::prelude::*;

/// Depth of the nearest and of the farthest thing.
pub const DEPTHS: (f32, f32) = (4.0, 10.0);

/// A small generator: the same scene in every run.
#[derive(Clone, Debug)]
pub struct Dice(u64);

impl Dice {
    /// Starts at `seed`.
    pub fn new(seed: u64) -> Self {
        Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x5851_F42D_4C95_7F2D)
    }

    /// 64 random bits (splitmix64).
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `from..to`.
    pub fn range(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * ((self.bits() >> 11) as f64 / (1u64 << 53) as f64)
    }
}

/// An opaque strand that hangs down: at height y its middle is a parabola in y, its depth a line.
#[derive(Clone, Copy, Debug)]
struct Strand {
    top: f64,
    bottom: f64,
    x: f64,
    slant: f64,
    bend: f64,
    half_width: f64,
    z: f64,
    slope: f64,
}

impl Strand {
    /// Left end, right end and depth at height `y`, which must lie between top and bottom.
    #[inline]
    fn at(&self, y: f64) -> (f64, f64, f32) {
        let t = y - self.top;
        let middle = self.x + t * (self.slant + t * self.bend);
        let z = (self.z + self.slope * t) as f32;
        (middle - self.half_width, middle + self.half_width, z)
    }
}

/// Opaque strands in front of an opaque wall at depth 10.
#[derive(Debug)]
pub struct Hair {
    /// Side of the map in pixels.
    pub side: u32,
    strands: Vec<Strand>,
    /// Strands that reach into each row of pixels.
    rows: Vec<Vec<u32>>,
}

impl Hair {
    /// Hair over `side` x `side` pixels: on average two strands in front of each other, each a
    /// seventh of a pixel wide, in tufts.
    pub fn new(side: u32, seed: u64) -> Self {
        let (mut dice, unit) = (Dice::new(seed), f64::from(side));
        let length = 24.0;
        let wanted = 14.0 * unit * (unit + length) / length;
        let mut strands = Vec::new();
        while strands.len() < wanted as usize {
            let (x, top) = (dice.range(-4.0, unit + 4.0), dice.range(-length, unit));
            let tuft = (0.31 * x).sin() * (0.17 * top + 0.05 * x).cos();
            if dice.range(-1.2, 1.0) > tuft {
                continue;
            }
            let deep = dice.range(0.5, 1.5) * length;
            strands.push(Strand {
                top,
                bottom: top + deep,
                x,
                slant: dice.range(-0.4, 0.4),
                bend: dice.range(-0.01, 0.01),
                half_width: dice.range(0.05, 0.09),
                z: dice.range(4.5, 8.5),
                slope: dice.range(-0.5, 0.5) / deep,
            });
        }
        let mut rows = vec![Vec::new(); side as usize];
        for (i, s) in strands.iter().enumerate() {
            let last = (s.bottom.floor() as i64).min(i64::from(side) - 1);
            for row in (s.top.floor() as i64).max(0)..=last {
                rows[row as usize].push(i as u32);
            }
        }
        Hair {
            side,
            strands,
            rows,
        }
    }

    /// One row of a depth buffer with `n` samples a pixel in each direction: depths at the rows'
    /// and columns' middles.
    fn render_row(&self, n: u32, row: u32, out: &mut [f32]) {
        out.fill(DEPTHS.1);
        let scale = f64::from(n);
        let y = (f64::from(row) + 0.5) / scale;
        for &i in &self.rows[(row / n) as usize] {
            let strand = &self.strands[i as usize];
            if y < strand.top || y >= strand.bottom {
                continue;
            }
            let (left, right, z) = strand.at(y);
            // Columns whose middle lies in left..right.
            let from = (left * scale - 0.5).ceil().max(0.0) as usize;
            let to = ((right * scale - 0.5).ceil().max(0.0) as usize).min(out.len());
            for cell in out.iter_mut().take(to).skip(from) {
                *cell = cell.min(z);
            }
        }
    }

    /// A depth buffer of `side * n` x `side * n` samples, row by row, `stride` apart.
    pub fn render(&self, n: u32, stride: usize) -> Vec<f32> {
        let grid = (self.side * n) as usize;
        let mut out = vec![0.0; grid * stride];
        out.par_chunks_mut(stride)
            .enumerate()
            .for_each(|(row, cells)| self.render_row(n, row as u32, &mut cells[..grid]));
        out
    }

    /// The exact functions of all pixels from `n` x `n` samples each, row by row.
    pub fn curves(&self, n: u32) -> Vec<Curve> {
        let rows: Vec<Vec<Curve>> = (0..self.side)
            .into_par_iter()
            .map(|y| self.curves_of_row(n, y))
            .collect();
        rows.into_iter().flatten().collect()
    }

    fn curves_of_row(&self, n: u32, y: u32) -> Vec<Curve> {
        let grid = (self.side * n) as usize;
        let mut band = vec![0.0; grid * n as usize];
        for (j, cells) in band.chunks_mut(grid).enumerate() {
            self.render_row(n, y * n + j as u32, cells);
        }
        let (mut sweep, mut ray) = (Sweep::new(), Ray::new());
        let pixels = 0..self.side as usize;
        pixels
            .map(|x| {
                sweep.clear();
                for cells in band.chunks(grid) {
                    for &z in &cells[x * n as usize..][..n as usize] {
                        ray.clear();
                        ray.surface(z, 1.0).expect("a finite depth");
                        sweep.add_ray(&ray, 1e-4, 1.0).expect("a weight of one");
                    }
                }
                let mut curve = Curve::lit(1);
                sweep.finish(&mut curve).expect("a positive weight");
                curve
            })
            .collect()
    }

    /// Fraction of the box of one pixel's size around (x, y) that light passes to depth `z`: exact
    /// along x, on 256 lines along y. This is what every filter of one pixel estimates.
    pub fn coverage(&self, x: f64, y: f64, z: f32) -> f64 {
        const LINES: u32 = 256;
        let (left, right, top) = (x - 0.5, x + 0.5, y - 0.5);
        if z > DEPTHS.1 {
            return 0.0;
        }
        let rows = self.rows.len() as i64 - 1;
        let (first, last) = (top.floor() as i64, (top + 1.0).floor() as i64);
        let mut near: Vec<u32> = (first..=last)
            .flat_map(|row| &self.rows[row.clamp(0, rows) as usize])
            .copied()
            .collect();
        near.sort_unstable();
        near.dedup();
        let (mut open, mut hidden) = (0.0, Vec::new());
        for line in 0..LINES {
            let y = top + (f64::from(line) + 0.5) / f64::from(LINES);
            hidden.clear();
            for &i in &near {
                let strand = &self.strands[i as usize];
                if y < strand.top || y >= strand.bottom {
                    continue;
                }
                let (from, to, depth) = strand.at(y);
                if depth < z && to > left && from < right {
                    hidden.push((from.max(left), to.min(right)));
                }
            }
            hidden.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (mut end, mut lit) = (left, 0.0);
            for &(from, to) in &hidden {
                lit += (from - end).max(0.0);
                end = end.max(to);
            }
            open += lit + (right - end);
        }
        open / f64::from(LINES)
    }
}

/// Smoke whose density waves over `side` x `side` pixels, `n` x `n` rays a pixel.
pub fn smoke(side: u32, n: u32) -> Vec<Curve> {
    let rows: Vec<Vec<Curve>> = (0..side)
        .into_par_iter()
        .map(|y| (0..side).map(|x| smoke_pixel(side, n, x, y)).collect())
        .collect();
    rows.into_iter().flatten().collect()
}

fn smoke_pixel(side: u32, n: u32, x: u32, y: u32) -> Curve {
    let (mut sweep, mut ray, mut samples) = (Sweep::new(), Ray::new(), Vec::new());
    for k in 0..n * n {
        let u = (x as f32 + (0.5 + (k % n) as f32) / n as f32) / side as f32;
        let v = (y as f32 + (0.5 + (k / n) as f32) / n as f32) / side as f32;
        let density = (0.6 + 0.4 * (9.0 * u).sin() * (7.0 * v + 2.0 * u).cos())
            * (1.0 - (u - 0.5).hypot(v - 0.5) * 1.2);
        samples.clear();
        samples.extend((0..24).map(|i| {
            let z = 4.0 + 0.2 * i as f32 + 0.1 * (5.0 * u + 3.0 * v).sin().abs();
            (z, density * (0.4 * i as f32).sin().abs())
        }));
        ray.clear();
        ray.medium(&samples, 1.0).expect("densities of smoke");
        sweep.add_ray(&ray, 1e-3, 1.0).expect("a weight of one");
    }
    let mut curve = Curve::lit(1);
    sweep.finish(&mut curve).expect("a positive weight");
    curve
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coverage_is_what_many_samples_average_to() {
        let hair = Hair::new(8, 3);
        let curves = hair.curves(64);
        for (i, z) in [(9, 5.0), (20, 7.0), (35, 8.5), (50, 9.5)] {
            let exact = hair.coverage((i % 8) as f64 + 0.5, (i / 8) as f64 + 0.5, z);
            let sampled = curves[i].visibility(z);
            assert!((exact - sampled).abs() < 0.01, "{exact} and {sampled}");
        }
    }

    #[test]
    fn behind_the_wall_it_is_dark() {
        let hair = Hair::new(4, 1);
        assert_eq!(hair.coverage(2.0, 2.0, 10.5), 0.0);
        assert_eq!(hair.curves(4)[5].visibility_behind(10.0), 0.0);
    }
}
