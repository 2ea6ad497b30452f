//! Shadows by rays from the light, the reference for the other sources.

use deepshadow::Footprint;
use deepshadow_scene::hits::medium::Medium;
use deepshadow_scene::scene::{Scene, View};
use glam::DVec3;

use super::Asker;
use crate::kernel::Kernel;
use crate::lamp::{Asked, Lamp, line};
use crate::surfaces::Surfaces;

/// Everything that casts a shadow, prepared for the rays of each light.
#[derive(Debug)]
pub struct Exact<'a> {
    lamps: Vec<Surfaces<'a>>,
    media: Vec<Medium<'a>>,
    /// Rays over the footprint. `None` is one ray to the point.
    kernel: Option<Kernel>,
}

impl<'a> Exact<'a> {
    /// Prepares rays for the lights of a scene.
    ///
    /// Without a kernel, one ray goes to each point, at the time of the camera ray. With a kernel,
    /// the result is the average of its rays over the footprint and the shutter interval, which is
    /// the answer of a map without error.
    pub fn new(scene: &'a Scene, lamps: &[Lamp<'_>], kernel: Option<Kernel>) -> Self {
        Exact {
            lamps: lamps.iter().map(|l| surfaces(scene, l)).collect(),
            media: Medium::of(scene),
            kernel,
        }
    }

    /// Bytes of the geometry for its rays.
    pub fn bytes(&self) -> usize {
        self.lamps.iter().map(Surfaces::bytes).sum()
    }

    /// The fraction of light that reaches a point.
    pub fn light(
        &self,
        asker: &mut Asker,
        lamp: &Lamp<'_>,
        number: usize,
        asked: &Asked,
    ) -> [f32; 3] {
        let Some((face, at)) = lamp.seen(asked.point) else {
            return [1.0; 3];
        };
        let view = &lamp.views[face];
        let depth = at[2] - asked.bias;
        let march = &mut asker.march;
        let mut through = |x: f64, y: f64, time: f64| {
            self.transmittance(number, view, [x, y], depth, time, march)
        };
        let Some(kernel) = &self.kernel else {
            return through(at[0], at[1], asked.time).map(|v| v as f32);
        };
        let width = width_in(view, asked.point, asked.width);
        let mut sum = [0.0; 3];
        kernel.places(asked.key, &mut asker.samples, |[x, y], time| {
            let light = through(at[0] + x * width, at[1] + y * width, time);
            (0..3).for_each(|c| sum[c] += light[c]);
        });
        sum.map(|v| (v / kernel.count() as f64) as f32)
    }

    /// Transmittance along one ray of the light, up to a depth.
    fn transmittance(
        &self,
        number: usize,
        view: &View,
        [x, y]: [f64; 2],
        depth: f64,
        time: f64,
        march: &mut Vec<(f32, [f32; 3])>,
    ) -> [f64; 3] {
        let (origin, way) = line(view, x, y);
        let length = way.length();
        let mut light =
            self.lamps[number].transmittance(origin, way / length, time, depth * length);
        for medium in &self.media {
            if light == [0.0; 3] {
                break;
            }
            medium.along((origin, way), time, (0.0, depth), march);
            let passed = optical_depth(march, length);
            (0..3).for_each(|c| light[c] *= (-passed[c]).exp());
        }
        light
    }
}

/// The surfaces that cast a shadow, prepared for the rays of a light.
pub fn surfaces<'a>(scene: &'a Scene, lamp: &Lamp<'_>) -> Surfaces<'a> {
    Surfaces::new(scene, |o| o.shadow, |p: DVec3| lamp.views[0].eye.ray(p))
}

/// Converts a width at a point to pixels of a view.
pub fn width_in(view: &View, point: DVec3, width: f64) -> f64 {
    match view.space.footprint_of_width(point.to_array(), width) {
        Some(Footprint::Width(pixels)) => pixels.into(),
        _ => 0.0,
    }
}

/// Integrates extinction that is linear between samples. `distance` is the length of a
/// unit of depth.
fn optical_depth(samples: &[(f32, [f32; 3])], distance: f64) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for pair in samples.windows(2) {
        let length = f64::from(pair[1].0 - pair[0].0) * distance;
        for (c, sum) in sum.iter_mut().enumerate() {
            *sum += f64::from(pair[0].1[c] + pair[1].1[c]) / 2.0 * length;
        }
    }
    sum
}
