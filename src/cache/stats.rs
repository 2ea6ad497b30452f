//! Counters of the cache.

use std::fmt;
use std::time::Duration;

use super::shelf::LoadEvent;

/// Counters of a cache, or of one level of a map, and the memory of the cache. Prints as a few
/// lines.
///
/// A lookup of a tile that is remembered as broken is neither a hit nor a miss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct CacheStats {
    /// Tiles that were in the cache when a lookup needed them.
    pub hits: u64,
    /// Tiles that were not.
    pub misses: u64,
    /// Tiles that were read and decoded, failures included. The other misses waited for one of
    /// these.
    pub loads: u64,
    /// Loads of tiles that had been loaded and evicted before.
    pub redundant_loads: u64,
    /// Time spent in loads, summed over threads.
    pub loading: Duration,
    /// Bytes that the cache holds now: arenas, tiles, pinned tiles that were evicted, spare
    /// buffers, tables.
    pub bytes: usize,
    /// The most bytes that the cache ever held.
    pub peak_bytes: usize,
    /// The budget in bytes.
    pub budget: usize,
    /// Loads for which spare buffers, all too small, were freed to allocate a new one.
    pub grown: u64,
    /// Spare buffers that were cut because a tile needed less than half of them.
    pub shrunk: u64,
}

impl CacheStats {
    /// Counts a miss.
    pub(super) fn count(&mut self, event: LoadEvent) {
        self.misses += 1;
        if let LoadEvent::Loaded { again, time } = event {
            self.loads += 1;
            self.redundant_loads += u64::from(again);
            self.loading += time;
        }
    }
}

impl fmt::Display for CacheStats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let wanted = self.hits + self.misses;
        let percent = 100.0 * self.hits as f64 / wanted.max(1) as f64;
        let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
        writeln!(
            f,
            "tiles: {wanted} wanted, {} hits ({percent:.2} %), {} misses",
            self.hits, self.misses
        )?;
        writeln!(
            f,
            "loads: {}, {} of them again, {:.3} s",
            self.loads,
            self.redundant_loads,
            self.loading.as_secs_f64()
        )?;
        write!(
            f,
            "memory: {:.1} MiB now, {:.1} at most, of {:.1}; {} buffers grown, {} shrunk",
            mib(self.bytes),
            mib(self.peak_bytes),
            mib(self.budget),
            self.grown,
            self.shrunk
        )
    }
}
