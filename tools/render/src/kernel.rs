//! Jittered offsets over the footprint of a filter, with times within the shutter interval.

use deepshadow::Filter;
use deepshadow_scene::samples::{Pattern, Samples};

/// Intervals of the table that maps uniform offsets to offsets distributed like a filter.
const STEPS: usize = 1024;

/// Offsets of equal weight for each footprint, distributed like the weights of a filter.
#[derive(Clone, Debug)]
pub struct Kernel {
    pattern: Pattern,
    /// Offset in widths below which the filter has k / STEPS of its weight, for each k.
    places: Vec<f32>,
}

impl Kernel {
    /// `n` offsets per footprint. `None` for a filter with negative weights.
    pub fn new(n: u32, filter: Filter, seed: u64) -> Option<Self> {
        let places = match filter {
            Filter::CatmullRom => return None,
            Filter::Nearest => vec![0.0; STEPS + 1],
            _ => inverse(filter),
        };
        Some(Kernel {
            pattern: Pattern::new(n, seed, true),
            places,
        })
    }

    /// Number of offsets per footprint.
    pub fn count(&self) -> usize {
        self.pattern.count()
    }

    /// Calls `each` with the offsets of footprint `key`, in widths from its middle, and a time
    /// from 0 to 1 for each.
    pub fn places(&self, key: u64, samples: &mut Samples, mut each: impl FnMut([f64; 2], f64)) {
        let [x, y] = [key as u32, (key >> 32) as u32].map(|k| k as i32 >> 1);
        self.pattern.fill(x..x + 1, y..y + 1, samples);
        for i in 0..self.count() {
            let [a, b] = samples.place(0, i);
            each([self.warp(a), self.warp(b)], samples.moment(0, i).into());
        }
    }

    fn warp(&self, even: f32) -> f64 {
        let at = (even + 0.5).clamp(0.0, 1.0) * STEPS as f32;
        let low = (at as usize).min(STEPS - 1);
        let (a, b) = (self.places[low], self.places[low + 1]);
        f64::from(a + (b - a) * (at - low as f32))
    }
}

/// Tabulates the inverse of the cumulative weight of a filter.
fn inverse(filter: Filter) -> Vec<f32> {
    const FINE: usize = 1 << 14;
    let radius = f64::from(filter.radius());
    let place = |i: usize| radius * (2.0 * i as f64 / FINE as f64 - 1.0);
    // Integrate by the midpoint rule.
    let mut sums = vec![0.0];
    for i in 0..FINE {
        let middle = (place(i) + place(i + 1)) / 2.0;
        sums.push(sums[i] + f64::from(filter.weight(middle as f32)));
    }
    let all = sums[FINE];
    let mut i = 0;
    let steps = (0..=STEPS).map(|k| {
        let want = all * k as f64 / STEPS as f64;
        while i + 2 < sums.len() && sums[i + 1] < want {
            i += 1;
        }
        let part = ((want - sums[i]) / (sums[i + 1] - sums[i])).clamp(0.0, 1.0);
        (place(i) + (place(i + 1) - place(i)) * part) as f32
    });
    steps.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(filter: Filter) -> (f64, f64, f64) {
        let kernel = Kernel::new(256, filter, 1).unwrap();
        let (mut n, mut mean, mut square, mut most) = (0.0, 0.0, 0.0, 0.0f64);
        for key in 0..64 {
            kernel.places(key * 7919, &mut Samples::default(), |[x, y], _| {
                for v in [x, y] {
                    (n, mean, square) = (n + 1.0, mean + v, square + v * v);
                    most = most.max(v.abs());
                }
            });
        }
        (mean / n, square / n, most)
    }

    #[test]
    fn offsets_are_distributed_like_the_weights_of_the_filter() {
        // Variances: 1/12 for a box of width 1, 1/6 for a triangle of width 2, and slightly less
        // than 1/4 for the Gaussian truncated at 2.
        for (filter, variance) in [
            (Filter::Box, 1.0 / 12.0),
            (Filter::Triangle, 1.0 / 6.0),
            (Filter::Gaussian, 0.2495),
        ] {
            let (mean, square, most) = moments(filter);
            assert!(mean.abs() < 0.002, "{filter:?}: {mean}");
            assert!(
                (square / variance - 1.0).abs() < 0.01,
                "{filter:?}: {square}"
            );
            assert!(most <= filter.radius().into());
        }
        assert_eq!(moments(Filter::Nearest).2, 0.0);
    }

    #[test]
    fn a_filter_with_negative_weights_has_no_kernel() {
        assert!(Kernel::new(16, Filter::CatmullRom, 1).is_none());
    }
}
