//! Damaged files: no flipped bit, no cut and no failing read yields another picture or a panic.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::fuzz_replay::naive;
use crate::heap::LARGEST;
use crate::random::Random;
use crate::support::tile_ids;
use crate::vectors_support::{
    RawFile, RawLevel, header, invalid, mono, stored, tile_by, tiles_of, valid,
};
use deepshadow::raw::directory::{Entry, TileKind};
use deepshadow::raw::{LevelShape, Precision, TileBuilder};
use deepshadow::*;

/// A file of about 8 KiB with everything that the format offers.
///
/// Mono and coloured maps, lattice and f32 values, tiles of all kinds, codecs and transforms,
/// levels, groups and attributes.
fn everything() -> Vec<u8> {
    let mut file = RawFile::default();
    let ways = [
        (Codec::None, 0),
        (Codec::Lz4, 1),
        (Codec::Zstd(3), 1),
        (Codec::None, 1),
        (Codec::Zstd(3), 0),
    ];
    let h = header("mono", 40, 16, 1);
    let shape = LevelShape::of(&h, 0);
    let mut tiles = Vec::new();
    for ty in 0..2 {
        for tx in 0..5u32 {
            let mut builder = TileBuilder::new(8, Precision::Lattice(64));
            for i in 0..64u32 {
                builder.push(&match (tx, ty) {
                    (1, 1) => Visibility::lit(),
                    (3, 0) => mono(&[(2.5, 0.25)]),
                    _ => valid::mixed_mono(i % 8 + tx, i / 8),
                });
            }
            let (codec, transform) = ways[(tx + ty) as usize % ways.len()];
            tiles.push(tile_by(&builder.finish(), codec, transform));
        }
    }
    assert_eq!(tiles.len() as u64, shape.tiles());
    file.maps.push((
        h,
        vec![RawLevel {
            max_error: 0.0,
            tiles,
            directory: Codec::Zstd(3),
        }],
    ));
    let mut h = header("colour", 11, 9, 3);
    h.attributes = vec![("note".into(), "of the map".into())];
    h.camera.camera_from_world = Some([0.5; 16]);
    let levels = (0..4).map(|l| RawLevel {
        max_error: 0.125,
        tiles: tiles_of(
            LevelShape::of(&h, l),
            Precision::F32,
            ways[l as usize],
            |x, y| match (x + l) % 2 {
                0 => valid::mixed_rgb(x, y),
                _ => valid::off_lattice(x, y),
            },
        ),
        directory: [Codec::None, Codec::Lz4][l as usize % 2],
    });
    let levels = levels.collect();
    file.maps.push((h, levels));
    file.groups = vec![Group::new(
        "both",
        GroupRole::Clusters,
        vec![MapId(1), MapId(0)],
    )];
    file.attributes = vec![
        ("owner".into(), "nobody".into()),
        ("n".into(), Attribute::Integers(vec![7])),
    ];
    file.optional_features = 2;
    file.assemble()
}

/// Reads all tiles of a file.
fn tiles(file: &DsmFile) -> Vec<Result<Tile>> {
    let ids = tile_ids(file).into_iter();
    ids.map(|(level, tile)| file.tile(level, tile)).collect()
}

#[test]
fn every_flipped_bit_is_found_and_none_changes_a_tile() {
    let bytes = everything();
    assert!(
        (6000..14000).contains(&bytes.len()),
        "{} bytes",
        bytes.len()
    );
    let sound = DsmFile::from_bytes(bytes.clone()).unwrap();
    sound.verify(|_, _| true).unwrap();
    let original: Vec<Tile> = tiles(&sound).into_iter().map(|t| t.unwrap()).collect();
    let workers = std::thread::available_parallelism().map_or(1, |n| n.get());
    std::thread::scope(|scope| {
        for worker in 0..workers {
            let (bytes, original) = (&bytes, &original);
            scope.spawn(move || {
                for bit in (worker..8 * bytes.len()).step_by(workers) {
                    let mut damaged = bytes.clone();
                    damaged[bit / 8] ^= 1 << (bit % 8);
                    check_damaged(damaged, original, bit);
                }
            });
        }
    });
}

/// Checks that the damage is found and that each tile is either refused or as before.
fn check_damaged(damaged: Vec<u8>, original: &[Tile], bit: usize) {
    let Ok(file) = DsmFile::from_bytes(damaged) else {
        return;
    };
    assert!(file.verify(|_, _| true).is_err(), "verify misses bit {bit}");
    let read = tiles(&file);
    assert_eq!(
        read.len(),
        original.len(),
        "bit {bit} changes the number of tiles"
    );
    let mut refused = 0;
    for (tile, original) in read.iter().zip(original) {
        match tile {
            Ok(tile) => assert!(tile == original, "bit {bit} changes a tile"),
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 0, "reading all tiles misses bit {bit}");
}

#[test]
fn every_shorter_and_longer_file_is_refused_on_opening() {
    let bytes = everything();
    for length in 0..bytes.len() {
        let error = DsmFile::from_bytes(bytes[..length].to_vec()).expect_err("truncated");
        assert_eq!(error.kind(), ErrorKind::Corrupt, "{length} bytes: {error}");
    }
    for more in 1..=64 {
        for fill in [0, 255] {
            let mut longer = bytes.clone();
            longer.resize(bytes.len() + more, fill);
            assert!(
                DsmFile::from_bytes(longer).is_err(),
                "{more} bytes of {fill} appended"
            );
        }
        let mut longer = bytes.clone();
        longer.extend_from_slice(&bytes[bytes.len() - more..]);
        assert!(
            DsmFile::from_bytes(longer).is_err(),
            "its last {more} bytes appended"
        );
    }
    assert!(
        DsmFile::from_bytes([&bytes[..], &bytes[..]].concat()).is_err(),
        "the whole file appended"
    );
}

/// Bytes whose n-th read fails, as it does when a disk is removed or a file is truncated.
struct Failing {
    bytes: Vec<u8>,
    reads: AtomicUsize,
    fails: AtomicUsize,
    how: io::ErrorKind,
}

impl ReadAt for Failing {
    fn length(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        if self.reads.fetch_add(1, Ordering::Relaxed) == self.fails.load(Ordering::Relaxed) {
            buffer.fill(0xAA); // a partial read
            return Err(self.how.into());
        }
        buffer.copy_from_slice(&self.bytes[offset as usize..][..buffer.len()]);
        Ok(())
    }
}

#[test]
fn a_failed_read_is_an_io_error_and_the_next_one_succeeds() {
    let bytes = everything();
    let hash = DsmFile::from_bytes(bytes.clone())
        .unwrap()
        .content_hash(|_, _| true)
        .unwrap();
    for how in [
        io::ErrorKind::Other,
        io::ErrorKind::UnexpectedEof,
        io::ErrorKind::PermissionDenied,
    ] {
        let mut failed = 0;
        for n in 0.. {
            let source = Arc::new(Failing {
                bytes: bytes.clone(),
                reads: AtomicUsize::new(0),
                fails: AtomicUsize::new(n),
                how,
            });
            let file = match DsmFile::from_source(source.clone(), Limits::default()) {
                Ok(file) => file,
                Err(e) => {
                    assert_eq!(e.kind(), ErrorKind::Io, "read {n}: {e}");
                    failed += 1;
                    continue;
                }
            };
            let verified = file.verify(|_, _| true);
            let hashed = file.content_hash(|_, _| true);
            if source.reads.load(Ordering::Relaxed) <= n {
                verified.unwrap();
                assert_eq!(hashed.unwrap(), hash);
                break;
            }
            let errors = [verified.err(), hashed.err()];
            assert!(
                errors.iter().flatten().count() == 1,
                "read {n} failed: {errors:?}"
            );
            errors
                .iter()
                .flatten()
                .for_each(|e| assert_eq!(e.kind(), ErrorKind::Io, "read {n}: {e}"));
            // The failure leaves no trace.
            assert_eq!(file.content_hash(|_, _| true).unwrap(), hash);
            failed += 1;
        }
        assert!(failed > 20, "{failed} reads");
    }
}

#[test]
fn an_open_file_that_is_truncated_yields_io_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    let bytes = everything();
    for length in [0, 63, 64, 100, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes).unwrap();
        let file = DsmFile::open(&path).unwrap();
        std::fs::OpenOptions::new()
            .write(true)
            .open(&path)
            .unwrap()
            .set_len(length as u64)
            .unwrap();
        for tile in tiles(&file) {
            if let Err(e) = tile {
                assert_eq!(e.kind(), ErrorKind::Io, "{length} bytes: {e}");
            }
        }
    }
}

/// Verifies a file; returns its error and the size of the largest single allocation.
fn verify_and_measure(bytes: &[u8], limits: Limits) -> (Option<Error>, usize) {
    struct Borrowed(Vec<u8>);
    impl ReadAt for Borrowed {
        fn length(&self) -> u64 {
            self.0.len() as u64
        }
        fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
            buffer.copy_from_slice(&self.0[offset as usize..][..buffer.len()]);
            Ok(())
        }
    }
    let source = Arc::new(Borrowed(bytes.to_vec()));
    LARGEST.set(0);
    let result = DsmFile::from_source(source, limits).and_then(|file| file.verify(|_, _| true));
    (result.err(), LARGEST.get())
}

#[test]
fn forged_counts_and_bombs_are_refused_before_they_are_allocated() {
    let limits = Limits::default().memory(1 << 16);
    for (name, bytes) in invalid::all() {
        let (error, most) = verify_and_measure(&bytes, limits);
        let error = error.unwrap_or_else(|| panic!("{name} is not refused"));
        assert!(
            matches!(
                error.kind(),
                ErrorKind::Corrupt | ErrorKind::Unsupported | ErrorKind::Limit
            ),
            "{name}: {error}"
        );
        // The contexts of zstd are allocated in C and not counted. A directory block may have
        // 48 KiB.
        assert!(most <= 1 << 16, "{name}: {most} bytes at once");
    }
    // Valid files: some exceed these limits, all exceed a smaller one.
    for v in valid::all() {
        let (error, most) = verify_and_measure(&v.bytes, limits);
        assert!(
            error.is_none_or(|e| e.kind() == ErrorKind::Limit),
            "{}",
            v.name
        );
        assert!(most <= 1 << 17, "{}: {most} bytes at once", v.name);
        let small = limits.memory(100);
        assert_eq!(
            verify_and_measure(&v.bytes, small).0.map(|e| e.kind()),
            Some(ErrorKind::Limit),
            "{}",
            v.name
        );
    }
}

#[test]
fn a_bomb_within_the_limits_is_refused_by_its_counts() {
    // 16 MiB of zeros in a few hundred bytes. As a tile they are vertex tables that do not match
    // the vertex counts.
    let bomb = zstd::bulk::compress(&vec![0; 16 << 20], 19).unwrap();
    let (entry, _) = tile_by(&small_tile(), Codec::Zstd(3), 1);
    for vertices in [entry.vertices, 1 << 21] {
        let mut entry = entry;
        entry.vertices = vertices;
        let tile = stored(entry, 2, 1, 16 << 20, bomb.clone());
        let level = RawLevel {
            max_error: 0.0,
            tiles: vec![tile],
            directory: Codec::None,
        };
        let bytes = RawFile::of(header("map", 2, 1, 1), vec![level]).assemble();
        let (error, most) = verify_and_measure(&bytes, Limits::default());
        let error = error.expect("a bomb");
        assert_eq!(error.rule(), Some("TILE-STREAM"), "{error}");
        assert!(most < 1 << 16, "{most} bytes at once");
        // The rule is named even where the limit is lower.
        let limits = Limits::default().memory(1 << 20);
        let error = verify_and_measure(&bytes, limits).0;
        assert_eq!(error.expect("a bomb").rule(), Some("TILE-STREAM"));
    }
}

fn small_tile() -> Tile {
    let mut builder = TileBuilder::new(2, Precision::Lattice(4));
    builder.push(&mono(&[(1.0, 0.5)]));
    builder.push(&mono(&[(1.0, 1.0), (2.0, 0.25)]));
    builder.finish()
}

const CHILD: &str = "DSM_DAMAGE_CHILD";

/// The child process of [`a_writer_that_is_killed_leaves_the_old_file`]; does nothing by itself.
#[test]
fn child_writes_slowly() {
    let Some(path) = std::env::var_os(CHILD) else {
        return;
    };
    let mut writer = Writer::create(&path).unwrap();
    let begun = std::path::PathBuf::from(&path).with_extension("begun");
    writer.on_progress(move |done, _| {
        if done == 3 {
            std::fs::write(&begun, b"").unwrap();
        }
        std::thread::sleep(Duration::from_millis(20));
        true
    });
    let map = writer
        .add_map(header("map", 8, 1 << 16, 1), Encoding::default())
        .unwrap();
    for y in 0..1 << 16 {
        for x in 0..8 {
            writer
                .pixel(
                    map,
                    Pixel::new(x, y),
                    &Curve::mono(vec![1.0 + y as f32, 1.5 + (x + y) as f32], vec![0.75, 0.5])
                        .unwrap(),
                )
                .unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn a_writer_that_is_killed_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    let old = everything();
    std::fs::write(&path, &old).unwrap();
    let mut child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "damage::child_writes_slowly"])
        .env(CHILD, &path)
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !path.with_extension("begun").exists() {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "the writer never began"
        );
        assert!(
            child.try_wait().unwrap().is_none(),
            "the writer ended by itself"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap(); // SIGKILL
    child.wait().unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), old);
    DsmFile::open(&path).unwrap().verify(|_, _| true).unwrap();
}

#[test]
fn lz4_blocks_are_refused_where_a_strict_decoder_refuses_them() {
    let mut random = Random(11);
    let (mut good, mut bad) = (0, 0);
    for _ in 0..20_000 {
        // Bytes with many repetitions, and a block of them that is changed in up to two places.
        let letters = 1 + random.below(4) as u8;
        let size = 1 + random.index(60);
        let content: Vec<u8> = (0..size)
            .map(|_| random.below(256) as u8 % letters)
            .collect();
        let mut block = lz4_flex::block::compress(&content);
        assert_eq!(naive::lz4(&block), Some(content.clone()));
        for _ in 0..random.below(3) {
            let at = random.index(block.len());
            match random.below(3) {
                0 => block[at] = [0, 1, 4, 5, 16, 80, 240, 255][random.index(8)],
                1 => block.insert(at, random.below(4) as u8),
                _ => _ = block.remove(at),
            }
            if block.is_empty() {
                block.push(0);
            }
        }
        let expected = naive::lz4(&block).filter(|bytes| bytes.len() == size);
        // Wrapped in a tile of more vertices than any size allows: only its counts can tell, so the
        // bytes are decoded first.
        let entry = Entry {
            kind: TileKind::Data,
            vertices: u32::MAX,
            ..Entry::default()
        };
        let (entry, payload) = stored(entry, 1, 1, size, block);
        let error = Tile::decode(&entry, &payload, (1, 1), 1 << 20).err();
        let is_refused = error.is_some_and(|e| e.rule() == Some("TILE-CODEC"));
        assert_eq!(is_refused, expected.is_none(), "{payload:?}");
        if expected.is_some() {
            good += 1
        } else {
            bad += 1
        }
    }
    assert!(good > 5000 && bad > 5000, "{good} {bad}");
}
