//! The bytes that the cache reports, against the bytes that it allocates.

use crate::cache_support::{WAYS, nearest, pixel, row};
use crate::heap::{ALLOCATIONS, HELD};
use deepshadow::*;

const TILES: u32 = 300;

/// A budget for all tiles, in buffers from the allocator of this program, which counts them.
const BUFFERS: usize = 48 << 20;
/// A budget for all tiles in one arena, which comes from the system if it has huge pages.
const ARENAS: usize = 1 << 30;

/// A cache with a file, and a sampler that has looked up one tile: everything that is allocated
/// once has been allocated.
fn warm(budget: usize, file: DsmFile) -> (CachedFile, Sampler) {
    let file = TileCache::new(budget).add(file);
    let mut sampler = nearest(&file, 0, OnError::Fail);
    look(&mut sampler, TILES - 1);
    (file, sampler)
}

fn look(sampler: &mut Sampler, tile: u32) {
    let query = pixel(0, (8 * tile + 1, 2), f32::INFINITY);
    assert!(sampler.visibility(&query).unwrap() < 1.0);
}

#[test]
fn the_cache_allocates_no_more_than_it_reports() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    // Large tiles, small tiles, and tiles of a single vertex.
    for (vertices, least_share) in [(40, 0.98), (3, 0.6), (1, 0.0)] {
        for way in WAYS {
            let bytes = row(way, &[vertices; TILES as usize]);
            std::fs::write(&path, &bytes).unwrap();
            let sources = [
                ("read", BUFFERS),
                ("in memory", BUFFERS),
                ("read", ARENAS),
                ("in memory", ARENAS),
            ];
            for (source, budget) in sources {
                let what = format!("{vertices} vertices, {way:?}, {source}, budget {budget}");
                let file = match source {
                    "read" => DsmFile::open(&path),
                    _ => DsmFile::from_bytes(bytes.clone()),
                };
                let (file, mut sampler) = warm(budget, file.unwrap());
                let (held, reported) = (HELD.get(), file.cache().stats().bytes);
                (0..TILES - 1).for_each(|tile| look(&mut sampler, tile));
                let held_more = HELD.get() - held;
                let reported_more = (file.cache().stats().bytes - reported) as isize;
                assert!(
                    held_more <= reported_more,
                    "{what}: {held_more} bytes held, {reported_more} reported"
                );
                // A file in memory and an arena are not on this heap, but their bookkeeping is.
                let elsewhere = budget == ARENAS || (way == WAYS[0] && source == "in memory");
                assert!(
                    elsewhere || held_more as f64 >= least_share * reported_more as f64,
                    "{what}: {held_more} bytes held, {reported_more} reported"
                );
                sampler.release();
                file.cache().clear();
                let left = HELD.get() - held;
                assert!(left < 64 << 10, "{what}: {left} bytes left");
            }
        }
    }
}

#[test]
fn neither_a_hit_nor_a_recycled_buffer_allocates() {
    for way in WAYS {
        let file = DsmFile::from_bytes(row(way, &[40; TILES as usize])).unwrap();
        let (file, mut sampler) = warm(BUFFERS, file);
        (0..TILES).for_each(|tile| look(&mut sampler, tile));
        let allocations = ALLOCATIONS.get();
        for _ in 0..3 {
            (0..TILES).for_each(|tile| look(&mut sampler, tile));
        }
        assert_eq!(ALLOCATIONS.get(), allocations, "hits");
        // Half of the tiles fit, so every load evicts a tile and uses its memory.
        sampler.release();
        file.cache().set_budget(file.cache().stats().bytes / 2);
        let held = HELD.get();
        for tile in 0..TILES {
            look(&mut sampler, tile);
            sampler.release();
            let more = HELD.get() - held;
            assert!(more < 4 << 10, "{more} bytes more at tile {tile}");
        }
    }
}
