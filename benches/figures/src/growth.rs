//! Figures 7 and 8: error, time and bytes by number of samples per pixel.

use std::hint::black_box;
use std::time::Instant;

use deepshadow::{
    CachedFile, DsmFile, Encoding, Filter, MapId, Pixel, Query, Sampler, SamplerOptions, TileCache,
};
use deepshadow_compare::plot;
use deepshadow_frame::{InFile, Result};
use deepshadow_scene::scene::Scene;

use crate::page::Page;
use crate::plain::{PlainMap, jittered_taps};
use crate::shots::{BuiltMap, Studio, seconds, size};

/// Width and height of the deep maps in pixels, as in the paper.
pub const SIDE: i32 = 256;

/// Points to look up, in scanline order: x and y in pixels of the deep map, and depth.
pub struct LookupPoints(pub Vec<[f32; 3]>);

impl LookupPoints {
    /// One point in every pixel that has vertices, at a depth between its first and last vertex.
    pub fn of(file: &DsmFile) -> Result<Self> {
        let mut points = Vec::new();
        for y in 0..SIDE as u32 {
            for x in 0..SIDE as u32 {
                let function = file.function(MapId(0).level(0), Pixel::new(x, y))?;
                if let (Some(first), Some(last)) =
                    (function.depths().first(), function.depths().last())
                {
                    // Multiples of the golden ratio spread the depths evenly.
                    let t = (f64::from(y * SIDE as u32 + x) * 0.618_033_988_749_895).fract() as f32;
                    points.push([x as f32 + 0.5, y as f32 + 0.5, first + (last - first) * t]);
                }
            }
        }
        Ok(LookupPoints(points))
    }
}

/// Runs `lookup` for every point. Returns the answers and the nanoseconds per lookup.
///
/// The time is that of the fastest of `runs` runs.
pub fn time_lookups(
    points: &LookupPoints,
    runs: usize,
    mut lookup: impl FnMut(usize, &[f32; 3]) -> f32,
) -> (Vec<f32>, f64) {
    let mut best = f64::INFINITY;
    let mut answers = vec![0.0; points.0.len()];
    for _ in 0..runs {
        let started = Instant::now();
        for (i, (point, answer)) in points.0.iter().zip(&mut answers).enumerate() {
            *answer = black_box(lookup(i, point));
        }
        best = best.min(started.elapsed().as_nanos() as f64 / points.0.len() as f64);
    }
    (answers, best)
}

/// Opens a map in a cache large enough for all of it.
pub fn cached(map: &BuiltMap) -> Result<CachedFile> {
    let cache = TileCache::new(1 << 30);
    Ok(cache.add(DsmFile::open(&map.path).in_file(&map.path)?))
}

/// Makes a sampler with a box filter.
pub fn sampler(file: &CachedFile) -> Result<Sampler> {
    let options = SamplerOptions::default().filter(Filter::Box);
    Ok(Sampler::with_options(file, MapId(0), options)?)
}

fn scene(studio: &Studio, samples: u32) -> Result<Scene> {
    let mut scene = studio.scene("growth")?;
    scene.lights[0].samples = samples;
    Ok(scene)
}

fn rms(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// Writes figures 7 and 8: table and plots.
pub fn tables(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 7: deep and plain shadow maps with the same number of samples");
    let most = if studio.quick { 4 } else { 6 };
    let maps: Vec<(u32, BuiltMap)> = (1..=most)
        .map(|k| {
            let samples = 4u32.pow(k);
            Ok((
                samples,
                studio.map(&scene(studio, samples)?, &format!("growth{samples}"))?,
            ))
        })
        .collect::<Result<_>>()?;
    let (_, finest) = maps.last().expect("there are several");
    let reference = cached(finest)?;
    let points = LookupPoints::of(&DsmFile::open(&finest.path)?)?;
    let lookup_all = |file: &CachedFile, runs| -> Result<_> {
        let mut sampler = sampler(file)?;
        let mut failed = None;
        let found = time_lookups(&points, runs, |_, [x, y, z]| {
            sampler
                .visibility(&Query::new(*x, *y, *z))
                .unwrap_or_else(|e| {
                    failed = Some(e);
                    0.0
                })
        });
        failed.map_or(Ok(found), |e| Err(e.into()))
    };
    let (exact, _) = lookup_all(&reference, 1)?;
    let mut rows = String::from(
        "| samples | tolerance | bytes: plain f32 | plain, zstd | deep | deep, all levels \
         | plain f32 / deep | vertices per pixel | build time | lookup: plain, as many taps | deep \
         | RMS error: plain | deep |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let (mut growth, mut bytes, mut ratio) = (Vec::new(), [Vec::new(), Vec::new()], 0.0);
    for (samples, map) in &maps {
        let root = f64::from(*samples).sqrt() as i32;
        let plain = PlainMap::new(&scene(studio, 1)?, SIDE * root)?;
        let [raw, packed] = plain.bytes()?;
        let sets = jittered_taps(*samples, 64);
        let (filtered, plain_ns) = time_lookups(
            &points,
            if *samples > 300 { 1 } else { 5 },
            |i, [x, y, z]| {
                let scale = root as f32;
                plain.light([x * scale, y * scale], *z, scale, &sets[i % sets.len()])
            },
        );
        let (deep, deep_ns) = lookup_all(&cached(map)?, 5)?;
        let pixels = f64::from(SIDE * SIDE);
        let vertices = map.report.summary.vertices[0][0] as f64 / pixels;
        ratio = raw as f64 / map.bytes[0] as f64;
        let finest = *samples == maps.last().map_or(0, |m| m.0);
        rows += &format!(
            "| {root} x {root} | {:.4} | {} | {} | {} | {} | {ratio:.1} x | {vertices:.2} | {} \
             | {plain_ns:.0} ns | {deep_ns:.0} ns | {:.4} | {} |\n",
            Encoding::default_tolerance(*samples),
            size(raw),
            size(packed),
            size(map.bytes[0]),
            size(map.bytes[1]),
            seconds(map.build_time),
            rms(&filtered, &exact),
            if finest {
                "(reference)".into()
            } else {
                format!("{:.4}", rms(&deep, &exact))
            },
        );
        growth.push((f64::from(*samples), vertices));
        bytes[0].push((f64::from(*samples), raw as f64));
        bytes[1].push((f64::from(*samples), map.bytes[0] as f64));
    }
    page.table(&rows);
    page.paragraph(
        "The hair ball on the ground under one spotlight, as in the paper. Each deep map has 256 x \
         256 pixels, and in each pixel the number of samples in the first column. The plain map of \
         the same row has as many depths in all. Every filter is one pixel of the deep map wide. \
         Times are for one lookup in scanline order on one thread. The plain map compares as many \
         jittered depths as a pixel of the deep map has samples. RMS errors are relative to the \
         finest deep map. The paper compressed its plain maps to 1.33 bytes per depth. This table \
         gives their size uncompressed and compressed by zstd (level 3).",
    );
    let path = page.embed(
        "bytes.svg",
        "Bytes by samples per pixel, for plain and deep maps",
    );
    let [plain, deep] = bytes;
    plot::lines(
        &path,
        "Bytes of a map of 256 x 256 pixels",
        "samples per pixel",
        "bytes",
        &[("plain, f32", plain), ("deep, base level", deep)],
    );
    page.section("Figure 8: growth of deep maps with the number of samples");
    let (first, last) = (growth[0], growth[growth.len() - 1]);
    let slope = (last.1 / first.1).ln() / (last.0 / first.0).ln();
    let line = |exponent: f64| {
        growth
            .iter()
            .map(|(n, _)| (*n, first.1 * (n / first.0).powf(exponent)))
            .collect::<Vec<_>>()
    };
    let path = page.embed("growth.svg", "Vertices per pixel by samples per pixel");
    plot::lines(
        &path,
        "Vertices per pixel",
        "samples per pixel",
        "vertices",
        &[
            ("measured", growth.clone()),
            ("N^(1/4), the paper's estimate", line(0.25)),
            ("N^(1/2), upper bound", line(0.5)),
        ],
    );
    page.paragraph(&format!(
        "The mean number of vertices per pixel grows as the number of samples N to the power of \
         {slope:.2}, from {} to {} samples, with a tolerance of 0.25 / sqrt(N). The paper expects \
         a power of 1/4 for smooth functions and 1/2 at worst. At {} samples the plain map takes \
         {ratio:.0} times the bytes of the deep map.",
        first.0, last.0, last.0,
    ));
    Ok(())
}
