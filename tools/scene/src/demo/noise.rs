//! Perlin's gradient noise on a hashed lattice, and sums of its octaves.

use glam::Vec3;

use super::hash::Hash;

/// A noise function.
#[derive(Clone, Copy, Debug)]
pub struct Noise(Hash);

impl Noise {
    /// The noise of this seed.
    pub fn new(seed: u64) -> Self {
        Noise(Hash::new(seed))
    }

    /// Noise at a point: smooth, about -1 to 1, and 0 at integer points.
    pub fn at(self, p: Vec3) -> f32 {
        let cell = p.floor();
        let f = p - cell;
        let [x, y, z] = cell.to_array().map(|c| c as i64);
        let corner = |i: i64, j: i64, k: i64| {
            let offset = Vec3::new(i as f32, j as f32, k as f32);
            self.gradient(x + i, y + j, z + k).dot(f - offset)
        };
        // Perlin's curve; its first two derivatives are 0 at both ends.
        let t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let row = |j, k| lerp(corner(0, j, k), corner(1, j, k), t.x);
        let plane = |k| lerp(row(0, k), row(1, k), t.y);
        lerp(plane(0), plane(1), t.z)
    }

    /// A sum of octaves. Each has half the wavelength and half the amplitude of the previous one;
    /// the first is [`Noise::at`].
    pub fn octaves(self, p: Vec3, octaves: u32) -> f32 {
        let (mut sum, mut p, mut height) = (0.0, p, 1.0);
        for _ in 0..octaves {
            sum += self.at(p) * height;
            // Not exactly twice, and shifted: otherwise all octaves would be 0 at the same points.
            p = p * 2.03 + Vec3::new(17.3, 5.1, 11.7);
            height *= 0.5;
        }
        sum
    }

    /// One of Perlin's twelve gradients, which point to the edges of a cube.
    fn gradient(self, x: i64, y: i64, z: i64) -> Vec3 {
        let key = (x as u64 & 0x1f_ffff) | (y as u64 & 0x1f_ffff) << 21 | (z as u64) << 42;
        let bits = self.0.at(key).bits();
        let sign = |bit: u32| if bits >> bit & 1 == 0 { 1.0 } else { -1.0 };
        match (bits >> 32) % 3 {
            0 => Vec3::new(sign(0), sign(1), 0.0),
            1 => Vec3::new(sign(0), 0.0, sign(1)),
            _ => Vec3::new(0.0, sign(0), sign(1)),
        }
    }
}
