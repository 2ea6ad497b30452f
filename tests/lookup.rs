//! Filtered lookups against a naive model: every pixel and every weight, in f64.

use crate::random::Random;
use crate::support::written;
use deepshadow::*;

/// A random function, sometimes coloured.
///
/// It has few depths, so that lookups often meet vertices, steps and equal depths.
fn random_function(random: &mut Random, coloured: bool) -> Curve {
    let channels = if coloured && random.below(3) == 0 {
        3
    } else {
        1
    };
    let (mut z, mut v) = (Vec::new(), vec![Vec::new(); channels]);
    let mut last = vec![1.0; channels];
    let mut depth = random.below(4) as f32;
    for i in 0..random.below(9) {
        if i > 1 && random.below(3) == 0 && z.iter().filter(|&&d| d == depth).count() < 2 {
            // A step.
        } else {
            depth += 0.25 + random.below(8) as f32 / 4.0;
        }
        for last in &mut last {
            *last *= f64::from(random.unit_f32());
        }
        if random.below(8) == 0 {
            last.fill(0.0);
        }
        z.push(depth);
        (0..channels).for_each(|c| v[c].push(last[c]));
    }
    Curve::from_planes(z, v).unwrap()
}

/// The bytes of a file with one map of random functions.
fn random_map(
    seed: u64,
    size: (u32, u32),
    tile: u32,
    codec: Codec,
    tolerance: f64,
    coloured: bool,
) -> Vec<u8> {
    let mut random = Random(seed);
    let header = MapHeader::new("m", size.0, size.1).tile_size(tile);
    let encoding = Encoding::new(tolerance).codec(codec);
    written(|w| {
        let map = w.add_map(header, encoding).unwrap();
        for y in 0..size.1 {
            for x in 0..size.0 {
                // Some tiles are lit, some constant.
                let block = (x / tile + 3 * (y / tile)) % 5;
                let curve = match block {
                    1 => Curve::lit(1),
                    2 => Curve::mono(vec![6.0], vec![0.25]).unwrap(),
                    _ => random_function(&mut random, coloured),
                };
                w.pixel(map, Pixel::new(x, y), &curve).unwrap();
            }
        }
    })
}

/// The model: computes lookups by their definition.
struct Model {
    file: DsmFile,
    functions: Vec<Vec<Visibility>>,
    options: SamplerOptions,
}

impl Model {
    fn new(bytes: Vec<u8>, options: SamplerOptions) -> Self {
        let file = DsmFile::from_bytes(bytes).unwrap();
        let functions = (0..file.maps()[0].levels.len())
            .map(|l| {
                let s = file.maps()[0].levels[l].shape;
                (0..s.width * s.height)
                    .map(|i| {
                        file.function(
                            MapId(0).level(l as u32),
                            Pixel::new(i % s.width, i / s.width),
                        )
                        .unwrap()
                    })
                    .collect()
            })
            .collect();
        Model {
            file,
            functions,
            options,
        }
    }

    /// The function of a pixel of a level at `z`; the border decides outside the level.
    fn pixel(&self, level: usize, x: i64, y: i64, z: f32) -> [f64; 3] {
        let s = self.file.maps()[0].levels[level].shape;
        let (w, h) = (i64::from(s.width), i64::from(s.height));
        let inside = (0..w).contains(&x) && (0..h).contains(&y);
        if !inside && self.options.border == Border::Lit {
            return [1.0; 3];
        }
        let f = &self.functions[level][(y.clamp(0, h - 1) * w + x.clamp(0, w - 1)) as usize];
        std::array::from_fn(|c| evaluate(f, c % f.channels(), z))
    }

    /// The lookup in one level with a kernel of `u` pixels of that level.
    fn level(&self, level: usize, u: f64, q: &Query) -> [f64; 3] {
        let (x, y) = (
            f64::from(q.x) / 2f64.powi(level as i32),
            f64::from(q.y) / 2f64.powi(level as i32),
        );
        let z = q.depth - q.bias;
        let s = self.file.maps()[0].levels[level].shape;
        let u = u.min(4.0 * f64::from(s.width.max(s.height)));
        if self.options.filter == Filter::Nearest {
            return self.pixel(level, x.floor() as i64, y.floor() as i64, z);
        }
        let weight = |d: f64| match self.options.filter {
            Filter::Box => ((d + 0.5).min(u / 2.0) - (d - 0.5).max(-u / 2.0)).clamp(0.0, 1.0),
            Filter::Triangle => (1.0 - d.abs() / u).max(0.0),
            Filter::Gaussian if d.abs() < 2.0 * u => {
                (-2.0 * (d / u) * (d / u)).exp() - (-8f64).exp()
            }
            Filter::CatmullRom => {
                let d = d.abs() / u;
                match d {
                    _ if d < 1.0 => 1.5 * d.powi(3) - 2.5 * d * d + 1.0,
                    _ if d < 2.0 => -0.5 * d.powi(3) + 2.5 * d * d - 4.0 * d + 2.0,
                    _ => 0.0,
                }
            }
            _ => 0.0,
        };
        let reach = (2.0 * u + 2.0).ceil() as i64;
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for j in y as i64 - reach..=y as i64 + reach {
            for i in x as i64 - reach..=x as i64 + reach {
                let w = weight(i as f64 + 0.5 - x) * weight(j as f64 + 0.5 - y);
                if w != 0.0 {
                    let v = self.pixel(level, i, j, z);
                    (0..3).for_each(|c| sum[c] += w * v[c]);
                    total += w;
                }
            }
        }
        sum.map(|v| v / total)
    }

    /// The lookup of a query.
    fn look_up(&self, q: &Query) -> [f64; 3] {
        let Footprint::Width(width) = q.footprint else {
            panic!("the model has no ellipses")
        };
        let w = f64::from(width).max(1.0);
        let last = match self.options.levels {
            LevelChoice::Base => 0,
            _ => self.functions.len() - 1,
        };
        let level = (w.log2().floor() as usize).min(last);
        let u = w / 2f64.powi(level as i32);
        let v = if self.options.levels == LevelChoice::Blend && level < last {
            let (a, b) = (self.level(level, 1.0, q), self.level(level + 1, 1.0, q));
            std::array::from_fn(|c| a[c] + (b[c] - a[c]) * (u - 1.0))
        } else {
            self.level(level, u, q)
        };
        v.map(|v| v.clamp(0.0, 1.0))
    }
}

/// Channel `c` at `z`: linear between vertices; at a step, the value in front of it.
fn evaluate(f: &Visibility, c: usize, z: f32) -> f64 {
    let v = |i: usize| f64::from(f.values(c)[i]);
    match f.depths().iter().position(|&d| d >= z) {
        Some(0) => 1.0,
        None if f.is_empty() => 1.0,
        None => v(f.len() - 1),
        Some(i) => {
            let (a, b) = (f64::from(f.depths()[i - 1]), f64::from(f.depths()[i]));
            v(i - 1) + (v(i) - v(i - 1)) * (f64::from(z) - a) / (b - a)
        }
    }
}

/// A query at a telling place.
///
/// Its depth is often on a vertex or one float from it; its centre is often on a pixel's centre,
/// border or corner, or near the border of a tile or of the map.
fn telling_query(random: &mut Random, size: (u32, u32), tile: u32) -> Query {
    let mut place = |side: u32| match random.below(6) {
        0 => random.below(side + 1) as f32,
        1 => random.below(side) as f32 + 0.5,
        2 => (random.below(side / tile + 2) * tile) as f32 + (random.unit_f32() - 0.5) * 3.0,
        3 => (random.below(2) * side) as f32 + (random.unit_f32() - 0.5) * 6.0,
        4 => (random.below(side) as f32 + 0.5).next_up(),
        _ => side as f32 * random.unit_f32(),
    };
    let (x, y) = (place(size.0), place(size.1));
    let z = random.below(60) as f32 / 4.0;
    let z = match random.below(5) {
        0 => z.next_up(),
        1 => z.next_down(),
        2 => 15.0 * random.unit_f32(),
        _ => z,
    };
    let width = match random.below(5) {
        0 => 1.0,
        1 => random.unit_f32(),
        2 => (1 << random.below(8)) as f32,
        _ => 1.0 + 30.0 * random.unit_f32() * random.unit_f32(),
    };
    let bias = [0.0, 0.0, 0.25][random.below(3) as usize];
    Query::new(x, y, z).width(width).bias(bias)
}

const FILTERS: [Filter; 5] = [
    Filter::Nearest,
    Filter::Box,
    Filter::Triangle,
    Filter::Gaussian,
    Filter::CatmullRom,
];

fn sampler(bytes: Vec<u8>, options: SamplerOptions) -> Sampler {
    let cache = TileCache::new(64 << 20);
    let file = cache.add(DsmFile::from_bytes(bytes).unwrap());
    Sampler::with_options(&file, MapId(0), options).unwrap()
}

#[test]
fn a_lookup_is_the_weighted_average_of_its_pixels() {
    let mut random = Random(1);
    let sizes = [
        ((5, 7), 8),
        ((40, 33), 8),
        ((70, 50), 32),
        ((1, 1), 8),
        ((64, 3), 16),
    ];
    let mut seen = 0;
    for (seed, (size, tile)) in sizes.into_iter().enumerate() {
        // A tolerance this small is stored as f32.
        for (tolerance, coloured) in [(1.0 / 64.0, false), (1e-6, true), (1.0 / 64.0, true)] {
            let bytes = random_map(seed as u64, size, tile, Codec::Lz4, tolerance, coloured);
            for filter in FILTERS {
                for levels in [LevelChoice::Blend, LevelChoice::One, LevelChoice::Base] {
                    let border = [Border::Lit, Border::Clamp][random.below(2) as usize];
                    let options = SamplerOptions::new(filter).levels(levels).border(border);
                    let model = Model::new(bytes.clone(), options);
                    let mut fast = sampler(bytes.clone(), options);
                    for _ in 0..36 {
                        let q = telling_query(&mut random, size, tile);
                        if levels == LevelChoice::Base && q.footprint == Footprint::Width(128.0) {
                            continue; // the model reads 10,000 pixels for each
                        }
                        let expected = model.look_up(&q);
                        let rgb = fast.visibility_rgb(&q).unwrap();
                        let mono = fast.visibility(&q).unwrap();
                        for c in 0..3 {
                            let off = (f64::from(rgb[c]) - expected[c]).abs();
                            // The weights of wide kernels are f32.
                            assert!(off < 3e-6, "{options:?} {q:?}: {rgb:?} for {expected:?}");
                        }
                        assert!(
                            (f64::from(mono) - expected[0]).abs() < 3e-6,
                            "{options:?} {q:?}"
                        );
                        assert!((mono - rgb[0]).abs() <= f32::EPSILON);
                        seen += usize::from(expected[0] > 0.01 && expected[0] < 0.99);
                    }
                }
            }
        }
    }
    assert!(seen > 1200, "only {seen} answers between light and dark");
}

#[test]
fn a_lookup_one_pixel_wide_is_exact_to_about_the_last_bit() {
    let (size, tile) = ((40, 33), 8);
    let bytes = random_map(9, size, tile, Codec::None, 1.0 / 64.0, false);
    let mut random = Random(5);
    for filter in [
        Filter::Nearest,
        Filter::Box,
        Filter::Triangle,
        Filter::CatmullRom,
    ] {
        let options = SamplerOptions::new(filter);
        let model = Model::new(bytes.clone(), options);
        let mut fast = sampler(bytes.clone(), options);
        for _ in 0..4000 {
            let q = telling_query(&mut random, size, tile).width(1.0);
            let off = (f64::from(fast.visibility(&q).unwrap()) - model.look_up(&q)[0]).abs();
            // Only the model rounds a stored k / L to f32.
            assert!(off < 2f64.powi(-22), "{filter:?} {q:?} is off by {off}");
        }
    }
}

#[test]
fn every_method_codec_and_budget_gives_the_same_bits() {
    let (size, tile) = ((90, 70), 16);
    let files: Vec<Vec<u8>> = [Codec::None, Codec::Lz4, Codec::default()]
        .map(|codec| random_map(3, size, tile, codec, 1.0 / 64.0, true))
        .into();
    let mut random = Random(8);
    for filter in FILTERS {
        let options = SamplerOptions::new(filter);
        let queries: Vec<Query> = (0..700)
            .map(|_| telling_query(&mut random, size, tile))
            .collect();
        let mut first = sampler(files[0].clone(), options);
        let expected: Vec<f32> = queries
            .iter()
            .map(|q| first.visibility(q).unwrap())
            .collect();
        let same = |what: &str, answers: &[f32]| {
            for ((q, a), b) in queries.iter().zip(&expected).zip(answers) {
                assert_eq!(a.to_bits(), b.to_bits(), "{what}, {filter:?} {q:?}");
            }
        };
        let folder = tempfile::tempdir().unwrap();
        for (i, bytes) in files.iter().enumerate() {
            let path = folder.path().join("m.dsm");
            std::fs::write(&path, bytes).unwrap();
            // A budget for everything, and none.
            for budget in [64 << 20, 0] {
                let cache = TileCache::new(budget);
                let file = cache.add(DsmFile::open(&path).unwrap());
                std::thread::scope(|scope| {
                    for _ in 0..2 {
                        scope.spawn(|| {
                            let mut sampler =
                                Sampler::with_options(&file, MapId(0), options).unwrap();
                            let mut cursor = Cursor::default();
                            let single: Vec<f32> = queries
                                .iter()
                                .map(|q| sampler.visibility(q).unwrap())
                                .collect();
                            same(&format!("file {i}, budget {budget}"), &single);
                            let again: Vec<f32> = queries
                                .iter()
                                .map(|q| sampler.visibility_with(&mut cursor, q).unwrap())
                                .collect();
                            same("cursor", &again);
                        });
                    }
                });
                // A batch has one bias for all queries.
                let mut sampler = Sampler::with_options(&file, MapId(0), options).unwrap();
                let of = |f: fn(&Query) -> f32| queries.iter().map(f).collect::<Vec<f32>>();
                let (x, y) = (of(|q| q.x), of(|q| q.y));
                let depth = of(|q| q.depth - q.bias);
                let footprint: Vec<Footprint> = queries.iter().map(|q| q.footprint).collect();
                let batch = Batch::new(&x, &y, &depth).footprints(&footprint);
                let mut out = vec![0.0; queries.len()];
                for _ in 0..3 {
                    sampler.visibility_batch(&batch, &mut out).unwrap();
                    same("batch", &out);
                }
                let mut rgb = vec![[0.0; 3]; queries.len()];
                sampler.visibility_rgb_batch(&batch, &mut rgb).unwrap();
                for (q, rgb) in queries.iter().zip(rgb) {
                    assert_eq!(sampler.visibility_rgb(q).unwrap(), rgb);
                }
            }
        }
    }
}

#[test]
fn a_slice_holds_the_answers_of_single_lookups() {
    let (size, tile) = ((40, 33), 8);
    for coloured in [false, true] {
        let bytes = random_map(9, size, tile, Codec::Lz4, 1.0 / 64.0, coloured);
        for (filter, border) in FILTERS
            .into_iter()
            .zip([Border::Lit, Border::Clamp].repeat(3))
        {
            let mut sampler = sampler(bytes.clone(), SamplerOptions::new(filter).border(border));
            let (columns, rows) = (3..45, 7..36);
            for width in [1.0, 1.5, 7.3] {
                let footprint = Footprint::Width(width);
                let mut mono = vec![0.0; 42 * 29];
                let mut rgb = vec![[0.0; 3]; 42 * 29];
                let (c, r) = (columns.clone(), rows.clone());
                (sampler.visibility_slice(5.0, footprint, c.clone(), r.clone(), &mut mono))
                    .unwrap();
                (sampler.visibility_rgb_slice(5.0, footprint, c, r, &mut rgb)).unwrap();
                let pixels = rows
                    .clone()
                    .flat_map(|y| columns.clone().map(move |x| (x, y)));
                for (((x, y), v), rgb) in pixels.zip(mono).zip(rgb) {
                    let q = Query::new(x as f32 + 0.5, y as f32 + 0.5, 5.0).width(width);
                    assert_eq!(
                        sampler.visibility(&q).unwrap().to_bits(),
                        v.to_bits(),
                        "{q:?}"
                    );
                    assert_eq!(sampler.visibility_rgb(&q).unwrap(), rgb, "{q:?}");
                }
            }
            let error =
                sampler.visibility_slice(5.0, Footprint::Width(1.0), 0..3, 0..3, &mut [0.0]);
            assert_eq!(error.unwrap_err().kind(), ErrorKind::Input);
        }
    }
}

#[test]
fn a_round_ellipse_answers_as_a_width_does() {
    let size = (40, 33);
    let bytes = random_map(10, size, 8, Codec::Lz4, 1.0 / 64.0, false);
    let mut random = Random(8);
    for filter in FILTERS {
        let mut sampler = sampler(bytes.clone(), SamplerOptions::new(filter));
        for i in 0..300 {
            let width = [1.0, 2.0, 3.0, 4.0][i % 4];
            let q = telling_query(&mut random, size, 8).width(width);
            let ellipse = q.ellipse([width, 0.0], [0.0, width]);
            let both = [&q, &ellipse].map(|q| sampler.visibility(q).unwrap().to_bits());
            assert_eq!(both[0], both[1], "{q:?}");
            assert_eq!(sampler.taps(&q).unwrap(), sampler.taps(&ellipse).unwrap());
        }
    }
}

#[test]
fn every_filter_keeps_uniform_light_and_darkness_exact() {
    let mut writer = Writer::in_memory();
    let map = writer
        .add_map(MapHeader::new("m", 50, 50), Encoding::default())
        .unwrap();
    for i in 0..2500 {
        // Walls at several depths, so that no tile is constant.
        let wall = Curve::mono(vec![5.0 + (i % 7) as f32 / 8.0], vec![0.0]).unwrap();
        writer
            .pixel(map, Pixel::new(i % 50, i / 50), &wall)
            .unwrap();
    }
    let bytes = writer.into_bytes().unwrap();
    let mut random = Random(2);
    for filter in FILTERS {
        let options = SamplerOptions::new(filter).border(Border::Clamp);
        let mut sampler = sampler(bytes.clone(), options);
        for i in 0..3000 {
            let q = telling_query(&mut random, (50, 50), 32).bias(0.0);
            let q = if i % 3 == 0 {
                q.ellipse(
                    [random.unit_f32() * 9.0, random.unit_f32()],
                    [0.5, -random.unit_f32() * 5.0],
                )
            } else {
                q
            };
            assert_eq!(sampler.visibility(&q.depth(5.0)).unwrap(), 1.0, "{q:?}");
            assert_eq!(sampler.visibility(&q.depth(6.0)).unwrap(), 0.0, "{q:?}");
            assert_eq!(sampler.opacity(&q).unwrap(), 1.0);
        }
    }
}

#[test]
fn an_elliptic_footprint_is_a_kernel_along_the_axes_of_the_ellipse() {
    let (size, tile) = ((64, 64), 16);
    let bytes = random_map(12, size, tile, Codec::Lz4, 1.0 / 64.0, false);
    let mut random = Random(4);
    for filter in [Filter::Box, Filter::Triangle, Filter::Gaussian] {
        let options = SamplerOptions::new(filter)
            .levels(LevelChoice::Base)
            .border(Border::Clamp)
            .anisotropy(8.0);
        let model = Model::new(bytes.clone(), options);
        let mut fast = sampler(bytes.clone(), options);
        for _ in 0..300 {
            let (x, y, z) = (
                64.0 * random.unit_f32(),
                64.0 * random.unit_f32(),
                15.0 * random.unit_f32(),
            );
            let (long, short) = (
                2.0 + 6.0 * f64::from(random.unit_f32()),
                1.0 + f64::from(random.unit_f32()),
            );
            let angle = 6.3 * f64::from(random.unit_f32());
            let (u, v) = ([angle.cos(), angle.sin()], [-angle.sin(), angle.cos()]);
            // Other conjugate vectors of the same ellipse: rotate the unit circle before it is
            // scaled to the axes.
            let turn = 6.3 * f64::from(random.unit_f32());
            let along =
                |a: f64, b: f64| [0, 1].map(|k| (long * u[k] * a + short * v[k] * b) as f32);
            let (dx, dy) = (
                along(turn.cos(), turn.sin()),
                along(-turn.sin(), turn.cos()),
            );
            let q = Query::new(x, y, z).ellipse(dx, dy);
            let weight = |d: f64, len: f64| match filter {
                Filter::Box => {
                    ((d + 0.5).min(len / 2.0) - (d - 0.5).max(-len / 2.0)).clamp(0.0, 1.0)
                }
                Filter::Triangle => (1.0 - d.abs() / len).max(0.0),
                _ if d.abs() < 2.0 * len => (-2.0 * (d / len).powi(2)).exp() - (-8f64).exp(),
                _ => 0.0,
            };
            let (mut sum, mut total) = (0.0, 0.0);
            for j in -24..88 {
                for i in -24..88 {
                    let d = [
                        f64::from(i) + 0.5 - f64::from(x),
                        f64::from(j) + 0.5 - f64::from(y),
                    ];
                    let w = weight(d[0] * u[0] + d[1] * u[1], long)
                        * weight(d[0] * v[0] + d[1] * v[1], short);
                    sum += w * model.pixel(0, i.into(), j.into(), z)[0];
                    total += w;
                }
            }
            let got = f64::from(fast.visibility(&q).unwrap());
            assert!(
                (got - sum / total).abs() < 2e-5,
                "{filter:?} {q:?}: {got} for {}",
                sum / total
            );
        }
    }
}

#[test]
fn opacity_depths_and_taps_agree_with_visibility() {
    let (size, tile) = ((40, 33), 8);
    let bytes = random_map(21, size, tile, Codec::Lz4, 1.0 / 64.0, false);
    let mut random = Random(6);
    for filter in [Filter::Nearest, Filter::Triangle, Filter::Gaussian] {
        let mut sampler = sampler(bytes.clone(), SamplerOptions::new(filter));
        for _ in 0..300 {
            let q = telling_query(&mut random, size, tile).bias(0.0);
            let t = random.unit_f32();
            let at =
                |sampler: &mut Sampler, depth: f32| sampler.visibility(&q.depth(depth)).unwrap();
            let behind = at(&mut sampler, f32::INFINITY);
            assert_eq!(sampler.opacity(&q).unwrap(), 1.0 - behind);
            match sampler.depth_below(&q, t).unwrap() {
                Some(z) => {
                    assert!(
                        at(&mut sampler, z) >= t && at(&mut sampler, z.next_up()) < t,
                        "{q:?} {t}"
                    );
                }
                None => assert!(behind >= t),
            }
            match sampler.depth_range(&q).unwrap() {
                Some([near, far]) => {
                    assert_eq!(at(&mut sampler, near), 1.0, "{q:?}");
                    assert_eq!(at(&mut sampler, far.next_up()), behind, "{q:?}");
                }
                None => assert_eq!(behind, 1.0),
            }
            let taps = sampler.taps(&q).unwrap();
            let inside: f64 = taps.iter().map(|v| v.weight).sum();
            assert!(
                taps.iter().all(|v| v.weight > 0.0) && inside < 1.0 + 1e-6,
                "{taps:?}"
            );
        }
    }
}

#[test]
fn a_query_that_is_not_finite_is_an_input_error() {
    let bytes = random_map(1, (9, 9), 8, Codec::Lz4, 1.0 / 64.0, false);
    let mut sampler = sampler(bytes, SamplerOptions::default());
    let sound = Query::new(1.0, 1.0, 3.0);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let broken = [
            Query::new(bad, 1.0, 3.0),
            Query::new(1.0, bad, 3.0),
            sound.width(bad),
            sound.ellipse([bad, 0.0], [0.0, 1.0]),
            sound.depth(f32::NAN),
            sound.bias(f32::NAN),
            sound.width(-1.0),
        ];
        for q in broken {
            assert_eq!(
                sampler.visibility(&q).unwrap_err().kind(),
                ErrorKind::Input,
                "{q:?}"
            );
            assert!(sampler.visibility_rgb(&q).is_err() && sampler.taps(&q).is_err());
            assert_eq!(sampler.visibility_or_lit(&q), 1.0);
            let (x, y, depth, footprint) = ([q.x], [q.y], [q.depth], [q.footprint]);
            let batch = Batch::new(&x, &y, &depth).footprints(&footprint);
            assert!(
                sampler
                    .visibility_batch(&batch.bias(q.bias), &mut [0.0])
                    .is_err(),
                "{q:?}"
            );
        }
    }
    // Depths may be infinite, positions far away and footprints enormous.
    for q in [
        sound.depth(f32::INFINITY),
        sound.depth(f32::NEG_INFINITY),
        Query::new(3e38, -3e38, 5.0),
        sound.width(f32::MAX),
        sound.width(0.0),
        sound.ellipse([1e12, 1e12], [-1e12, 1e-20]),
    ] {
        let v = sampler.visibility(&q).unwrap();
        assert!((0.0..=1.0).contains(&v), "{q:?}: {v}");
    }
}

#[test]
fn threads_may_share_caches_and_own_samplers() {
    fn shared<T: Send + Sync>() {}
    fn moved<T: Send>() {}
    shared::<TileCache>();
    shared::<CachedFile>();
    moved::<Sampler>();
    moved::<WorldSampler>();
    moved::<Cursor>();
}

#[test]
fn sampler_options_outside_their_domain_are_input_errors() {
    let cache = TileCache::new(1 << 20);
    let file =
        cache.add(DsmFile::from_bytes(random_map(1, (9, 9), 8, Codec::Lz4, 0.01, false)).unwrap());
    for anisotropy in [0.5, 65.0, f32::NAN] {
        let options = SamplerOptions::default().anisotropy(anisotropy);
        let e = Sampler::with_options(&file, MapId(0), options).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
    }
    assert_eq!(
        Sampler::new(&file, MapId(1)).unwrap_err().kind(),
        ErrorKind::Input
    );
}
