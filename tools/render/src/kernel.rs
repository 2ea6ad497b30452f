//! Jittered places over the footprint of a filter, and moments of the shutter that go with them.

use deepshadow::Filter;
use deepshadow_scene::samples::{Pattern, Samples};

/// Entries of the table that turns even places into those of a filter.
const STEPS: usize = 1024;

/// As many places for each footprint, spread as the weights of a filter: each counts the same.
#[derive(Clone, Debug)]
pub struct Kernel {
    pattern: Pattern,
    /// Where the kernel holds k / STEPS of its weight, in widths.
    places: Vec<f32>,
}

impl Kernel {
    /// `n` places a footprint. `None` for a filter with negative weights.
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

    /// Places in each footprint.
    pub fn count(&self) -> usize {
        self.pattern.count()
    }

    /// Calls `each` with the places of footprint number `key`, in widths from its middle, and their moments from 0 to 1.
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

/// The inverse of the integral of a filter's weight.
fn inverse(filter: Filter) -> Vec<f32> {
    const FINE: usize = 1 << 14;
    let radius = f64::from(filter.radius());
    let place = |i: usize| radius * (2.0 * i as f64 / FINE as f64 - 1.0);
    // By the middles of short pieces.
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
    fn places_are_spread_as_the_weights_of_the_filter() {
        // Variance of a box of width 1, of a triangle of two; of a bell that ends at two a little less than a quarter.
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
    fn a_filter_with_negative_weights_has_no_places() {
        assert!(Kernel::new(16, Filter::CatmullRom, 1).is_none());
    }
}
