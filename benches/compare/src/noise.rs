//! The same noise: jittered percentage-closer filtering against deep lookups that are no noisier.

use std::path::Path;

use deepshadow::{Codec, Compressor, Encoding, Mips};
use rayon::prelude::*;

use crate::lookups::{BYTES, WIDTH, mib};
use crate::maps::Block;
use crate::ours::{Shadows, Source};
use crate::pcf::{Jitter, Plain};
use crate::queries::{Access, Lookup, Queries};
use crate::record::{Record, Row};
use crate::reference::{Levels, evaluate};
use crate::scene::{DEPTHS, Dice, Hair};
use crate::timing::{Candidate, interleaved};

/// Texels of the plain map across one pixel of the deep one, which is the footprint.
pub const TEXELS: u32 = 64;

/// Points with the exact values that filters of one pixel estimate there.
pub struct Truth {
    /// The scene.
    pub hair: Hair,
    /// Points, in pixels.
    pub queries: Queries,
    /// Box of one pixel around each point.
    boxes: Vec<f64>,
    /// Box of the pixel that holds the point.
    pixels: Vec<f64>,
    /// The same of the 2 x 2 pixels around the point, bilinear.
    bilinear: Vec<f64>,
}

impl Truth {
    /// `n` random points of a scene.
    pub fn new(side: u32, n: usize) -> Self {
        let hair = Hair::new(side, 23);
        let queries = Queries::new(Access::Random, n, (side, side), 1.5, DEPTHS);
        let middle = |v: f32| f64::from(v.floor()) + 0.5;
        let each = |at: &(dyn Fn(f32, f32, f32) -> f64 + Sync)| -> Vec<f64> {
            let points: Vec<_> = queries.iter().collect();
            points.par_iter().map(|&(x, y, z)| at(x, y, z)).collect()
        };
        let bilinear = |x: f32, y: f32, z: f32| -> f64 {
            let taps = four(x, y).map(|(i, j, w)| w * hair.coverage(i + 0.5, j + 0.5, z));
            taps.iter().sum()
        };
        Truth {
            boxes: each(&|x, y, z| hair.coverage(f64::from(x), f64::from(y), z)),
            pixels: each(&|x, y, z| hair.coverage(middle(x), middle(y), z)),
            bilinear: each(&bilinear),
            hair,
            queries,
        }
    }

    fn rms(&self, exact: &[f64], at: impl Fn(f32, f32, f32) -> f64) -> f64 {
        let squares = self.queries.iter().zip(exact);
        let sum: f64 = squares
            .map(|((x, y, z), e)| (at(x, y, z) - e).powi(2))
            .sum();
        (sum / exact.len() as f64).sqrt()
    }

    /// Noise of `n` x `n` stratified taps over one pixel of a plain map of the scene; every tap at
    /// its own place, none from a table.
    pub fn jittered(&self, map: &Plain, n: usize) -> f64 {
        let scale = map.side as f64 / f64::from(self.hair.side);
        let dice = std::cell::RefCell::new(Dice::new(3));
        self.rms(&self.boxes, |x, y, z| {
            let mut dice = dice.borrow_mut();
            let mut lit = 0;
            for k in 0..n * n {
                let mut axis = |at: f32, i: usize| {
                    let place = (i as f64 + dice.range(0.0, 1.0)) / n as f64 - 0.5;
                    ((f64::from(at) + place) * scale) as usize
                };
                let (i, j) = (axis(x, k % n), axis(y, k / n));
                lit += usize::from(map.depth(i, j) >= z);
            }
            lit as f64 / (n * n) as f64
        })
    }

    /// Noise of a box over all `W` x `W` texels of a pixel.
    pub fn contiguous<const W: usize>(&self, map: &Plain) -> f64 {
        let scale = W as f32;
        self.rms(&self.boxes, |x, y, z| {
            f64::from(map.box_at::<W>(x * scale, y * scale, z))
        })
    }

    /// Noise of a deep lookup.
    pub fn deep(&self, block: &Block, lookup: Lookup) -> f64 {
        let at = |i: f64, j: f64, z| {
            let pixel = j as usize * block.side as usize + i as usize;
            evaluate(&block.functions[pixel], z)
        };
        match lookup {
            Lookup::Pixel => self.rms(&self.pixels, |x, y, z| at(f64::from(x), f64::from(y), z)),
            _ => self.rms(&self.bilinear, |x, y, z| {
                let taps = four(x, y).map(|(i, j, w)| w * at(i, j, z));
                taps.iter().sum()
            }),
        }
    }
}

/// The 2 x 2 pixels around a point with their bilinear weights.
fn four(x: f32, y: f32) -> [(f64, f64, f64); 4] {
    let (x, y) = (f64::from(x) - 0.5, f64::from(y) - 0.5);
    let (i, j) = (x.floor(), y.floor());
    let (u, v) = (x - i, y - j);
    [
        (i, j, (1.0 - u) * (1.0 - v)),
        (i + 1.0, j, u * (1.0 - v)),
        (i, j + 1.0, (1.0 - u) * v),
        (i + 1.0, j + 1.0, u * v),
    ]
}

/// A deep map and how noisy it is.
pub struct Deep {
    /// Samples a pixel.
    pub samples: u32,
    /// The functions.
    pub block: Block,
    /// RMS error of one-pixel and of bilinear lookups.
    pub noise: [f64; 2],
}

/// Deep maps of one scene from 16 to 4096 samples a pixel, around the tolerance that LV00 advises.
pub fn candidates(truth: &Truth) -> Vec<Deep> {
    let mut out = Vec::new();
    for n in [4u32, 8, 16, 32, 64] {
        let curves = truth.hair.curves(n);
        for part in [1.3, 1.15, 1.05, 1.0, 0.85, 0.7, 0.5, 0.35] {
            let tolerance = Encoding::default_tolerance(n * n) * part;
            let block = Block::compress(truth.hair.side, &curves, tolerance);
            let noise = [Lookup::Pixel, Lookup::Bilinear].map(|l| truth.deep(&block, l));
            out.push(Deep {
                samples: n * n,
                block,
                noise,
            });
        }
    }
    out
}

const FILTERS: [Lookup; 2] = [Lookup::Pixel, Lookup::Bilinear];

/// The smallest map whose lookups with the `filter`th filter are at most as noisy.
fn quietest(maps: &[Deep], filter: usize, noise: f64) -> Option<&Deep> {
    let enough = maps.iter().filter(|d| d.noise[filter] <= noise);
    enough.min_by(|a, b| a.block.vertices().total_cmp(&b.block.vertices()))
}

/// Rows at the noise of 256 and of 4096 jittered taps, and what the maps take.
pub fn rows(folder: &Path, truth: &Truth, rounds: usize, record: &mut Record) {
    let plain = Plain::of(&truth.hair, TEXELS);
    let small = Plain::of(&truth.hair, 16);
    let maps = candidates(truth);
    let lines: Vec<Vec<String>> = maps.iter().map(line).collect();
    record.heading("Noise");
    record.say(format!(
        "RMS error of a filter one pixel wide at {} random points and depths, against the exact \
         coverage of the scene ({} x {} pixels). Plain maps have {TEXELS} x {TEXELS} texels a \
         pixel. \
         Deep lookups are those of stored functions, each against the exact value of its own \
         filter.",
        truth.queries.len(),
        truth.hair.side,
        truth.hair.side,
    ));
    let columns = [
        "samples a pixel",
        "tolerance",
        "vertices a pixel",
        "noise: one pixel",
        "noise: bilinear",
    ];
    record.table("noise", &columns, &lines);
    // Times of plain maps: 64 MiB, as the deep ones have.
    let big = Plain::corner(&plain, 4096);
    for (taps, n) in [(256, 16), (4096, 64)] {
        let noise = truth.jittered(&plain, n);
        let beside = match taps {
            256 => truth.contiguous::<16>(&small),
            _ => truth.contiguous::<64>(&plain),
        };
        record.say(format!(
            "{taps} jittered taps: {noise:.5}. Contiguous box of as many texels, of a map that \
             has them in a pixel: {beside:.5}."
        ));
        let jitter = Jitter::new(n, TEXELS as usize, big.side);
        for (filter, lookup) in FILTERS.into_iter().enumerate() {
            let name = format!("noise of {taps} jittered taps: {}", lookup.name());
            let Some(deep) = quietest(&maps, filter, noise) else {
                record.row(Row::new(name, "").skipped("no map here is that quiet"));
                continue;
            };
            record.say(format!(
                "{} lookups are as quiet with {} samples a pixel at a tolerance of {:.5}: {:.5}, \
                 {:.1} vertices a pixel.",
                lookup.name(),
                deep.samples,
                deep.block.tolerance,
                deep.noise[filter],
                deep.block.vertices()
            ));
            times(folder, &name, deep, filter, &big, &jitter, rounds, record);
            if taps == 4096 {
                let name = format!("noise of 4096 jittered taps: {}", lookup.name());
                memory(&name, &deep.block, plain.bytes(), record);
                let n = f64::from(deep.samples).sqrt() as u32;
                let minimal = Block::compress_with(
                    Compressor::Minimal,
                    truth.hair.side,
                    &truth.hair.curves(n),
                    deep.block.tolerance,
                );
                let quiet = truth.deep(&minimal, lookup);
                if quiet <= noise {
                    memory(&format!("{name}; Minimal"), &minimal, plain.bytes(), record);
                } else {
                    record.say(format!(
                        "`Minimal` at that tolerance is noisier: {quiet:.5}."
                    ));
                }
            }
        }
    }
}

fn line(deep: &Deep) -> Vec<String> {
    vec![
        deep.samples.to_string(),
        format!("{:.5}", deep.block.tolerance),
        format!("{:.1}", deep.block.vertices()),
        format!("{:.5}", deep.noise[0]),
        format!("{:.5}", deep.noise[1]),
    ]
}

#[allow(clippy::too_many_arguments, reason = "one comparison, called once")]
fn times(
    folder: &Path,
    name: &str,
    deep: &Deep,
    filter: usize,
    plain: &Plain,
    jitter: &Jitter,
    rounds: usize,
    record: &mut Record,
) {
    let (lookup, taps) = (FILTERS[filter], jitter.taps);
    let size = (WIDTH, deep.block.rows_for(WIDTH, BYTES));
    let path = folder.join("noise.dsm");
    let bytes = deep.block.write(size.0, size.1, Mips::None, Codec::None);
    std::fs::write(&path, bytes).expect("room for a map");
    let shadows = Shadows::open(&path, Source::Read, 1 << 30);
    let mut sampler = shadows.sampler(lookup);
    for access in Access::ALL {
        let queries = Queries::new(access, 100_000, size, 0.0, DEPTHS);
        // Neighbouring points are one texel apart, which is kinder to the plain map than the pixel
        // of the deep one.
        let square = (plain.side as u32, plain.side as u32);
        let n = 10_000_000 / taps;
        let texels = Queries::new(access, n, square, 40.0, DEPTHS);
        let checked = sampler.sum(1.0, &queries);
        assert!(
            checked > 0.0 && checked < queries.len() as f32,
            "light and shadow"
        );
        let [ours, scalar, gathered, contiguous] = interleaved(
            rounds,
            [
                Candidate::new(queries.len(), || sampler.sum(1.0, &queries)),
                Candidate::new(n, || plain.sum_jittered(jitter, &texels)),
                Candidate::new(n, || {
                    let sum = plain.sum_gathered(jitter, &texels);
                    sum.unwrap_or_else(|| plain.sum_jittered(jitter, &texels))
                }),
                Candidate::new(n, || match taps {
                    256 => plain.sum_boxes::<16>(&texels),
                    _ => plain.sum_boxes::<64>(&texels),
                }),
            ],
        );
        let (best, how) = if gathered < scalar {
            (gathered, "gathered")
        } else {
            (scalar, "scalar")
        };
        let row = Row::new(name, access.name()).error(deep.noise[filter]);
        let row = row.times(ours, format!("{taps} jittered taps ({how})"), best);
        record.row(row.goal(best));
        let row = Row::new(format!("{name} (beside)"), access.name());
        let beside = format!("{taps} contiguous taps with {}", plain.features());
        record.row(row.times(ours, beside, contiguous));
    }
}

/// Rows of bytes: the plain map against the deep one of the same scene, decoded and as a file, with
/// all levels and with the base alone, which is all that these lookups load.
fn memory(name: &str, block: &Block, plain: usize, record: &mut Record) {
    let side = block.side;
    let texels = side * TEXELS;
    let baseline = format!("f32 map {texels} x {texels}");
    for (mips, levels) in [(Mips::None, "base level"), (Mips::Full, "all levels")] {
        let decoded = Levels::of(&block.file(side, side, mips));
        let resident: usize = (0..decoded.sizes.len()).map(|l| decoded.bytes(l)).sum();
        let file = block.write(side, side, mips, Codec::Zstd(9)).len();
        for (what, bytes, times) in [("resident", resident, 50.0), ("file", file, 100.0)] {
            let row = Row::new(format!("{name}; {what}; {levels}"), "bytes");
            let row = row.times(bytes as f64, baseline.clone(), plain as f64);
            record.row(row.goal(plain as f64 / times));
        }
        record.say(format!(
            "Memory, {name}, {levels}: {baseline} takes {:.1} MiB; the deep map {:.3} MiB decoded \
             ({:.0} times less), {:.3} MiB as a file with zstd 9 ({:.0} times less).",
            mib(plain),
            mib(resident),
            plain as f64 / resident as f64,
            mib(file),
            plain as f64 / file as f64,
        ));
    }
}
