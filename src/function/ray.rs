//! The transmittance function of one ray: surfaces, thick samples and media (LV00, sections 3.1 and
//! 3.2).

mod flatten;

use super::Curve;
use crate::error::Place;
use crate::{Error, Result};

/// One number for all channels (`f32`), or one each for red, green and blue (`[f32; 3]`).
pub trait Channels: Copy {
    /// The numbers for red, green and blue.
    fn to_rgb(self) -> [f32; 3];
}

impl Channels for f32 {
    fn to_rgb(self) -> [f32; 3] {
        [self; 3]
    }
}

impl Channels for [f32; 3] {
    fn to_rgb(self) -> [f32; 3] {
        self
    }
}

/// A surface hit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub z: f32,
    pub opacity: [f32; 3],
}

/// A thick sample: exponential from `front` to `back`. No channel is opaque.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Thick {
    pub front: f32,
    pub back: f32,
    pub opacity: [f32; 3],
}

/// A stretch of a medium. The extinction per unit of *depth* is linear from `front` to `back`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch {
    pub front: f32,
    pub back: f32,
    pub kappa: [[f64; 3]; 2],
}

/// The transmittance function of one ray: the fraction of light that reaches each depth.
///
/// A ray takes surfaces, thick samples (deep images) and media (extinction samples) in any order.
/// Their transmittances multiply, also where they overlap. The ray is monochrome until a sample has
/// different numbers for red, green and blue. [`Ray::visibility`] is exact. [`Ray::flatten`] makes
/// the piecewise linear [`Curve`] that pixels are summed from. LV00, sections 3.1 and 3.2.
///
/// ```
/// use deepshadow::{Curve, Ray};
/// let mut ray = Ray::new();
/// ray.surface(2.0, 0.5).unwrap();
/// ray.thick(4.0, 6.0, 0.75).unwrap(); // exponential: half of it absorbs half of the light
/// assert_eq!((ray.visibility(2.0), ray.visibility_behind(2.0)), (1.0, 0.5));
/// assert_eq!((ray.visibility(5.0), ray.visibility(6.0)), (0.25, 0.125));
/// let mut curve = Curve::default();
/// ray.flatten(0.001, &mut curve);
/// assert!((curve.visibility(5.0) - 0.25).abs() <= curve.error() && curve.error() <= 0.001);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Ray {
    pub(super) surfaces: Vec<Surface>,
    pub(super) thick: Vec<Thick>,
    pub(super) media: Vec<Stretch>,
    coloured: bool,
    /// Number of surfaces and thick samples so far, transparent ones included; the place in errors.
    samples: usize,
}

impl Ray {
    /// A ray without samples.
    pub fn new() -> Self {
        Self::default()
    }

    /// Removes all samples and keeps the memory.
    pub fn clear(&mut self) {
        self.surfaces.clear();
        self.thick.clear();
        self.media.clear();
        self.coloured = false;
        self.samples = 0;
    }

    /// Number of channels: 3 if the channels of any sample differ, else 1.
    pub fn channels(&self) -> usize {
        if self.coloured { 3 } else { 1 }
    }

    /// Whether the ray has only surfaces.
    pub(crate) fn is_steps(&self) -> bool {
        self.thick.is_empty() && self.media.is_empty()
    }

    fn refuse<T>(sample: usize, what: impl Into<String>) -> Result<T> {
        Err(Error::input(what).at(Place::sample(sample)))
    }

    fn check_opacity(&self, opacity: [f32; 3]) -> Result<()> {
        match opacity.iter().find(|o| !(0.0..=1.0).contains(*o)) {
            Some(o) => Self::refuse(self.samples, format!("opacity {o} is not in 0 to 1")),
            None => Ok(()),
        }
    }

    fn push_surface(&mut self, z: f32, opacity: [f32; 3]) {
        if opacity != [0.0; 3] {
            self.coloured |= opacity != [opacity[0]; 3];
            self.surfaces.push(Surface {
                z: z + 0.0,
                opacity,
            });
        }
    }

    /// Adds a surface at depth `z` that absorbs the fraction `opacity` of the light: a step.
    ///
    /// # Errors
    /// `Input` for a depth that is not finite or an opacity outside 0 to 1. The error names the
    /// sample by the number of `surface` and `thick` calls before it. The ray stays as it was.
    pub fn surface<O: Channels>(&mut self, z: f32, opacity: O) -> Result<()> {
        let opacity = opacity.to_rgb();
        if !z.is_finite() {
            return Self::refuse(self.samples, format!("depth {z} is not finite"));
        }
        self.check_opacity(opacity)?;
        self.push_surface(z, opacity);
        self.samples += 1;
        Ok(())
    }

    /// Adds a sample of a deep image, which absorbs the fraction `opacity` of the light from
    /// `front` to `back`.
    ///
    /// The light falls exponentially with depth. A channel with opacity 1 is a step at
    /// `front`. A sample with `back <= front` is a surface at `front`.
    ///
    /// # Errors
    /// As [`Ray::surface`].
    pub fn thick<O: Channels>(&mut self, front: f32, back: f32, opacity: O) -> Result<()> {
        if !front.is_finite() || !back.is_finite() {
            let what = format!("interval {front} to {back} is not finite");
            return Self::refuse(self.samples, what);
        }
        if back <= front {
            return self.surface(front, opacity);
        }
        let mut opacity = opacity.to_rgb();
        self.check_opacity(opacity)?;
        let opaque = opacity.map(|o| if o == 1.0 { 1.0 } else { 0.0 });
        self.push_surface(front, opaque);
        for (o, opaque) in opacity.iter_mut().zip(opaque) {
            *o -= opaque;
        }
        if opacity != [0.0; 3] {
            self.coloured |= opacity != [opacity[0]; 3];
            self.thick.push(Thick {
                front: front + 0.0,
                back: back + 0.0,
                opacity,
            });
        }
        self.samples += 1;
        Ok(())
    }

    /// Adds a medium from samples `(depth, extinction)`.
    ///
    /// The extinction is per unit of *distance*, linear between samples and zero outside them. The
    /// light falls as `exp(-integral of the extinction)`. Two samples at one depth make the
    /// extinction jump there.
    ///
    /// `distance_per_depth` is the distance along the ray per unit of depth. It is 1 if depths are
    /// distances along the ray. Otherwise it is the length of the ray's direction, scaled so that
    /// its depth component is 1 (LV00, section 3.2, footnote 3).
    ///
    /// # Errors
    /// `Input` for numbers that are not finite, a negative extinction, a depth less than the
    /// previous one, a factor that is not positive and finite, or a product of extinction and
    /// factor above 1e100. The error names the index of the sample. The ray stays as it was.
    ///
    /// ```
    /// # use deepshadow::Ray;
    /// let mut ray = Ray::new();
    /// ray.medium(&[(0.0, 1.0), (3.0, 1.0)], 2.0).unwrap();
    /// let expected = (-2.0f64).exp(); // a depth of 1 is a distance of 2
    /// assert!((ray.visibility(1.0) - expected).abs() < 1e-15);
    /// ```
    pub fn medium<K: Channels>(
        &mut self,
        samples: &[(f32, K)],
        distance_per_depth: f64,
    ) -> Result<()> {
        if !(distance_per_depth > 0.0 && distance_per_depth.is_finite()) {
            return Err(Error::input(format!(
                "distance per depth {distance_per_depth} is not a positive number"
            )));
        }
        for (i, &(z, kappa)) in samples.iter().enumerate() {
            if !z.is_finite() {
                return Self::refuse(i, format!("depth {z} is not finite"));
            }
            if i > 0 && z < samples[i - 1].0 {
                return Self::refuse(i, "a depth is less than the one before it");
            }
            for k in kappa.to_rgb() {
                if !(k >= 0.0 && f64::from(k) * distance_per_depth <= 1e100) {
                    return Self::refuse(i, format!("extinction {k} is not in 0 to 1e100"));
                }
            }
        }
        for pair in samples.windows(2) {
            let kappa = [pair[0].1, pair[1].1].map(|k| k.to_rgb());
            if pair[0].0 < pair[1].0 && kappa != [[0.0; 3]; 2] {
                self.coloured |= kappa.iter().any(|&k| k != [k[0]; 3]);
                self.media.push(Stretch {
                    front: pair[0].0 + 0.0,
                    back: pair[1].0 + 0.0,
                    kappa: kappa.map(|k| k.map(|k| f64::from(k) * distance_per_depth)),
                });
            }
        }
        Ok(())
    }

    /// Transmittance at `depth`, exact to f64 rounding; the red channel of a coloured ray.
    ///
    /// At a surface this is the value in front of it. Cost: linear in the samples; meant for
    /// checks.
    pub fn visibility(&self, depth: f32) -> f64 {
        self.visibility_rgb(depth)[0]
    }

    /// Transmittance just behind `depth`. It differs from [`Ray::visibility`] only at a surface.
    pub fn visibility_behind(&self, depth: f32) -> f64 {
        self.visibility_behind_rgb(depth)[0]
    }

    /// [`Ray::visibility`] of red, green and blue.
    pub fn visibility_rgb(&self, depth: f32) -> [f64; 3] {
        self.evaluate(depth, |surface| surface < depth)
    }

    /// [`Ray::visibility_behind`] of red, green and blue.
    pub fn visibility_behind_rgb(&self, depth: f32) -> [f64; 3] {
        self.evaluate(depth, |surface| surface <= depth)
    }

    /// Transmittance behind all samples; the red channel of a coloured ray.
    pub fn end(&self) -> f64 {
        self.end_rgb()[0]
    }

    /// [`Ray::end`] of red, green and blue.
    pub fn end_rgb(&self) -> [f64; 3] {
        self.visibility_rgb(f32::INFINITY)
    }

    fn evaluate(&self, depth: f32, met: impl Fn(f32) -> bool) -> [f64; 3] {
        let z = f64::from(depth);
        std::array::from_fn(|c| {
            let surfaces = self.surfaces.iter().filter(|s| met(s.z));
            let steps: f64 = surfaces.map(|s| 1.0 - f64::from(s.opacity[c])).product();
            let thick: f64 = self.thick.iter().map(|t| t.transmittance(z, c)).product();
            let optical: f64 = self.media.iter().map(|m| m.optical_depth(z, c)).sum();
            steps * thick * (-optical).exp()
        })
    }

    /// The surfaces sorted by depth; equal depths stay in order of insertion. Sorts them in
    /// `scratch` if necessary.
    pub(crate) fn surfaces_in_order<'a>(&'a self, scratch: &'a mut Vec<Surface>) -> &'a [Surface] {
        if self.surfaces.is_sorted_by(|a, b| a.z <= b.z) {
            return &self.surfaces;
        }
        scratch.clear();
        scratch.extend_from_slice(&self.surfaces);
        scratch.sort_by(|a, b| a.z.total_cmp(&b.z));
        scratch
    }
}

impl Thick {
    /// Transmittance from the front to `z`: `(1 - opacity)^t`, with t from 0 at the front to 1 at
    /// the back.
    pub fn transmittance(&self, z: f64, c: usize) -> f64 {
        let all = 1.0 - f64::from(self.opacity[c]);
        let [front, back] = [self.front, self.back].map(f64::from);
        match (z - front) / (back - front) {
            t if t <= 0.0 => 1.0,
            t if t >= 1.0 => all,
            t => all.powf(t),
        }
    }

    fn kappa(&self) -> [f64; 3] {
        let thickness = f64::from(self.back) - f64::from(self.front);
        self.opacity.map(|o| -(-f64::from(o)).ln_1p() / thickness)
    }
}

impl Stretch {
    /// Integral of the extinction from the front to `z`.
    pub fn optical_depth(&self, z: f64, c: usize) -> f64 {
        let [front, back] = [self.front, self.back].map(f64::from);
        let inside = z.clamp(front, back) - front;
        let (k0, k1) = (self.kappa[0][c], self.kappa[1][c]);
        let k = k0 + (k1 - k0) * (inside / (back - front));
        inside * (k0 + k) / 2.0
    }
}

/// A compensated sum: it also sums its rounding errors.
#[derive(Clone, Copy, Default)]
pub(crate) struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    pub fn new(start: f64) -> Self {
        Sum {
            sum: start,
            lost: 0.0,
        }
    }

    /// Adds `x` by Knuth's two-sum, which is exact whichever operand is larger.
    #[inline]
    pub fn add(&mut self, x: f64) {
        let sum = self.sum + x;
        let part = sum - self.sum;
        self.lost += (self.sum - (sum - part)) + (x - part);
        self.sum = sum;
    }

    #[inline]
    pub fn value(&self) -> f64 {
        self.sum + self.lost
    }
}
