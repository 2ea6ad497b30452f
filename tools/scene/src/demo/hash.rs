//! Numbers by number: the same counter gives the same number, on every machine and in any order of the threads.

use glam::Vec3;

/// A source of numbers; each has a place of its own, and none needs the one before.
#[derive(Clone, Copy, Debug)]
pub struct Hash(u64);

impl Hash {
    /// Of this seed.
    pub fn new(seed: u64) -> Self {
        Hash(mix(seed ^ 0x6a09_e667_f3bc_c908))
    }

    /// The source at this place, as good as another seed.
    pub fn at(self, place: u64) -> Self {
        Hash(mix(self.0 ^ place.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// From 0 up to but not including 1: the number of this index.
    pub fn unit(self, index: u64) -> f32 {
        (self.at(index).0 >> 40) as f32 / (1 << 24) as f32
    }

    /// From `lo` to `hi`.
    pub fn between(self, index: u64, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.unit(index)
    }

    /// A direction, all alike: a point in the cube until one is in the ball, which after few tries is sure.
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

    /// The bits, for whoever makes something else of them.
    pub fn bits(self) -> u64 {
        self.0
    }
}

/// Steele, Lea and Flood's SplitMix64, the part that mixes.
fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
