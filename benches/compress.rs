//! Measures the compressors: speed, and number of vertices relative to the exact minimum.
//!
//! `cargo bench --bench compress` prints a table and writes it to `benches/record/compress.md`. It
//! fails if an output exceeds the tolerance. The exact minimum is on the same lattice, over the
//! first `EXACT_PIXELS` pixels.

#[path = "../tests/compress_support/mod.rs"]
mod compress_support;
#[path = "../tests/random.rs"]
mod random;

use std::fmt::Write;
use std::time::{Duration, Instant};

use compress_support::{cloud, coloured_hair, exact_minimum, hair, max_error, mixed, plane};
use criterion::{Criterion, Throughput};
use deepshadow::raw::{Encoder, Precision};
use deepshadow::{Compressor, Curve, Encoding, Visibility};

const PIXELS: usize = 256;
const EXACT_PIXELS: usize = 64;

struct Scene {
    name: &'static str,
    curves: Vec<Curve>,
    /// Vertices of the exact minimum over the first `EXACT_PIXELS` pixels, for mono scenes.
    fewest: Option<usize>,
}

fn scenes(eps: f64) -> Vec<Scene> {
    let make = |name, make: &dyn Fn(u64) -> Curve| {
        let curves: Vec<_> = (0..PIXELS as u64).map(make).collect();
        let fewest = (curves[0].channels() == 1).then(|| {
            let first = &curves[..EXACT_PIXELS];
            first.iter().map(|c| exact_minimum(c, eps, 255)).sum()
        });
        Scene {
            name,
            curves,
            fewest,
        }
    };
    vec![
        make("hair", &|seed| hair(16, seed)),
        make("cloud", &|seed| cloud(256, seed)),
        make("plane", &|seed| plane(16, seed)),
        make("mixed", &|seed| mixed(16, seed)),
        make("hair RGB", &|seed| coloured_hair(16, seed)),
    ]
}

fn main() {
    let eps = Encoding::default_tolerance(256);
    let mut table = String::from(
        "| scene | compressor | input vertices per pixel | output | / exact minimum \
         | worst error / tolerance | M input vertices/s |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .without_plots()
        .configure_from_args();
    for scene in scenes(eps) {
        let input: usize = scene.curves.iter().map(Curve::len).sum();
        let mut group = criterion.benchmark_group(scene.name);
        group.throughput(Throughput::Elements(input as u64));
        for compressor in [
            Compressor::Croquet,
            Compressor::Lookahead,
            Compressor::Minimal,
        ] {
            let mut encoder = Encoder::new(compressor, Precision::for_tolerance(eps), eps).unwrap();
            let mut out = Visibility::lit();
            let (mut total, mut compared, mut worst) = (0, 0, 0.0f64);
            for (i, curve) in scene.curves.iter().enumerate() {
                encoder.compress(curve, &mut out).unwrap();
                worst = worst.max(max_error(curve, &out) / eps);
                total += out.len();
                compared += if i < EXACT_PIXELS { out.len() } else { 0 };
            }
            assert!(worst <= 1.0, "{compressor:?} on {}: {worst}", scene.name);
            let mut pass = || {
                let start = Instant::now();
                for curve in &scene.curves {
                    encoder.compress(curve, &mut out).unwrap();
                }
                start.elapsed()
            };
            // The table has the fastest of 15 passes; criterion reports the distribution.
            let best = (0..15).map(|_| pass()).min().unwrap_or_default();
            group.bench_function(format!("{compressor:?}"), |b| {
                b.iter_custom(|n| (0..n).map(|_| pass()).sum());
            });
            let ratio = match scene.fewest {
                Some(fewest) => format!("{:.3}", compared as f64 / fewest as f64),
                None => "-".into(),
            };
            let pixels = PIXELS as f64;
            writeln!(
                table,
                "| {} | {compressor:?} | {:.1} | {:.2} | {ratio} | {worst:.4} | {:.1} |",
                scene.name,
                input as f64 / pixels,
                total as f64 / pixels,
                input as f64 / best.as_secs_f64() / 1e6,
            )
            .unwrap();
        }
        group.finish();
    }
    println!("{table}");
    if !std::env::args().any(|arg| arg == "--bench") {
        return; // run by `cargo test`, which must not overwrite the record
    }
    let record = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/record");
    std::fs::create_dir_all(record).unwrap();
    let text = format!(
        "Tolerance {eps:.6} (256 samples per pixel), lattice 1/255, one thread. Written by `cargo \
         bench --bench compress`.\n\n{table}"
    );
    std::fs::write(format!("{record}/compress.md"), text).unwrap();
}
