//! The binding rows: lookups through the cache against the same arithmetic on flat arrays, on one
//! map of 64 MiB.

use std::path::{Path, PathBuf};

use deepshadow::{Codec, Curve, DsmFile, Mips, Pixel};

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
        let file = DsmFile::from_bytes(bytes).expect("our own file");
        let levels = Levels::of(&file);
        record.say(format!(
            "Main map: hair, 256 samples a pixel, tolerance 1/64, {} x {} pixels, {:.1} vertices \
             a pixel, {:.1} MiB in {} tiles at the base, {:.1} MiB with all levels.",
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

    /// The largest error of our lookups against exact averages of the base level; asserts the
    /// bound, and what the flat arrays say.
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
        "Lookups of a map of {side} x {side} pixels at random points, against f64 averages of the \
         exact functions that were given to the writer at a tolerance of {tolerance}:"
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
fn write_curves(path: &Path, side: u32, curves: &[Curve], tolerance: f64) -> DsmFile {
    use deepshadow::{Encoding, MapHeader, Writer};
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

/// What the rows of a map aim at, as parts of the baseline: singly and in a batch, coherent and
/// random.
type Goals = [[Option<f64>; 2]; 2];

fn goals(lookup: Lookup) -> Goals {
    let [single, batch] = match lookup {
        Lookup::Pixel => [[1.0, 0.9], [0.75, 0.4]],
        Lookup::Bilinear => [[0.75, 0.9], [0.65, 0.45]],
        Lookup::Trilinear => [[0.6, 0.9], [0.6, 0.6]],
        Lookup::Gaussian => return [[Some(0.8), Some(0.95)], [None; 2]],
    };
    [single.map(Some), batch.map(Some)]
}

/// Four lookups in two orders, one by one and in a batch; and the cursor.
pub fn rows(main: &Main, rounds: usize, record: &mut Record) {
    let huge = main.flat.in_huge_pages();
    for (lookup, access) in pairs(&Lookup::ALL) {
        let queries = main.queries(access);
        let error = main.check(lookup, lookup.width(), &queries, 2000);
        compare(
            &|name| name,
            (lookup, access, goals(lookup)),
            (&main.shadows, &main.flat, &huge),
            &queries,
            error,
            rounds,
            record,
        );
    }
    cursor(main, rounds, record);
}

/// All kinds that have levels of their own rows, in both orders.
fn pairs(lookups: &[Lookup]) -> impl Iterator<Item = (Lookup, Access)> + '_ {
    let orders = |lookup: &Lookup| Access::ALL.map(|access| (*lookup, access));
    lookups.iter().flat_map(orders)
}

/// The rows of one kind of lookup in one order: single lookups and batches, each against flat
/// arrays in ordinary and in huge pages. Only the first baseline has goals.
fn compare<const C: usize>(
    name: &dyn Fn(String) -> String,
    (lookup, access, goals): (Lookup, Access, Goals),
    (shadows, flat, huge): (&Shadows, &Flat<C>, &Flat<C>),
    queries: &Queries,
    error: f64,
    rounds: usize,
    record: &mut Record,
) {
    let (width, n) = (lookup.width(), queries.len());
    let (mut single, mut batch) = (shadows.sampler(lookup), shadows.sampler(lookup));
    let mut out = vec![[0.0; C]; n];
    batch.batch(width, queries, &mut out);
    for ((x, y, z), v) in queries.iter().zip(&out) {
        let one: [f32; C] = single.channels(width, x, y, z);
        assert_eq!(one, *v, "a batch answers as single calls do");
    }
    for ((x, y, z), v) in queries.iter().zip(&out).step_by(1 + n / 2000) {
        for (v, flat) in v.iter().zip(flat.channels(lookup, width, x, y, z)) {
            assert!((v - flat).abs() < 1e-6, "{lookup:?} at {x} {y} {z}");
        }
    }
    let sums = [flat, huge].map(|flat| flat.sum(lookup, width, queries));
    assert_eq!(sums[0], sums[1], "huge pages change no answer");
    let [one, all, theirs, in_huge_pages] = interleaved(
        rounds,
        [
            Candidate::new(n, || single.sum_channels::<C>(width, queries)),
            Candidate::new(n, || {
                batch.batch(width, queries, &mut out);
                out[0][0]
            }),
            Candidate::new(n, || flat.sum(lookup, width, queries)),
            Candidate::new(n, || huge.sum(lookup, width, queries)),
        ],
    );
    let order = usize::from(access == Access::Random);
    for (ours, batch, goals) in [(one, "", goals[0]), (all, "batch: ", goals[1])] {
        let name = name(format!("{batch}{}", lookup.name()));
        let baseline = "flat arrays in huge pages";
        let second = Row::new(format!("{name}: {baseline}"), access.name());
        let row = Row::new(name, access.name()).times(ours, "flat arrays", theirs);
        let row = row.error(error);
        record.row(match goals[order] {
            Some(part) => row.goal(part * theirs),
            None => row,
        });
        record.row(second.times(ours, baseline, in_huge_pages).error(error));
    }
}

/// Lookups of three channels against flat arrays of three planes.
pub fn colour(rounds: usize, record: &mut Record) {
    let block = Block {
        channels: 3,
        ..Block::compress(128, &Hair::new(128, 11).curves(16), 1.0 / 64.0)
    };
    let size = (WIDTH, WIDTH / 2);
    let bytes = block.write(size.0, size.1, Mips::Full, Codec::Lz4);
    let file = DsmFile::from_bytes(bytes).expect("our own file");
    let flat = Flat::<3>::of(&file);
    let huge = flat.in_huge_pages();
    record.say(format!(
        "Coloured map: the functions of the main map, and their squares and cubes; {} x {} \
         pixels, {:.1} MiB with all levels.",
        size.0,
        size.1,
        mib(flat.bytes())
    ));
    let shadows = Shadows::of(file, 1 << 30);
    for (lookup, access) in pairs(&Lookup::ALL[..3]) {
        let n = (size.0 * size.1) as usize;
        let n = if access == Access::Random { 100_000 } else { n };
        let queries = Queries::new(access, n, size, 0.0, DEPTHS);
        compare(
            &|name| match name.strip_prefix("batch: ") {
                Some(name) => format!("batch: RGB {name}"),
                None => format!("RGB {name}"),
            },
            (lookup, access, [[Some(1.0), Some(0.95)], [None; 2]]),
            (&shadows, &flat, &huge),
            &queries,
            1e-6,
            rounds,
            record,
        );
    }
}

/// Lookups of a map of 4096 x 4096 pixels, as production has them.
pub fn large(rounds: usize, record: &mut Record) {
    let side = 4096;
    let block = Block::compress(128, &Hair::new(128, 31).curves(4), 1.0 / 16.0);
    let file = block.repeated(side);
    let flat = Flat::<1>::of(&file);
    let huge = flat.in_huge_pages();
    let base = side as f64 * side as f64 * (6.0 * block.vertices() + 4.0);
    record.say(format!(
        "Large map: hair, 16 samples a pixel, tolerance 1/16, {side} x {side} pixels, 16,384 \
         tiles at the base, {:.1} vertices a pixel, {:.0} MiB decoded at the base, {:.0} with all \
         levels. The tiles of 128 x 128 pixels are repeated.",
        block.vertices(),
        mib(base as usize),
        mib(flat.bytes())
    ));
    let shadows = Shadows::of(file, 8 << 30);
    for (lookup, access) in pairs(&Lookup::ALL[..3]) {
        let goals = match lookup {
            Lookup::Pixel => [[None, Some(0.85)], [None, Some(0.4)]],
            Lookup::Bilinear => [[None, Some(0.9)], [None, Some(0.4)]],
            _ => [[None, Some(1.0)], [None, Some(0.65)]],
        };
        let queries = Queries::new(access, 100_000, (side, side), 0.0, DEPTHS);
        compare(
            &|name| format!("{name}, 4096 wide"),
            (lookup, access, goals),
            (&shadows, &flat, &huge),
            &queries,
            1e-6,
            rounds,
            record,
        );
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

/// Trilinear lookups against a flat texture of as many bytes, the same footprint in pixels and the
/// same order.
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
        "The texture: OpenImageIO {}, TextureSystem, called from a loop in C++ (`shim.cpp`, \
         compiled with g++ -O3 when the program starts, loaded with dlopen) by texture handle and \
         per-thread data, \
         so that no binding and no search by name is in the time. {TEXTURE} x {TEXTURE} floats \
         (64 MiB, tiles of 64 x 64, uncompressed TIFF with all levels), a cache that holds all of \
         it, MipModeTrilinear, InterpBilinear, \
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
        let mut out = vec![[0.0; 1]; n];
        let mut batch = main.shadows.sampler(lookup);
        let [one, all, theirs] = interleaved(
            rounds,
            [
                Candidate::new(n, || sampler.sum(lookup.width(), &queries)),
                Candidate::new(n, || {
                    batch.batch(lookup.width(), &queries, &mut out);
                    out[0][0]
                }),
                Candidate::new(n, || texture.sum(&texels)),
            ],
        );
        let goals = match access {
            Access::Coherent => [0.45, 0.45],
            Access::Random => [0.6, 0.4],
        };
        for (ours, prefix, goal) in [(one, "", goals[0]), (all, "batch: ", goals[1])] {
            let name = format!("OpenImageIO {} texture", texture.version);
            let row = Row::new(
                format!("{prefix}trilinear against a texture"),
                access.name(),
            );
            let row = row.error(error).times(ours, name, theirs);
            record.row(row.goal(goal * theirs));
        }
    }
}

/// Side of the texture: 64 MiB of floats.
pub const TEXTURE: u32 = 4096;
