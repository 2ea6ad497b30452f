//! Damage of every kind: no flipped bit, no cut, no failing read ever yields another picture or a panic.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::heap::LARGEST;
use crate::vectors_support::{RawFile, RawLevel, header, invalid, mono, tile_by, tiles_of, valid};
use deepshadow::raw::LevelShape;
use deepshadow::raw::TileBuilder;
use deepshadow::*;

/// About 8 KiB with everything in it: monochrome and coloured, lattice and f32, tiles of all kinds, codecs and transforms, levels, groups, attributes.
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

fn places(file: &DsmFile) -> Vec<(usize, usize, u32, u32)> {
    let mut out = Vec::new();
    for (m, map) in file.maps().iter().enumerate() {
        for (l, level) in map.levels.iter().enumerate() {
            let tiles = (0..level.shape.tiles_y())
                .flat_map(|ty| (0..level.shape.tiles_x()).map(move |tx| (tx, ty)));
            out.extend(tiles.map(|(tx, ty)| (m, l, tx, ty)));
        }
    }
    out
}

fn tiles(file: &DsmFile) -> Vec<Result<Tile>> {
    places(file)
        .into_iter()
        .map(|(m, l, tx, ty)| file.tile(MapId(m as u32).level(l as u32), TileId::new(tx, ty)))
        .collect()
}

#[test]
fn every_flipped_bit_is_found_and_none_yields_another_picture() {
    let bytes = everything();
    assert!(
        (6000..14000).contains(&bytes.len()),
        "{} bytes",
        bytes.len()
    );
    let sound = DsmFile::from_bytes(bytes.clone()).unwrap();
    sound.verify(|_| true).unwrap();
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

fn check_damaged(damaged: Vec<u8>, original: &[Tile], bit: usize) {
    let Ok(file) = DsmFile::from_bytes(damaged) else {
        return;
    };
    assert!(
        file.verify(|_| true).is_err(),
        "the full check passes over bit {bit}"
    );
    let read = tiles(&file);
    assert_eq!(read.len(), original.len(), "bit {bit} makes other maps");
    let mut refused = 0;
    for (tile, original) in read.iter().zip(original) {
        match tile {
            Ok(tile) => assert!(tile == original, "bit {bit} yields another picture"),
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 0, "reading everything passes over bit {bit}");
}

#[test]
fn every_shorter_and_longer_file_is_refused_on_opening() {
    let bytes = everything();
    for length in 0..bytes.len() {
        let error = DsmFile::from_bytes(bytes[..length].to_vec()).expect_err("cut off");
        assert_eq!(error.kind(), ErrorKind::Corrupt, "{length} bytes: {error}");
    }
    for more in 1..=64 {
        for fill in [0, 255] {
            let mut longer = bytes.clone();
            longer.resize(bytes.len() + more, fill);
            assert!(
                DsmFile::from_bytes(longer).is_err(),
                "{more} bytes of {fill} more"
            );
        }
        let mut longer = bytes.clone();
        longer.extend_from_slice(&bytes[bytes.len() - more..]);
        assert!(
            DsmFile::from_bytes(longer).is_err(),
            "its last {more} bytes twice"
        );
    }
    assert!(
        DsmFile::from_bytes([&bytes[..], &bytes[..]].concat()).is_err(),
        "twice"
    );
}

/// Bytes whose n-th read fails, as it does when the disk is gone or the file was cut off meanwhile.
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
            buffer.fill(0xAA); // what was read before it failed
            return Err(self.how.into());
        }
        buffer.copy_from_slice(&self.bytes[offset as usize..][..buffer.len()]);
        Ok(())
    }
}

#[test]
fn a_read_that_fails_is_an_error_of_the_system_and_the_next_one_works() {
    let bytes = everything();
    let hash = DsmFile::from_bytes(bytes.clone())
        .unwrap()
        .content_hash(|_| true)
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
            let verified = file.verify(|_| true);
            let hashed = file.content_hash(|_| true);
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
            // Nothing of the failure stays.
            assert_eq!(file.content_hash(|_| true).unwrap(), hash);
            failed += 1;
        }
        assert!(failed > 20, "{failed} reads");
    }
}

#[test]
fn a_file_that_is_cut_off_while_it_is_open_is_an_error_of_the_system() {
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

/// Opens and reads everything, and says what the largest single allocation was.
fn largest(bytes: &[u8], limits: Limits) -> (Option<Error>, usize) {
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
    let result = DsmFile::from_source(source, limits).and_then(|file| file.verify(|_| true));
    (result.err(), LARGEST.get())
}

#[test]
fn forged_counts_and_bombs_are_refused_before_they_are_allocated() {
    let mut limits = Limits::default();
    (limits.footer_bytes, limits.tile_bytes) = (1 << 12, 1 << 14);
    for (name, bytes) in invalid::all() {
        let (error, most) = largest(&bytes, limits);
        let error = error.unwrap_or_else(|| panic!("{name} is not refused"));
        assert!(
            matches!(
                error.kind(),
                ErrorKind::Corrupt | ErrorKind::Unsupported | ErrorKind::Limit
            ),
            "{name}: {error}"
        );
        // Contexts of zstd are not counted here: they are C's. A block of the directory may have 48 KiB.
        assert!(most <= 1 << 16, "{name}: {most} bytes at once");
    }
    // Sound files that are too large for these limits, and for smaller ones.
    for v in valid::all() {
        let (error, most) = largest(&v.bytes, limits);
        assert!(
            error.is_none_or(|e| e.kind() == ErrorKind::Limit),
            "{}",
            v.name
        );
        assert!(most <= 1 << 17, "{}: {most} bytes at once", v.name);
        let (mut footer, mut tile) = (limits, limits);
        (footer.footer_bytes, tile.tile_bytes) = (100, 16);
        assert_eq!(
            largest(&v.bytes, footer).0.map(|e| e.kind()),
            Some(ErrorKind::Limit),
            "{}",
            v.name
        );
        let error = largest(&v.bytes, tile).0;
        assert!(
            error.is_none_or(|e| e.kind() == ErrorKind::Limit),
            "{}",
            v.name
        );
    }
}

#[test]
fn a_bomb_within_the_limits_is_refused_by_its_counts() {
    // 16 MiB of zeros in some hundred bytes: as a tile they would be vertex tables that do not fit the counts.
    let bomb = zstd::bulk::compress(&vec![0; 16 << 20], 19).unwrap();
    let (entry, _) = tile_by(&small_tile(), Codec::Zstd(3), 1);
    for vertices in [entry.vertices, 1 << 21] {
        let mut entry = entry;
        entry.vertices = vertices;
        let tile = crate::vectors_support::stored(entry, 2, 1, 16 << 20, bomb.clone());
        let level = RawLevel {
            max_error: 0.0,
            tiles: vec![tile],
            directory: Codec::None,
        };
        let bytes = RawFile::of(header("map", 2, 1, 1), vec![level]).assemble();
        let (error, most) = largest(&bytes, Limits::default());
        let error = error.expect("a bomb");
        let rule = error.rule();
        assert!(
            matches!(rule, Some("TILE-STREAM" | "TILE-VERTICES")),
            "{error}"
        );
        assert!(vertices > 4 || most < 1 << 16, "{most} bytes at once");
        let mut limits = Limits::default();
        limits.tile_bytes = 1 << 20;
        assert_eq!(
            largest(&bytes, limits).0.map(|e| e.kind()),
            Some(ErrorKind::Limit)
        );
    }
}

fn small_tile() -> Tile {
    let mut builder = TileBuilder::new(2, Precision::Lattice(4));
    builder.push(&mono(&[(1.0, 0.5)]));
    builder.push(&mono(&[(1.0, 1.0), (2.0, 0.25)]));
    builder.finish()
}

const CHILD: &str = "DSM_DAMAGE_CHILD";

/// Not a test by itself: what [`a_writer_that_is_killed_leaves_the_old_file`] runs and kills.
#[test]
fn writes_slowly_when_asked_to() {
    let Some(path) = std::env::var_os(CHILD) else {
        return;
    };
    let mut writer = Writer::create(&path).unwrap();
    let begun = std::path::PathBuf::from(&path).with_extension("begun");
    writer.on_progress(move |p| {
        if p.done == 3 {
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
        .args(["--exact", "damage::writes_slowly_when_asked_to"])
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
    DsmFile::open(&path).unwrap().verify(|_| true).unwrap();
}
