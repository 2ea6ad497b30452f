//! Tiles that are looked up in place, without a copy, sound and damaged.

use crate::cache_support::{BOOKKEEPING, Model, SLOT, WAYS, nearest, pixel, row};
use deepshadow::*;

const TILES: u32 = 12;

/// A row of tiles with codec none, of 30 vertices a pixel: 12 KiB each.
fn plain() -> Vec<u8> {
    row(WAYS[0], &[30; TILES as usize])
}

/// Looks up every pixel at some depths and compares with the model.
fn check_all(file: &CachedFile, model: &Model) {
    let mut sampler = nearest(file, 0, OnError::Fail);
    for x in 0..8 * TILES {
        for y in 0..8 {
            for depth in [0.0, 1.5, 2.0, 3.0625, f32::INFINITY] {
                let answer = sampler.visibility(&pixel(0, (x, y), depth)).unwrap();
                assert_eq!(answer, model.answer(0, 0, (x, y), depth)[0]);
            }
        }
    }
}

/// The bytes that the cache holds after it has loaded all tiles.
fn cached_bytes(file: DsmFile) -> usize {
    let file = TileCache::new(1 << 30).add(file);
    check_all(&file, &Model::new(plain()));
    let stats = file.cache().stats();
    assert_eq!(stats.loads, u64::from(TILES), "each tile is checked once");
    stats.bytes
}

#[test]
fn plain_tiles_in_memory_are_not_copied() {
    let bookkeeping = TILES as usize * (SLOT + BOOKKEEPING);
    let decoded = TILES as usize * Model::new(plain()).largest();
    assert!(decoded > 10 * bookkeeping);
    if cfg!(target_endian = "little") {
        assert!(cached_bytes(DsmFile::from_bytes(plain()).unwrap()) <= bookkeeping);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    std::fs::write(&path, plain()).unwrap();
    assert!(cached_bytes(DsmFile::open(&path).unwrap()) >= decoded);
    #[cfg(all(feature = "mmap", target_endian = "little"))]
    {
        // SAFETY: only this test knows the file, and it does not write to it.
        let file = unsafe { DsmFile::open_mmap(&path) }.unwrap();
        assert!(cached_bytes(file) <= bookkeeping);
    }
}

#[test]
fn tiles_at_unaligned_addresses_are_copied_and_answer_the_same() {
    /// A file that begins at an odd address.
    struct Odd(Vec<u64>, usize);
    impl AsRef<[u8]> for Odd {
        fn as_ref(&self) -> &[u8] {
            &bytemuck::cast_slice(&self.0)[1..][..self.1]
        }
    }
    let bytes = plain();
    let mut odd = Odd(vec![0; bytes.len() / 8 + 2], bytes.len());
    bytemuck::cast_slice_mut(&mut odd.0)[1..][..bytes.len()].copy_from_slice(&bytes);
    let decoded = TILES as usize * Model::new(plain()).largest();
    assert!(cached_bytes(DsmFile::from_bytes(odd).unwrap()) >= decoded);
}

#[test]
fn a_damaged_tile_is_an_error_that_names_it_or_counts_as_lit_or_dark() {
    for way in WAYS {
        let mut bytes = row(way, &[30; TILES as usize]);
        let model = Model::new(bytes.clone());
        let sound = DsmFile::from_bytes(bytes.clone()).unwrap();
        let at = sound
            .entry(MapId(0).level(0), TileId::new(7, 0))
            .unwrap()
            .offset as usize;
        bytes[at + 40] ^= 1;
        let cache = TileCache::new(1 << 20);
        let file = cache.add(DsmFile::from_bytes(bytes).unwrap());
        let (good, bad) = (pixel(0, (8 * 6 + 7, 3), 6.0), pixel(0, (8 * 7, 3), 6.0));
        let expected = model.answer(0, 0, (8 * 6 + 7, 3), 6.0)[0];
        assert!(0.0 < expected && expected < 1.0);

        let mut sampler = nearest(&file, 0, OnError::Fail);
        for _ in 0..3 {
            let error = sampler.visibility(&bad).unwrap_err();
            assert_eq!(error.rule(), Some("TILE-CRC"), "{error}");
            let place = error.place();
            assert_eq!(
                (place.map, place.level, place.tile, place.byte),
                (Some(MapId(0)), Some(0), Some(7), Some(at as u64)),
                "{error}"
            );
            assert_eq!(sampler.visibility(&good).unwrap(), expected);
            assert_eq!(sampler.visibility_or_lit(&bad), 1.0);
        }
        assert_eq!(sampler.replaced_tiles(), 0);

        for (on_error, value) in [(OnError::Lit, 1.0), (OnError::Dark, 0.0)] {
            let mut sampler = nearest(&file, 0, on_error);
            for i in 1..=5 {
                assert_eq!(sampler.visibility(&bad).unwrap(), value);
                assert_eq!(sampler.visibility(&good).unwrap(), expected);
                assert_eq!(sampler.replaced_tiles(), i);
            }
            // A filter across both tiles uses the sound half unchanged.
            let options = SamplerOptions::default().on_error(on_error);
            let mut sampler = Sampler::with_options(&file, MapId(0), options).unwrap();
            let both = Query::new(8.0 * 7.0, 3.5, 6.0);
            let mean = (f64::from(expected) + f64::from(value)) / 2.0;
            assert!((f64::from(sampler.visibility(&both).unwrap()) - mean).abs() < 1e-6);
        }
        assert_eq!(cache.stats().loads, 2, "the damaged tile was checked once");
    }
}
