//! Shadows from a plain shadow map, with percentage-closer filtering.
//!
//! Reeves, Salesin and Cook 1987. Deep shadow maps are compared with it.

use deepshadow_frame::Result;
use deepshadow_scene::demo::hash::Hash;
use deepshadow_scene::hits::medium::Medium;
use deepshadow_scene::scene::{Light, Scene, View};
use rayon::prelude::*;

use super::Asker;
use super::exact::{surfaces, width_in};
use crate::kernel::Kernel;
use crate::lamp::{Asked, Lamp, line};
use crate::surfaces::Surfaces;

/// Depth maps of all lights, and the taps of a lookup.
#[derive(Debug)]
pub struct Plain {
    /// For each light, the depth maps of its views.
    lamps: Vec<Vec<Face>>,
    taps: Kernel,
}

/// Depth map of a view: for each pixel, where the ray through its middle is stopped.
#[derive(Debug)]
struct Face {
    view: View,
    depths: Vec<f32>,
}

impl Plain {
    /// Renders the maps, `side` pixels along the longer side.
    ///
    /// A surface stops a ray with the probability of its mean opacity. A medium stops it at a
    /// random depth, by its mean extinction. Each ray has its own time. `progress` gets the
    /// number of rows done and of all rows.
    ///
    /// # Errors
    /// As [`Light::views`].
    pub fn new(
        scene: &Scene,
        lamps: &[Lamp<'_>],
        side: u32,
        taps: Kernel,
        mut progress: impl FnMut(u64, u64),
    ) -> Result<Self> {
        let views = |lamp: &Lamp<'_>| {
            let longer = lamp.light.resolution[0].max(lamp.light.resolution[1]);
            let scaled = |n: u32| (f64::from(n) * f64::from(side) / f64::from(longer)).round();
            let light = Light {
                resolution: lamp.light.resolution.map(|n| scaled(n).max(1.0) as u32),
                ..lamp.light.clone()
            };
            light.views(scene)
        };
        let views = lamps
            .iter()
            .map(views)
            .collect::<deepshadow_scene::Result<Vec<_>>>()?;
        let total = views.iter().flatten().map(|v| u64::from(v.size[1])).sum();
        let media = Medium::of(scene);
        let (mut done, mut made) = (0, Vec::new());
        for (number, (lamp, views)) in lamps.iter().zip(views).enumerate() {
            let surfaces = surfaces(scene, lamp);
            let mut faces = Vec::new();
            for (face, view) in views.into_iter().enumerate() {
                let caster = Caster {
                    surfaces: &surfaces,
                    media: &media,
                    view: &view,
                    chance: Hash::new(scene.seed).at(number as u64).at(face as u64),
                };
                let mut depths = Vec::new();
                let rows: Vec<u32> = (0..view.size[1]).collect();
                for rows in rows.chunks(64) {
                    let next = rows.par_iter().flat_map_iter(|&y| caster.row(y));
                    depths.par_extend(next);
                    done += rows.len() as u64;
                    progress(done, total);
                }
                faces.push(Face { view, depths });
            }
            made.push(faces);
        }
        Ok(Plain { lamps: made, taps })
    }

    /// Bytes of all depths.
    pub fn bytes(&self) -> usize {
        let faces = self.lamps.iter().flatten();
        faces.map(|f| f.depths.len() * size_of::<f32>()).sum()
    }

    /// Fraction of the taps whose depth is not less than that of a point.
    pub fn light(&self, asker: &mut Asker, lamp: &Lamp<'_>, number: usize, asked: &Asked) -> f32 {
        let Some((face, _)) = lamp.seen(asked.point) else {
            return 1.0;
        };
        let face = &self.lamps[number][face];
        let Some(at) = face.view.space.light_from_world(asked.point.to_array()) else {
            return 1.0;
        };
        let width = width_in(&face.view, asked.point, asked.width);
        let depth = (at[2] - asked.bias) as f32;
        let inside_only = lamp.views.len() == 1;
        let [w, h] = face.view.size.map(i64::from);
        let mut lit = 0u32;
        self.taps
            .places(asked.key, &mut asker.samples, |[x, y], _| {
                let pixel = [at[0] + x * width, at[1] + y * width].map(|v| v.floor() as i64);
                let inside = (0..w).contains(&pixel[0]) && (0..h).contains(&pixel[1]);
                let [x, y] = [pixel[0].clamp(0, w - 1), pixel[1].clamp(0, h - 1)];
                let beside = inside_only && !inside;
                lit += u32::from(beside || face.depths[(y * w + x) as usize] >= depth);
            });
        lit as f32 / self.taps.count() as f32
    }
}

/// Traces rays through the middles of pixels.
struct Caster<'a> {
    surfaces: &'a Surfaces<'a>,
    media: &'a [Medium<'a>],
    view: &'a View,
    chance: Hash,
}

impl Caster<'_> {
    fn row(&self, y: u32) -> Vec<f32> {
        let mut march = Vec::new();
        let pixels = 0..self.view.size[0];
        pixels.map(|x| self.depth(x, y, &mut march)).collect()
    }

    fn depth(&self, x: u32, y: u32, march: &mut Vec<(f32, [f32; 3])>) -> f32 {
        let chance = self.chance.at(u64::from(y) << 32 | u64::from(x));
        let (origin, way) = line(self.view, f64::from(x) + 0.5, f64::from(y) + 0.5);
        let length = way.length();
        let time = f64::from(chance.unit(0));
        let mut nearest = f64::INFINITY;
        self.surfaces
            .along(origin, way / length, time, f64::INFINITY, |hit| {
                let opacity = hit.opacity.iter().sum::<f32>() / 3.0;
                let stops = opacity >= 1.0 || chance.at(1).unit(u64::from(hit.triangle)) < opacity;
                if stops {
                    nearest = nearest.min(hit.t / length);
                }
                stops
            });
        for (i, medium) in self.media.iter().enumerate() {
            medium.along((origin, way), time, (0.0, nearest), march);
            // The optical depth at which a medium stops this ray.
            let most = -f64::from(1.0 - chance.at(2).unit(i as u64)).ln();
            nearest = nearest.min(depth_of(march, length, most));
        }
        nearest as f32
    }
}

/// Depth at which the integral of the mean extinction reaches `most`. Infinite if it never does.
fn depth_of(samples: &[(f32, [f32; 3])], distance: f64, most: f64) -> f64 {
    let mean = |k: [f32; 3]| f64::from(k[0] + k[1] + k[2]) / 3.0;
    let mut left = most;
    for pair in samples.windows(2) {
        let (a, b) = (mean(pair[0].1), mean(pair[1].1));
        let length = f64::from(pair[1].0 - pair[0].0);
        let all = (a + b) / 2.0 * length * distance;
        if all > left {
            // a t + (b - a) t² / 2 = left / (length distance), for t from 0 to 1.
            let want = left / (length * distance);
            let root = (a * a + 2.0 * (b - a) * want).max(0.0).sqrt();
            let t = (2.0 * want / (a + root)).clamp(0.0, 1.0);
            return f64::from(pair[0].0) + t * length;
        }
        left -= all;
    }
    f64::INFINITY
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_ends_where_its_optical_depth_is_used_up() {
        let ramp = [(1.0, [0.0; 3]), (3.0, [2.0; 3]), (5.0, [2.0; 3])];
        // Up to 1 + x the ramp adds x² / 2; twice that where a depth is two units long.
        assert!((depth_of(&ramp, 1.0, 0.5) - 2.0).abs() < 1e-12);
        assert!((depth_of(&ramp, 2.0, 1.0) - 2.0).abs() < 1e-12);
        assert!((depth_of(&ramp, 1.0, 4.0) - 4.0).abs() < 1e-12);
        assert_eq!(depth_of(&ramp, 1.0, 6.5), f64::INFINITY);
        assert_eq!(depth_of(&[], 1.0, 0.5), f64::INFINITY);
    }
}
