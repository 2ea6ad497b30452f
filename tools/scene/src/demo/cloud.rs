//! A puffy cloud (Lokovic and Veach, figure 10): overlapping balls with a surface displaced by
//! noise.

use glam::Vec3;

use super::hash::Hash;
use super::noise::Noise;
use super::{Demo, Part, volume};
use crate::geometry::Grid;
use crate::load::Loaded;

/// Parameters of the cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// Samples along x, y and z, at least two each. The longest side is 2 units.
    pub size: [u32; 3],
    /// Number of balls.
    pub puffs: u32,
    /// Displacement of the surface by noise, in units.
    pub rough: f32,
    /// Octaves of the noise.
    pub octaves: u32,
    /// Seed of the cloud's random numbers.
    pub seed: u64,
}

impl Default for Cloud {
    fn default() -> Self {
        Cloud {
            size: [128; 3],
            puffs: 14,
            rough: 0.3,
            octaves: 5,
            seed: 1,
        }
    }
}

impl Cloud {
    /// Builds the demo with its one part `cloud`.
    pub fn make(&self) -> Demo {
        Demo {
            parts: vec![Part {
                name: "cloud",
                geometry: Loaded::Volume(self.density()),
                opacity: 12.0,
            }],
        }
    }

    /// Density from 0 to 1, 0 at all borders, centred at the origin.
    pub fn density(&self) -> Grid {
        let hash = Hash::new(self.seed);
        let half = volume::half(self.size);
        let puffs: Vec<(Vec3, f32)> = (0..self.puffs)
            .map(|i| {
                let hash = hash.at(u64::from(i));
                // The first ball is in the middle. The others surround it, smaller towards the
                // outside and more of them to the sides than above.
                let out = if i == 0 {
                    0.0
                } else {
                    hash.between(0, 0.3, 0.62)
                };
                let flat = Vec3::new(1.0, 0.62, 1.0);
                let radius = 0.5 - 0.45 * out + hash.between(1, -0.03, 0.06);
                (
                    hash.direction(2) * out * flat * half,
                    radius * half.min_element(),
                )
            })
            .collect();
        let noise = Noise::new(self.seed ^ 0xc10d);
        let reach = self.rough * 1.2;
        volume::filled(self.size, |p| {
            let inside = puffs
                .iter()
                .map(|&(centre, radius)| radius - p.distance(centre))
                .fold(f32::NEG_INFINITY, f32::max);
            if inside < -reach {
                return 0.0;
            }
            // The absolute value of the noise makes round bulges with sharp creases between them.
            let bulge = noise.at(p * 2.7).abs() * 1.1 - 0.3;
            let fine = noise.octaves(p * 5.5, self.octaves) * 0.45;
            let depth = inside + self.rough * (bulge + fine);
            (depth * 9.0).clamp(0.0, 1.0)
        })
    }
}
