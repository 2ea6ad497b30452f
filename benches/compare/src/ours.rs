//! Lookups of this crate, through its cache: the only file that knows the API of the sampler.

use std::path::Path;

use deepshadow::{
    CachedFile, Cursor, DsmFile, Filter, Query, Sampler as Inner, SamplerOptions, TileCache,
};

use crate::queries::{Lookup, Queries};

/// How a map file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// Positioned reads: tiles are decoded into the cache.
    Read,
    /// A memory map: tiles of codec `none` are looked up in place.
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

/// The first map of a file behind a cache.
#[derive(Debug)]
pub struct Shadows {
    cache: std::sync::Arc<TileCache>,
    file: CachedFile,
}

/// One thread's lookups.
pub struct Sampler {
    inner: Inner,
    cursor: Cursor,
}

impl Shadows {
    /// What tables call it.
    pub const NAME: &str = "deepshadow";

    /// Opens a file with a cache of `budget` bytes.
    pub fn open(path: &Path, source: Source, budget: usize) -> Self {
        let file = match source {
            Source::Read => DsmFile::open(path),
            // SAFETY: the file lies in this run's own temporary folder, and nobody writes to it again.
            Source::Mapped => unsafe { DsmFile::map(path) },
        };
        let cache = TileCache::new(budget);
        let file = cache.add(file.expect("our own file"));
        Shadows { cache, file }
    }

    /// A sampler with the filter of `lookup`.
    pub fn sampler(&self, lookup: Lookup) -> Sampler {
        let filter = match lookup {
            Lookup::Pixel => Filter::Nearest,
            Lookup::Bilinear | Lookup::Trilinear => Filter::Triangle,
            Lookup::Gaussian => Filter::Gaussian,
        };
        let options = SamplerOptions {
            filter,
            border: deepshadow::Border::Clamp,
            ..SamplerOptions::default()
        };
        Sampler {
            inner: Inner::with_options(&self.file, 0, options).expect("the first map"),
            cursor: Cursor::default(),
        }
    }

    /// What the cache counted; `None` where there is no cache.
    pub fn stats(&self) -> Option<Stats> {
        let s = self.cache.stats();
        Some(Stats {
            hits: s.hits,
            loads: s.loads,
            peak: s.peak_bytes,
        })
    }
}

impl Sampler {
    /// One lookup.
    #[inline(always)]
    pub fn at(&mut self, width: f32, x: f32, y: f32, z: f32) -> f32 {
        let query = Query::new(x, y, z).width(width);
        self.inner.visibility(&query).expect("our own file")
    }

    /// Sum of the answers to all queries, one by one.
    pub fn sum(&mut self, width: f32, queries: &Queries) -> f32 {
        queries
            .iter()
            .map(|(x, y, z)| self.at(width, x, y, z))
            .sum()
    }

    /// The same with a cursor.
    pub fn sum_with_cursor(&mut self, width: f32, queries: &Queries) -> f32 {
        let mut sum = 0.0;
        for (x, y, z) in queries.iter() {
            let query = Query::new(x, y, z).width(width);
            let v = self.inner.visibility_with(&mut self.cursor, &query);
            sum += v.expect("our own file");
        }
        sum
    }

    /// All answers in one call.
    pub fn batch(&mut self, width: f32, queries: &Queries, out: &mut [f32]) {
        let batch = deepshadow::Batch {
            x: &queries.x,
            y: &queries.y,
            depth: &queries.z,
            footprint: &[deepshadow::Footprint::Width(width)],
            bias: 0.0,
        };
        let answered = self.inner.visibility_batch(&batch, out);
        answered.expect("our own file");
    }
}
