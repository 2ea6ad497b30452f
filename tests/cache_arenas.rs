//! Large caches keep tiles in arenas: right answers, full use of the budget, and memory that goes
//! back to the system.

use std::sync::Arc;
use std::time::Duration;

use crate::cache_support::{BOOKKEEPING, Model, SLOT, WAYS, nearest, pixel, row};
use crate::random::Random;
use deepshadow::*;

/// The least budget with arenas.
const BUDGET: usize = 64 << 20;

/// Bytes of an arena for that budget.
const ARENA: usize = 2 << 20;

/// The cache's bookkeeping for a tile in an arena takes fewer bytes than this.
const LENT: usize = 2 * BOOKKEEPING;

/// Tiles of a row that do not fit the budget together.
const TILES: u32 = 5000;

/// A cache and a row of tiles of 5 to 60 vertices a pixel, most of them large.
fn cached(budget: usize, tiles: u32) -> (Arc<TileCache>, CachedFile, Model) {
    let sizes: Vec<u32> = (0..tiles)
        .map(|t| 60 - 55 * u32::from(t % 4 == 0))
        .collect();
    let bytes = row(WAYS[1], &sizes);
    let cache = TileCache::new(budget);
    let file = cache.add(DsmFile::from_bytes(bytes.clone()).unwrap());
    (cache, file, Model::new(bytes))
}

/// Looks up a pixel of a tile at a depth that few pixels answer alike.
fn look(sampler: &mut Sampler, model: &Model, tile: u32) {
    let at = (8 * tile + tile % 8, tile / 8 % 8);
    let depth = 1.5 + (at.0 + at.1) as f32 / 16.0 + (tile % 16) as f32 / 64.0;
    let found = sampler.visibility(&pixel(0, at, depth)).unwrap();
    assert_eq!(found, model.answer(0, 0, at, depth)[0], "tile {tile}");
}

#[test]
fn threads_share_arenas_and_the_budget_is_kept() {
    let (cache, file, model) = cached(2 * BUDGET, TILES);
    let work = |seed: u64| {
        let (mut sampler, mut random) = (nearest(&file, 0, OnError::Fail), Random(seed));
        for _ in 0..4000 {
            look(&mut sampler, &model, random.below(TILES));
            if random.below(100) == 0 {
                sampler.release();
            }
        }
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (1..4).map(|i| scope.spawn(move || work(i))).collect();
        let mut random = Random(9);
        while threads.iter().any(|t| !t.is_finished()) {
            match random.below(4) as usize {
                0 => cache.clear(),
                n => cache.set_budget(2 * BUDGET / n),
            }
            std::thread::sleep(Duration::from_micros(300));
        }
    });
    let stats = cache.stats();
    assert!(stats.bytes <= stats.budget, "{stats}");
    drop(file);
    cache.clear();
    assert_eq!(cache.stats().bytes, 0);
}

#[test]
fn arenas_hold_nearly_as_much_as_the_budget() {
    let (cache, file, model) = cached(BUDGET, TILES);
    let all: usize = (0..TILES)
        .map(|t| file.file().tile(MapId(0).level(0), TileId::new(t, 0)))
        .map(|tile| tile.unwrap().bytes())
        .sum();
    let held = BUDGET - SLOT * TILES as usize;
    assert!(all > held * 5 / 4, "{all} bytes");
    let (mut sampler, mut random) = (nearest(&file, 0, OnError::Fail), Random(1));
    let mut misses = || {
        let before = cache.stats().misses;
        for _ in 0..10_000 {
            look(&mut sampler, &model, random.below(TILES));
            assert!(cache.stats().bytes <= BUDGET);
        }
        cache.stats().misses - before
    };
    // The first lookups fill the cache. Afterwards the share of hits is that of the tiles held.
    misses();
    let hits = 10_000 - misses();
    let least = 10_000 * (held * 8 / 10) / all;
    assert!(hits as usize > least, "{hits} hits, not {least}");
}

#[cfg(all(feature = "mmap", target_os = "linux"))]
#[test]
fn a_small_budget_uses_no_arena_and_a_falling_one_frees_them() {
    let (cache, file, model) = cached(BUDGET, 8);
    let tables = 8 * SLOT;
    let mut sampler = nearest(&file, 0, OnError::Fail);
    let bytes = || cache.stats().bytes;
    look(&mut sampler, &model, 1);
    assert!((1..LENT).contains(&(bytes() - tables - ARENA)));
    // A second tile in the same arena costs its bookkeeping only.
    let before = bytes();
    look(&mut sampler, &model, 2);
    assert!((1..LENT).contains(&(bytes() - before)));
    // A tile larger than a quarter of an arena has memory of its own.
    let slab = Visibility::mono(vec![Vertex::new(1.0, 1.0), Vertex::new(2.0, 0.25)]).unwrap();
    let mut writer = Writer::in_memory();
    let header = MapHeader::new("large", 256, 256).tile_size(256);
    let encoding = Encoding::default().mips(Mips::None).codec(Codec::Lz4);
    let map = writer.add_map(header, encoding).unwrap();
    let pixels = Pixels::Functions(vec![slab; 256 * 256]);
    writer.tile(map, TileId::new(0, 0), pixels).unwrap();
    let large = cache.add(DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap());
    let own = (large.file().tile(map.level(0), TileId::new(0, 0)))
        .unwrap()
        .bytes();
    assert!(own > ARENA / 4);
    let before = bytes();
    let query = pixel(0, (200, 100), 3.0);
    let found = nearest(&large, 0, OnError::Fail)
        .visibility(&query)
        .unwrap();
    assert_eq!(found, 0.25);
    assert!((own..own + BOOKKEEPING).contains(&(bytes() - before - SLOT)));
    drop(large);
    // The arena stays while somebody holds a tile in it.
    cache.set_budget(ARENA / 2);
    assert!((1..2 * LENT).contains(&(bytes() - tables - ARENA)));
    sampler.release();
    assert_eq!(bytes(), tables);
    look(&mut sampler, &model, 3);
    assert!(bytes() < ARENA / 2);
}
