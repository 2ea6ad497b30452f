//! Small files that ask for much memory or much work stay within the budget, in little time.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use crate::heap::{HELD, PEAK};
use crate::vectors_support::{attacks, invalid, valid};
use deepshadow::*;

const BUDGET: u64 = 64 << 20;
/// Memory that does not depend on the file: buffers of threads, contexts of codecs.
const FIXED: isize = 64 << 20;

/// Calls `work` with the file, in a thread pool of one thread. Returns what it returns, and the
/// most bytes that were held meanwhile.
fn measured<T: Send>(bytes: &[u8], work: impl FnOnce(&DsmFile) -> T + Send) -> (T, isize) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let source: Arc<dyn ReadAt> = Arc::new(Owned(bytes.to_vec()));
    pool.unwrap().install(|| {
        let start = HELD.get();
        PEAK.set(start);
        let file = DsmFile::from_source(source, Limits::default().memory(BUDGET)).unwrap();
        let result = work(&file);
        (result, PEAK.get() - start)
    })
}

/// Bytes that are read as those of a file are.
struct Owned(Vec<u8>);

impl ReadAt for Owned {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> std::io::Result<()> {
        buffer.copy_from_slice(&self.0[offset as usize..][..buffer.len()]);
        Ok(())
    }
}

/// Everything that walks over a whole file.
fn walks(file: &DsmFile) -> Vec<Result<()>> {
    let base = MapId(0).level(0);
    let calls = AtomicUsize::new(0);
    let band = || {
        let shape = file.level(base)?.shape;
        let rows = shape.tile_size.min(shape.height);
        file.band(base, [0, 0, shape.width, rows]).map(drop)
    };
    vec![
        file.verify(|_, _| true).map(drop),
        file.content_hash(|_, _| calls.fetch_add(1, Relaxed) < 5)
            .map(drop),
        file.runs(base).unwrap().try_for_each(|run| run.map(drop)),
        file.function(base, Pixel::new(0, 0)).map(drop),
        band(),
    ]
}

/// Runs every walk, checks its memory, and returns the kinds of the errors.
fn errors(name: &str, bytes: &[u8]) -> Vec<Option<ErrorKind>> {
    let start = Instant::now();
    let (results, peak) = measured(bytes, walks);
    let time = start.elapsed();
    println!("{name}: {peak} bytes, {time:?}, {results:?}");
    assert!(peak <= BUDGET as isize + FIXED, "{name}: {peak} bytes");
    assert!(time < Duration::from_secs(120), "{name}: {time:?}");
    results
        .iter()
        .map(|r| r.as_ref().err().map(Error::kind))
        .collect()
}

use ErrorKind::{Cancelled, Corrupt, Limit};

#[test]
fn tiles_that_share_bytes_are_refused_before_they_are_decoded() {
    let kinds = errors("a shared row", &attacks::shared_row(1024));
    let corrupt = Some(Corrupt);
    assert_eq!(kinds, [corrupt, corrupt, None, None, corrupt]);
}

#[test]
fn constant_tiles_take_no_memory() {
    let kinds = errors("a row of constants", &attacks::constant(1 << 20, 256));
    assert_eq!(kinds, [None, Some(Cancelled), None, None, None]);
}

#[test]
fn content_beyond_the_limit_is_refused_before_it_is_hashed() {
    let kinds = errors("2^40 constant pixels", &attacks::constant(1 << 20, 1 << 20));
    assert_eq!(kinds, [None, Some(Limit), None, None, None]);
}

#[test]
fn a_tile_beyond_the_budget_is_refused() {
    let kinds = errors("a function of 8 M steps", &attacks::huge_function(1 << 22));
    let limit = Some(Limit);
    assert_eq!(kinds, [limit, limit, None, limit, limit]);
}

#[test]
fn empty_tiles_are_walked_in_little_memory() {
    let kinds = errors("2^24 empty tiles", &attacks::empty(1 << 12));
    assert_eq!(kinds, [None, Some(Cancelled), None, None, None]);
}

#[test]
fn many_maps_take_linear_time() {
    let bytes = attacks::many_maps(1 << 13);
    let kinds = errors("many maps", &bytes);
    assert_eq!(kinds, [None, Some(Cancelled), None, None, None]);
    let file = DsmFile::from_bytes(bytes).unwrap();
    let start = Instant::now();
    let mut writer = Writer::in_memory();
    writer.on_progress(|_, _| true);
    for map in file.maps() {
        writer
            .add_map(map.header.clone(), Encoding::default())
            .unwrap();
    }
    for map in (0..file.maps().len() as u32).map(MapId) {
        let lit = Curve::lit(1);
        writer.pixel(map, Pixel::new(0, 0), &lit).unwrap();
    }
    writer.add_group(file.groups()[0].clone());
    let again = DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap();
    assert_eq!(again.groups(), file.groups());
    let merged = Join::merge(vec![("a".into(), file), ("b".into(), again)]);
    assert_eq!(merged.unwrap().headers().len(), 1 << 13);
    println!("writing and merging: {:?}", start.elapsed());
}

#[test]
fn errors_of_broken_tiles_stay_within_the_budget_of_the_cache() {
    let tiles = 1 << 17;
    let bytes = attacks::broken(tiles);
    let file = DsmFile::from_bytes(bytes).unwrap();
    let cache = TileCache::new(1 << 20);
    let mut sampler = Sampler::new(&cache.add(file), MapId(0)).unwrap();
    let held = HELD.get();
    let mut look = |tile: u32| {
        let query = Query::new(8.0 * tile as f32 + 4.5, 4.5, 1.0);
        sampler.visibility(&query).unwrap_err()
    };
    let first = look(0);
    (1..tiles).for_each(|tile| drop(look(tile)));
    // The slots take 16 bytes a tile.
    let more = HELD.get() - held;
    assert!(more <= (1 << 20) + 20 * tiles as isize, "{more} bytes");
    assert_eq!(look(0).to_string(), first.to_string());
}

#[test]
fn every_vector_stays_within_the_budget() {
    let valid = valid::all().into_iter().map(|v| (v.name, v.bytes));
    let invalid = invalid::all().into_iter();
    for (name, bytes) in invalid
        .map(|(n, b)| (n.to_string(), b))
        .chain(valid.map(|(n, b)| (n.to_string(), b)))
    {
        if DsmFile::from_bytes(bytes.clone()).is_ok() {
            errors(&name, &bytes);
        }
    }
}
