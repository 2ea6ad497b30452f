//! Figures 7 and 8: error, time and bytes as the samples of a pixel grow.

use std::hint::black_box;
use std::time::Instant;

use deepshadow::{
    CachedFile, DsmFile, Filter, MapId, Pixel, Query, Sampler, SamplerOptions, TileCache,
    default_tolerance,
};
use deepshadow_compare::plot;
use deepshadow_frame::{InFile, Result};
use deepshadow_scene::scene::Scene;

use crate::page::Page;
use crate::plain::{Plain, taps};
use crate::shots::{Made, Studio, seconds, size};

/// Pixels along the sides of the deep maps, as in the paper.
pub const SIDE: i32 = 256;

/// Places that lookups ask for, row by row: x and y in pixels of the deep map, and depth.
pub struct Places(pub Vec<[f32; 3]>);

impl Places {
    /// One for each pixel in which something is, somewhere between its first and its last depth.
    pub fn of(file: &DsmFile) -> Result<Self> {
        let mut places = Vec::new();
        for y in 0..SIDE as u32 {
            for x in 0..SIDE as u32 {
                let function = file.function(MapId(0).level(0), Pixel::new(x, y))?;
                if let (Some(first), Some(last)) =
                    (function.depths().first(), function.depths().last())
                {
                    // Evenly spread, without a generator: the golden ratio of the pixel's number.
                    let t = (f64::from(y * SIDE as u32 + x) * 0.618_033_988_749_895).fract() as f32;
                    places.push([x as f32 + 0.5, y as f32 + 0.5, first + (last - first) * t]);
                }
            }
        }
        Ok(Places(places))
    }
}

/// What is looked up, in the order of the places, and nanoseconds a lookup: the best of several runs.
pub fn timed(
    places: &Places,
    runs: usize,
    mut look: impl FnMut(usize, &[f32; 3]) -> f32,
) -> (Vec<f32>, f64) {
    let mut best = f64::INFINITY;
    let mut answers = vec![0.0; places.0.len()];
    for _ in 0..runs {
        let started = Instant::now();
        for (i, (place, answer)) in places.0.iter().zip(&mut answers).enumerate() {
            *answer = black_box(look(i, place));
        }
        best = best.min(started.elapsed().as_nanos() as f64 / places.0.len() as f64);
    }
    (answers, best)
}

/// A map in a cache that holds all of it.
pub fn cached(made: &Made) -> Result<CachedFile> {
    let cache = TileCache::new(1 << 30);
    Ok(cache.add(DsmFile::open(&made.path).in_file(&made.path)?))
}

/// A sampler with a box for a filter.
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

/// Figures 7 and 8.
pub fn tables(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 7: deep shadow maps and plain ones of the same number of samples");
    let most = if studio.quick { 4 } else { 6 };
    let made: Vec<(u32, Made)> = (1..=most)
        .map(|k| {
            let samples = 4u32.pow(k);
            Ok((
                samples,
                studio.map(&scene(studio, samples)?, &format!("growth{samples}"))?,
            ))
        })
        .collect::<Result<_>>()?;
    let (_, finest) = made.last().expect("there are several");
    let truth = cached(finest)?;
    let places = Places::of(&DsmFile::open(&finest.path)?)?;
    let ask = |file: &CachedFile, runs| -> Result<_> {
        let mut sampler = sampler(file)?;
        let mut failed = None;
        let found = timed(&places, runs, |_, [x, y, z]| {
            sampler
                .visibility(&Query::new(*x, *y, *z))
                .unwrap_or_else(|e| {
                    failed = Some(e);
                    0.0
                })
        });
        failed.map_or(Ok(found), |e| Err(e.into()))
    };
    let (exact, _) = ask(&truth, 1)?;
    let mut rows = String::from(
        "| samples | promise | bytes: plain f32 | plain, zstd | deep | deep, all levels | plain f32 / deep | vertices a pixel | made in | lookup: plain, that many taps | deep | RMS error: plain | deep |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let (mut growth, mut bytes, mut smallest) = (Vec::new(), [Vec::new(), Vec::new()], 0.0);
    for (samples, map) in &made {
        let root = f64::from(*samples).sqrt() as i32;
        let plain = Plain::new(&scene(studio, 1)?, SIDE * root)?;
        let [raw, packed] = plain.bytes()?;
        let sets = taps(*samples, 64);
        let (filtered, plain_ns) = timed(
            &places,
            if *samples > 300 { 1 } else { 5 },
            |i, [x, y, z]| {
                let scale = root as f32;
                plain.light([x * scale, y * scale], *z, scale, &sets[i % sets.len()])
            },
        );
        let (deep, deep_ns) = ask(&cached(map)?, 5)?;
        let pixels = f64::from(SIDE * SIDE);
        let vertices = map.report.summary.vertices[0][0] as f64 / pixels;
        smallest = raw as f64 / map.bytes[0] as f64;
        let finest = *samples == made.last().map_or(0, |m| m.0);
        rows += &format!(
            "| {root} x {root} | {:.4} | {} | {} | {} | {} | {smallest:.1} x | {vertices:.2} | {} | {plain_ns:.0} ns | {deep_ns:.0} ns | {:.4} | {} |\n",
            default_tolerance(*samples),
            size(raw),
            size(packed),
            size(map.bytes[0]),
            size(map.bytes[1]),
            seconds(map.time),
            rms(&filtered, &exact),
            if finest {
                "(the measure)".into()
            } else {
                format!("{:.4}", rms(&deep, &exact))
            },
        );
        growth.push((f64::from(*samples), vertices));
        bytes[0].push((f64::from(*samples), raw as f64));
        bytes[1].push((f64::from(*samples), map.bytes[0] as f64));
    }
    page.text(&rows);
    page.text(
        "The hair ball on the ground under one spotlight, as in the paper: every deep map has 256 x 256 pixels and as many samples in each as the first column says, the plain map beside it as many depths in all. \
         The filter is one pixel of the deep map everywhere. Time is one lookup in scanline order, one thread; the plain map compares as many depths as there are samples, jittered. RMS error is against the finest deep map. \
         The paper's plain maps were compressed to 1.33 bytes a depth; here raw and zstd (level 3) stand side by side.",
    );
    let path = page.show("bytes.svg", "Bytes by samples, plain and deep");
    let [plain, deep] = bytes;
    plot::lines(
        &path,
        "Bytes of a map of 256 x 256 pixels",
        "samples in a pixel",
        "bytes",
        &[("plain, f32", plain), ("deep, base level", deep)],
    );
    page.section("Figure 8: how deep maps grow with their samples");
    let (first, last) = (growth[0], growth[growth.len() - 1]);
    let slope = (last.1 / first.1).ln() / (last.0 / first.0).ln();
    let line = |exponent: f64| {
        growth
            .iter()
            .map(|(n, _)| (*n, first.1 * (n / first.0).powf(exponent)))
            .collect::<Vec<_>>()
    };
    let path = page.show("growth.svg", "Vertices in a pixel by samples");
    plot::lines(
        &path,
        "Vertices in a pixel",
        "samples in a pixel",
        "vertices",
        &[
            ("measured", growth.clone()),
            ("N^(1/4), the paper's theory", line(0.25)),
            ("N^(1/2), the bound", line(0.5)),
        ],
    );
    page.text(&format!(
        "Vertices in a pixel, all pixels, grow with the samples to the power of {slope:.2} from {} to {} samples, the tolerance shrinking with them as 0.25 / sqrt(N); the paper expects 1/4 for smooth functions and 1/2 at worst. \
         At {} samples the plain map takes {smallest:.0} times the bytes.",
        first.0, last.0, last.0,
    ));
    Ok(())
}
