//! Whole files: every level stays within its maximum error, whatever the order of tiles, the codec
//! and the source.

use crate::random::Random;
use crate::support::{file, written};
use deepshadow::raw::Deviation;
use deepshadow::*;

/// A random ray of up to five surfaces and thick samples; some are opaque, some coloured.
fn ray(dice: &mut Random, coloured: bool) -> Ray {
    let mut ray = Ray::new();
    for _ in 0..dice.below(6) {
        let z = 1.0 + dice.below(64) as f32 * 0.25;
        let opacity = match dice.below(4) {
            0 => 1.0,
            _ => dice.unit_f32(),
        };
        let tint = [opacity, opacity * 0.5, opacity * dice.unit_f32()];
        match (dice.below(3), coloured && dice.below(2) == 0) {
            (0, false) => ray.thick(z, z + dice.unit_f32() * 4.0, opacity).unwrap(),
            (0, true) => ray.thick(z, z + 1.0, tint).unwrap(),
            (_, false) => ray.surface(z, opacity).unwrap(),
            (_, true) => ray.surface(z, tint).unwrap(),
        }
    }
    ray
}

struct Scene {
    width: u32,
    height: u32,
    rays: Vec<Ray>,
}

fn scene(width: u32, height: u32, seed: u8, coloured: bool) -> Scene {
    let mut dice = Random(seed.into());
    let rays = (0..width * height)
        .map(|_| ray(&mut dice, coloured))
        .collect();
    Scene {
        width,
        height,
        rays,
    }
}

impl Scene {
    fn curve(&self, x: u32, y: u32, tolerance: f64) -> Curve {
        let mut curve = Curve::lit(1);
        self.rays[(y * self.width + x) as usize].flatten(tolerance / 64.0, &mut curve);
        curve
    }

    fn header(&self, name: &str) -> MapHeader {
        MapHeader::new(name, self.width, self.height).tile_size(8)
    }

    fn tiles(&self, tolerance: f64) -> Vec<(TileId, Pixels)> {
        let side = 8;
        let mut tiles = Vec::new();
        for ty in 0..self.height.div_ceil(side) {
            for tx in 0..self.width.div_ceil(side) {
                let (x0, y0) = (tx * side, ty * side);
                let (x1, y1) = ((x0 + side).min(self.width), (y0 + side).min(self.height));
                let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
                let curves = pixels.map(|(x, y)| self.curve(x, y, tolerance)).collect();
                tiles.push((TileId::new(tx, ty), Pixels::Curves(curves)));
            }
        }
        tiles
    }

    fn write(&self, encoding: &Encoding, shuffle: Option<u8>, budget: usize) -> Vec<u8> {
        let mut writer = Writer::in_memory();
        writer.set_budget(budget);
        let map = writer
            .add_map(self.header("scene"), encoding.clone())
            .unwrap();
        let mut tiles = self.tiles(encoding.tolerance);
        if let Some(seed) = shuffle {
            let mut dice = Random(seed.into());
            for i in (1..tiles.len()).rev() {
                tiles.swap(i, dice.below(i as u32 + 1) as usize);
            }
            tiles
                .into_iter()
                .for_each(|(tile, pixels)| writer.tile(map, tile, pixels).unwrap());
        } else {
            writer.tiles(map, tiles).unwrap();
        }
        writer.into_bytes().unwrap()
    }

    /// Checks every function of every level against the exact average of its rays.
    fn check_max_errors(&self, file: &DsmFile, tolerance: f64) {
        for (l, level) in file.maps()[0].levels.iter().enumerate() {
            assert!(
                level.max_error <= tolerance,
                "level {l} promises {} over {tolerance}",
                level.max_error
            );
            for y in 0..level.shape.height {
                for x in 0..level.shape.width {
                    let f = file
                        .function(MapId(0).level(l as u32), Pixel::new(x, y))
                        .unwrap();
                    let side = |at: u32, n: u32| at << l..((at + 1) << l).min(n);
                    let sources =
                        side(y, self.height).flat_map(|j| side(x, self.width).map(move |i| (i, j)));
                    let rays: Vec<_> = sources
                        .map(|(i, j)| (1.0, &self.rays[(j * self.width + i) as usize]))
                        .collect();
                    let worst = Deviation::of_average(&rays, &f);
                    assert!(
                        worst.error <= level.max_error + 2f64.powi(-22),
                        "level {l} pixel {x},{y}: {worst:?}"
                    );
                }
            }
        }
    }
}

fn hash(bytes: &[u8]) -> [u8; 32] {
    DsmFile::from_bytes(bytes.to_vec())
        .unwrap()
        .content_hash(|_, _| true)
        .unwrap()
}

#[test]
fn every_level_stays_within_its_max_error() {
    for (w, h, coloured) in [(5, 7, false), (21, 13, true), (1, 1, false), (1, 40, true)] {
        let scene = scene(w, h, w as u8, coloured);
        for tolerance in [0.01, 0.1] {
            for &compressor in Compressor::ALL {
                let encoding = Encoding::new(tolerance).compressor(compressor);
                let bytes = scene.write(&encoding, None, 1 << 30);
                let file = DsmFile::from_bytes(bytes).unwrap();
                file.verify(|_, _| true).unwrap();
                scene.check_max_errors(&file, tolerance);
            }
        }
    }
}

#[test]
fn halved_mip_tolerances_stay_within_their_max_error() {
    let scene = scene(13, 9, 3, true);
    let encoding = Encoding::new(0.02).mips(Mips::Halved);
    let file = DsmFile::from_bytes(scene.write(&encoding, None, 1 << 30)).unwrap();
    file.verify(|_, _| true).unwrap();
    scene.check_max_errors(&file, 0.04);
    let errors: Vec<_> = file.maps()[0].levels.iter().map(|l| l.max_error).collect();
    assert!(errors[1] >= 0.03 && errors[4] < 0.04, "{errors:?}");
}

#[test]
fn a_tolerance_of_zero_becomes_the_minimum_and_is_kept() {
    let scene = scene(6, 6, 9, true);
    let encoding = Encoding::new(0.0);
    let file = file(|w| {
        let map = w.add_map(scene.header("m"), encoding).unwrap();
        w.tiles(map, scene.tiles(Encoding::MIN_TOLERANCE)).unwrap();
    });
    scene.check_max_errors(&file, 1.0 / 32768.0);
    assert_eq!(file.maps()[0].levels[0].max_error, Encoding::MIN_TOLERANCE);
}

#[test]
fn content_does_not_depend_on_order_budget_codec_or_source() {
    let scene = scene(70, 50, 5, true);
    let encoding = Encoding::default().codec(Codec::None);
    let whole = scene.write(&encoding, None, 1 << 30);
    let same = hash(&whole);
    assert_eq!(
        hash(&scene.write(&encoding, Some(1), 1 << 30)),
        same,
        "order"
    );
    assert_eq!(
        hash(&scene.write(&encoding, Some(2), 0)),
        same,
        "all tiles spilled"
    );
    assert_eq!(
        scene.write(&encoding, None, 1 << 30),
        whole,
        "the same file twice"
    );
    for codec in [Codec::Lz4, Codec::Zstd(3)] {
        assert_eq!(
            hash(&scene.write(&encoding.clone().codec(codec), Some(3), 1 << 20)),
            same,
            "{codec:?}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    std::fs::write(&path, &whole).unwrap();
    assert_eq!(
        DsmFile::open(&path)
            .unwrap()
            .content_hash(|_, _| true)
            .unwrap(),
        same
    );
    // SAFETY: only this test knows the file, and it does not write to it.
    let mapped = unsafe { DsmFile::open_mmap(&path) }.unwrap();
    assert_eq!(mapped.content_hash(|_, _| true).unwrap(), same);
}

#[test]
fn pixels_in_any_order_make_the_same_file_as_tiles() {
    let scene = scene(20, 11, 7, false);
    let encoding = Encoding::default();
    let bytes = written(|w| {
        let map = w.add_map(scene.header("scene"), encoding.clone()).unwrap();
        for x in (0..20).rev() {
            for y in 0..11 {
                let curve = scene.curve(x, y, encoding.tolerance);
                if !curve.is_empty() || x % 2 == 0 {
                    // Pixels without a function are lit.
                    w.pixel(map, Pixel::new(x, y), &curve).unwrap();
                }
            }
        }
    });
    assert_eq!(hash(&bytes), hash(&scene.write(&encoding, None, 1 << 30)));
}

#[test]
fn stored_functions_pass_through_unchanged() {
    let scene = scene(17, 9, 11, true);
    let first = DsmFile::from_bytes(scene.write(&Encoding::default(), None, 1 << 30)).unwrap();
    let source_error = first.maps()[0].levels[0].max_error;
    let mut writer = Writer::in_memory();
    let encoding = Encoding::default()
        .source_error(source_error)
        .mips(Mips::Halved);
    let map = writer
        .add_map(scene.header("scene").tile_size(16), encoding)
        .unwrap();
    for (tx, w) in [(0, 16), (1, 1)] {
        let functions = (0..9 * w)
            .map(|i| {
                first
                    .function(MapId(0).level(0), Pixel::new(tx * 16 + i % w, i / w))
                    .unwrap()
            })
            .collect();
        writer
            .tile(map, TileId::new(tx, 0), Pixels::Functions(functions))
            .unwrap();
    }
    let second = DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap();
    second.verify(|_, _| true).unwrap();
    for y in 0..9 {
        for x in 0..17 {
            assert_eq!(
                second
                    .function(MapId(0).level(0), Pixel::new(x, y))
                    .unwrap(),
                first.function(MapId(0).level(0), Pixel::new(x, y)).unwrap()
            );
        }
    }
    assert_eq!(second.maps()[0].levels[0].max_error, source_error);
    scene.check_max_errors(&second, 0.03);
}

/// Three pixels hold a staircase and one is lit; all are stored `given` above the true function.
#[test]
fn levels_count_the_source_error_of_lit_functions() {
    let given = 0.125;
    let steps = 200;
    let depths = |first: f32| {
        let stairs = (0..steps).flat_map(|i| [i as f32; 2]).skip(1);
        std::iter::once(first).chain(stairs).collect::<Vec<_>>()
    };
    let fall = |i: u32| 1.0 - 0.75 * f64::from(i) / f64::from(steps);
    // The step from 1 to the first value lies in front of the stairs.
    let values = |by: f64| {
        let stairs = (0..steps).flat_map(|i| [fall(i), fall(i + 1)]).skip(1);
        let first = std::iter::once(1.0 - by);
        first.chain(stairs.map(|v| v - by)).collect::<Vec<_>>()
    };
    let stored = depths(-1.0).into_iter().zip(values(0.0));
    let stored: Vec<_> = stored.map(|(z, v)| Vertex::new(z, v as f32)).collect();
    let stored = Visibility::mono(stored).unwrap();
    let curve = Curve::mono(depths(-1.0), values(given)).unwrap();
    let lit = Curve::mono(vec![-1.0], vec![1.0 - given]).unwrap();
    let mut exact = Sweep::new();
    for _ in 0..3 {
        exact.add(&curve, 1.0).unwrap();
    }
    exact.add(&lit, 1.0).unwrap();
    let mut average = Curve::lit(1);
    exact.finish(&mut average).unwrap();
    for mips in [Mips::Full, Mips::Halved] {
        for compressor in [Compressor::Croquet, Compressor::Minimal] {
            let mut writer = Writer::in_memory();
            let encoding = Encoding::new(given)
                .mip_tolerance(given / 4.0)
                .source_error(given)
                .compressor(compressor)
                .mips(mips);
            // The four pixels, and then each of them four times: that way the lit pixel reaches the
            // second level, too.
            let lone = writer
                .add_map(MapHeader::new("lone", 2, 2), encoding.clone())
                .unwrap();
            let four = writer
                .add_map(MapHeader::new("four", 4, 4), encoding.clone())
                .unwrap();
            for (map, side) in [(lone, 2), (four, 4)] {
                let function = |i: u32| match (i / side / (side / 2), i % side / (side / 2)) {
                    (1, 1) => Visibility::lit(),
                    _ => stored.clone(),
                };
                let pixels = Pixels::Functions((0..side * side).map(function).collect());
                writer.tile(map, TileId::new(0, 0), pixels).unwrap();
            }
            let file = DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap();
            for (map, level) in [(lone, 1), (four, 2)] {
                let f = file.function(map.level(level), Pixel::new(0, 0)).unwrap();
                let worst = average.deviation(&f);
                let promise = file.level(map.level(level)).unwrap().max_error;
                assert!(
                    worst.error <= promise + 2f64.powi(-22),
                    "{mips:?} {compressor:?} level {level}: {worst:?} over {promise}"
                );
            }
        }
    }
}

#[test]
fn misuse_of_the_writer_is_an_input_error() {
    let mut writer = Writer::in_memory();
    let kind = |e: Error| e.kind();
    let bad = |f: &dyn Fn(&mut MapHeader)| {
        let mut header = MapHeader::new("m", 4, 4);
        f(&mut header);
        header
    };
    let e = Encoding::default();
    for header in [
        bad(&|h| h.width = 0),
        bad(&|h| h.height = (1 << 20) + 1),
        bad(&|h| h.channels = 2),
        bad(&|h| h.tile_size = 48),
        bad(&|h| h.name.clear()),
        bad(&|h| h.name = "a\nb".into()),
        bad(&|h| h.depth_unit = f64::NAN),
        bad(&|h| h.camera.camera_from_world = Some([f64::INFINITY; 16])),
        bad(&|h| h.attributes = vec![("a".into(), "1".into()), ("a".into(), "2".into())]),
    ] {
        assert_eq!(
            writer.add_map(header.clone(), e.clone()).map_err(kind),
            Err(ErrorKind::Input),
            "{header:?}"
        );
    }
    for tolerance in [f64::NAN, -0.5, f64::INFINITY] {
        let encoding = e.clone().tolerance(tolerance);
        assert_eq!(
            writer
                .add_map(MapHeader::new("m", 4, 4), encoding)
                .map_err(kind),
            Err(ErrorKind::Input)
        );
    }
    let header = MapHeader::new("m", 9, 4).channels(1).tile_size(8);
    let map = writer.add_map(header.clone(), e.clone()).unwrap();
    assert_eq!(
        writer.add_map(header, e).map_err(kind),
        Err(ErrorKind::Input)
    );
    let lit = Curve::lit(1);
    assert_eq!(
        writer.pixel(map, Pixel::new(9, 0), &lit).map_err(kind),
        Err(ErrorKind::Input)
    );
    assert_eq!(
        writer.pixel(MapId(7), Pixel::new(0, 0), &lit).map_err(kind),
        Err(ErrorKind::Input)
    );
    writer.pixel(map, Pixel::new(8, 0), &lit).unwrap();
    assert_eq!(
        writer.pixel(map, Pixel::new(8, 0), &lit).map_err(kind),
        Err(ErrorKind::Input)
    );
    let mut give = |tx, n, channels| {
        let pixels = Pixels::Curves(vec![Curve::lit(channels); n]);
        writer.tile(map, TileId::new(tx, 0), pixels)
    };
    assert_eq!(
        give(1, 4, 1).map_err(kind),
        Err(ErrorKind::Input),
        "the tile has pixels already"
    );
    assert_eq!(
        give(0, 31, 1).map_err(kind),
        Err(ErrorKind::Input),
        "too few pixels"
    );
    assert_eq!(
        give(0, 32, 3).map_err(kind),
        Err(ErrorKind::Input),
        "coloured"
    );
    give(0, 32, 1).unwrap();
    assert_eq!(give(0, 32, 1).map_err(kind), Err(ErrorKind::Input), "twice");
    assert_eq!(
        writer.pixel(map, Pixel::new(0, 0), &lit).map_err(kind),
        Err(ErrorKind::Input),
        "twice"
    );
    assert!(Writer::in_memory().finish().is_err(), "a file without maps");
}

#[test]
fn open_tiles_beyond_the_budget_are_a_limit_error() {
    let mut writer = Writer::in_memory();
    writer.set_budget(1000);
    let map = writer
        .add_map(MapHeader::new("m", 64, 64), Encoding::default())
        .unwrap();
    let curve = Curve::mono(vec![1.0; 1], vec![0.5]).unwrap();
    let error = (0..64)
        .find_map(|x| writer.pixel(map, Pixel::new(x, 0), &curve).err())
        .unwrap();
    assert_eq!(error.kind(), ErrorKind::Limit);
}

#[test]
fn a_cancelled_writer_leaves_the_old_file_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dsm");
    std::fs::write(&path, b"old").unwrap();
    let mut writer = Writer::create(&path).unwrap();
    writer.on_progress(|done, _| done < 3);
    let scene = scene(40, 40, 1, false);
    let map = writer
        .add_map(scene.header("m"), Encoding::default())
        .unwrap();
    let error = writer.tiles(map, scene.tiles(0.01)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Cancelled);
    assert!(writer.finish().is_err());
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// A disk with room for this many bytes.
struct Full(u64);

impl std::io::Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 = self
            .0
            .checked_sub(bytes.len() as u64)
            .ok_or(std::io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_at_every_write() {
    let scene = scene(20, 20, 2, false);
    let write = |room: u64| -> Result<raw::Summary> {
        let mut writer = Writer::new(Full(room))?;
        let map = writer.add_map(scene.header("m"), Encoding::default())?;
        for (tile, pixels) in scene.tiles(0.01) {
            writer.tile(map, tile, pixels)?;
        }
        writer.finish()
    };
    let whole = write(u64::MAX).unwrap().bytes;
    for room in (0..whole).step_by(97).chain(whole - 70..whole) {
        assert_eq!(
            write(room).unwrap_err().kind(),
            ErrorKind::Io,
            "room for {room} of {whole} bytes"
        );
    }
    assert!(write(whole).is_ok());
}

#[test]
fn truncated_and_longer_files_are_refused() {
    let bytes = scene(9, 9, 4, true).write(&Encoding::default(), None, 1 << 30);
    for n in 0..bytes.len() {
        assert!(
            DsmFile::from_bytes(bytes[..n].to_vec()).is_err(),
            "{n} of {} bytes",
            bytes.len()
        );
    }
    for extra in [1, 8, 64] {
        let longer = [&bytes[..], &vec![0; extra]].concat();
        assert!(DsmFile::from_bytes(longer).is_err());
    }
}

#[test]
fn waiting_levels_use_the_scratch_folder_of_the_caller() {
    let write = |folder: &std::path::Path| {
        let mut writer = Writer::in_memory();
        writer.set_budget(1);
        writer.set_scratch(folder);
        let map = writer.add_map(MapHeader::new("m", 128, 128), Encoding::default())?;
        // Only one tile of each four: all of them wait for the others.
        for tile in [TileId::new(0, 0), TileId::new(2, 2), TileId::new(3, 1)] {
            let curves = vec![Curve::mono(vec![1.0], vec![0.5])?; 32 * 32];
            writer.tile(map, tile, Pixels::Curves(curves))?;
        }
        writer.into_bytes()
    };
    let folder = tempfile::tempdir().unwrap();
    assert!(write(folder.path()).is_ok());
    let error = write(&folder.path().join("missing")).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Io);
    assert!(error.to_string().contains("missing"), "{error}");
}
