//! A ball covered with hair (Lokovic and Veach, figure 6): hairs narrower than a pixel, in tufts
//! and curls of various densities.

use glam::Vec3;
use rayon::prelude::*;

use super::hash::Hash;
use super::shapes;
use super::trig::{across, sin_cos};
use super::{Demo, Part};
use crate::geometry::Curves;
use crate::load::Loaded;

/// Parameters of the hairball.
#[derive(Clone, Debug, PartialEq)]
pub struct Hairball {
    /// Number of hairs; about 50,000 in the paper.
    pub hairs: u32,
    /// Segments of each hair, at least one.
    pub segments: u32,
    /// Radius of the ball, which is centred at the origin.
    pub radius: f32,
    /// Length of the longest hair if it were straight; the shortest are less than half as long.
    pub length: f32,
    /// Width of a hair at its root; it narrows to a fifth at its tip. The default is about a fifth
    /// of a pixel if the whole hairball covers 512 pixels.
    pub width: f32,
    /// Width of the curls as a fraction of the length; 0 is straight.
    pub curl: f32,
    /// Number of tufts into which hairs gather; with 0, every hair stands alone.
    pub tufts: u32,
    /// Seed of the hairball's random numbers.
    pub seed: u64,
}

impl Default for Hairball {
    fn default() -> Self {
        Hairball {
            hairs: 50_000,
            segments: 16,
            radius: 0.6,
            length: 0.55,
            width: 0.0009,
            curl: 0.2,
            tufts: 420,
            seed: 1,
        }
    }
}

/// Shared properties of the hairs of a tuft.
struct Tuft {
    /// Direction from the ball's centre.
    axis: Vec3,
    /// How close the hairs come together: from 0, not at all, to 1, at a point.
    hold: f32,
    /// Displacement of the tip, for a length of 1.
    lean: Vec3,
    /// Width of the curl, its turns along the hair and its phase at the root.
    curl: f32,
    turns: f32,
    phase: f32,
    /// Length of the hairs, relative to the longest.
    length: f32,
}

impl Hairball {
    /// Builds the demo with its parts `ball` and `hair`, both opaque.
    pub fn make(&self) -> Demo {
        let ball = shapes::ball(Vec3::ZERO, self.radius, 5);
        Demo {
            parts: vec![
                Part::opaque("ball", Loaded::Mesh(ball)),
                Part::opaque("hair", Loaded::Curves(self.hair())),
            ],
        }
    }

    /// Only the hairs. Each begins slightly inside the ball.
    ///
    /// # Panics
    /// If hairs have no segments, or there are more than 2^32 - 1 points.
    pub fn hair(&self) -> Curves {
        let hash = Hash::new(self.seed);
        let tufts: Vec<Tuft> = (0..self.tufts)
            .map(|i| self.tuft(i, hash.at(1).at(u64::from(i))))
            .collect();
        let points: Vec<Vec3> = (0..self.hairs)
            .into_par_iter()
            .flat_map_iter(|i| self.strand(hash.at(2).at(u64::from(i)), &tufts))
            .collect();
        let width = |s: f32| self.width * (1.0 - 0.8 * s * s);
        shapes::hairs(points, self.hairs, self.segments, width)
    }

    /// Places a tuft on a spiral from pole to pole, with a random offset.
    fn tuft(&self, i: u32, hash: Hash) -> Tuft {
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / self.tufts as f32;
        let (sin, cos) = sin_cos((f64::from(i) * GOLDEN).fract() as f32);
        let across = (1.0 - y * y).sqrt();
        let spread = 0.9 / (self.tufts as f32).sqrt();
        let axis = Vec3::new(across * cos, y, across * sin) + hash.direction(0) * spread;
        Tuft {
            axis: axis.normalize(),
            hold: hash.between(1, 0.7, 1.0),
            lean: hash.direction(2) * hash.between(3, 0.1, 0.5) - Vec3::Y * 0.35,
            // Most curls are narrow, few are wide.
            curl: self.curl * (0.2 + 0.9 * hash.unit(4) * hash.unit(4)),
            turns: hash.between(5, 1.5, 3.0) * if hash.unit(6) < 0.5 { -1.0 } else { 1.0 },
            phase: hash.unit(7),
            length: hash.between(8, 0.6, 1.0),
        }
    }

    fn strand(&self, hash: Hash, tufts: &[Tuft]) -> impl Iterator<Item = Vec3> {
        let root = hash.direction(0);
        // One hair in twelve stands alone.
        let alone = hash.unit(1) < 0.08;
        let nearest = tufts
            .iter()
            .max_by(|a, b| a.axis.dot(root).total_cmp(&b.axis.dot(root)));
        let loose = Tuft {
            axis: root,
            hold: 0.0,
            lean: hash.direction(2) * 0.4 - Vec3::Y * 0.2,
            curl: self.curl * hash.between(3, 0.2, 1.2),
            turns: hash.between(4, -3.0, 3.0),
            phase: hash.unit(5),
            length: hash.between(6, 0.5, 1.0),
        };
        let (tuft, loose_axis) = match nearest.filter(|_| !alone) {
            Some(tuft) => (tuft, false),
            None => (&loose, true),
        };
        let length = self.length * tuft.length * hash.between(7, 0.62, 1.0);
        let phase = tuft.phase + hash.between(8, -0.06, 0.06);
        let (axis, hold, lean) = (
            tuft.axis,
            if loose_axis { 0.0 } else { tuft.hold },
            tuft.lean,
        );
        let (curl, turns) = (tuft.curl * length, tuft.turns);
        let (u, v) = across(axis);
        // Each hair of a tuft keeps its own offset from the axis.
        let own = hash.direction(9) * hash.unit(10) * 0.06 * length;
        let (radius, segments) = (self.radius, self.segments);
        (0..=segments).map(move |i| {
            let s = i as f32 / segments as f32;
            let up = radius * 0.995 + length * s;
            let own_way = root * up;
            let tuft_way = axis * up + own;
            // A tuft draws its hairs together soon after the root.
            let together = hold * (1.0 - (1.0 - s) * (1.0 - s) * (1.0 - s));
            let (sin, cos) = sin_cos(phase + turns * s);
            let (sin0, cos0) = sin_cos(phase);
            let round = (u * (cos - cos0 * (1.0 - s)) + v * (sin - sin0 * (1.0 - s))) * curl;
            let grown = s * (3.0 - 2.0 * s).min(1.0);
            own_way.lerp(tuft_way, together) + lean * (length * s * s) + round * grown
        })
    }
}
