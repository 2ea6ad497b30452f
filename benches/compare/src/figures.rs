//! Figures 7 and 9 of LV00 for maps of this crate.

use std::path::Path;

use deepshadow::{Codec, DsmFile, Encoding, Mips};

use crate::lookups::mib;
use crate::maps::Block;
use crate::noise::Truth;
use crate::ours::{Shadows, Source};
use crate::pcf::{Jitter, Plain};
use crate::queries::{Access, Lookup, Queries};
use crate::record::Record;
use crate::reference::Levels;
use crate::scene::DEPTHS;
use crate::timing::{Candidate, interleaved};
use deepshadow_compare::plot;

/// Sum of boxes of `n` x `n` texels.
pub fn boxes(plain: &Plain, n: u32, queries: &Queries) -> f32 {
    match n {
        2 => plain.sum_boxes::<2>(queries),
        4 => plain.sum_boxes::<4>(queries),
        8 => plain.sum_boxes::<8>(queries),
        16 => plain.sum_boxes::<16>(queries),
        32 => plain.sum_boxes::<32>(queries),
        _ => plain.sum_boxes::<64>(queries),
    }
}

/// The faster of scalar and gathered taps.
pub fn jittered(rounds: usize, plain: &Plain, jitter: &Jitter, queries: &Queries) -> f64 {
    let n = queries.len();
    let scalar = Candidate::new(n, || plain.sum_jittered(jitter, queries));
    if jitter.taps < 8 || plain.sum_gathered(jitter, queries).is_none() {
        return interleaved(rounds, [scalar])[0];
    }
    let gathered = Candidate::new(n, || plain.sum_gathered(jitter, queries).unwrap_or(0.0));
    let [a, b] = interleaved(rounds, [scalar, gathered]);
    a.min(b)
}

/// Error, time and bytes by the samples of a pixel, the filter being one pixel of a map of constant
/// size (Figure 7).
pub fn seven(folder: &Path, truth: &Truth, rounds: usize, record: &mut Record) {
    let side = truth.hair.side;
    let (mut lines, mut times) = (Vec::new(), [const { Vec::new() }; 4]);
    let mut sizes = [const { Vec::new() }; 3];
    for n in [2u32, 4, 8, 16, 32, 64] {
        let (samples, plain) = (n * n, Plain::of(&truth.hair, n));
        let tolerance = Encoding::default_tolerance(samples);
        let block = Block::compress(side, &truth.hair.curves(n), tolerance);
        let path = folder.join("seven.dsm");
        let none = block.write(side, side, Mips::Full, Codec::None);
        std::fs::write(&path, &none).expect("room for a map");
        let levels = Levels::of(&DsmFile::from_bytes(none).expect("our own file"));
        let resident: usize = (0..levels.sizes.len()).map(|l| levels.bytes(l)).sum();
        let file = block.write(side, side, Mips::Full, Codec::Zstd(9)).len();
        let shadows = Shadows::open(&path, Source::Read, 1 << 30);
        let noise = [
            truth.jittered(&plain, n as usize),
            truth.deep(&block, Lookup::Pixel),
            truth.deep(&block, Lookup::Bilinear),
        ];
        let jitter = Jitter::new(n as usize, n as usize, plain.side);
        let mut line = vec![
            samples.to_string(),
            format!("{:.4}", 0.5 / f64::from(samples).sqrt()),
            format!("{:.4}", noise[0]),
            format!("{:.4}", noise[1]),
            format!("{:.4}", noise[2]),
        ];
        for access in Access::ALL {
            let points = (10_000_000 / samples as usize).clamp(4000, 100_000);
            let queries = Queries::new(access, points, (side, side), 1.5, DEPTHS);
            let texels = queries.scaled(n as f32);
            let (mut pixel, mut bilinear) = (
                shadows.sampler(Lookup::Pixel),
                shadows.sampler(Lookup::Bilinear),
            );
            let [a, b, c] = interleaved(
                rounds,
                [
                    Candidate::new(points, || boxes(&plain, n, &texels)),
                    Candidate::new(points, || pixel.sum(1.0, &queries)),
                    Candidate::new(points, || bilinear.sum(1.0, &queries)),
                ],
            );
            let taps = jittered(rounds, &plain, &jitter, &texels);
            let all = [a, taps, b, c];
            line.extend(all.map(|ns| format!("{ns:.0}")));
            if access == Access::Random {
                for (series, ns) in times.iter_mut().zip(all) {
                    series.push((f64::from(samples), ns));
                }
            }
        }
        for (series, bytes) in sizes.iter_mut().zip([plain.bytes(), resident, file]) {
            series.push((f64::from(samples), mib(bytes)));
            line.push(format!("{:.2}", mib(bytes)));
        }
        lines.push(line);
    }
    record.heading("Figure 7 of LV00: error, time and bytes by samples a pixel");
    record.say(format!(
        "Maps of {side} x {side} pixels of hair; filters one pixel wide, so a plain map has N \
         texels there; tolerance 0.25/sqrt(N). Noise is the RMS error against the exact coverage \
         at {} points. \
         Times in ns a lookup: contiguous box, jittered taps, deep one pixel, deep bilinear. All \
         are asked at the same points. MiB: the plain map, the deep one decoded with all levels, \
         its file with zstd 9.",
        truth.queries.len()
    ));
    let columns = [
        "N",
        "0.5/sqrt(N)",
        "noise: jittered",
        "noise: deep one pixel",
        "noise: deep bilinear",
        "coherent: box",
        "coherent: jittered",
        "coherent: deep pixel",
        "coherent: deep bilinear",
        "random: box",
        "random: jittered",
        "random: deep pixel",
        "random: deep bilinear",
        "MiB plain",
        "MiB deep",
        "MiB file",
    ];
    record.table("figure7", &columns, &lines);
    let names = [
        "contiguous box",
        "jittered taps",
        "deep, one pixel",
        "deep, bilinear",
    ];
    let series: Vec<_> = names.into_iter().zip(times).collect();
    let title = "Figure 7: time of a random lookup by samples a pixel";
    draw(
        record,
        "compare-figure7-time.svg",
        title,
        ["samples a pixel", "ns"],
        &series,
    );
    let series: Vec<_> = ["plain map", "deep map, decoded", "deep map, file"]
        .into_iter()
        .zip(sizes)
        .collect();
    let title = "Figure 7: size by samples a pixel";
    draw(
        record,
        "compare-figure7-size.svg",
        title,
        ["samples a pixel", "MiB"],
        &series,
    );
}

fn draw(
    record: &mut Record,
    name: &str,
    title: &str,
    axes: [&str; 2],
    series: &[plot::Series<'_>],
) {
    if let Some(folder) = record.folder.clone() {
        std::fs::create_dir_all(&folder).expect("the folder of records");
        plot::lines(&folder.join(name), title, axes[0], axes[1], series);
        record.say(format!("![{title}]({name})"));
    }
}

/// Time and error by the width of the filter, 8 x 8 taps against the levels of a deep map (Figure
/// 9).
pub fn nine(folder: &Path, truth: &Truth, rounds: usize, record: &mut Record) {
    const TAPS: u32 = 8;
    let side = truth.hair.side;
    let plain = Plain::of(&truth.hair, TAPS);
    let block = Block::compress(
        side,
        &truth.hair.curves(TAPS),
        Encoding::default_tolerance(64),
    );
    let path = folder.join("nine.dsm");
    let bytes = block.write(side, side, Mips::Full, Codec::None);
    std::fs::write(&path, &bytes).expect("room for a map");
    let levels = Levels::of(&DsmFile::from_bytes(bytes).expect("our own file"));
    let shadows = Shadows::open(&path, Source::Read, 1 << 30);
    let mut sampler = shadows.sampler(Lookup::Trilinear);
    let (mut lines, mut times) = (Vec::new(), [const { Vec::new() }; 4]);
    for width in [1u32, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64] {
        let jitter = Jitter::new(TAPS as usize, (TAPS * width) as usize, plain.side);
        let margin = width as f32 / 2.0 + 2.0;
        let few = Queries::new(Access::Random, 200, (side, side), margin, DEPTHS);
        let (mut deep, mut worst, mut taps) = (0.0, 0.0f64, 0.0);
        for (i, at @ (x, y, z)) in few.iter().enumerate() {
            if i % 8 == 0 {
                let off = f64::from(sampler.at(width as f32, x, y, z))
                    - levels.exact(Lookup::Trilinear, width as f32, at);
                assert!(
                    off.abs() <= levels.bound(Lookup::Trilinear, width as f32),
                    "{width} at {at:?}"
                );
                worst = worst.max(off.abs());
                deep += off * off * 8.0;
            }
            let (u, v, reach) = (
                (x * TAPS as f32) as usize,
                (y * TAPS as f32) as usize,
                (TAPS * width / 2) as usize,
            );
            let area =
                (v - reach..v + reach).flat_map(|j| (u - reach..u + reach).map(move |i| (i, j)));
            let lit = area.filter(|&(i, j)| plain.depth(i, j) >= z).count();
            let exact = lit as f64 / (4 * reach * reach) as f64;
            let count = plain.count_jittered(&jitter, u as f32, v as f32, z);
            taps += (f64::from(count) / f64::from(TAPS * TAPS) - exact).powi(2);
        }
        let points = few.len() as f64;
        let mut line = vec![
            width.to_string(),
            format!("1/{:.1}", f64::from(side) / f64::from(width)),
            format!("{worst:.4}"),
            format!("{:.4}", (deep / points).sqrt()),
            format!("{:.4}", (taps / points).sqrt()),
        ];
        for (a, access) in Access::ALL.into_iter().enumerate() {
            let queries = Queries::new(access, 50_000, (side, side), margin, DEPTHS);
            let texels = queries.scaled(TAPS as f32);
            let [ours] = interleaved(
                rounds,
                [Candidate::new(queries.len(), || {
                    sampler.sum(width as f32, &queries)
                })],
            );
            let theirs = jittered(rounds, &plain, &jitter, &texels);
            for (series, ns) in times[2 * a..].iter_mut().zip([ours, theirs]) {
                series.push((f64::from(width) / f64::from(side), ns));
                line.push(format!("{ns:.0}"));
            }
        }
        lines.push(line);
    }
    record.heading("Figure 9 of LV00: time by filter width");
    record.say(format!(
        "Hair, {side} x {side} pixels of 64 samples. Deep: a triangle through the levels (powers \
         of two meet one level, four pixels; others two, eight pixels). Plain: 8 x 8 jittered \
         taps over the width, in a map of {} x {} texels. \
         Errors of deep lookups against exact averages of the stored base level, of taps against \
         all texels of the area; they get noisier where the area grows.",
        plain.side, plain.side
    ));
    let columns = [
        "width in pixels",
        "of the map",
        "deep: largest error",
        "deep: RMS",
        "taps: RMS",
        "deep coherent",
        "taps coherent",
        "deep random",
        "taps random",
    ];
    record.table("figure9", &columns, &lines);
    let names = [
        "deep, coherent",
        "8x8 taps, coherent",
        "deep, random",
        "8x8 taps, random",
    ];
    let series: Vec<_> = names.into_iter().zip(times).collect();
    let title = "Figure 9: time by filter width";
    draw(
        record,
        "compare-figure9.svg",
        title,
        ["width as a fraction of the map", "ns"],
        &series,
    );
}
