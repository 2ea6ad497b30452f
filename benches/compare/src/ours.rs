//! Lookups of this crate, through its cache: the only file that knows the API of the sampler.

use std::path::Path;
use std::sync::Arc;

use deepshadow::{
    Batch, Border, CachedFile, Cursor, DsmFile, Filter, Footprint, MapId, Query, Sampler as Inner,
    SamplerOptions, TileCache,
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
    /// Tiles that were loaded.
    pub loads: u64,
    /// The most bytes ever held.
    pub peak: usize,
}

/// The first map of a file behind a cache.
pub struct Shadows {
    cache: Arc<TileCache>,
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
            // SAFETY: the file lies in this run's own temporary folder, and nobody writes to it
            // again.
            Source::Mapped => unsafe { DsmFile::open_mmap(path) },
        };
        Self::of(file.expect("our own file"), budget)
    }

    /// A file behind a cache of `budget` bytes.
    pub fn of(file: DsmFile, budget: usize) -> Self {
        let cache = TileCache::new(budget);
        let file = cache.add(file);
        Shadows { cache, file }
    }

    /// A sampler with the filter of `lookup`.
    pub fn sampler(&self, lookup: Lookup) -> Sampler {
        let filter = match lookup {
            Lookup::Pixel => Filter::Nearest,
            Lookup::Bilinear | Lookup::Trilinear => Filter::Triangle,
            Lookup::Gaussian => Filter::Gaussian,
        };
        let options = SamplerOptions::new(filter).border(Border::Clamp);
        Sampler {
            inner: Inner::with_options(&self.file, MapId(0), options).expect("the first map"),
            cursor: Cursor::default(),
        }
    }

    /// Evicts all tiles.
    pub fn clear(&self) {
        self.cache.clear();
    }

    /// What the cache counted.
    pub fn stats(&self) -> Stats {
        let s = self.cache.stats();
        Stats {
            loads: s.loads,
            peak: s.peak_bytes,
        }
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

    /// One lookup of one channel or three.
    #[inline(always)]
    pub fn channels<const C: usize>(&mut self, width: f32, x: f32, y: f32, z: f32) -> [f32; C] {
        if C == 1 {
            return [self.at(width, x, y, z); C];
        }
        let query = Query::new(x, y, z).width(width);
        let rgb = self.inner.visibility_rgb(&query).expect("our own file");
        std::array::from_fn(|c| rgb[c])
    }

    /// Sum of the answers of `C` channels to all queries, one by one.
    pub fn sum_channels<const C: usize>(&mut self, width: f32, queries: &Queries) -> f32 {
        let all = queries.iter();
        all.map(|(x, y, z)| self.channels::<C>(width, x, y, z).iter().sum::<f32>())
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

    /// All answers of one channel or three in one call.
    pub fn batch<const C: usize>(&mut self, width: f32, queries: &Queries, out: &mut [[f32; C]]) {
        let footprint = [Footprint::Width(width)];
        let batch = Batch::new(&queries.x, &queries.y, &queries.z).footprints(&footprint);
        let out = out.as_flattened_mut();
        let answered = if C == 1 {
            self.inner.visibility_batch(&batch, out)
        } else {
            self.inner
                .visibility_rgb_batch(&batch, out.as_chunks_mut().0)
        };
        answered.expect("our own file");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flat::Flat;
    use crate::maps::Block;
    use crate::queries::Access;
    use crate::scene::{DEPTHS, Hair};
    use deepshadow::{Codec, Mips};

    #[test]
    fn lookups_through_the_cache_are_those_of_flat_arrays_also_at_the_border() {
        let block = Block::compress(32, &Hair::new(32, 2).curves(8), 0.03);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.dsm");
        std::fs::write(&path, block.write(96, 64, Mips::Full, Codec::None)).unwrap();
        let flat = Flat::<1>::of(&DsmFile::open(&path).unwrap());
        let queries = Queries::new(Access::Random, 3000, (96, 64), 0.0, DEPTHS);
        for source in [Source::Read, Source::Mapped] {
            let shadows = Shadows::open(&path, source, 20_000); // two tiles or so
            for (lookup, width) in [
                (Lookup::Pixel, 1.0),
                (Lookup::Bilinear, 1.0),
                (Lookup::Trilinear, 1.5),
                (Lookup::Trilinear, 11.0),
                (Lookup::Gaussian, 1.0),
            ] {
                let mut sampler = shadows.sampler(lookup);
                let mut out = vec![[0.0]; queries.len()];
                sampler.batch(width, &queries, &mut out);
                for ((x, y, z), [v]) in queries.iter().zip(out) {
                    let expected = flat.lookup(lookup, width, x, y, z);
                    assert!(
                        (v - expected).abs() < 1e-6,
                        "{lookup:?} {width} at {x} {y} {z}"
                    );
                }
            }
        }
    }
}
