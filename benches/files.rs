//! Measures tiles and levels: encoding and decoding speed, bits per vertex, and vertices per level.
//!
//! `cargo bench --bench files` prints the tables and writes `benches/record/files.md`. It fails if
//! a decoded tile differs from the encoded one, or if a function of any level exceeds the
//! tolerance.

use std::fmt::Write as _;
use std::time::Instant;

use deepshadow::raw::directory::Entry;
use deepshadow::raw::{Encoder, Precision};
use deepshadow::*;

#[path = "../tests/compress_support/mod.rs"]
mod compress_support;
#[path = "../tests/random.rs"]
mod random;

const TILE: u32 = 32;

/// Hair in front of an opaque ball, drawn into a depth buffer.
///
/// Each pixel averages `n` x `n` depths.
fn hair(side: u32, n: u32) -> Vec<Curve> {
    let grid = (side * n) as usize;
    let mut depth = vec![f32::INFINITY; grid * grid];
    let mut dice = random::Random(5);
    let unit = grid as f64;
    let mut dot = |x: f64, y: f64, z: f64| {
        if (0.0..unit).contains(&x) && (0.0..unit).contains(&y) {
            let cell = &mut depth[y as usize * grid + x as usize];
            *cell = cell.min(z as f32);
        }
    };
    for _ in 0..6000 {
        let (x0, y0) = (dice.range(-0.1, 1.1), dice.range(-0.1, 1.1));
        let (angle, bend, z0) = (
            dice.range(0.0, std::f64::consts::TAU),
            dice.range(-3.0, 3.0),
            dice.range(4.0, 9.0),
        );
        let length = dice.range(0.05, 0.25);
        let (mut x, mut y) = (x0, y0);
        let steps = (length * unit) as usize;
        for s in 0..steps {
            let t = s as f64 / steps as f64;
            x += (angle + bend * t).cos() / unit;
            y += (angle + bend * t).sin() / unit;
            let z = z0 + t * length * 4.0;
            dot(x * unit, y * unit, z);
            dot(x * unit + 1.0, y * unit, z);
        }
    }
    // The ball, deeper than the hair.
    for y in 0..grid {
        for x in 0..grid {
            let (u, v) = (x as f64 / unit - 0.5, y as f64 / unit - 0.5);
            let r = (u * u + v * v) / 0.2;
            if r < 1.0 {
                dot(x as f64, y as f64, 10.0 - 2.0 * (1.0 - r).sqrt());
            }
        }
    }
    average(side, n, |x, y, ray| {
        let z = depth[y as usize * grid + x as usize];
        if z.is_finite() {
            ray.surface(z, 1.0).unwrap();
        }
    })
}

/// Smoke with a density that varies over the map.
fn cloud(side: u32) -> Vec<Curve> {
    average(side, 1, |x, y, ray| {
        let (u, v) = (x as f32 / side as f32, y as f32 / side as f32);
        let density = (0.6 + 0.4 * (9.0 * u).sin() * (7.0 * v + 2.0 * u).cos())
            * (1.0 - (u - 0.5).hypot(v - 0.5) * 1.5).max(0.0);
        let samples: Vec<_> = (0..24)
            .map(|i| (5.0 + i as f32 * 0.2, density * (0.4 * i as f32).sin().abs()))
            .collect();
        ray.medium(&samples, 1.0).unwrap();
    })
}

/// A tilted plane that covers part of the pixels. Each pixel averages `n` x `n` rays.
fn plane(side: u32, n: u32) -> Vec<Curve> {
    average(side, n, |x, y, ray| {
        let (u, v) = (x as f32 / n as f32, y as f32 / n as f32);
        if u + 0.3 * v < side as f32 * 0.7 {
            ray.surface(5.0 + 0.04 * u + 0.02 * v, 1.0).unwrap();
        }
        ray.surface(20.0 + 0.01 * v, 1.0).unwrap();
    })
}

/// Traces `side` x `side` pixels. Each pixel averages `n` x `n` rays.
fn average(side: u32, n: u32, trace: impl Fn(u32, u32, &mut Ray)) -> Vec<Curve> {
    let (mut sweep, mut ray, mut out) = (Sweep::new(), Ray::new(), Vec::new());
    for y in 0..side {
        for x in 0..side {
            sweep.clear();
            for j in 0..n {
                for i in 0..n {
                    ray.clear();
                    trace(x * n + i, y * n + j, &mut ray);
                    sweep.add_ray(&ray, 1e-4, 1.0).unwrap();
                }
            }
            let mut curve = Curve::lit(1);
            sweep.finish(&mut curve).unwrap();
            out.push(curve);
        }
    }
    out
}

fn tiles(side: u32, curves: &[Curve]) -> Vec<(TileId, Pixels)> {
    let mut out = Vec::new();
    for ty in 0..side.div_ceil(TILE) {
        for tx in 0..side.div_ceil(TILE) {
            let rows = ty * TILE..((ty + 1) * TILE).min(side);
            let columns = tx * TILE..((tx + 1) * TILE).min(side);
            let pixels = rows
                .flat_map(|y| {
                    columns
                        .clone()
                        .map(move |x| curves[(y * side + x) as usize].clone())
                })
                .collect();
            out.push((TileId::new(tx, ty), Pixels::Curves(pixels)));
        }
    }
    out
}

fn write(side: u32, curves: &[Curve], encoding: &Encoding) -> DsmFile {
    let mut writer = Writer::in_memory();
    let map = writer
        .add_map(MapHeader::new("bench", side, side), encoding.clone())
        .unwrap();
    writer.tiles(map, tiles(side, curves)).unwrap();
    DsmFile::from_bytes(writer.into_bytes().unwrap()).unwrap()
}

/// Median seconds of `runs` calls.
fn median(runs: usize, mut f: impl FnMut()) -> f64 {
    let time = |f: &mut dyn FnMut()| {
        let start = Instant::now();
        f();
        start.elapsed().as_secs_f64()
    };
    let mut times: Vec<f64> = (0..runs).map(|_| time(&mut f)).collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

fn codecs(curves: &[Curve], side: u32, out: &mut String) {
    let file = write(side, curves, &Encoding::new(1.0 / 64.0).mips(Mips::None));
    let count = side / TILE;
    let all: Vec<Tile> = (0..count * count)
        .map(|i| {
            file.tile(MapId(0).level(0), TileId::new(i % count, i / count))
                .unwrap()
        })
        .collect();
    let vertices: usize = all.iter().map(Tile::vertices).sum();
    let encode =
        |codec| -> Vec<(Entry, Vec<u8>)> { all.iter().map(|t| t.encode(codec).unwrap()).collect() };
    let payload: usize = encode(Codec::None)
        .iter()
        .map(|(_, bytes)| bytes.len())
        .sum();
    out.push_str(
        "\n## Tiles\n\n\
         Hair, N = 256, tolerance 1/64, visibility on a lattice, one thread, median of 15 runs.\n\
         MB counts the payload of codec `none`. A tile is decoded into the memory of the previous\n\
         tile, as a cache does, or into fresh memory.\n\n",
    );
    out.push_str(
        "| codec | bits per vertex | encode MB/s | decode MB/s | into fresh memory MB/s \
         | copy MB/s in the same run |\n\
         |---|---|---|---|---|---|\n",
    );
    for (name, codec) in [
        ("none", Codec::None),
        ("lz4", Codec::Lz4),
        ("zstd 3", Codec::Zstd(3)),
        ("zstd 9", Codec::Zstd(9)),
        ("zstd 19", Codec::Zstd(19)),
    ] {
        let stored = encode(codec);
        let decode = || {
            stored
                .iter()
                .map(|(e, bytes)| Tile::decode(e, bytes, (TILE, TILE), 1 << 30).unwrap())
                .collect::<Vec<_>>()
        };
        assert!(
            decode() == all,
            "{name}: decoded tiles differ from the encoded ones"
        );
        let bytes: usize = stored.iter().map(|(_, b)| b.len()).sum();
        let runs = if name == "zstd 19" { 3 } else { 15 };
        let encoding = median(runs, || assert_eq!(encode(codec).len(), all.len()));
        let decoding = median(15, || {
            for (e, bytes) in &stored {
                let tile = Tile::decode(e, bytes, (TILE, TILE), 1 << 30).unwrap();
                assert!(tile.vertices() > 0);
            }
        });
        let mut old = Tile::lit(TILE, TILE);
        let reusing = median(15, || {
            for (e, bytes) in &stored {
                let buffer = std::mem::replace(&mut old, Tile::lit(1, 1));
                old = Tile::decode_reusing(e, bytes, (TILE, TILE), 1 << 30, buffer).unwrap();
                assert!(old.vertices() > 0);
            }
        });
        let plain = encode(Codec::None);
        let copying = median(15, || {
            for (_, bytes) in &plain {
                assert!(!std::hint::black_box(bytes.clone()).is_empty());
            }
        });
        let speed = |seconds: f64| payload as f64 / seconds / 1e6;
        let bits = 8.0 * bytes as f64 / vertices as f64;
        let _ = writeln!(
            out,
            "| {name} | {bits:.1} | {:.0} | {:.0} | {:.0} | {:.0} |",
            speed(encoding),
            speed(reusing),
            speed(decoding),
            speed(copying)
        );
    }
}

/// Exact averages of 2 x 2 pixels.
fn halve(side: u32, curves: &[Curve]) -> Vec<Curve> {
    let (half, mut sweep, mut out) = (side / 2, Sweep::new(), Vec::new());
    for y in 0..half {
        for x in 0..half {
            sweep.clear();
            for at in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let i = (2 * y + at.1) * side + 2 * x + at.0;
                sweep.add(&curves[i as usize], 1.0).unwrap();
            }
            let mut curve = Curve::lit(1);
            sweep.finish(&mut curve).unwrap();
            out.push(curve);
        }
    }
    out
}

/// Distance between the pixels of a level that are searched for the minimum.
fn stride(pixels: usize) -> usize {
    (pixels / 48).max(1) | 1
}

/// Estimated minimum number of vertices of every level, from the exact averages of its pixels.
///
/// It extrapolates from about 48 pixels per level. Averages of more than 300 vertices are too long
/// for the exact search. For those, `Minimal` compresses the exact average instead.
fn minimum(side: u32, curves: &[Curve], tolerance: f64) -> Vec<f64> {
    let Precision::Lattice(lattice) = Precision::for_tolerance(tolerance) else {
        unreachable!("the tolerances here have lattices")
    };
    let fewest = |curve: &Curve| {
        if curve.len() <= 300 {
            return compress_support::exact_minimum(curve, tolerance, lattice);
        }
        // First thin the average within 1/500 of the tolerance.
        let mut out = Visibility::lit();
        let mut thin =
            Encoder::new(Compressor::Croquet, Precision::F32, tolerance / 500.0).unwrap();
        let exact = curve.clone().with_error(0.0);
        thin.compress(&exact, &mut out).unwrap();
        let mut thinned = Curve::lit(1);
        thinned.assign(&out, 0.0);
        let mut encoder =
            Encoder::new(Compressor::Minimal, Precision::Lattice(lattice), tolerance).unwrap();
        encoder.compress(&thinned, &mut out).unwrap();
        out.len()
    };
    let (mut exact, mut size, mut out) = (curves.to_vec(), side, Vec::new());
    loop {
        let sample = exact.iter().step_by(stride(exact.len()));
        let total: usize = sample.map(fewest).sum();
        out.push(total as f64 * stride(exact.len()) as f64);
        if size == 1 {
            return out;
        }
        exact = halve(size, &exact);
        size /= 2;
    }
}

fn levels(name: &str, side: u32, curves: &[Curve], tolerance: f64, out: &mut String) {
    let minimum = minimum(side, curves, tolerance);
    for compressor in [Compressor::Lookahead, Compressor::Minimal] {
        let file = write(
            side,
            curves,
            &Encoding::new(tolerance).compressor(compressor),
        );
        // Vertices of the sampled pixels, extrapolated as in `minimum`.
        let mut stored = Vec::new();
        let all: Vec<f64> = file.maps()[0]
            .levels
            .iter()
            .map(|l| l.vertices as f64)
            .collect();
        let (mut exact, mut size, mut worst) = (curves.to_vec(), side, 0.0f64);
        for l in 0..all.len() {
            let mut total = 0;
            for (i, curve) in exact.iter().enumerate() {
                let f = file
                    .function(
                        MapId(0).level(l as u32),
                        Pixel::new(i as u32 % size, i as u32 / size),
                    )
                    .unwrap();
                worst = worst.max(curve.deviation(&f).error);
                if i % stride(exact.len()) == 0 {
                    total += f.len();
                }
            }
            stored.push(total as f64 * stride(exact.len()) as f64);
            if size > 1 {
                exact = halve(size, &exact);
                size /= 2;
            }
        }
        assert!(
            worst <= tolerance + 2f64.powi(-22),
            "{name}: error {worst} exceeds the tolerance"
        );
        let sum = |v: &[f64]| v.iter().sum::<f64>();
        let _ = writeln!(
            out,
            "| {name} | {compressor:?} | {} | {:.2} | {:.2} | {:.2} | {:.3} |",
            all[0],
            sum(&all) / all[0],
            sum(&minimum) / minimum[0],
            sum(&stored) / sum(&minimum),
            worst / tolerance
        );
    }
}

fn main() {
    if std::env::args().any(|a| a == "--test") {
        return; // run by `cargo test --benches`
    }
    let mut out = String::from("# Files\n\nWritten by `cargo bench --bench files`.\n");
    let side = 128;
    let hair = hair(side, 16);
    codecs(&hair, side, &mut out);
    out.push_str(
        "\n## Levels\n\n\
         Vertices of all levels divided by those of the base level, for the compressor and for\n\
         the exact minimum of each level from the exact averages. The minimum is estimated from\n\
         a sample of the pixels. The worst error is the largest of any function of any level, in\n\
         units of the tolerance.\n\n",
    );
    out.push_str(
        "| scene | compressor | base vertices | all / base | all / base of the exact minimum \
         | compressor / exact minimum | worst error |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let small = |curves: &[Curve], n: u32| -> Vec<Curve> {
        (0..n * n)
            .map(|i| curves[((i / n + 32) * side + i % n + 32) as usize].clone())
            .collect()
    };
    levels(
        "hair, N = 256, 1/64",
        64,
        &small(&hair, 64),
        Encoding::default_tolerance(256),
        &mut out,
    );
    levels("cloud, 0.02", 64, &cloud(64), 0.02, &mut out);
    levels(
        "plane, N = 64, 1/32",
        64,
        &plane(64, 8),
        Encoding::default_tolerance(64),
        &mut out,
    );
    print!("{out}");
    std::fs::create_dir_all("benches/record").expect("the folder of records");
    std::fs::write("benches/record/files.md", out).expect("the record");
}
