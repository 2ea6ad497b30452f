//! Many threads on one cache: right answers, shared loads, errors and panics.

use std::io;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Barrier, Condvar, Mutex};
use std::thread::{scope, sleep};
use std::time::Duration;

use crate::cache_support::{
    BOOKKEEPING, Model, SLOT, WAYS, Watched, everything, nearest, pixel, row,
};
use crate::random::Random;
use deepshadow::*;

/// Usually long enough for other threads to arrive and wait; no result depends on it.
const A_WHILE: Duration = Duration::from_millis(30);

/// The offset of the bytes of a tile of a [`row`].
fn offset(file: &CachedFile, tile: u32) -> u64 {
    file.file()
        .entry(MapId(0).level(0), TileId::new(tile, 0))
        .unwrap()
        .offset
}

/// Looks up a pixel in a tile of a [`row`] with a new sampler.
fn look(file: &CachedFile, tile: u32) -> Result<f32> {
    nearest(file, 0, OnError::Fail).visibility(&pixel(0, (8 * tile + 1, 5), f32::INFINITY))
}

/// The results of `n` threads that start the same lookup at the same time.
fn together(n: usize, file: &CachedFile, tile: u32) -> Vec<std::thread::Result<Result<f32>>> {
    let barrier = Barrier::new(n);
    scope(|scope| {
        let look = || {
            barrier.wait();
            look(file, tile)
        };
        let threads: Vec<_> = (0..n).map(|_| scope.spawn(look)).collect();
        threads.into_iter().map(|t| t.join()).collect()
    })
}

#[test]
fn many_threads_get_right_answers_from_a_cache_that_is_far_too_small() {
    const THREADS: usize = 6;
    let stored: Vec<_> = WAYS.into_iter().map(everything).collect();
    let models: Vec<_> = stored.iter().cloned().map(Model::new).collect();
    let tables: usize = models.iter().map(Model::tables).sum();
    let largest = models.iter().map(Model::largest).max().unwrap();
    let room = 8 << 10;
    let cache = TileCache::new(tables + room);
    // One file is looked up in place, two are decoded.
    let files: Vec<_> = [
        DsmFile::from_bytes(stored[0].clone()).unwrap(),
        Watched::open(stored[1].clone()).0,
        Watched::open(stored[2].clone()).0,
    ]
    .into_iter()
    .map(|file| cache.add(file))
    .collect();
    let lookups = AtomicUsize::new(0);
    let work = |thread: usize| {
        let mut random = Random(thread as u64);
        for _ in 0..8 {
            let (kind, map) = (random.index(3), random.index(2));
            let mut sampler = nearest(&files[kind], map, OnError::Fail);
            let mut at = (0, 0);
            for i in 0..500 {
                let level = random.index(models[kind].levels(map));
                at = random.pixel(models[kind].shape(map, level), at);
                let depth = random.depth();
                let answer = sampler.visibility_rgb(&pixel(level, at, depth)).unwrap();
                let expected = models[kind].answer(map, level, at, depth);
                assert_eq!(answer.map(f32::to_bits), expected.map(f32::to_bits));
                if i % 100 == 99 {
                    sampler.release();
                }
                lookups.fetch_add(1, SeqCst);
            }
        }
    };
    scope(|scope| {
        let work = &work;
        let threads: Vec<_> = (0..THREADS).map(|i| scope.spawn(move || work(i))).collect();
        // Meanwhile this thread clears the cache and changes its budget.
        let mut random = Random(99);
        while threads.iter().any(|t| !t.is_finished()) {
            match random.index(3) {
                0 => cache.clear(),
                1 => cache.set_budget(tables + random.index(room)),
                _ => {
                    let stats = cache.stats();
                    assert!(stats.bytes <= stats.peak_bytes, "{stats}");
                }
            }
            sleep(Duration::from_micros(200));
        }
    });
    let stats = cache.stats();
    assert!(stats.bytes <= stats.budget, "{stats}");
    let tile = 2 * largest + BOOKKEEPING;
    let peak = tables + room + THREADS * (64 + 1) * tile;
    assert!(
        stats.peak_bytes <= peak,
        "{peak} bytes are allowed\n{stats}"
    );
    assert_eq!(stats.hits + stats.misses, lookups.into_inner() as u64);
    drop(files);
    cache.clear();
    assert_eq!(cache.stats().bytes, 0);
}

#[test]
fn a_cache_without_budget_holds_at_most_one_tile_for_each_thread() {
    const THREADS: usize = 4;
    let model = Model::new(row(WAYS[2], &[40; 24]));
    let cache = TileCache::new(0);
    let file = cache.add(Watched::open(row(WAYS[2], &[40; 24])).0);
    scope(|scope| {
        for thread in 0..THREADS {
            let file = &file;
            scope.spawn(move || {
                let mut random = Random(thread as u64);
                for _ in 0..500 {
                    look(file, random.index(24) as u32).unwrap();
                }
            });
        }
    });
    let stats = cache.stats();
    assert!(stats.bytes <= 24 * SLOT, "{stats}");
    // Each thread holds one tile, which it loads or looks up.
    let most = 24 * SLOT + THREADS * (model.largest() + BOOKKEEPING);
    assert!(
        stats.peak_bytes <= most,
        "{most} bytes are allowed\n{stats}"
    );
}

#[test]
fn threads_that_need_the_same_tile_load_it_once() {
    let (file, source) = Watched::open(row(WAYS[1], &[20, 20]));
    source.on_read(|_| {
        sleep(A_WHILE);
        Ok(())
    });
    let file = TileCache::new(1 << 20).add(file);
    let answers = together(8, &file, 0);
    assert!(answers.iter().all(|a| matches!(a, Ok(Ok(v)) if *v < 1.0)));
    assert_eq!(source.reads(offset(&file, 0)), 1);
    let stats = file.cache().stats();
    assert_eq!((stats.loads, stats.redundant_loads), (1, 0), "{stats}");
    assert_eq!(stats.hits + stats.misses, 8, "{stats}");
}

#[test]
fn threads_that_need_different_tiles_load_them_at_the_same_time() {
    let (file, source) = Watched::open(row(WAYS[1], &[20, 20, 20]));
    // No read ends before all have begun. If they come one after another, the first times out.
    let begun = (Mutex::new(0), Condvar::new());
    source.on_read(move |_| {
        let mut n = begun.0.lock().unwrap();
        *n += 1;
        begun.1.notify_all();
        let patience = Duration::from_secs(60);
        let (_n, waited) = begun.1.wait_timeout_while(n, patience, |n| *n < 3).unwrap();
        match waited.timed_out() {
            true => Err(io::ErrorKind::TimedOut.into()),
            false => Ok(()),
        }
    });
    let file = TileCache::new(0).add(file);
    scope(|scope| {
        for tile in 0..3 {
            let file = &file;
            scope.spawn(move || look(file, tile).unwrap());
        }
    });
    assert_eq!(file.cache().stats().loads, 3);
}

#[test]
fn an_io_error_reaches_every_waiting_thread_and_the_next_lookup_retries() {
    let (file, source) = Watched::open(row(WAYS[1], &[20, 20]));
    let broken = source.clone();
    broken.on_read(|_| {
        sleep(A_WHILE);
        Err(io::ErrorKind::TimedOut.into())
    });
    let file = TileCache::new(1 << 20).add(file);
    for answer in together(6, &file, 1) {
        let error = answer.expect("no panic").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Io, "{error}");
        let place = error.place();
        assert_eq!(
            (place.map, place.level, place.tile),
            (Some(MapId(0)), Some(0), Some(1)),
            "{error}"
        );
    }
    let failed = source.reads(offset(&file, 1));
    assert!((1..=6).contains(&failed));
    assert_eq!(file.cache().stats().loads, failed as u64);
    assert_eq!(
        file.cache().stats().bytes,
        2 * SLOT,
        "the cache keeps nothing of a failed load"
    );
    assert!(look(&file, 1).is_err());
    assert_eq!(
        source.reads(offset(&file, 1)),
        failed + 1,
        "the next lookup reads again"
    );
    source.on_read(|_| Ok(()));
    assert!(look(&file, 1).unwrap() < 1.0);
    assert_eq!(file.cache().stats().redundant_loads, 0);
}

#[test]
fn a_damaged_tile_is_read_again_only_after_its_error_was_evicted() {
    let mut bytes = row(WAYS[2], &[20, 20]);
    let at = DsmFile::from_bytes(bytes.clone()).unwrap();
    let at = at
        .entry(MapId(0).level(0), TileId::new(1, 0))
        .unwrap()
        .offset;
    bytes[at as usize + 5] ^= 4;
    let (file, source) = Watched::open(bytes);
    source.on_read(|_| {
        sleep(A_WHILE);
        Ok(())
    });
    let cache = TileCache::new(1 << 20);
    let file = cache.add(file);
    for loads in 1..3 {
        for _ in 0..3 {
            for answer in together(4, &file, 1) {
                let error = answer.expect("no panic").unwrap_err();
                assert_eq!(error.rule(), Some("TILE-CRC"), "{error}");
                assert_eq!(error.place().tile, Some(1), "{error}");
            }
        }
        assert_eq!(source.reads(at), loads);
        assert_eq!(cache.stats().loads, loads as u64);
        cache.clear();
    }
    assert!(look(&file, 0).unwrap() < 1.0);
    drop(file);
    cache.clear();
    assert_eq!(cache.stats().bytes, 0);
}

#[test]
fn a_panic_in_a_read_affects_only_the_thread_that_reads() {
    let (file, source) = Watched::open(row(WAYS[1], &[20, 20]));
    let first = AtomicBool::new(true);
    source.on_read(move |_| {
        sleep(A_WHILE);
        if first.swap(false, SeqCst) {
            resume_unwind(Box::new("a panic without a message"));
        }
        Ok(())
    });
    let cache = TileCache::new(1 << 20);
    let file = cache.add(file);
    let answers = together(6, &file, 0);
    let (fine, panicked): (Vec<_>, Vec<_>) = answers.into_iter().partition(|a| a.is_ok());
    assert_eq!(panicked.len(), 1);
    assert!(fine.iter().all(|a| matches!(a, Ok(Ok(v)) if *v < 1.0)));
    assert_eq!(
        source.reads(offset(&file, 0)),
        2,
        "one of the waiting threads loads"
    );
    let bytes = cache.stats().bytes;
    let tile = file
        .file()
        .tile(MapId(0).level(0), TileId::new(0, 0))
        .unwrap()
        .bytes();
    assert!(bytes <= 2 * SLOT + tile + BOOKKEEPING, "{bytes} bytes");
    assert!(look(&file, 0).unwrap() < 1.0 && look(&file, 1).unwrap() < 1.0);
    drop(file);
    cache.clear();
    assert_eq!(cache.stats().bytes, 0);
}

#[test]
fn an_open_file_that_is_truncated_yields_errors_that_name_the_tile() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    for way in WAYS {
        let bytes = row(way, &[20; 6]);
        std::fs::write(&path, &bytes).unwrap();
        let file = TileCache::new(1 << 20).add(DsmFile::open(&path).unwrap());
        look(&file, 0).unwrap();
        look(&file, 5).unwrap();
        let cut = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        cut.set_len(offset(&file, 3) + 8).unwrap();
        for _ in 0..2 {
            for tile in [3, 4] {
                let error = look(&file, tile).unwrap_err();
                assert_eq!(error.kind(), ErrorKind::Io, "{error}");
                assert_eq!(error.place().tile, Some(tile.into()), "{error}");
            }
        }
        // Tiles before the cut, and tile 5, which is in the cache, are as before.
        assert!(
            [0, 1, 2, 5]
                .into_iter()
                .all(|tile| look(&file, tile).is_ok())
        );
        std::fs::write(&path, &bytes).unwrap();
        assert!(look(&file, 3).unwrap() < 1.0, "the file is whole again");
    }
}
