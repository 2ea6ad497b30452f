//! What only the full run measures: maps of all kinds and sizes, plain maps by taps, uncompressed
//! deep samples.

use std::path::Path;

use deepshadow::{Codec, Curve, DsmFile, Encoding, MapId, Mips, Pixel};

use crate::figures::{boxes, jittered};
use crate::flat::Flat;
use crate::lookups::mib;
use crate::maps::Block;
use crate::ours::{Shadows, Source};
use crate::pcf::{Jitter, Plain};
use crate::queries::{Access, Lookup, Queries};
use crate::record::Record;
use crate::reference;
use crate::scene::{DEPTHS, Hair, smoke};
use crate::timing::{Candidate, interleaved};
use crate::walk::Samples;

/// Lookups against flat arrays for hair and smoke, 4 to 256 samples a pixel, 256 to 4096 pixels
/// wide.
pub fn maps(folder: &Path, rounds: usize, record: &mut Record) {
    let mut lines = Vec::new();
    for (scene, samples) in [("hair", [2u32, 4, 8, 16]), ("smoke", [2, 4, 8, 16])] {
        for n in samples {
            let side = 128;
            let curves = match scene {
                "hair" => Hair::new(side, 31).curves(n),
                _ => smoke(side, n),
            };
            let block = Block::compress(side, &curves, Encoding::default_tolerance(n * n));
            for width in [256u32, 1024, 4096] {
                let line = map(folder, &block, width, rounds);
                let mut head = vec![scene.to_string(), (n * n).to_string(), width.to_string()];
                head.extend(line);
                eprintln!("{}", head.join(" | "));
                lines.push(head);
            }
        }
    }
    record.heading("Maps of all kinds and sizes");
    record.say(
        "Lookups through the cache over flat arrays, all resident: ns, and how many times those \
         of the flat arrays (x). Square maps, tolerance 0.25/sqrt(N); the functions of 128 x 128 \
         pixels repeated with shifted depths. \
         Maps 4096 pixels wide are written without levels.",
    );
    let mut columns = vec![
        "scene".to_string(),
        "N".into(),
        "width".into(),
        "vertices a pixel".into(),
        "MiB".into(),
    ];
    for lookup in Lookup::ALL {
        for access in Access::ALL {
            let name = format!("{} {}", lookup.name(), access.name());
            columns.extend([name.clone(), format!("{name} x")]);
        }
    }
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    record.table("maps", &columns, &lines);
}

fn map(folder: &Path, block: &Block, width: u32, rounds: usize) -> Vec<String> {
    let path = folder.join("map.dsm");
    let mips = if width > 1024 { Mips::None } else { Mips::Full };
    std::fs::write(&path, block.write(width, width, mips, Codec::None)).expect("room for a map");
    let file = DsmFile::open(&path).expect("our own file");
    let sizes: Vec<_> = (file.maps()[0].levels.iter())
        .map(|l| (l.shape.width, l.shape.height))
        .collect();
    let flat = Flat::of(&file);
    let shadows = Shadows::open(&path, Source::Read, 8 << 30);
    let mut line = vec![
        format!("{:.1}", block.vertices()),
        format!("{:.0}", mib(flat.bytes())),
    ];
    for lookup in Lookup::ALL {
        for access in Access::ALL {
            if lookup == Lookup::Trilinear && sizes.len() == 1 {
                line.extend([String::new(), String::new()]);
                continue;
            }
            let queries = Queries::new(access, 50_000, (width, width), 0.0, DEPTHS);
            let mut sampler = shadows.sampler(lookup);
            for (x, y, z) in queries.thinned(2500).iter() {
                let taps = reference::taps(lookup, lookup.width(), &sizes, x, y);
                let value = |&(l, i, j, w): &(usize, u32, u32, f64)| {
                    w * reference::evaluate(
                        &file
                            .function(MapId(0).level(l as u32), Pixel::new(i, j))
                            .expect("our own file"),
                        z,
                    )
                };
                let stored: f64 = taps.iter().map(value).sum();
                for answer in [
                    flat.lookup(lookup, lookup.width(), x, y, z),
                    sampler.at(lookup.width(), x, y, z),
                ] {
                    let off = (f64::from(answer) - stored).abs();
                    assert!(off < 2f64.powi(-20), "{lookup:?} is off by {off}");
                }
            }
            let n = queries.len();
            let [ours, theirs] = interleaved(
                rounds,
                [
                    Candidate::new(n, || sampler.sum(lookup.width(), &queries)),
                    Candidate::new(n, || flat.sum(lookup, lookup.width(), &queries)),
                ],
            );
            line.push(format!("{ours:.0}"));
            line.push(format!("{:.2}", ours / theirs));
        }
    }
    line
}

/// Plain maps with percentage-closer filtering, 16 to 4096 taps, 4096 and 16384 texels wide.
pub fn plain(rounds: usize, record: &mut Record) {
    let mut lines = Vec::new();
    let mut features = "";
    for side in [4096usize, 16384] {
        let map = Plain::of(&Hair::new(side as u32 / 64, 23), 64);
        features = map.features();
        for n in [4u32, 8, 16, 32, 64] {
            let jitter = Jitter::new(n as usize, n as usize, side);
            let mut line = vec![side.to_string(), (n * n).to_string()];
            for access in Access::ALL {
                let points = 20_000_000 / (n * n) as usize;
                let square = (side as u32, side as u32);
                let queries = Queries::new(access, points.min(200_000), square, 40.0, DEPTHS);
                check_boxes(&map, n, &queries.thinned(queries.len() / 50));
                let [contiguous] = interleaved(
                    rounds,
                    [Candidate::new(queries.len(), || boxes(&map, n, &queries))],
                );
                let taps = jittered(rounds, &map, &jitter, &queries);
                line.push(format!("{contiguous:.1}"));
                line.push(format!("{taps:.1}"));
            }
            lines.push(line);
        }
    }
    record.heading("Plain shadow maps with percentage-closer filtering");
    record.say(format!(
        "ns a lookup; boxes with {features}; jittered taps over the same area, the faster of \
         scalar loads and gathers. Coherent: one texel a step."
    ));
    let columns = [
        "texels wide",
        "taps",
        "coherent: contiguous",
        "coherent: jittered",
        "random: contiguous",
        "random: jittered",
    ];
    record.table("plain", &columns, &lines);
}

fn check_boxes(map: &Plain, n: u32, queries: &Queries) {
    let (half, n) = (n as usize / 2, n as usize);
    let slow = |(x, y, z): (f32, f32, f32)| -> f64 {
        let (x, y) = ((x + 0.5) as usize - half, (y + 0.5) as usize - half);
        let lit = (0..n * n)
            .filter(|k| map.depth(x + k % n, y + k / n) >= z)
            .count();
        lit as f64 / (n * n) as f64
    };
    let exact: f64 = queries.iter().map(slow).sum();
    let off = (f64::from(boxes(map, n as u32, queries)) - exact).abs();
    assert!(off < 1e-4 * queries.len() as f64, "boxes are off by {off}");
}

/// Visibility by walking uncompressed deep samples against lookups of the compressed map of the
/// same image.
pub fn walk(folder: &Path, rounds: usize, record: &mut Record) {
    let side = 512;
    let curves = Hair::new(side, 41).curves(4);
    let samples = Samples::of(side, &curves);
    let block = Block::compress(side, &curves, Encoding::default_tolerance(16));
    let path = folder.join("walk.dsm");
    std::fs::write(&path, block.write(side, side, Mips::None, Codec::None))
        .expect("room for a map");
    let shadows = Shadows::open(&path, Source::Read, 1 << 30);
    let mut lines = Vec::new();
    for access in Access::ALL {
        let queries = Queries::new(access, 200_000, (side, side), 1.0, DEPTHS);
        check_walk(side, &samples, &curves, &queries.thinned(200));
        let (mut pixel, mut bilinear) = (
            shadows.sampler(Lookup::Pixel),
            shadows.sampler(Lookup::Bilinear),
        );
        let n = queries.len();
        let all = interleaved(
            rounds,
            [
                Candidate::new(n, || samples.sum(&queries, Samples::linear)),
                Candidate::new(n, || samples.sum(&queries, Samples::searched)),
                Candidate::new(n, || pixel.sum(1.0, &queries)),
                Candidate::new(n, || samples.sum_bilinear(&queries, Samples::linear)),
                Candidate::new(n, || samples.sum_bilinear(&queries, Samples::searched)),
                Candidate::new(n, || bilinear.sum(1.0, &queries)),
            ],
        );
        let mut line = vec![access.name().to_string()];
        line.extend(all.map(|ns| format!("{ns:.1}")));
        lines.push(line);
    }
    record.heading("Walking uncompressed deep samples");
    record.say(format!(
        "Hair, {side} x {side} pixels of 16 samples, {:.1} distinct depths a pixel, {:.1} MiB; \
         compressed at 1/16: {:.1} vertices a pixel. ns a lookup.",
        samples.average(),
        mib(samples.bytes()),
        block.vertices()
    ));
    let columns = [
        "access",
        "one pixel: linear",
        "one pixel: prefix and search",
        "one pixel: this crate",
        "2x2: linear",
        "2x2: prefix and search",
        "2x2: this crate",
    ];
    record.table("walk", &columns, &lines);
}

fn check_walk(side: u32, samples: &Samples, curves: &[Curve], queries: &Queries) {
    for (x, y, z) in queries.iter() {
        let (i, j) = (x as usize, y as usize);
        let exact = curves[j * side as usize + i].visibility(z);
        for v in [samples.linear(i, j, z), samples.searched(i, j, z)] {
            assert!((f64::from(v) - exact).abs() < 1e-5, "{v} is not {exact}");
        }
    }
}
