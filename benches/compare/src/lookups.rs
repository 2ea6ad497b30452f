//! The binding rows: lookups through the cache against the same arithmetic on flat arrays, on one map of 64 MiB.

use std::path::{Path, PathBuf};

use deepshadow::{Codec, Curve, Mips, Pixel};

use crate::flat::Flat;
use crate::maps::Block;
use crate::ours::{Shadows, Source};
use crate::queries::{Access, Lookup, Queries};
use crate::record::{Record, Row};
use crate::reference::{self, Levels};
use crate::scene::{DEPTHS, Hair};
use crate::texture::Texture;
use crate::timing::{Candidate, interleaved};

/// Width of the main map in pixels.
pub const WIDTH: u32 = 1024;

/// Bytes of its base level, about.
pub const BYTES: usize = 64 << 20;

/// The hair-like map of the main table.
pub struct Main {
    /// The functions that it repeats.
    pub block: Block,
    /// Width and height.
    pub size: (u32, u32),
    /// The file, tiles not compressed.
    pub path: PathBuf,
    /// Its decoded levels.
    pub levels: Levels,
    /// The same as flat arrays.
    pub flat: Flat,
    /// The same through the cache.
    pub shadows: Shadows,
}

impl Main {
    /// Makes the map, and checks lookups of a small map against exact functions on the way.
    pub fn new(folder: &Path, record: &mut Record) -> Self {
        let side = 128;
        let curves = Hair::new(side, 11).curves(16);
        let tolerance = 1.0 / 64.0;
        let block = Block::compress(side, &curves, tolerance);
        check_against_curves(folder, side, &curves, tolerance, record);
        let size = (WIDTH, block.rows_for(WIDTH, BYTES));
        let path = folder.join("main.dsm");
        let bytes = block.write(size.0, size.1, Mips::Full, Codec::None);
        std::fs::write(&path, &bytes).expect("room for a map");
        let file = deepshadow::DsmFile::from_bytes(bytes).expect("our own file");
        let levels = Levels::of(&file);
        record.say(format!(
            "Main map: hair, 256 samples a pixel, tolerance 1/64, {} x {} pixels, {:.1} vertices a pixel, {:.1} MiB in {} tiles at the base, {:.1} MiB with all levels.",
            size.0,
            size.1,
            block.vertices(),
            mib(levels.bytes(0)),
            levels.tile_count(0),
            mib((0..levels.sizes.len()).map(|l| levels.bytes(l)).sum()),
        ));
        Main {
            flat: Flat::of(&file),
            shadows: Shadows::open(&path, Source::Read, 1 << 30),
            block,
            size,
            path,
            levels,
        }
    }

    /// Queries over the map: all of its pixels in order, or 100,000 anywhere.
    pub fn queries(&self, access: Access) -> Queries {
        let n = match access {
            Access::Coherent => (self.size.0 * self.size.1) as usize,
            Access::Random => 100_000,
        };
        Queries::new(access, n, self.size, 0.0, DEPTHS)
    }

    /// The largest error of our lookups against exact averages of the base level; asserts the bound, and what the flat arrays say.
    pub fn check(&self, lookup: Lookup, width: f32, queries: &Queries, checks: usize) -> f64 {
        let mut sampler = self.shadows.sampler(lookup);
        let (mut worst, bound) = (0.0f64, self.levels.bound(lookup, width));
        for at @ (x, y, z) in queries.thinned(queries.len() / checks).iter() {
            let flat = f64::from(self.flat.lookup(lookup, width, x, y, z));
            let stored = self.levels.stored(lookup, width, at);
            let off = (flat - stored).abs();
            assert!(
                off < 2f64.powi(-20),
                "flat {lookup:?} at {at:?} is off by {off}"
            );
            let ours = f64::from(sampler.at(width, x, y, z));
            let off = (ours - self.levels.exact(lookup, width, at)).abs();
            assert!(off <= bound, "{lookup:?} at {at:?} is off by {off}");
            worst = worst.max(off);
        }
        worst
    }
}

/// Bytes as MiB.
pub fn mib(bytes: usize) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

/// Lookups in a map made of exact functions are within the tolerance of these, in all filters.
fn check_against_curves(
    folder: &Path,
    side: u32,
    curves: &[Curve],
    tolerance: f64,
    record: &mut Record,
) {
    let path = folder.join("small.dsm");
    let file = write_curves(&path, side, curves, tolerance);
    let sizes: Vec<(u32, u32)> = (file.maps()[0].levels.iter())
        .map(|l| (l.shape.width, l.shape.height))
        .collect();
    let shadows = Shadows::open(&path, Source::Read, 1 << 30);
    let exact = |level: usize, i: u32, j: u32, z: f32| {
        let covered = (j << level..(j + 1) << level)
            .flat_map(|y| (i << level..(i + 1) << level).map(move |x| (y * side + x) as usize));
        covered.map(|p| curves[p].visibility(z)).sum::<f64>() / f64::from(1 << (2 * level))
    };
    let quarter = side as f32 / 4.0;
    let mut lines = Vec::new();
    let kinds = Lookup::ALL.map(|lookup| (lookup, lookup.width()));
    for (lookup, width) in kinds.into_iter().chain([(Lookup::Trilinear, quarter)]) {
        let mut sampler = shadows.sampler(lookup);
        let n = if width < quarter { 3000 } else { 500 };
        let queries = Queries::new(Access::Random, n, (side, side), 0.0, DEPTHS);
        let (mut worst, mut squares) = (0.0f64, 0.0);
        for (x, y, z) in queries.iter() {
            let taps = reference::taps(lookup, width, &sizes, x, y);
            let value: f64 = taps.iter().map(|&(l, i, j, w)| w * exact(l, i, j, z)).sum();
            let off = (f64::from(sampler.at(width, x, y, z)) - value).abs();
            let bound = tolerance + 2f64.powi(-20);
            assert!(off <= bound, "{lookup:?} at {x} {y} {z} is off by {off}");
            worst = worst.max(off);
            squares += off * off;
        }
        let rms = (squares / n as f64).sqrt();
        lines.push(vec![
            lookup.name().to_string(),
            format!("{width}"),
            n.to_string(),
            format!("{worst:.5}"),
            format!("{rms:.5}"),
        ]);
    }
    record.say(format!(
        "Lookups of a map of {side} x {side} pixels at random points, against f64 averages of the exact functions that were given to the writer at a tolerance of {tolerance}:"
    ));
    record.table(
        "exact",
        &[
            "lookup",
            "width in pixels",
            "points",
            "largest error",
            "RMS error",
        ],
        &lines,
    );
}

/// Writes a map of exact functions.
fn write_curves(path: &Path, side: u32, curves: &[Curve], tolerance: f64) -> deepshadow::DsmFile {
    use deepshadow::{DsmFile, Encoding, MapHeader, Writer};
    let mut writer = Writer::create(path).expect("room for a map");
    let encoding = Encoding::new(tolerance).codec(Codec::None);
    let map = writer
        .add_map(MapHeader::new("curves", side, side), encoding)
        .expect("a legal map");
    for (i, curve) in curves.iter().enumerate() {
        let (x, y) = (i as u32 % side, i as u32 / side);
        writer
            .pixel(map, Pixel::new(x, y), curve)
            .expect("a pixel of the map");
    }
    writer.finish().expect("all pixels are there");
    DsmFile::open(path).expect("our own file")
}

/// Goals in nanoseconds: coherent, random.
fn goals(lookup: Lookup) -> [f64; 2] {
    match lookup {
        Lookup::Pixel => [20.0, 110.0],
        Lookup::Bilinear => [60.0, 250.0],
        Lookup::Trilinear => [110.0, 400.0],
        Lookup::Gaussian => [220.0, 700.0],
    }
}

/// Four lookups in two orders, the batch call, and the cursor.
pub fn rows(main: &Main, rounds: usize, record: &mut Record) {
    for lookup in Lookup::ALL {
        for (access, goal) in Access::ALL.into_iter().zip(goals(lookup)) {
            let (width, queries) = (lookup.width(), main.queries(access));
            let error = main.check(lookup, width, &queries, 2000);
            let mut sampler = main.shadows.sampler(lookup);
            let n = queries.len();
            let ns = interleaved(
                rounds,
                [
                    Candidate::new(n, || sampler.sum(width, &queries)),
                    Candidate::new(n, || main.flat.sum(lookup, width, &queries)),
                ],
            );
            record.row(
                Row::new(lookup.name(), access.name())
                    .times(ns[0], "flat arrays", ns[1])
                    .goal(goal)
                    .error(error),
            );
        }
    }
    cursor(main, rounds, record);
    for lookup in Lookup::ALL {
        batch(main, lookup, rounds, record);
    }
}

fn cursor(main: &Main, rounds: usize, record: &mut Record) {
    let (lookup, queries) = (Lookup::Pixel, main.queries(Access::Coherent));
    let (mut with, mut without) = (main.shadows.sampler(lookup), main.shadows.sampler(lookup));
    assert_eq!(
        with.sum_with_cursor(1.0, &queries),
        without.sum(1.0, &queries),
        "a cursor changes no answer"
    );
    let n = queries.len();
    let ns = interleaved(
        rounds,
        [
            Candidate::new(n, || with.sum_with_cursor(1.0, &queries)),
            Candidate::new(n, || without.sum(1.0, &queries)),
        ],
    );
    let row = Row::new("one pixel with a cursor", "coherent");
    record.row(row.times(ns[0], "without it", ns[1]).error(0.0));
}

fn batch(main: &Main, lookup: Lookup, rounds: usize, record: &mut Record) {
    let name = format!("batch: {}", lookup.name());
    let (width, queries) = (lookup.width(), main.queries(Access::Random));
    let (mut batch, mut single) = (main.shadows.sampler(lookup), main.shadows.sampler(lookup));
    let mut out = vec![0.0; queries.len()];
    batch.batch(width, &queries, &mut out);
    for ((x, y, z), v) in queries.iter().zip(&out) {
        assert_eq!(
            single.at(width, x, y, z),
            *v,
            "a batch answers as single calls do"
        );
    }
    let n = queries.len();
    let ns = interleaved(
        rounds,
        [
            Candidate::new(n, || {
                batch.batch(width, &queries, &mut out);
                out[0]
            }),
            Candidate::new(n, || single.sum(width, &queries)),
        ],
    );
    let row = Row::new(name, "random");
    record.row(
        row.times(ns[0], "one by one", ns[1])
            .goal(ns[1] / 2.0)
            .error(0.0),
    );
}

/// Trilinear lookups against a flat texture of as many bytes, the same footprint in pixels and the same order.
pub fn texture(main: &Main, texture: Result<Texture, String>, rounds: usize, record: &mut Record) {
    let lookup = Lookup::Trilinear;
    let texture = match texture {
        Ok(texture) => texture,
        Err(why) => {
            record.row(Row::new("trilinear against a texture", "").skipped(why));
            return;
        }
    };
    record.say(format!(
        "The texture: OpenImageIO {}, TextureSystem, called from a loop in C++ (`shim.cpp`, compiled with g++ -O3 when the program starts, loaded with dlopen) by texture handle and per-thread data, \
         so that no binding and no search by name is in the time. {TEXTURE} x {TEXTURE} floats (64 MiB, tiles of 64 x 64, uncompressed TIFF with all levels), a cache that holds all of it, MipModeTrilinear, InterpBilinear, \
         the footprint {} texels wide as ours is in pixels, the same order of points.",
        texture.version,
        lookup.width()
    ));
    for access in Access::ALL {
        let queries = main.queries(access);
        let texels = Queries::new(access, queries.len(), (TEXTURE, TEXTURE), 8.0, DEPTHS);
        let off = texture.max_error(&texels.thinned(50));
        assert!(off < 1e-3, "a texture lookup is off by {off}");
        let error = main.check(lookup, lookup.width(), &queries, 500);
        let mut sampler = main.shadows.sampler(lookup);
        let n = queries.len();
        let ns = interleaved(
            rounds,
            [
                Candidate::new(n, || sampler.sum(lookup.width(), &queries)),
                Candidate::new(n, || texture.sum(&texels)),
            ],
        );
        let name = format!("OpenImageIO {} texture", texture.version);
        let row = Row::new("trilinear against a texture", access.name()).error(error);
        let row = row.times(ns[0], name, ns[1]);
        record.row(if access == Access::Coherent {
            row.goal(75.0)
        } else {
            row
        });
    }
}

/// Side of the texture: 64 MiB of floats.
pub const TEXTURE: u32 = 4096;
