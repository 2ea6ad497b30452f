//! Counts the instructions of the hot lookup paths with valgrind.
//!
//! The counts do not depend on the load of the machine. `cargo bench --bench instructions` prints a
//! table and writes it to `benches/record/instructions.md`. The record is committed, so that review
//! shows a path that became longer. Without valgrind the bench prints a notice and writes nothing.

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use deepshadow::*;

const SIDE: u32 = 128;
const LOOKUPS: usize = 4096;

/// Pseudorandom numbers from 0 to 1, determined by the seed.
fn dice(mut state: u64) -> impl FnMut() -> f32 {
    move || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Writes a hair-like map. Every pixel has its own random ramps, 20 vertices on average.
fn write_map(path: &Path) {
    let mut dice = dice(7);
    let mut writer = Writer::create(path).expect("room for a map");
    let encoding = Encoding::new(1.0 / 512.0).codec(Codec::Lz4);
    let map = writer
        .add_map(MapHeader::new("hair", SIDE, SIDE), encoding)
        .expect("a legal map");
    for y in 0..SIDE {
        for x in 0..SIDE {
            let n = 14 + (dice() * 12.0) as usize;
            let mut z: Vec<f32> = (0..n).map(|_| 4.0 + 8.0 * dice()).collect();
            z.sort_by(f32::total_cmp);
            z.dedup();
            let mut v: Vec<f64> = z.iter().map(|_| dice().into()).collect();
            v.sort_by(|a, b| b.total_cmp(a));
            let curve = Curve::mono(z, v).expect("a legal function");
            writer
                .pixel(map, Pixel::new(x, y), &curve)
                .expect("a pixel of the map");
        }
    }
    writer.finish().expect("a file");
}

fn queries(coherent: bool) -> [Vec<f32>; 3] {
    let mut dice = dice(3);
    let side = SIDE as f32;
    let mut out = [const { Vec::new() }; 3];
    for i in 0..LOOKUPS {
        let at = if coherent {
            let (x, y) = (i as f32 % side, (i / SIDE as usize) as f32);
            [x + 0.3, y + 0.6, 8.0 + (i as f32 * 0.01).sin()]
        } else {
            [side * dice(), side * dice(), 4.0 + 8.0 * dice()]
        };
        out.iter_mut().zip(at).for_each(|(out, at)| out.push(at));
    }
    out
}

/// Performs the lookups. Valgrind counts the instructions inside this function only.
#[inline(never)]
fn measured(
    sampler: &mut Sampler,
    call: &str,
    width: f32,
    [x, y, z]: &[Vec<f32>; 3],
    out: &mut [f32],
) {
    let query = |i: usize| Query::new(x[i], y[i], z[i]).width(width);
    match call {
        "batch" => {
            let footprint = [Footprint::Width(width)];
            let batch = Batch::new(x, y, z).footprints(&footprint);
            sampler.visibility_batch(&batch, out).expect("our own file");
        }
        "cursor" => {
            let mut cursor = Cursor::default();
            for (i, out) in out.iter_mut().enumerate() {
                *out = sampler
                    .visibility_with(&mut cursor, &query(i))
                    .expect("our own file");
            }
        }
        _ => {
            for (i, out) in out.iter_mut().enumerate() {
                *out = sampler.visibility(&query(i)).expect("our own file");
            }
        }
    }
}

/// Measured paths: name, filter, footprint width, coherent order, kind of call.
const PATHS: [(&str, Filter, f32, bool, &str); 12] = [
    ("one pixel, coherent", Filter::Nearest, 1.0, true, "single"),
    ("one pixel, random", Filter::Nearest, 1.0, false, "single"),
    ("one pixel, cursor", Filter::Nearest, 1.0, true, "cursor"),
    ("one pixel, batch", Filter::Nearest, 1.0, false, "batch"),
    ("bilinear, coherent", Filter::Triangle, 1.0, true, "single"),
    ("bilinear, random", Filter::Triangle, 1.0, false, "single"),
    ("bilinear, batch", Filter::Triangle, 1.0, false, "batch"),
    ("trilinear, coherent", Filter::Triangle, 1.5, true, "single"),
    ("trilinear, random", Filter::Triangle, 1.5, false, "single"),
    ("trilinear, batch", Filter::Triangle, 1.5, false, "batch"),
    (
        "4x4 Gaussian, coherent",
        Filter::Gaussian,
        1.0,
        true,
        "single",
    ),
    (
        "4x4 Gaussian, random",
        Filter::Gaussian,
        1.0,
        false,
        "single",
    ),
];

fn run(path: &Path, name: &str) {
    let (_, filter, width, coherent, call) = *PATHS.iter().find(|p| p.0 == name).expect("a path");
    let cache = TileCache::new(64 << 20);
    let file = cache.add(DsmFile::open(path).expect("our own file"));
    let options = SamplerOptions::new(filter);
    let mut sampler = Sampler::with_options(&file, MapId(0), options).expect("the map");
    let queries = queries(coherent);
    let mut out = vec![0.0; LOOKUPS];
    if std::env::args().any(|a| a == "--long") {
        for _ in 0..5000 {
            measured(&mut sampler, call, width, &queries, &mut out);
        }
        return;
    }
    // Loads the tiles outside the counted function.
    let warm = |sampler: &mut Sampler, out: &mut [f32]| {
        for i in 0..LOOKUPS {
            let query = Query::new(queries[0][i], queries[1][i], queries[2][i]).width(width);
            out[i] = sampler.visibility(&query).expect("our own file");
        }
    };
    warm(&mut sampler, &mut out);
    let expected = out.clone();
    measured(&mut sampler, call, width, &queries, &mut out);
    assert_eq!(out, expected, "{name}");
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    if args.iter().any(|a| a == "--test") {
        return; // run by `cargo test --benches`
    }
    if let Some(at) = args.iter().position(|a| a == "--path") {
        return run(Path::new(&args[at + 1]), &args[at + 2]);
    }
    if Command::new("valgrind").arg("--version").output().is_err() {
        println!("skipped: valgrind is not installed");
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let map = folder.path().join("hair.dsm");
    write_map(&map);
    let mut out = String::from(
        "# Instructions\n\n\
         Written by `cargo bench --bench instructions`: instructions per lookup, counted by \
         valgrind. All\ntiles are resident. Pixels have 20 vertices on average.\n\n\
         | path | instructions |\n|---|---|\n",
    );
    for (name, ..) in PATHS {
        let counted = Command::new("valgrind")
            .args([
                "--tool=callgrind",
                "--callgrind-out-file=/dev/null",
                "--toggle-collect=*measured*",
            ])
            .arg(std::env::current_exe().expect("our own path"))
            .arg("--path")
            .arg(&map)
            .arg(name)
            .output()
            .expect("valgrind runs");
        let text = String::from_utf8_lossy(&counted.stderr);
        assert!(counted.status.success(), "{text}");
        let total: f64 = text
            .lines()
            .find_map(|l| l.split("Collected :").nth(1)?.trim().parse().ok())
            .expect("valgrind reports a count");
        assert!(total > 0.0, "valgrind counted no instructions of {name}");
        let _ = writeln!(out, "| {name} | {:.0} |", total / LOOKUPS as f64);
    }
    print!("{out}");
    std::fs::create_dir_all("benches/record").expect("the folder of records");
    std::fs::write("benches/record/instructions.md", out).expect("the record");
}
