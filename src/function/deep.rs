//! Converts a visibility function to samples of a deep image.
//!
//! A step becomes a thin sample. A ramp is linear but a thick sample is exponential, so each ramp
//! becomes several samples, each as long as the tolerance allows. Each opacity is computed from the
//! light that the previous, rounded samples let through, so rounding errors do not add up. Finally
//! the samples are evaluated exactly, as a reader does, and compared with the function.

use super::{FunctionRef, Ray};
use crate::{Error, Result};

/// A sample of a deep image: absorbs light from its front to its back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DeepSample {
    /// Depth of its front.
    pub depth: f32,
    /// Depth of its back; `depth` for a surface.
    pub depth_back: f32,
    /// Opacity of each channel, 0 to 1.
    pub opacity: [f32; 3],
}

impl FunctionRef<'_> {
    /// Samples of a deep image, front to back, that reproduce the function within `tolerance`.
    ///
    /// Readers must treat a thick sample as exponential, as [`Ray::thick`] does. `round` returns
    /// the nearest opacity below 1 that the image can hold; for images of f32 pass `|o| o as f32`.
    /// Cost: up to four evaluations of [`Ray::deviation`].
    ///
    /// # Errors
    /// `Input` if `round` is too coarse for the tolerance. The message holds the smallest deviation
    /// that was reached.
    ///
    /// ```
    /// use deepshadow::{Vertex, Visibility};
    /// let pane_and_fog = Visibility::mono(vec![
    ///     Vertex::new(1.0, 0.5),
    ///     Vertex::new(2.0, 0.5),
    ///     Vertex::new(3.0, 0.25),
    /// ])?;
    /// let samples = pane_and_fog.function().deep_samples(0.03, |opacity| opacity as f32)?;
    /// assert_eq!(samples.len(), 2); // the pane, and one for the fog
    /// assert_eq!((samples[0].depth, samples[0].opacity[0]), (1.0, 0.5));
    /// assert_eq!((samples[1].depth, samples[1].depth_back), (2.0, 3.0));
    /// # Ok::<(), deepshadow::Error>(())
    /// ```
    pub fn deep_samples(
        self,
        tolerance: f64,
        round: impl Fn(f64) -> f32,
    ) -> Result<Vec<DeepSample>> {
        let mut least = f64::INFINITY;
        // The smaller the chords' share of the tolerance, the more is left for rounding.
        for share in [0.9, 0.6, 0.3, 0.1] {
            let mut fit = Fit {
                slack: tolerance * share,
                round: &round,
                channels: self.channels(),
                left: [1.0; 3],
                samples: Vec::new(),
                ray: Ray::new(),
            };
            fit.add_all(self)?;
            let error = fit.ray.deviation(self).error;
            if error <= tolerance {
                return Ok(fit.samples);
            }
            least = least.min(error);
        }
        Err(Error::input(format!(
            "samples come within {least:.3e} of the function, not {tolerance:e}"
        )))
    }
}

/// The samples of one function so far, and a ray through them.
struct Fit<'a, R> {
    /// The largest error of a piece of a ramp.
    slack: f64,
    round: &'a R,
    channels: usize,
    /// Light that the samples so far let through.
    left: [f64; 3],
    samples: Vec<DeepSample>,
    ray: Ray,
}

impl<R: Fn(f64) -> f32> Fit<'_, R> {
    fn add_all(&mut self, f: FunctionRef<'_>) -> Result<()> {
        let z = f.depths();
        let value = |i: usize| -> [f64; 3] { std::array::from_fn(|c| f.value(i, c)) };
        for i in 0..z.len() {
            if i == 0 || z[i] == z[i - 1] {
                self.step(z[i], value(i))?;
            } else if value(i) != value(i - 1) {
                self.ramp([z[i - 1], z[i]], [value(i - 1), value(i)])?;
            }
        }
        Ok(())
    }

    /// Adds a surface at `z`. The function is `target` just behind it.
    fn step(&mut self, z: f32, target: [f64; 3]) -> Result<()> {
        let opacity = self.opacities(target);
        self.push(z, z, opacity)
    }

    /// Adds samples for a ramp that falls linearly from `v[0]` at `z[0]` to `v[1]` at `z[1]`.
    fn ramp(&mut self, z: [f32; 2], v: [[f64; 3]; 2]) -> Result<()> {
        let mut front = z[0];
        while front < z[1] {
            let back = self.reach(front, z, v);
            let opacity = self.opacities(self.piece_end(back, z, v));
            self.push(front, back, opacity)?;
            front = back;
        }
        if (0..self.channels).any(|c| v[1][c] == 0.0 && self.left[c] > 0.0) {
            self.step(z[1], v[1])?;
        }
        Ok(())
    }

    /// Target value of a piece of the ramp at its end `back`: the value of the ramp.
    ///
    /// No exponential reaches 0. At the end of a ramp to 0 the target is therefore the largest
    /// value that the tolerance allows.
    fn piece_end(&self, back: f32, z: [f32; 2], v: [[f64; 3]; 2]) -> [f64; 3] {
        std::array::from_fn(|c| {
            if back == z[1] && v[1][c] == 0.0 {
                return (0.9 * self.slack).min(0.5 * self.left[c]);
            }
            line(back, z, [v[0][c], v[1][c]])
        })
    }

    /// The farthest depth, up to the ramp's end, to which one sample from `front` fits the ramp.
    fn reach(&self, front: f32, z: [f32; 2], v: [[f64; 3]; 2]) -> f32 {
        let fits = |back: f32| {
            let end = self.piece_end(back, z, v);
            (0..self.channels).all(|c| {
                let line = |depth| line(depth, z, [v[0][c], v[1][c]]);
                let exponential = [self.left[c], end[c].min(self.left[c])];
                chord_error([line(front), line(back)], exponential) <= self.slack
            })
        };
        if fits(z[1]) {
            return z[1];
        }
        // Bisects the depth itself. Bisecting the order of the floats would favour tiny ramps.
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

    /// Storable opacities that bring the light as near to `target` as possible. A channel is opaque
    /// only for a target of 0.
    fn opacities(&self, target: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            let (left, target) = (self.left[c % self.channels], target[c]);
            if left <= 0.0 || target >= left {
                0.0
            } else if target <= 0.0 {
                1.0
            } else {
                (self.round)(1.0 - target / left).min(1.0f32.next_down())
            }
        })
    }

    fn push(&mut self, depth: f32, depth_back: f32, opacity: [f32; 3]) -> Result<()> {
        if opacity == [0.0; 3] {
            return Ok(());
        }
        for (left, opacity) in self.left.iter_mut().zip(opacity) {
            *left *= 1.0 - f64::from(opacity);
        }
        self.samples.push(DeepSample {
            depth,
            depth_back,
            opacity,
        });
        self.ray.thick(depth, depth_back, opacity)
    }
}

/// Value at `z` on the line from `v[0]` at `ends[0]` to `v[1]` at `ends[1]`.
fn line(z: f32, ends: [f32; 2], v: [f64; 2]) -> f64 {
    let [a, b] = ends.map(f64::from);
    v[0] + (v[1] - v[0]) * ((f64::from(z) - a) / (b - a))
}

/// The largest distance between a line and an exponential, given their values at both ends.
fn chord_error(line: [f64; 2], exponential: [f64; 2]) -> f64 {
    let [first, last] = exponential;
    let ends = (line[0] - first).abs().max((line[1] - last).abs());
    if first <= 0.0 || last <= 0.0 || last >= first {
        // No light is left, or none is absorbed: both are straight.
        return ends;
    }
    // The distance is largest where both fall equally fast.
    let rate = (last / first).ln();
    let t = ((line[1] - line[0]) / (first * rate)).ln() / rate;
    if !(t.is_finite() && t > 0.0 && t < 1.0) {
        return ends;
    }
    let difference = line[0] + (line[1] - line[0]) * t - first * (last / first).powf(t);
    ends.max(difference.abs())
}
