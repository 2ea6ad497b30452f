//! Writes a map of 16384 x 16384 pixels with all levels and its tiles in shuffled order, then opens
//! it, and verifies it with `--verify`.
//!
//! `cargo bench --bench big_map -- FOLDER [dense|sparse] [--verify]`
//!
//! - `dense` (default): every fourth pixel has at least 8 vertices; the file is larger than 4 GiB.
//! - `sparse`: every tile has one vertex, so every directory entry is of kind data.
//!
//! Prints times and the peak of resident memory (Linux only). It takes minutes and 12 GB of disk,
//! so it is not part of the tests.

use std::time::Instant;

use deepshadow::*;

const SIDE: u32 = 16384;
const TILE: u32 = 32;

/// Peak of resident memory in MiB, or 0 where the system does not report it.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status
        .lines()
        .find(|l| l.starts_with("VmHWM"))
        .unwrap_or_default();
    line.split_whitespace()
        .nth(1)
        .and_then(|n| n.parse::<u64>().ok())
        .unwrap_or(0)
        >> 10
}

/// 251 functions with `steps` large steps each, at different depths.
fn pool(steps: usize) -> Result<Vec<Curve>> {
    (0..251u32)
        .map(|seed| {
            let mut ray = Ray::new();
            for s in 0..steps as u32 {
                let jitter = (seed * 7919 + s * 104_729) % 1000;
                ray.surface(
                    10.0 + s as f32 + jitter as f32 * 0.001,
                    0.1 + jitter as f32 * 0.0001,
                )?;
            }
            let mut curve = Curve::lit(1);
            ray.flatten(1e-4, &mut curve);
            Ok(curve)
        })
        .collect()
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = arguments.first().expect("a folder").clone();
    let sparse = arguments.iter().any(|a| a == "sparse");
    let path = std::path::Path::new(&folder).join(if sparse { "sparse.dsm" } else { "dense.dsm" });
    let functions = pool(if sparse { 1 } else { 6 })?;

    let start = Instant::now();
    let mut writer = Writer::create(&path)?;
    writer.set_budget(256 << 20);
    let encoding = Encoding::default()
        .codec(Codec::None)
        .compressor(Compressor::Croquet);
    let map = writer.add_map(MapHeader::new("big", SIDE, SIDE).channels(1), encoding)?;
    let tiles_x = SIDE / TILE;
    let tiles = tiles_x * tiles_x;
    for chunk in 0..tiles / 64 {
        let batch = (chunk * 64..(chunk + 1) * 64).map(|i| {
            // A permutation: the factor is odd and the modulus is a power of two.
            let tile = i.wrapping_mul(40_503) % tiles;
            let pixel = |p: u32| match (sparse, p % 4) {
                (true, _) if p == 77 => functions[tile as usize % functions.len()].clone(),
                (false, 0) => {
                    functions[(tile.wrapping_mul(31) + p / 4) as usize % functions.len()].clone()
                }
                _ => Curve::lit(1),
            };
            let pixels = Pixels::Curves((0..TILE * TILE).map(pixel).collect());
            (TileId::new(tile % tiles_x, tile / tiles_x), pixels)
        });
        writer.tiles(map, batch.collect())?;
    }
    let summary = writer.finish()?;
    println!(
        "written: {} bytes in {:.1} s, peak {} MiB",
        summary.bytes,
        start.elapsed().as_secs_f64(),
        peak()
    );
    println!("vertices of each level: {:?}", summary.vertices[0]);

    for _ in 0..3 {
        let start = Instant::now();
        let file = DsmFile::open(&path)?;
        let opened = start.elapsed();
        file.function(MapId(0).level(0), Pixel::new(9999, 77))?;
        println!(
            "opened in {:.2} ms, first function after {:.2} ms",
            1e3 * opened.as_secs_f64(),
            1e3 * start.elapsed().as_secs_f64()
        );
    }
    if arguments.iter().any(|a| a == "--verify") {
        let start = Instant::now();
        let report = DsmFile::open(&path)?.verify(|_, _| true)?;
        println!(
            "verified in {:.1} s: {report:?}, peak {} MiB",
            start.elapsed().as_secs_f64(),
            peak()
        );
    }
    Ok(())
}
