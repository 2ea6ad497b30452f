//! Demos: procedural objects after the figures of papers, bit-identical on every machine.

pub mod cloud;
pub mod fur;
pub mod hairball;
pub mod hash;
pub mod noise;
pub mod papers;
pub mod shapes;
pub mod smoke;
pub mod solids;
pub mod trig;
pub mod volume;

use glam::Vec3;

use crate::load::Loaded;

/// A procedural object of one or more parts. It is centred near the origin and one or two units in
/// size; y is up.
#[derive(Clone, Debug, PartialEq)]
pub struct Demo {
    /// The parts. Each becomes an object in the scene.
    pub parts: Vec<Part>,
}

/// A part of a [`Demo`].
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of the part, for example `hair`.
    pub name: &'static str,
    /// The geometry.
    pub geometry: Loaded,
    /// For surfaces and strands, the intended opacity, 0 to 1; for volumes, the extinction at
    /// density 1.
    pub opacity: f32,
}

impl Part {
    /// A part that blocks all light.
    fn opaque(name: &'static str, geometry: Loaded) -> Self {
        Part {
            name,
            geometry,
            opacity: 1.0,
        }
    }
}

/// A demo's name, its description and its constructor from a seed.
struct Entry {
    name: &'static str,
    what: &'static str,
    make: fn(u64) -> Demo,
}

const ENTRIES: [Entry; 11] = [
    Entry {
        name: "hairball",
        what: "a ball with 50,000 hairs in tufts and curls (Lokovic and Veach, figure 6)",
        make: |seed| {
            hairball::Hairball {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "fur",
        what: "a patch of short, dense, curly fur (Lokovic and Veach, figure 1)",
        make: |seed| {
            fur::Fur {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "cloud",
        what: "a puffy cloud, 128 x 128 x 128 (Lokovic and Veach, figure 10)",
        make: |seed| {
            cloud::Cloud {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "smoke",
        what: "a rising plume of smoke, 96 x 192 x 96",
        make: |seed| {
            smoke::Smoke {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "boxes",
        what: "boxes of different height, side by side",
        make: |seed| {
            solids::Boxes {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "spheres",
        what: "balls of different size",
        make: |seed| {
            solids::Spheres {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "ball",
        what: "one ball of radius 1",
        make: |_| Demo {
            parts: vec![Part::opaque(
                "ball",
                Loaded::Mesh(shapes::ball(Vec3::ZERO, 1.0, 5)),
            )],
        },
    },
    Entry {
        name: "pipes",
        what: "bent pipes, to stand in a cloud (Lokovic and Veach, figure 11)",
        make: |seed| {
            solids::Pipes {
                seed,
                ..Default::default()
            }
            .make()
        },
    },
    Entry {
        name: "box",
        what: "a box that gets more opaque towards its middle, 64 x 64 x 64",
        make: |_| papers::cube(64),
    },
    Entry {
        name: "bucky",
        what: "a bucky ball of sixty blobs and ninety bonds, 32 x 32 x 32",
        make: |_| papers::bucky(32),
    },
    Entry {
        name: "rods",
        what: "rods that cross each other, 64 x 64 x 64",
        make: |_| papers::rods(64),
    },
];

/// Every demo: its name and a description of one line.
pub fn names() -> impl Iterator<Item = (&'static str, &'static str)> {
    ENTRIES.iter().map(|e| (e.name, e.what))
}

/// The demo `name` with default parameters, or `None`. The seed has no effect on `ball`, `box`,
/// `bucky` and `rods`.
pub fn by_name(name: &str, seed: u64) -> Option<Demo> {
    ENTRIES
        .iter()
        .find(|e| e.name == name)
        .map(|e| (e.make)(seed))
}
