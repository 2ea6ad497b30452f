//! The volumes of papers on opacity in volumes: a box, a bucky ball and crossed rods.
//!
//! After "Deep shadow maps from volumetric data", figures 2 to 4. The paper gives their names and
//! sizes, and says that the box "gets more opaque towards the center". All other properties are
//! chosen here.

use glam::Vec3;

use super::shapes::icosahedron;
use super::{Demo, Part, volume};
use crate::geometry::Grid;
use crate::load::Loaded;

/// A demo of one volume; `opacity` makes its middle nearly opaque.
fn demo(name: &'static str, grid: Grid, opacity: f32) -> Demo {
    Demo {
        parts: vec![Part {
            name,
            geometry: Loaded::Volume(grid),
            opacity,
        }],
    }
}

/// A box with this many samples along each side: 1 in its middle, falling linearly to 0 at its
/// faces.
pub fn cube(samples: u32) -> Demo {
    let density = |p: Vec3| 1.0 - p.abs().max_element();
    demo(
        "box",
        volume::filled_to_the_border([samples; 3], density),
        6.0,
    )
}

/// A bucky ball with this many samples along each side: blobs at the sixty corners of a truncated
/// icosahedron, and thinner bonds along its ninety edges.
pub fn bucky(samples: u32) -> Demo {
    let atoms = bucky_atoms().map(|p| p * 0.72);
    let bonds = bonds(&atoms);
    let density = |p: Vec3| {
        let atom = atoms.iter().map(|a| blob(p.distance(*a), 0.21));
        let bond = bonds.iter().map(|&(a, b)| {
            let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
            0.45 * blob(p.distance(a.lerp(b, t)), 0.13)
        });
        atom.chain(bond).fold(0.0, f32::max)
    };
    demo("bucky", volume::filled([samples; 3], density), 12.0)
}

/// Three rods along the axes that cross in the middle, and four along the diagonals, with this many
/// samples along each side.
pub fn rods(samples: u32) -> Demo {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (axis, 0.2));
    let diagonals = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        .map(|(x, y)| (Vec3::new(x, y, 1.0).normalize(), 0.13));
    let density = |p: Vec3| {
        let rods = axes.iter().chain(&diagonals).map(|&(axis, radius)| {
            let along = p.dot(axis);
            let end = ((0.88 - along.abs()) * 12.0).clamp(0.0, 1.0);
            blob((p - axis * along).length(), radius) * end
        });
        rods.fold(0.0, f32::max)
    };
    demo("rods", volume::filled([samples; 3], density), 10.0)
}

/// 1 at distance 0, falling smoothly to 0 at `radius`.
fn blob(distance: f32, radius: f32) -> f32 {
    let t = (1.0 - distance * distance / (radius * radius)).max(0.0);
    t * t
}

/// The corners of a truncated icosahedron at distance 1: the points at one and two thirds of each
/// edge of an icosahedron.
pub fn bucky_atoms() -> [Vec3; 60] {
    let (corners, triangles) = icosahedron();
    let mut atoms = Vec::new();
    for t in &triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            // Each edge belongs to two triangles, once in each direction.
            let (a, b) = (corners[a as usize], corners[b as usize]);
            atoms.push(a.lerp(b, 1.0 / 3.0).normalize());
        }
    }
    let mut out = [Vec3::ZERO; 60];
    out.copy_from_slice(&atoms);
    out
}

/// The edges: from each corner to its three nearest.
fn bonds(atoms: &[Vec3]) -> Vec<(Vec3, Vec3)> {
    let pairs = || {
        let later = |i: usize| (i + 1..atoms.len()).map(move |k| (i, k));
        (0..atoms.len()).flat_map(later)
    };
    let length = |&(i, k): &(usize, usize)| atoms[i].distance(atoms[k]);
    let least = pairs().map(|p| length(&p)).fold(f32::INFINITY, f32::min);
    pairs()
        .filter(|p| length(p) < least * 1.1)
        .map(|(i, k)| (atoms[i], atoms[k]))
        .collect()
}
