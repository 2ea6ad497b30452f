//! Visibility by walking uncompressed deep samples in memory, as a renderer does that keeps a deep
//! image.

use deepshadow::Curve;

use crate::queries::Queries;

/// Deep samples of all pixels of a square, flat: depth, opacity and the transmittance behind each.
#[derive(Debug)]
pub struct Samples {
    side: usize,
    start: Vec<u32>,
    z: Vec<f32>,
    alpha: Vec<f32>,
    behind: Vec<f32>,
}

impl Samples {
    /// The steps of exact functions as samples of some opacity.
    pub fn of(side: u32, curves: &[Curve]) -> Self {
        let mut out = Samples {
            side: side as usize,
            start: vec![0],
            z: Vec::new(),
            alpha: Vec::new(),
            behind: Vec::new(),
        };
        for curve in curves {
            let mut front = 1.0;
            for &z in curve.depths() {
                let after = curve.visibility_behind(z);
                if after < front {
                    out.z.push(z);
                    out.alpha.push((1.0 - after / front) as f32);
                    out.behind.push(after as f32);
                    front = after;
                }
            }
            out.start.push(out.z.len() as u32);
        }
        out
    }

    /// Samples a pixel, on average.
    pub fn average(&self) -> f64 {
        self.z.len() as f64 / (self.start.len() - 1) as f64
    }

    /// Bytes with depth and opacity, as the image has them.
    pub fn bytes(&self) -> usize {
        4 * self.start.len() + 8 * self.z.len()
    }

    #[inline(always)]
    fn range(&self, x: usize, y: usize) -> std::ops::Range<usize> {
        let pixel = y * self.side + x;
        self.start[pixel] as usize..self.start[pixel + 1] as usize
    }

    /// Product of what the samples in front of `z` let through, one after the other.
    #[inline(always)]
    pub fn linear(&self, x: usize, y: usize, z: f32) -> f32 {
        let range = self.range(x, y);
        let mut light = 1.0;
        for (depth, alpha) in self.z[range.clone()].iter().zip(&self.alpha[range]) {
            if *depth >= z {
                break;
            }
            light *= 1.0 - alpha;
        }
        light
    }

    /// Transmittance that was summed up before, behind the last sample in front of `z`.
    #[inline(always)]
    pub fn searched(&self, x: usize, y: usize, z: f32) -> f32 {
        let range = self.range(x, y);
        match self.z[range.clone()].partition_point(|&d| d < z) {
            0 => 1.0,
            n => self.behind[range][n - 1],
        }
    }

    /// Sum of one-pixel lookups.
    pub fn sum(&self, queries: &Queries, at: impl Fn(&Self, usize, usize, f32) -> f32) -> f32 {
        let one = |(x, y, z): (f32, f32, f32)| at(self, x as usize, y as usize, z);
        queries.iter().map(one).sum()
    }

    /// Sum of 2 x 2 bilinear lookups, queries at least half a pixel from the border.
    pub fn sum_bilinear(
        &self,
        queries: &Queries,
        at: impl Fn(&Self, usize, usize, f32) -> f32,
    ) -> f32 {
        let one = |(x, y, z): (f32, f32, f32)| {
            let (x, y) = (x - 0.5, y - 0.5);
            let (i, j) = (x as usize, y as usize);
            let (u, v) = (x - i as f32, y - j as f32);
            let row = |j| at(self, i, j, z) * (1.0 - u) + at(self, i + 1, j, z) * u;
            row(j) * (1.0 - v) + row(j + 1) * v
        };
        queries.iter().map(one).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Hair;

    #[test]
    fn walking_and_searching_give_what_the_exact_functions_give() {
        let curves = Hair::new(16, 4).curves(8);
        let samples = Samples::of(16, &curves);
        for (i, curve) in curves.iter().enumerate() {
            for z in [4.0, 5.5, 7.25, 9.0, 10.0, 11.0] {
                let exact = curve.visibility(z) as f32;
                assert!((samples.linear(i % 16, i / 16, z) - exact).abs() < 1e-5);
                assert!((samples.searched(i % 16, i / 16, z) - exact).abs() < 1e-6);
            }
        }
    }
}
