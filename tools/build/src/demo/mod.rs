//! Objects without files: what the papers shaded, made by number, the same to the last bit on every machine.

pub mod cloud;
pub mod hairball;
pub mod hash;
pub mod noise;
pub mod shapes;
pub mod trig;
pub mod volume;

use crate::load::Loaded;

/// A thing made of one or more parts, around the origin, a unit or two in size; y points up.
#[derive(Clone, Debug, PartialEq)]
pub struct Demo {
    /// The parts, each of which is an object of its own.
    pub parts: Vec<Part>,
}

/// A part of a [`Demo`].
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What it is, as in `hair`.
    pub name: &'static str,
    /// What it is made of.
    pub geometry: Loaded,
    /// Of a surface or a strand, how opaque it is meant to be, from 0 to 1; of a volume, extinction where the density is 1.
    pub opacity: f32,
}

/// A demo's name, what it is, and how it is made from a seed.
struct Entry {
    name: &'static str,
    what: &'static str,
    make: fn(u64) -> Demo,
}

const ENTRIES: [Entry; 2] = [
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
];

/// Every demo: its name, and what it is in one line.
pub fn names() -> impl Iterator<Item = (&'static str, &'static str)> {
    ENTRIES.iter().map(|e| (e.name, e.what))
}

/// The demo of this name, with default parameters; none if there is none.
pub fn by_name(name: &str, seed: u64) -> Option<Demo> {
    ENTRIES
        .iter()
        .find(|e| e.name == name)
        .map(|e| (e.make)(seed))
}
