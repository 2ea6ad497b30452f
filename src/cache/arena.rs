//! Memory for many tiles in few large allocations, which the system maps with huge pages.
//!
//! A random lookup in a large cache misses the processor's address cache once for every page of
//! 4 KiB that it touches. Pages of 2 MiB make lookups in 1 GiB of tiles 15 to 40 % faster. The
//! system maps memory with huge pages only where 2 MiB of it are aligned and in one piece, so
//! tiles share *arenas*: each tile takes a range of one arena.
//!
//! [`Arenas`] finds the smallest free range that holds a tile and cuts the tile off its front. A
//! range that is returned merges with free neighbours. An arena is allocated and freed as a whole,
//! and all of it counts as held meanwhile.

use std::collections::{BTreeMap, BTreeSet};

/// Ranges begin at multiples of this many words, a line of the processor's cache.
const ALIGN: usize = 8;

/// Arenas with their free ranges.
#[derive(Default)]
pub(super) struct Arenas {
    regions: BTreeMap<u64, Region>,
    next: u64,
    /// Free ranges: arena and first word, to number of words. No two of them touch.
    free: BTreeMap<(u64, usize), usize>,
    /// The same: number of words, arena, first word.
    by_size: BTreeSet<(usize, u64, usize)>,
}

/// A range of an arena that is in use.
#[derive(Debug)]
pub(super) struct Range {
    arena: u64,
    start: usize,
    words: usize,
    memory: *mut u64,
}

// SAFETY: a range is the only way to its words, and stands for an exclusive reference to them.
unsafe impl Send for Range {}
// SAFETY: as above; a shared range only lends shared references.
unsafe impl Sync for Range {}

impl Range {
    pub fn words(&self) -> &[u64] {
        // SAFETY: `Arenas` made the range from `words` initialised words of a region, gives them to
        // no other range, and keeps the region until the range comes back.
        unsafe { std::slice::from_raw_parts(self.memory, self.words) }
    }

    pub fn words_mut(&mut self) -> &mut [u64] {
        // SAFETY: as in `words`; `self` is borrowed exclusively.
        unsafe { std::slice::from_raw_parts_mut(self.memory, self.words) }
    }
}

impl Arenas {
    /// Adds an arena of `bytes`, a multiple of 64; whether the system had the memory.
    pub fn grow(&mut self, bytes: usize) -> bool {
        let Some(region) = Region::new(bytes) else {
            return false;
        };
        let (arena, words) = (self.next, bytes / 8);
        self.next += 1;
        self.regions.insert(arena, region);
        self.insert(arena, 0, words);
        true
    }

    /// A range of at least `words`, from the smallest free range that holds them.
    ///
    /// # Safety
    /// The range must come back through [`Arenas::put`] of the same arenas, or these must never be
    /// dropped.
    pub unsafe fn take(&mut self, words: usize) -> Option<Range> {
        let words = words.next_multiple_of(ALIGN);
        let &(size, arena, start) = self.by_size.range((words, 0, 0)..).next()?;
        self.remove(arena, start, size);
        if size > words {
            self.insert(arena, start + words, size - words);
        }
        Some(Range {
            arena,
            start,
            words,
            memory: self.regions[&arena].word(start),
        })
    }

    /// Takes a range back. Returns the bytes of its arena if all of it is free now.
    pub fn put(&mut self, range: Range) -> Option<usize> {
        let Range { arena, .. } = range;
        let (mut start, mut words) = (range.start, range.words);
        let before = self.free.range(..(arena, start)).next_back();
        if let Some((&(other, first), &size)) = before
            && other == arena
            && first + size == start
        {
            self.remove(arena, first, size);
            (start, words) = (first, size + words);
        }
        if let Some(&size) = self.free.get(&(arena, start + words)) {
            self.remove(arena, start + words, size);
            words += size;
        }
        self.insert(arena, start, words);
        let bytes = self.regions[&arena].bytes;
        (8 * words == bytes).then_some(bytes)
    }

    /// Gives one arena without a range in use back to the system; returns its bytes.
    pub fn shrink(&mut self) -> Option<usize> {
        let whole = |(&arena, region): (&u64, &Region)| {
            let words = region.bytes / 8;
            (self.free.get(&(arena, 0)) == Some(&words)).then_some((arena, words))
        };
        let (arena, words) = self.regions.iter().find_map(whole)?;
        self.remove(arena, 0, words);
        self.regions.remove(&arena);
        Some(8 * words)
    }

    fn insert(&mut self, arena: u64, start: usize, words: usize) {
        self.free.insert((arena, start), words);
        self.by_size.insert((words, arena, start));
    }

    fn remove(&mut self, arena: u64, start: usize, words: usize) {
        self.free.remove(&(arena, start));
        self.by_size.remove(&(words, arena, start));
    }
}

/// Zeroed memory for an arena.
struct Region {
    memory: *mut u64,
    bytes: usize,
    _owner: Owner,
}

#[cfg(all(feature = "mmap", target_os = "linux"))]
type Owner = memmap2::MmapMut;
#[cfg(not(all(feature = "mmap", target_os = "linux")))]
type Owner = Vec<u64>;

impl Region {
    /// Memory in huge pages, if the system grants them.
    #[cfg(all(feature = "mmap", target_os = "linux"))]
    fn new(bytes: usize) -> Option<Region> {
        /// Size and alignment of a huge page.
        const HUGE: usize = 2 << 20;
        // Pages that nobody touches take no memory, so that the cut at both ends is free.
        let mut map = memmap2::MmapMut::map_anon(bytes + HUGE).ok()?;
        let offset = map.as_ptr().align_offset(HUGE);
        // Without huge pages the arena works as well, but slower.
        let _ = map.advise_range(memmap2::Advice::HugePage, offset, bytes);
        Some(Region {
            memory: map[offset..][..bytes].as_mut_ptr().cast(),
            bytes,
            _owner: map,
        })
    }

    #[cfg(not(all(feature = "mmap", target_os = "linux")))]
    fn new(bytes: usize) -> Option<Region> {
        let mut words = vec![0; bytes / 8];
        Some(Region {
            memory: words.as_mut_ptr(),
            bytes,
            _owner: words,
        })
    }

    fn word(&self, i: usize) -> *mut u64 {
        assert!(8 * i < self.bytes);
        // SAFETY: asserted.
        unsafe { self.memory.add(i) }
    }
}

// SAFETY: a region owns its memory, like a box; only ranges read and write it.
unsafe impl Send for Region {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    impl Arenas {
        /// Checks that ranges in use and free ones cover all arenas without overlap, and that free
        /// ranges do not touch. Returns the bytes that are held.
        fn check(&self, used: &[Range]) -> usize {
            let free = self.free.iter().map(|(&(a, s), &n)| (a, s, n, true));
            let used = used.iter().map(|r| (r.arena, r.start, r.words, false));
            let mut all: Vec<_> = free.chain(used).collect();
            all.sort_unstable();
            let mut ends: BTreeMap<u64, (usize, bool)> = BTreeMap::new();
            for (arena, start, words, is_free) in all {
                let (end, was_free) = ends
                    .insert(arena, (start + words, is_free))
                    .unwrap_or_default();
                assert_eq!(start, end, "a gap or an overlap in arena {arena}");
                assert!(!(is_free && was_free), "free neighbours in arena {arena}");
            }
            assert_eq!(ends.len(), self.regions.len());
            for (arena, (end, _)) in ends {
                assert_eq!(8 * end, self.regions[&arena].bytes);
            }
            let by_size: BTreeSet<_> = self.free.iter().map(|(&(a, s), &n)| (n, a, s)).collect();
            assert_eq!(by_size, self.by_size);
            self.regions.values().map(|region| region.bytes).sum()
        }
    }

    /// One step of a random test of arenas.
    #[derive(Clone, Debug)]
    enum Step {
        Grow(usize),
        Take(usize),
        Put(usize),
        Shrink,
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            1 => (1usize..40).prop_map(|n| Step::Grow(64 * n)),
            8 => (1usize..120).prop_map(Step::Take),
            6 => any::<usize>().prop_map(Step::Put),
            1 => Just(Step::Shrink),
        ]
    }

    proptest! {
        #[test]
        fn ranges_never_overlap_and_all_bytes_come_back(
            steps in prop::collection::vec(step(), 1..200),
        ) {
            let mut arenas = Arenas::default();
            let (mut used, mut held, mut stamp) = (Vec::<(u64, Range)>::new(), 0, 0u64);
            for step in steps {
                match step {
                    Step::Grow(bytes) => {
                        prop_assert!(arenas.grow(bytes));
                        held += bytes;
                    }
                    Step::Take(words) => {
                        // SAFETY: all ranges come back below.
                        let range = unsafe { arenas.take(words) };
                        let largest = arenas.by_size.last().map_or(0, |&(n, ..)| n);
                        let Some(mut range) = range else {
                            prop_assert!(largest < words.next_multiple_of(ALIGN));
                            continue;
                        };
                        prop_assert!((words..words + ALIGN).contains(&range.words().len()));
                        stamp += 1;
                        range.words_mut().fill(stamp);
                        used.push((stamp, range));
                    }
                    Step::Put(_) if used.is_empty() => {}
                    Step::Put(i) => {
                        let (stamp, range) = used.swap_remove(i % used.len());
                        let own = range.words().iter().all(|&w| w == stamp);
                        prop_assert!(own, "another wrote here");
                        let arena = range.arena;
                        let empty = arenas.put(range);
                        let busy = used.iter().any(|(_, r)| r.arena == arena);
                        prop_assert_eq!(empty.is_none(), busy);
                    }
                    Step::Shrink => {
                        let freed = arenas.shrink();
                        let idle = |a: &&u64| used.iter().all(|(_, r)| r.arena != **a);
                        prop_assert!(freed.is_some() || !arenas.regions.keys().any(|a| idle(&a)));
                        held -= freed.unwrap_or(0);
                    }
                }
                let (stamps, ranges): (Vec<_>, Vec<_>) = used.drain(..).unzip();
                prop_assert_eq!(arenas.check(&ranges), held);
                used = stamps.into_iter().zip(ranges).collect();
            }
            for (_, range) in used {
                arenas.put(range);
            }
            while let Some(bytes) = arenas.shrink() {
                held -= bytes;
            }
            prop_assert_eq!((held, arenas.regions.len(), arenas.free.len()), (0, 0, 0));
        }
    }

    #[test]
    fn a_tile_takes_the_smallest_range_that_holds_it() {
        let mut arenas = Arenas::default();
        assert!(arenas.grow(8 * 100 * ALIGN));
        // SAFETY: all ranges come back below.
        let take = |arenas: &mut Arenas, lines: usize| unsafe { arenas.take(lines * ALIGN) };
        let ranges = [10, 1, 5, 1, 20].map(|n| take(&mut arenas, n).unwrap());
        let [a, b, c, d, e] = ranges;
        let starts = [&a, &c, &e].map(|r| r.start);
        for range in [a, c, e] {
            assert_eq!(arenas.put(range), None);
        }
        // The end of the arena was free already, so the last range merged with it.
        let [f, g, h] = [4, 6, 21].map(|n| take(&mut arenas, n).unwrap());
        assert_eq!(
            [f.start, g.start, h.start],
            [starts[1], starts[0], starts[2]]
        );
        assert!(take(&mut arenas, 63).is_none());
        for range in [b, d, f, g] {
            assert_eq!(arenas.put(range), None);
        }
        assert_eq!(arenas.shrink(), None);
        assert_eq!(arenas.put(h), Some(8 * 100 * ALIGN));
        assert_eq!(arenas.shrink(), Some(8 * 100 * ALIGN));
    }

    #[cfg(all(feature = "mmap", target_os = "linux"))]
    #[test]
    fn arenas_begin_at_huge_pages() {
        let mut arenas = Arenas::default();
        assert!(arenas.grow(4 << 20) && arenas.grow(2 << 20));
        for words in [4, 2].map(|mib| mib << 17) {
            // SAFETY: the range comes back in the next line but one.
            let range = unsafe { arenas.take(words) }.unwrap();
            assert_eq!(range.memory.align_offset(2 << 20), 0);
            assert!(range.words().iter().all(|&w| w == 0));
            arenas.put(range);
        }
    }
}
