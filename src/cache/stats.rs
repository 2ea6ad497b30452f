//! What the cache counts.

use std::fmt;
use std::time::Duration;

use super::account::Account;
use super::shelf::Event;
use super::sync::{AtomicU64, Ordering::Relaxed};

/// Counters of one level of one map.
#[derive(Default)]
pub(crate) struct LevelCounters {
    hits: AtomicU64,
    misses: AtomicU64,
    loads: AtomicU64,
    redundant: AtomicU64,
    nanoseconds: AtomicU64,
}

impl LevelCounters {
    pub(super) fn count(&self, event: Event) {
        self.misses.fetch_add(1, Relaxed);
        if let Event::Loaded { again, time } = event {
            self.loads.fetch_add(1, Relaxed);
            self.redundant.fetch_add(u64::from(again), Relaxed);
            self.nanoseconds.fetch_add(time.as_nanos() as u64, Relaxed);
        }
    }

    /// Adds the hits that a sampler counted.
    pub fn add_hits(&self, hits: u64) {
        self.hits.fetch_add(hits, Relaxed);
    }

    pub(super) fn stats(&self) -> LevelStats {
        LevelStats {
            hits: self.hits.load(Relaxed),
            misses: self.misses.load(Relaxed),
            loads: self.loads.load(Relaxed),
            redundant_loads: self.redundant.load(Relaxed),
            loading: Duration::from_nanos(self.nanoseconds.load(Relaxed)),
        }
    }
}

/// What the cache did for one level of one map. Lookups of a tile that is known to be broken are neither hits nor misses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LevelStats {
    /// Tiles that were there when they were wanted.
    pub hits: u64,
    /// Tiles that were not.
    pub misses: u64,
    /// Tiles read and decoded, failed ones included; the other misses waited for these.
    pub loads: u64,
    /// Loads of tiles that had been loaded before and were evicted since.
    pub redundant_loads: u64,
    /// Time spent in loads, added over threads.
    pub loading: Duration,
}

/// What a cache did and holds. Prints as a few lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct CacheStats {
    /// Tiles that were there when they were wanted.
    pub hits: u64,
    /// Tiles that were not.
    pub misses: u64,
    /// Tiles read and decoded, failed ones included.
    pub loads: u64,
    /// Loads of tiles that had been loaded before and were evicted since.
    pub redundant_loads: u64,
    /// Time spent in loads, added over threads.
    pub loading: Duration,
    /// Bytes held now: tiles, pinned ones that were evicted, spare buffers, tables.
    pub bytes: usize,
    /// The most that they ever were.
    pub peak_bytes: usize,
    /// The budget.
    pub budget: usize,
    /// Loads for which spare buffers, all too small, gave way to a new one.
    pub grown: u64,
    /// Spare buffers that were cut because a tile needed far less.
    pub shrunk: u64,
}

impl LevelStats {
    /// Adds what was done elsewhere.
    pub(super) fn add(&mut self, other: &LevelStats) {
        self.hits += other.hits;
        self.misses += other.misses;
        self.loads += other.loads;
        self.redundant_loads += other.redundant_loads;
        self.loading += other.loading;
    }
}

impl CacheStats {
    pub(super) fn new(account: &Account, levels: impl Iterator<Item = LevelStats>) -> Self {
        let mut all = LevelStats::default();
        levels.for_each(|level| all.add(&level));
        let bytes = account.bytes();
        CacheStats {
            hits: all.hits,
            misses: all.misses,
            loads: all.loads,
            redundant_loads: all.redundant_loads,
            loading: all.loading,
            bytes,
            // Another thread may have added to the one and not yet to the other.
            peak_bytes: account.peak().max(bytes),
            budget: account.budget(),
            grown: account.grown.load(Relaxed),
            shrunk: account.shrunk.load(Relaxed),
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
