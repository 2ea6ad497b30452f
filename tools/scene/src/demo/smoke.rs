//! A plume of smoke: narrow and dense at its base, wide and thin above, distorted by noise.

use glam::Vec3;

use super::noise::Noise;
use super::{Demo, Part, volume};
use crate::geometry::Grid;
use crate::load::Loaded;

/// Parameters of the smoke.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoke {
    /// Samples along x, y and z, at least two each. The longest side is 2 units.
    pub size: [u32; 3],
    /// Displacement by noise at the top, in units.
    pub drift: f32,
    /// Octaves of the noise.
    pub octaves: u32,
    /// Seed of the plume's random numbers.
    pub seed: u64,
}

impl Default for Smoke {
    fn default() -> Self {
        Smoke {
            size: [96, 192, 96],
            drift: 0.3,
            octaves: 4,
            seed: 1,
        }
    }
}

impl Smoke {
    /// Builds the demo with its one part `smoke`.
    pub fn make(&self) -> Demo {
        Demo {
            parts: vec![Part {
                name: "smoke",
                geometry: Loaded::Volume(self.density()),
                opacity: 14.0,
            }],
        }
    }

    /// Density from 0 to 1, 0 at all borders, centred at the origin.
    pub fn density(&self) -> Grid {
        let half = volume::half(self.size);
        let [bend, swirl, body] = [1, 2, 3].map(|k| Noise::new(self.seed.wrapping_mul(3) + k));
        let wide = half.x.min(half.z);
        volume::filled(self.size, |p| {
            // From 0 at the bottom to 1 at the top.
            let h = ((p.y / half.y + 1.0) / 2.0).clamp(0.0, 1.0);
            let radius = wide * (0.1 + 0.55 * h * (1.6 - 0.6 * h));
            // The whole plume bends as it rises, and swirls distort its surface.
            let rise = Vec3::new(0.5, p.y * 1.1 + 0.3, 0.5);
            let aside = Vec3::new(bend.at(rise), 0.0, bend.at(rise + Vec3::splat(31.7)));
            let far = p.with_y(0.0).length() - self.drift - radius;
            if far > radius {
                return 0.0;
            }
            let q = p * (1.6 / (0.35 + h)) - Vec3::Y * 2.0;
            let turn = Vec3::new(
                swirl.at(q),
                swirl.at(q + Vec3::splat(57.1)),
                swirl.at(q + Vec3::splat(91.3)),
            );
            let moved = p + aside * (self.drift * h) + turn * (radius * 0.55);
            let across = moved.with_y(0.0).length() / radius;
            if across >= 1.0 {
                return 0.0;
            }
            let texture = 0.55 + 0.8 * body.octaves(moved * 5.0, self.octaves);
            let thin = (1.0 - 0.65 * h) * (1.0 - h * h * h);
            let edge = 1.0 - across * across;
            (edge * texture * thin * 1.6).clamp(0.0, 1.0)
        })
    }
}
