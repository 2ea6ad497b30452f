//! A square patch of ground with short, dense, curved fur (Lokovic and Veach, figure 1).

use glam::Vec3;
use rayon::prelude::*;

use super::hash::Hash;
use super::noise::Noise;
use super::shapes;
use super::trig::sin_cos;
use super::{Demo, Part};
use crate::geometry::Curves;
use crate::load::Loaded;

/// Parameters of the patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Fur {
    /// Number of hairs.
    pub hairs: u32,
    /// Segments of each hair, at least one.
    pub segments: u32,
    /// Side of the patch. It is centred at the origin, with its ground at y = 0.
    pub side: f32,
    /// Length of the longest hair; the shortest are half as long.
    pub length: f32,
    /// Width of a hair at its root; it narrows to a tenth at its tip.
    pub width: f32,
    /// Turns of the curl from root to tip; 0 only bends the hair.
    pub curl: f32,
    /// How far the hairs lean: from 0, upright, to 1, half way to the ground.
    pub lean: f32,
    /// Seed of the patch's random numbers.
    pub seed: u64,
}

impl Default for Fur {
    fn default() -> Self {
        Fur {
            hairs: 40_000,
            segments: 12,
            side: 1.0,
            length: 0.16,
            width: 0.0012,
            curl: 1.25,
            lean: 0.7,
            seed: 1,
        }
    }
}

impl Fur {
    /// Builds the demo with its parts `ground` and `fur`, both opaque.
    pub fn make(&self) -> Demo {
        let ground = shapes::ground(self.side / 2.0, 16);
        Demo {
            parts: vec![
                Part::opaque("ground", Loaded::Mesh(ground)),
                Part::opaque("fur", Loaded::Curves(self.fur())),
            ],
        }
    }

    /// Only the hairs. Each begins on the ground.
    ///
    /// # Panics
    /// If hairs have no segments, or there are more than 2^32 - 1 points.
    pub fn fur(&self) -> Curves {
        let hash = Hash::new(self.seed);
        let noise = Noise::new(self.seed ^ 0xf0);
        let rows = (self.hairs as f32).sqrt().ceil().max(1.0);
        let points: Vec<Vec3> = (0..self.hairs)
            .into_par_iter()
            .flat_map_iter(|i| self.strand(i, rows, hash.at(u64::from(i)), noise))
            .collect();
        let width = |s: f32| self.width * (1.0 - 0.9 * s);
        shapes::hairs(points, self.hairs, self.segments, width)
    }

    fn strand(
        &self,
        i: u32,
        rows: f32,
        hash: Hash,
        noise: Noise,
    ) -> impl Iterator<Item = Vec3> + use<> {
        // One root in each cell of a lattice, at a random position in it.
        let place = |n: f32, k| ((n + hash.unit(k)) / rows - 0.5) * self.side;
        let row = (i as f32 / rows).floor();
        let root = Vec3::new(place(i as f32 - row * rows, 0), 0.0, place(row, 1));
        // The direction of a hair changes slowly over the patch, and a little from hair to hair.
        let at = root * (4.0 / self.side) + Vec3::Y * 0.5;
        let whorl = noise.octaves(at, 2) + hash.between(2, -0.06, 0.06);
        let (sin, cos) = sin_cos(0.13 + whorl);
        let (along, across) = (Vec3::new(cos, 0.0, sin), Vec3::new(-sin, 0.0, cos));
        let length = self.length * hash.between(3, 0.5, 1.0);
        let lean = self.lean * (0.75 + 0.5 * noise.at(at * 1.7 + Vec3::splat(9.5)));
        let (turns, curl) = (self.curl * hash.between(4, 0.8, 1.2), 0.16 * length);
        let segments = self.segments;
        (0..=segments).map(move |k| {
            let s = k as f32 / segments as f32;
            let (sin, cos) = sin_cos(turns * s);
            let up = Vec3::Y * (s * (1.0 - 0.45 * lean * s)) + along * (0.8 * lean * s * s);
            root + up * length + (along * (1.0 - cos) + across * sin) * (curl * s.min(0.5) * 2.0)
        })
    }
}
