//! One visibility function as samples of a deep image.
//!
//! Steps become thin samples. A ramp is linear, a sample with thickness exponential: ramps are cut into as many pieces as the
//! tolerance asks for, each as long as it allows. Each opacity is chosen from what the samples before it, as rounded, have let
//! through, so rounding errors do not add up. What comes out is evaluated exactly, as its reader will.

use deepshadow::{Ray, Reference, Visibility, deviation};
use deepshadow_exr::f16;

/// One sample, as it will be written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Depth of its front.
    pub z: f32,
    /// Depth of its back; `z` for a surface.
    pub z_back: f32,
    /// Opacity of each channel, exact in the type that is written.
    pub opacity: [f32; 3],
}

/// Makes samples of functions.
#[derive(Clone, Debug)]
pub struct Fitter {
    tolerance: f64,
    half: bool,
    /// What the current attempt allows a piece of a ramp.
    slack: f64,
    channels: usize,
    /// What the samples so far let through.
    left: [f64; 3],
    samples: Vec<Sample>,
    ray: Ray,
}

impl Fitter {
    /// A fitter whose samples stand for functions within `tolerance`; opacities are halves if `half`, else f32.
    pub fn new(tolerance: f64, half: bool) -> Self {
        Fitter {
            tolerance,
            half,
            slack: tolerance,
            channels: 1,
            left: [1.0; 3],
            samples: Vec::new(),
            ray: Ray::new(),
        }
    }

    /// The samples that stand for `f`, front to back.
    ///
    /// # Errors
    /// The smallest error that could be had, if it is above the tolerance.
    pub fn fit(&mut self, f: &Visibility) -> Result<&[Sample], f64> {
        let mut least = f64::INFINITY;
        // The second and third share less of the tolerance between chords, so more is left for rounding.
        for share in [0.9, 0.6, 0.3, 0.1] {
            self.slack = self.tolerance * share;
            self.attempt(f);
            let error = self.error(f);
            if error <= self.tolerance {
                return Ok(&self.samples);
            }
            least = least.min(error);
        }
        Err(least)
    }

    /// The error of the samples, evaluated exactly.
    fn error(&mut self, f: &Visibility) -> f64 {
        self.ray.clear();
        for s in &self.samples {
            let added = match f.channels() {
                1 => self.ray.thick(s.z, s.z_back, s.opacity[0]),
                _ => self.ray.thick(s.z, s.z_back, s.opacity),
            };
            if added.is_err() {
                return f64::INFINITY;
            }
        }
        deviation(Reference::Ray(&self.ray), f).error
    }

    fn attempt(&mut self, f: &Visibility) {
        self.samples.clear();
        self.left = [1.0; 3];
        self.channels = f.channels();
        let (z, c) = (f.depths(), f.channels());
        let value = |i: usize| -> [f64; 3] {
            std::array::from_fn(|k| f64::from(f.values()[i * c + k % c]))
        };
        for i in 0..z.len() {
            if i == 0 || z[i] == z[i - 1] {
                self.step(z[i], value(i));
            } else if value(i) != value(i - 1) {
                self.ramp([z[i - 1], z[i]], [value(i - 1), value(i)]);
            }
        }
    }

    /// A surface at `z`, behind which the function is `target`.
    fn step(&mut self, z: f32, target: [f64; 3]) {
        let opacity = self.opacities(target);
        self.push(z, z, opacity);
    }

    /// From `v[0]` at `z[0]` linearly down to `v[1]` at `z[1]`.
    fn ramp(&mut self, z: [f32; 2], v: [[f64; 3]; 2]) {
        let mut front = z[0];
        while front < z[1] {
            let back = self.reach(front, z, v);
            let opacity = self.opacities(self.piece_end(back, z, v));
            self.push(front, back, opacity);
            front = back;
        }
        if (0..self.channels).any(|c| v[1][c] == 0.0 && self.left[c] > 0.0) {
            self.step(z[1], v[1]);
        }
    }

    /// What the piece up to `back` leaves: the line there, but at the end of a ramp to 0, which no exponential reaches, as much as
    /// the tolerance allows.
    fn piece_end(&self, back: f32, z: [f32; 2], v: [[f64; 3]; 2]) -> [f64; 3] {
        std::array::from_fn(|c| {
            if back == z[1] && v[1][c] == 0.0 {
                return (0.9 * self.slack).min(0.5 * self.left[c]);
            }
            line(back, z, [v[0][c], v[1][c]])
        })
    }

    /// The farthest depth, up to the ramp's end, to which one sample can stand for it.
    fn reach(&self, front: f32, z: [f32; 2], v: [[f64; 3]; 2]) -> f32 {
        let fits = |back: f32| {
            let end = self.piece_end(back, z, v);
            (0..self.channels).all(|c| {
                let line = |depth| line(depth, z, [v[0][c], v[1][c]]);
                chord_error(
                    [line(front), line(back)],
                    [self.left[c], end[c].min(self.left[c])],
                ) <= self.slack
            })
        };
        if fits(z[1]) {
            return z[1];
        }
        // Positions in floating-point order would serve tiny ramps better than the large ones that there are.
        let (mut good, mut bad) = (front.next_up(), z[1]);
        for _ in 0..40 {
            let middle = ((f64::from(good) + f64::from(bad)) / 2.0) as f32;
            if middle <= good || middle >= bad {
                break;
            }
            match fits(middle) {
                true => good = middle,
                false => bad = middle,
            }
        }
        good.min(z[1])
    }

    /// Opacities after which as nearly `target` is left as the type allows; opaque only where the target is 0.
    fn opacities(&self, target: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            let (left, target) = (self.left[c % self.channels], target[c % self.channels]);
            if left <= 0.0 || target >= left {
                return 0.0;
            }
            if target <= 0.0 {
                return 1.0;
            }
            self.round(1.0 - target / left)
        })
    }

    /// The nearest value below 1 of the type that is written.
    fn round(&self, opacity: f64) -> f32 {
        if self.half {
            f16::from_f64(opacity).min(f16::from_bits(0x3bff)).to_f32()
        } else {
            (opacity as f32).min(1.0f32.next_down())
        }
    }

    fn push(&mut self, z: f32, z_back: f32, opacity: [f32; 3]) {
        if opacity == [0.0; 3] {
            return;
        }
        for (left, opacity) in self.left.iter_mut().zip(opacity) {
            *left *= 1.0 - f64::from(opacity);
        }
        self.samples.push(Sample { z, z_back, opacity });
    }
}

/// The line from `v[0]` at `z[0]` to `v[1]` at `z[1]`.
fn line(z: f32, ends: [f32; 2], v: [f64; 2]) -> f64 {
    let [a, b] = ends.map(f64::from);
    v[0] + (v[1] - v[0]) * ((f64::from(z) - a) / (b - a))
}

/// The largest distance of a line from an exponential, by their values at both ends.
fn chord_error(line: [f64; 2], exponential: [f64; 2]) -> f64 {
    let difference = |t: f64| {
        let e = exponential[0] * (exponential[1] / exponential[0]).powf(t);
        line[0] + (line[1] - line[0]) * t - e
    };
    let ends = (line[0] - exponential[0])
        .abs()
        .max((line[1] - exponential[1]).abs());
    if exponential[0] <= 0.0 || exponential[1] <= 0.0 || exponential[1] >= exponential[0] {
        // Nothing left, or nothing to take away: both are straight.
        return ends;
    }
    // Where both fall equally fast.
    let rate = (exponential[1] / exponential[0]).ln();
    let t = ((line[1] - line[0]) / (exponential[0] * rate)).ln() / rate;
    if t.is_finite() && t > 0.0 && t < 1.0 {
        return ends.max(difference(t).abs());
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use deepshadow::{Vertex, VertexRgb};

    fn mono(points: &[(f32, f32)]) -> Visibility {
        Visibility::mono(points.iter().map(|&(z, v)| Vertex::new(z, v)).collect()).unwrap()
    }

    #[test]
    fn steps_become_thin_samples() {
        let f = mono(&[(1.0, 0.5), (2.0, 0.5), (2.0, 0.0)]);
        let sample = |z, opacity| Sample {
            z,
            z_back: z,
            opacity: [opacity; 3],
        };
        let mut fitter = Fitter::new(0.001, true);
        assert_eq!(
            fitter.fit(&f).unwrap(),
            [sample(1.0, 0.5), sample(2.0, 1.0)]
        );
    }

    #[test]
    fn a_ramp_to_nothing_ends_in_an_opaque_thin_sample() {
        for (points, most) in [
            (vec![(1.0, 1.0), (3.0, 0.0)], 25),
            (vec![(1.0, 0.003), (3.0, 0.0)], 3),
            (vec![(1.0, 1.0), (1.0f32.next_up(), 0.0)], 3),
            (vec![(-5.0, 0.75), (-4.0, 0.25), (8.0, 0.0)], 25),
        ] {
            let f = mono(&points);
            let mut fitter = Fitter::new(0.002, true);
            let samples = fitter.fit(&f).unwrap();
            let last = samples.last().unwrap();
            assert_eq!((last.z, last.z_back), (points.last().unwrap().0, last.z));
            assert_eq!(last.opacity, [1.0; 3]);
            assert!(samples.len() <= most, "{} samples", samples.len());
        }
    }

    #[test]
    fn rounding_errors_do_not_add_up() {
        let points: Vec<_> = (0..500)
            .flat_map(|i| {
                let v = |i: i32| 1.0 - i as f32 / 600.0;
                let z = 1.0 + i as f32;
                if i == 0 {
                    vec![(z, v(1))]
                } else {
                    vec![(z, v(i)), (z, v(i + 1))]
                }
            })
            .collect();
        let f = mono(&points);
        assert!(Fitter::new(0.0005, true).fit(&f).is_ok());
        assert!(Fitter::new(1e-6, false).fit(&f).is_ok());
    }

    #[test]
    fn what_halves_cannot_say_is_an_error() {
        let f = mono(&[(1.0, 0.3)]);
        let least = Fitter::new(1e-6, true).fit(&f).unwrap_err();
        assert!(least > 1e-6 && least < 1e-3, "{least}");
    }

    #[test]
    fn colours_go_dark_one_by_one() {
        let f = Visibility::rgb(vec![
            VertexRgb::new(1.0, [1.0, 0.5, 1.0]),
            VertexRgb::new(2.0, [0.0, 0.25, 0.75]),
            VertexRgb::new(2.0, [0.0, 0.25, 0.5]),
            VertexRgb::new(4.0, [0.0, 0.0, 0.5]),
        ])
        .unwrap();
        let mut fitter = Fitter::new(0.002, true);
        fitter.fit(&f).unwrap();
        assert_eq!(fitter.left[..2], [0.0, 0.0]);
        assert!((fitter.left[2] - 0.5).abs() < 0.001);
    }
}
