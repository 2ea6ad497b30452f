//! The cache's account of its memory: bytes, loads, evictions and recycled buffers.

use std::sync::Arc;

use crate::cache_support::{
    BOOKKEEPING, Model, SLOT, WAYS, Watched, everything, nearest, pixel, row,
};
use deepshadow::raw::CacheStats;
use deepshadow::*;

/// A cache of `budget` bytes with a row of tiles of these sizes, which must be decoded.
fn cached(budget: usize, sizes: &[u32]) -> (Arc<TileCache>, CachedFile) {
    let cache = TileCache::new(budget);
    let file = cache.add(Watched::open(row(WAYS[1], sizes)).0);
    (cache, file)
}

/// Bytes that the cache charges for the error of a broken tile.
const ERROR: usize = 1024;

fn tile_bytes(file: &CachedFile, tile: u32) -> usize {
    file.file()
        .tile(MapId(0).level(0), TileId::new(tile, 0))
        .unwrap()
        .bytes()
}

/// Looks up a pixel of a tile of the row; the sampler pins the tile.
fn look(sampler: &mut Sampler, tile: u32) {
    let query = pixel(0, (8 * tile + 3, 4), f32::INFINITY);
    assert!(sampler.visibility(&query).unwrap() < 1.0);
}

/// Looks up a pixel of a tile of the row and unpins the tile.
fn look_and_release(sampler: &mut Sampler, tile: u32) {
    look(sampler, tile);
    sampler.release();
}

#[test]
fn the_reported_bytes_are_those_of_the_tiles_and_their_bookkeeping() {
    let (cache, file) = cached(1 << 20, &[5, 9, 33]);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    assert_eq!(cache.stats().bytes, 0);
    let mut expected = 3 * SLOT;
    for tile in 0..3 {
        look(&mut sampler, tile);
        let before = expected;
        expected += tile_bytes(&file, tile);
        let bytes = cache.stats().bytes;
        let most = before + tile_bytes(&file, tile) + BOOKKEEPING;
        assert!((expected..most).contains(&bytes), "{bytes} bytes");
        expected = bytes;
        look(&mut sampler, tile);
        assert_eq!(cache.stats().bytes, bytes, "a hit allocates nothing");
    }
    sampler.release();
    assert_eq!(
        cache.stats().bytes,
        expected,
        "tiles within the budget stay"
    );
    cache.clear();
    assert_eq!(
        cache.stats().bytes,
        3 * SLOT,
        "tables stay as long as their file"
    );
    assert_eq!(cache.stats().peak_bytes, expected);
    drop((sampler, file));
    assert_eq!(cache.stats().bytes, 0);
}

#[test]
fn a_tile_larger_than_the_budget_stays_only_while_its_sampler_pins_it() {
    let sizes = [30; 17];
    for budget in [0, 100, 17 * SLOT + 1] {
        let (cache, file) = cached(budget, &sizes);
        let one = tile_bytes(&file, 0) + BOOKKEEPING;
        let unpinned = budget.max(17 * SLOT);
        let mut sampler = nearest(&file, 0, OnError::Fail);
        // A sampler pins up to eight tiles of any size; one more replaces another.
        for tile in (0..12).chain([1]) {
            for _ in 0..3 {
                look(&mut sampler, tile);
            }
            let stats = cache.stats();
            assert!(stats.bytes <= unpinned + 8 * one, "{stats}");
            assert!(stats.peak_bytes <= unpinned + 9 * one, "{stats}");
        }
        let stats = cache.stats();
        assert_eq!((stats.loads, stats.redundant_loads), (13, 1), "{stats}");
        sampler.release();
        assert!(cache.stats().bytes <= unpinned);
    }
}

#[test]
fn tiles_beyond_the_budget_are_evicted_when_they_are_unpinned() {
    let (cache, file) = cached(4 << 10, &[20; 8]);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    (0..8).for_each(|tile| look(&mut sampler, tile));
    let pinned = cache.stats();
    assert!(pinned.bytes > 8 * tile_bytes(&file, 0), "{pinned}");
    sampler.release();
    let stats = cache.stats();
    assert!(stats.bytes <= stats.budget, "{stats}");
    // The budget may also shrink while they are pinned.
    cache.set_budget(1 << 20);
    (0..8).for_each(|tile| look(&mut sampler, tile));
    cache.set_budget(4 << 10);
    drop(sampler);
    let stats = cache.stats();
    assert!(stats.bytes <= stats.budget, "{stats}");
}

#[test]
fn tables_of_lit_tiles_evict_tiles_to_stay_within_the_budget() {
    let cache = TileCache::new(0);
    let file = cache.add(Watched::open(row(WAYS[1], &[20, 20])).0);
    let lit = cache.add(Watched::open(row(WAYS[1], &[0; 40])).0);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    cache.set_budget(1 << 20);
    look_and_release(&mut sampler, 0);
    look_and_release(&mut sampler, 1);
    // The cache is full to the last byte.
    cache.set_budget(cache.stats().bytes);
    let mut other = nearest(&lit, 0, OnError::Fail);
    for tile in 0..40 {
        let query = pixel(0, (8 * tile, 0), f32::INFINITY);
        assert_eq!(other.visibility(&query).unwrap(), 1.0);
    }
    let stats = cache.stats();
    assert!(stats.bytes <= stats.budget, "{stats}");
    assert_eq!(stats.loads, 42, "{stats}");
}

#[test]
fn the_memory_of_evicted_tiles_is_used_for_the_next_ones() {
    let (cache, file) = cached(1 << 20, &[20, 20, 20, 20, 60, 5]);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    look_and_release(&mut sampler, 0);
    look_and_release(&mut sampler, 1);
    let full = cache.stats().bytes;
    cache.set_budget(full);
    // Tiles of equal size use the same memory again and again.
    for tile in [2, 3, 0, 1, 2, 3] {
        look_and_release(&mut sampler, tile);
        let stats = cache.stats();
        assert_eq!((stats.bytes, stats.grown, stats.shrunk), (full, 0, 0));
    }
    assert!(cache.stats().peak_bytes <= full + BOOKKEEPING);
    // For a larger tile, small buffers are replaced by one that is large enough.
    look_and_release(&mut sampler, 4);
    let stats = cache.stats();
    assert_eq!((stats.grown, stats.shrunk), (1, 0), "{stats}");
    // For a much smaller tile, the buffer is shrunk.
    cache.set_budget(6 * SLOT + tile_bytes(&file, 4) + BOOKKEEPING);
    look_and_release(&mut sampler, 4);
    cache.set_budget(cache.stats().bytes);
    look_and_release(&mut sampler, 5);
    let stats = cache.stats();
    assert_eq!((stats.grown, stats.shrunk), (1, 1), "{stats}");
    let small = 6 * SLOT + 2 * tile_bytes(&file, 5) + BOOKKEEPING;
    assert!(stats.bytes <= small, "{stats}");
    assert!(stats.to_string().ends_with("1 buffers grown, 1 shrunk"));
}

#[test]
fn loads_of_tiles_that_were_evicted_count_as_redundant() {
    let (cache, file) = cached(1 << 20, &[20, 20, 20]);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    look_and_release(&mut sampler, 0);
    cache.set_budget(cache.stats().bytes);
    for (tile, loads, redundant) in [
        (0, 1, 0),
        (1, 2, 0),
        (1, 2, 0),
        (0, 3, 1),
        (2, 4, 1),
        (1, 5, 2),
    ] {
        look_and_release(&mut sampler, tile);
        let stats = cache.stats();
        assert_eq!(
            (stats.loads, stats.redundant_loads),
            (loads, redundant),
            "{stats}"
        );
    }
    cache.set_budget(1 << 20);
    look_and_release(&mut sampler, 0);
    cache.clear();
    look_and_release(&mut sampler, 0);
    let stats = cache.stats();
    assert_eq!((stats.loads, stats.redundant_loads), (7, 4), "{stats}");
}

#[test]
fn the_tile_that_was_not_used_is_evicted_first() {
    let (cache, file) = cached(1 << 20, &[20; 6]);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    (0..3).for_each(|tile| look_and_release(&mut sampler, tile));
    cache.set_budget(cache.stats().bytes);
    look_and_release(&mut sampler, 3); // the clock hand passes all tiles, then evicts 0
    look_and_release(&mut sampler, 1);
    look_and_release(&mut sampler, 4); // evicts 2, because 1 was used since
    let loads = cache.stats().loads;
    for tile in [1, 3, 4] {
        look_and_release(&mut sampler, tile);
        assert_eq!(cache.stats().loads, loads, "tile {tile} was in the cache");
    }
    look_and_release(&mut sampler, 2);
    assert_eq!(cache.stats().loads, loads + 1);
}

#[test]
fn a_pinned_tile_is_not_evicted_while_there_are_others() {
    let (cache, file) = cached(1 << 20, &[20; 8]);
    let mut holder = nearest(&file, 0, OnError::Fail);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    look(&mut holder, 0);
    look_and_release(&mut sampler, 1);
    look_and_release(&mut sampler, 2);
    cache.set_budget(cache.stats().bytes);
    // Tile 0 is not used meanwhile, but evicting it would free no memory.
    (3..8).for_each(|tile| look_and_release(&mut sampler, tile));
    let stats = cache.stats();
    assert!(stats.bytes <= stats.budget, "{stats}");
    look_and_release(&mut sampler, 0);
    assert_eq!(cache.stats().loads, stats.loads);
    // Once it is unpinned, it is evicted like any other.
    holder.release();
    (1..8).for_each(|tile| look_and_release(&mut sampler, tile));
    look_and_release(&mut sampler, 0);
    assert_eq!(cache.stats().loads, stats.loads + 8);
}

#[test]
fn the_statistics_of_levels_add_up_and_outlive_their_files() {
    let bytes = everything(WAYS[2]);
    let model = Model::new(bytes.clone());
    let cache = TileCache::new(100 << 10);
    let files = [0; 2].map(|_| cache.add(Watched::open(bytes.clone()).0));
    let places = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0)];
    for (f, file) in files.iter().enumerate() {
        for (map, level) in places {
            let shape = model.shape(map, level);
            let mut sampler = nearest(file, map, OnError::Fail);
            for i in 0..500 * (f as u32 + 1) {
                let query = pixel(level, (37 * i % shape.width, i % shape.height), 4.0);
                sampler.visibility(&query).unwrap();
            }
            drop(sampler);
            let stats = file.stats(MapId(map as u32).level(level as u32)).unwrap();
            assert_eq!(stats.hits + stats.misses, 500 * (f as u64 + 1), "{stats:?}");
            assert_eq!(
                stats.loads, stats.misses,
                "with one thread, every miss loads"
            );
        }
        assert_eq!(
            file.stats(MapId(0).level(4)).unwrap_err().kind(),
            ErrorKind::Input
        );
        assert_eq!(
            file.stats(MapId(2).level(0)).unwrap_err().kind(),
            ErrorKind::Input
        );
    }
    let all = cache.stats();
    let levels: Vec<CacheStats> = files
        .iter()
        .flat_map(|f| places.map(|(m, l)| f.stats(MapId(m as u32).level(l as u32)).unwrap()))
        .collect();
    assert_eq!(all.hits, levels.iter().map(|s| s.hits).sum::<u64>());
    assert_eq!(all.misses, levels.iter().map(|s| s.misses).sum::<u64>());
    assert_eq!(all.loads, levels.iter().map(|s| s.loads).sum::<u64>());
    assert_eq!(
        all.redundant_loads,
        levels.iter().map(|s| s.redundant_loads).sum::<u64>()
    );
    assert_eq!(all.loading, levels.iter().map(|s| s.loading).sum());
    assert!(all.redundant_loads > 0 && all.hits > 0);
    drop(files);
    let after = cache.stats();
    assert_eq!(
        (
            after.hits,
            after.misses,
            after.loads,
            after.redundant_loads,
            after.loading
        ),
        (
            all.hits,
            all.misses,
            all.loads,
            all.redundant_loads,
            all.loading
        )
    );
}

#[test]
fn the_memory_of_a_dropped_file_stays_until_it_is_needed_or_cleared() {
    let (cache, file) = cached(1 << 20, &[20; 4]);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    (0..4).for_each(|tile| look(&mut sampler, tile));
    let one = tile_bytes(&file, 0);
    drop((sampler, file));
    assert_eq!(cache.stats().bytes, 4 * one);
    cache.set_budget(3 * one);
    assert_eq!(cache.stats().bytes, 3 * one);
    cache.clear();
    assert_eq!(cache.stats().bytes, 0);
}

#[test]
fn a_tile_beyond_the_limits_evicts_no_others() {
    let mut limits = Limits::default();
    limits.memory = 16 << 10;
    let bytes = row(WAYS[1], &[10, 10, 60, 10]);
    let source: Arc<dyn ReadAt> = Watched::open(bytes).1;
    let cache = TileCache::new(1 << 20);
    let file = cache.add(DsmFile::from_source(source, limits).unwrap());
    let mut sampler = nearest(&file, 0, OnError::Fail);
    [0, 1, 3]
        .into_iter()
        .for_each(|tile| look_and_release(&mut sampler, tile));
    cache.set_budget(cache.stats().bytes + BOOKKEEPING + ERROR);
    let before = cache.stats();
    for _ in 0..3 {
        let error = sampler.visibility(&pixel(0, (20, 0), 9.0)).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Limit, "{error}");
        assert_eq!(error.place().tile, Some(2), "{error}");
    }
    let after = cache.stats();
    assert!(
        after.peak_bytes <= before.bytes + BOOKKEEPING + ERROR,
        "{after}"
    );
    assert_eq!(
        after.loads,
        before.loads + 1,
        "the failed tile is not loaded again"
    );
    [0, 1, 3]
        .into_iter()
        .for_each(|tile| look_and_release(&mut sampler, tile));
    assert_eq!(
        cache.stats().loads,
        after.loads,
        "the other tiles are still in the cache"
    );
}
