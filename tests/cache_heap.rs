//! What the cache says that it holds, against what it takes from the system.

use crate::cache_support::{WAYS, nearest, pixel, row};
use crate::heap::{HELD, TIMES};
use deepshadow::*;

const TILES: u32 = 300;

/// A budget for all tiles, in buffers that the allocator of this program sees.
const BUFFERS: usize = 48 << 20;
/// A budget for all tiles in one arena, which comes from the system if it has huge pages.
const ARENAS: usize = 1 << 30;

/// A cache with a file, and a sampler that has looked into one tile, so that all that is made once is there.
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
fn the_cache_takes_no_more_than_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    // Large tiles, small ones, and some that are a single vertex.
    for (vertices, least) in [(40, 0.98), (3, 0.6), (1, 0.0)] {
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
                let (held, said) = (HELD.get(), file.cache().stats().bytes);
                (0..TILES - 1).for_each(|tile| look(&mut sampler, tile));
                let held_more = HELD.get() - held;
                let said_more = (file.cache().stats().bytes - said) as isize;
                assert!(
                    held_more <= said_more,
                    "{what}: {held_more} bytes held, {said_more} admitted"
                );
                // Neither a file in memory nor an arena is on this heap; their bookkeeping is.
                let elsewhere = budget == ARENAS || (way == WAYS[0] && source == "in memory");
                assert!(
                    elsewhere || held_more as f64 >= least * said_more as f64,
                    "{what}: {held_more} bytes held, {said_more} charged"
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
fn a_hit_allocates_nothing_and_neither_does_a_recycled_buffer() {
    for way in WAYS {
        let file = DsmFile::from_bytes(row(way, &[40; TILES as usize])).unwrap();
        let (file, mut sampler) = warm(BUFFERS, file);
        (0..TILES).for_each(|tile| look(&mut sampler, tile));
        let times = TIMES.get();
        for _ in 0..3 {
            (0..TILES).for_each(|tile| look(&mut sampler, tile));
        }
        assert_eq!(TIMES.get(), times, "hits");
        // Half of it fits: every load evicts. Its memory is that of the tile which goes.
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
