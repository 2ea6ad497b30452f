//! What stands in for the sampler where the library has none: the flat arrays. It has no cache, so rows about the cache are skipped.

use std::path::Path;
use std::sync::Arc;

use deepshadow::DsmFile;

use crate::flat::Flat;
use crate::queries::{Lookup, Queries};

/// How a map file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// Positioned reads.
    Read,
    /// A memory map.
    Mapped,
}

/// What the cache counted.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stats {
    /// Tiles asked for that were there.
    pub hits: u64,
    /// Tiles that were loaded.
    pub loads: u64,
    /// The most bytes ever held.
    pub peak: usize,
}

/// The first map of a file.
#[derive(Debug)]
pub struct Shadows {
    flat: Arc<Flat>,
}

/// One thread's lookups.
#[derive(Debug)]
pub struct Sampler {
    flat: Arc<Flat>,
    lookup: Lookup,
}

impl Shadows {
    /// What tables call it.
    pub const NAME: &str = "flat stand-in";

    /// Reads a file.
    pub fn open(path: &Path, _: Source, _: usize) -> Self {
        let file = DsmFile::open(path).expect("our own file");
        Shadows {
            flat: Arc::new(Flat::of(&file)),
        }
    }

    /// A sampler for `lookup`.
    pub fn sampler(&self, lookup: Lookup) -> Sampler {
        Sampler {
            flat: self.flat.clone(),
            lookup,
        }
    }

    /// `None`: there is no cache.
    pub fn stats(&self) -> Option<Stats> {
        None
    }
}

impl Sampler {
    /// One lookup.
    #[inline(always)]
    pub fn at(&mut self, width: f32, x: f32, y: f32, z: f32) -> f32 {
        self.flat.lookup(self.lookup, width, x, y, z)
    }

    /// Sum of the answers to all queries, one by one.
    pub fn sum(&mut self, width: f32, queries: &Queries) -> f32 {
        self.flat.sum(self.lookup, width, queries)
    }

    /// The same with a cursor.
    pub fn sum_with_cursor(&mut self, width: f32, queries: &Queries) -> f32 {
        self.sum(width, queries)
    }

    /// All answers in one call.
    pub fn batch(&mut self, width: f32, queries: &Queries, out: &mut [f32]) {
        for ((x, y, z), out) in queries.iter().zip(out) {
            *out = self.at(width, x, y, z);
        }
    }
}
