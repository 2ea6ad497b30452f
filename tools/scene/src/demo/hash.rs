//! Random numbers by index: the same index gives the same number on every machine and in every
//! order of threads.

use glam::Vec3;

use crate::samples::mix;

/// A source of random numbers. Each number is computed from its index, independently of the others.
#[derive(Clone, Copy, Debug)]
pub struct Hash(u64);

impl Hash {
    /// A source with this seed.
    pub fn new(seed: u64) -> Self {
        Hash(mix(seed ^ 0x6a09_e667_f3bc_c908))
    }

    /// An independent source for this index.
    pub fn at(self, place: u64) -> Self {
        Hash(mix(self.0 ^ place.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// The number with this index, in [0, 1).
    pub fn unit(self, index: u64) -> f32 {
        (self.at(index).0 >> 40) as f32 / (1 << 24) as f32
    }

    /// The number with this index, scaled to [`lo`, `hi`).
    pub fn between(self, index: u64, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.unit(index)
    }

    /// A uniformly distributed direction. Tries points in the cube until one is inside the ball; 64
    /// tries practically always succeed.
    pub fn direction(self, index: u64) -> Vec3 {
        let source = self.at(index);
        for i in 0..64 {
            let x = |k: u64| source.between(3 * i + k, -1.0, 1.0);
            let p = Vec3::new(x(0), x(1), x(2));
            let squared = p.length_squared();
            if squared <= 1.0 && squared > 1e-4 {
                return p / squared.sqrt();
            }
        }
        Vec3::Y
    }

    /// The hash of this source, for other uses.
    pub fn bits(self) -> u64 {
        self.0
    }
}
