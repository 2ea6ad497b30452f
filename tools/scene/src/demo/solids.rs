//! Solid demos: boxes on a lattice, balls of different size, and bent pipes (Lokovic and Veach,
//! figure 11).

use glam::Vec3;

use super::hash::Hash;
use super::shapes::{self, join};
use super::trig::sin_cos;
use super::{Demo, Part};
use crate::geometry::Mesh;
use crate::load::Loaded;

/// A lattice of boxes of different height, side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Boxes {
    /// Number of boxes along x, and along z.
    pub across: u32,
    /// Side of the lattice, which is centred at the origin and stands on y = 0.
    pub side: f32,
    /// Fraction of each lattice cell's side that stays free.
    pub gap: f32,
    /// Height of the highest box; the lowest is at least a quarter as high.
    pub height: f32,
    /// Seed of the heights.
    pub seed: u64,
}

impl Default for Boxes {
    fn default() -> Self {
        Boxes {
            across: 6,
            side: 2.0,
            gap: 0.4,
            height: 0.8,
            seed: 1,
        }
    }
}

impl Boxes {
    /// Builds the demo with its one part `boxes`, opaque.
    pub fn make(&self) -> Demo {
        let hash = Hash::new(self.seed);
        let place = self.side / self.across as f32;
        let mut mesh = Mesh::default();
        for i in 0..self.across * self.across {
            let at = |n: u32| (n as f32 + 0.5) * place - self.side / 2.0;
            let height = self.height * hash.between(u64::from(i), 0.25, 1.0);
            let half = Vec3::new(place * (1.0 - self.gap), height, place * (1.0 - self.gap)) / 2.0;
            let centre = Vec3::new(at(i % self.across), half.y, at(i / self.across));
            join(&mut mesh, &shapes::cuboid(centre, half));
        }
        Demo {
            parts: vec![Part::opaque("boxes", Loaded::Mesh(mesh))],
        }
    }
}

/// Balls of different size that do not touch.
#[derive(Clone, Debug, PartialEq)]
pub struct Spheres {
    /// Number of balls; fewer if there is no room for more.
    pub count: u32,
    /// Radius of the largest ball; the smallest have a fifth of it.
    pub radius: f32,
    /// Half the side of the cube that contains the balls, centred at the origin.
    pub reach: f32,
    /// How often the triangles of each ball are split into four.
    pub splits: u32,
    /// Seed of the positions.
    pub seed: u64,
}

impl Default for Spheres {
    fn default() -> Self {
        Spheres {
            count: 24,
            radius: 0.4,
            reach: 1.0,
            splits: 4,
            seed: 1,
        }
    }
}

impl Spheres {
    /// Builds the demo with its one part `spheres`, opaque.
    pub fn make(&self) -> Demo {
        let mut mesh = Mesh::default();
        for (centre, radius) in self.places() {
            join(&mut mesh, &shapes::ball(centre, radius, self.splits));
        }
        Demo {
            parts: vec![Part::opaque("spheres", Loaded::Mesh(mesh))],
        }
    }

    /// Centre and radius of each ball, the largest first.
    pub fn places(&self) -> Vec<(Vec3, f32)> {
        let hash = Hash::new(self.seed);
        let mut places: Vec<(Vec3, f32)> = Vec::new();
        for i in 0..u64::from(self.count) {
            let share = i as f32 / self.count as f32;
            let radius = self.radius * (1.0 - 0.8 * share.sqrt());
            let room = self.reach - radius;
            // A free position, if 400 tries find one.
            let free = (0..400).find_map(|k| {
                let x = |axis: u64| hash.at(i).between(3 * k + axis, -room, room);
                let centre = Vec3::new(x(0), x(1), x(2));
                let clear = |&(c, r): &(Vec3, f32)| c.distance(centre) > (r + radius) * 1.02;
                places.iter().all(clear).then_some(centre)
            });
            places.extend(free.map(|centre| (centre, radius)));
        }
        places
    }
}

/// Bent pipes, closed at both ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Pipes {
    /// Number of pipes.
    pub count: u32,
    /// Radius of a pipe.
    pub radius: f32,
    /// Half the distance between a pipe's ends; the pipes run across the origin.
    pub reach: f32,
    /// Rings along each pipe, at least two.
    pub rings: u32,
    /// Corners of each ring, at least three.
    pub corners: u32,
    /// Seed of the bends.
    pub seed: u64,
}

impl Default for Pipes {
    fn default() -> Self {
        Pipes {
            count: 5,
            radius: 0.09,
            reach: 1.2,
            rings: 96,
            corners: 24,
            seed: 1,
        }
    }
}

impl Pipes {
    /// Builds the demo with its one part `pipes`, opaque.
    pub fn make(&self) -> Demo {
        let mut mesh = Mesh::default();
        for i in 0..self.count {
            join(
                &mut mesh,
                &shapes::tube(&self.path(i), self.radius, self.corners),
            );
        }
        Demo {
            parts: vec![Part::opaque("pipes", Loaded::Mesh(mesh))],
        }
    }

    /// The centre line of a pipe. Pipes alternate between x and z, and wave to the sides.
    fn path(&self, i: u32) -> Vec<Vec3> {
        let hash = Hash::new(self.seed).at(u64::from(i));
        let side = (i as f32 + 0.5) / self.count as f32 * 2.0 - 1.0;
        let rings = self.rings.max(2);
        let point = |k: u32| {
            let s = k as f32 / (rings - 1) as f32 * 2.0 - 1.0;
            let wave = |n: u64| {
                let turns = hash.between(3 * n, 0.35, 0.75);
                hash.between(3 * n + 1, 0.18, 0.34) * sin_cos(turns * s + hash.unit(3 * n + 2)).0
            };
            let (along, up, aside) = (s, side * 0.5 + wave(0), side * 0.7 + wave(1));
            self.reach
                * match i % 2 {
                    0 => Vec3::new(along, up, aside),
                    _ => Vec3::new(aside, up, along),
                }
        };
        (0..rings).map(point).collect()
    }
}
