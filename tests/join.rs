//! `Join`: stitched parts keep every byte, merged maps multiply, and every level
//! stays within its maximum error.

use crate::random::Random;
use crate::support::{file, written};
use deepshadow::raw::{Deviation, Precision};
use deepshadow::*;

const SIDE: u32 = 16;
const SIZE: [u32; 2] = [70, 45];
const ORIGIN: [i32; 2] = [-5, 7];

/// A pixel of an object: some tiles are empty, some constant, some hold samples of every kind.
fn ray(object: u64, coloured: bool, x: u32, y: u32) -> Ray {
    let mut ray = Ray::new();
    add_samples(&mut ray, object, coloured, x, y);
    ray
}

/// Adds the samples of a pixel of an object to a ray.
fn add_samples(ray: &mut Ray, object: u64, coloured: bool, x: u32, y: u32) {
    match (x / SIDE + object as u32, y / SIDE) {
        (1, 0) | (4, 2) => return,
        (2, 0) | (0, 2) => return ray.surface(3.0, 0.5).unwrap(),
        _ => {}
    }
    let mut random = Random((object << 40) | (u64::from(y) << 20) | u64::from(x));
    let mut dice = |n| random.below(n);
    for _ in 0..dice(5) {
        let z = 1.0 + dice(64) as f32 * 0.25;
        let opacity = [1.0, 0.75, 0.5, 0.125, 0.004, 0.3][dice(6) as usize];
        let tint = match coloured && dice(2) == 0 {
            true => [opacity, opacity * 0.5, opacity * 0.25],
            false => [opacity; 3],
        };
        match dice(2) {
            0 => ray.thick(z, z + 0.25 + dice(8) as f32 * 0.5, tint).unwrap(),
            _ => ray.surface(z, tint).unwrap(),
        }
    }
}

/// Left, top, right, bottom; the latter two are excluded.
type Area = [u32; 4];

const WHOLE: Area = [0, 0, SIZE[0], SIZE[1]];
const PARTS: [Area; 4] = [
    [32, 16, 70, 45],
    [0, 0, 32, 32],
    [32, 0, 70, 16],
    [0, 32, 32, 45],
];

fn header(name: &str, coloured: bool, [x0, y0, x1, y1]: Area) -> MapHeader {
    let mut header = MapHeader::new(name, x1 - x0, y1 - y0);
    header.channels = if coloured { 3 } else { 1 };
    header.tile_size = SIDE;
    header.data_origin = [ORIGIN[0] + x0 as i32, ORIGIN[1] + y0 as i32];
    header.display_window = [0, 0, 99, 99];
    header.depth_kind = DepthKind::Planar;
    header
}

/// Adds a map that holds an area of an object.
fn add_map(writer: &mut Writer, object: u64, header: MapHeader, area: Area, encoding: &Encoding) {
    let coloured = header.channels == 3;
    let map = writer.add_map(header, encoding.clone()).unwrap();
    let mut curve = Curve::lit(1);
    for y in area[1]..area[3] {
        for x in area[0]..area[2] {
            ray(object, coloured, x, y).flatten(encoding.tolerance / 64.0, &mut curve);
            writer
                .pixel(map, Pixel::new(x - area[0], y - area[1]), &curve)
                .unwrap();
        }
    }
}

/// A file of one map that holds an area of object 0.
fn part(coloured: bool, area: Area, encoding: &Encoding) -> DsmFile {
    file(|w| add_map(w, 0, header("key", coloured, area), area, encoding))
}

fn named(files: Vec<DsmFile>) -> Vec<(String, DsmFile)> {
    let named = files.into_iter().enumerate();
    named.map(|(i, f)| (format!("part {i}"), f)).collect()
}

fn stitched(files: Vec<DsmFile>, encoding: &Encoding) -> DsmFile {
    let stitch = Join::stitch(named(files)).unwrap();
    file(|w| stitch.write(w, std::slice::from_ref(encoding)).unwrap())
}

fn levels(codec: Codec) -> Encoding {
    Encoding::default().mips(Mips::Halved).codec(codec)
}

/// Checks every function of every level against the average of the rays of its pixels.
fn check_max_errors(file: &DsmFile, rays: impl Fn(u32, u32) -> Ray) {
    let all: Vec<Ray> = (0..SIZE[0] * SIZE[1])
        .map(|i| rays(i % SIZE[0], i / SIZE[0]))
        .collect();
    for (l, level) in file.maps()[0].levels.iter().enumerate() {
        let side = |at: u32, n: u32| at << l..((at + 1) << l).min(n);
        for y in 0..level.shape.height {
            for x in 0..level.shape.width {
                let f = file
                    .function(MapId(0).level(l as u32), Pixel::new(x, y))
                    .unwrap();
                let rows = side(y, SIZE[1]);
                let sources = rows.flat_map(|j| side(x, SIZE[0]).map(move |i| j * SIZE[0] + i));
                let rays: Vec<_> = sources.map(|i| (1.0, &all[i as usize])).collect();
                let worst = Deviation::of_average(&rays, &f);
                assert!(
                    worst.error <= level.max_error + 2f64.powi(-22),
                    "level {l} pixel {x},{y}: {worst:?} over {}",
                    level.max_error
                );
            }
        }
    }
}

/// A tile's directory entry with offset 0, and its payload.
fn stored(file: &DsmFile, tx: u32, ty: u32) -> (raw::directory::Entry, Vec<u8>) {
    let (mut entry, payload) = file
        .payload(MapId(0).level(0), TileId::new(tx, ty))
        .unwrap();
    entry.offset = 0;
    (entry, payload.into_owned())
}

#[test]
fn stitched_parts_equal_the_whole_byte_for_byte() {
    for (coloured, codec) in [
        (false, Codec::None),
        (true, Codec::Lz4),
        (true, Codec::Zstd(3)),
    ] {
        let encoding = Encoding::new(0.02).codec(codec);
        let whole = part(coloured, WHOLE, &encoding);
        let parts = || Vec::from(PARTS.map(|a| part(coloured, a, &encoding)));
        let joined = stitched(parts(), &levels(codec));
        assert_eq!(joined.maps()[0].header, whole.maps()[0].header);
        let shape = whole.level(MapId(0).level(0)).unwrap().shape;
        let mut kinds = [0; 3];
        for ty in 0..shape.tiles_y() {
            for tx in 0..shape.tiles_x() {
                let one = stored(&whole, tx, ty);
                kinds[one.0.kind as usize] += 1;
                assert_eq!(stored(&joined, tx, ty), one, "tile {tx},{ty}");
            }
        }
        assert!(kinds.iter().all(|&n| n > 0), "{kinds:?}");
        let promises: Vec<f64> = joined.maps()[0]
            .levels
            .iter()
            .map(|l| l.max_error)
            .collect();
        assert_eq!((promises[0], promises.len()), (0.02, 8));
        assert!(promises.iter().all(|p| *p < 0.0401), "{promises:?}");
        check_max_errors(&joined, |x, y| ray(0, coloured, x, y));

        // The order of the parts does not matter.
        let mut turned = parts();
        turned.rotate_left(1);
        let hash = |f: &DsmFile| f.content_hash(|_, _| true).unwrap();
        assert_eq!(hash(&joined), hash(&stitched(turned, &levels(codec))));
        // Without mip levels nothing is decoded, and the base is the same.
        let mips = Mips::None;
        let bare = stitched(parts(), &levels(codec).mips(mips));
        assert_eq!(bare.maps()[0].levels.len(), 1);
        assert_eq!(
            bare.function(MapId(0).level(0), Pixel::new(40, 20))
                .unwrap(),
            whole
                .function(MapId(0).level(0), Pixel::new(40, 20))
                .unwrap()
        );
    }
}

#[test]
fn parts_of_different_precision_and_codec_get_the_largest_max_error() {
    let kinds = [
        (0.01, Codec::None, Some(Precision::F32), Mips::Full),
        (0.05, Codec::Lz4, None, Mips::None),
        (
            0.002,
            Codec::Zstd(3),
            Some(Precision::Lattice(1000)),
            Mips::None,
        ),
        (0.03, Codec::None, Some(Precision::Lattice(50)), Mips::Full),
    ];
    let encodings = kinds.map(|(tolerance, codec, precision, mips)| {
        Encoding::new(tolerance)
            .codec(codec)
            .precision(precision)
            .mips(mips)
    });
    for (mips, mip_tolerance, expected) in [
        (Mips::Halved, None, 0.075),
        (Mips::Halved, Some(0.001), 0.0505),
        (Mips::Full, None, 0.1),
        (Mips::Full, Some(0.004), 0.054),
    ] {
        let parts = PARTS.iter().zip(&encodings);
        let parts = parts.map(|(a, e)| part(true, *a, e)).collect();
        let levels = levels(Codec::Lz4).mips(mips).mip_tolerance(mip_tolerance);
        let joined = stitched(parts, &levels);
        assert_eq!(joined.level(MapId(0).level(0)).unwrap().max_error, 0.05);
        let above = joined.level(MapId(0).level(1)).unwrap().max_error;
        assert!((above - expected).abs() < 1e-12, "{above}");
        check_max_errors(&joined, |x, y| ray(0, true, x, y));
    }
}

#[test]
fn pixels_that_no_part_covers_are_lit_and_counted() {
    let encoding = Encoding::default();
    let parts = Vec::from([PARTS[0], PARTS[1]].map(|a| part(false, a, &encoding)));
    let stitch = Join::stitch(named(parts)).unwrap();
    assert_eq!(stitch.lit_pixels(MapId(0)), u64::from(38 * 16 + 32 * 13u32));
    let joined = file(|w| stitch.write(w, &[levels(Codec::None)]).unwrap());
    check_max_errors(&joined, |x, y| {
        let contains = |[x0, y0, x1, y1]: &Area| (*x0..*x1).contains(&x) && (*y0..*y1).contains(&y);
        match PARTS[..2].iter().any(contains) {
            true => ray(0, false, x, y),
            false => Ray::new(),
        }
    });
}

#[test]
fn maps_are_stitched_by_name_with_groups_and_the_attributes_of_the_first_part() {
    let make = |names: [&str; 2], area: Area, who: &str| {
        file(|w| {
            for name in names {
                let object = u64::from(name == "b");
                let mut header = header(name, false, area);
                header.attributes = vec![("who".into(), who.into())];
                add_map(w, object, header, area, &Encoding::default());
            }
            w.add_group(Group::new(
                "all",
                GroupRole::Clusters,
                names
                    .map(|n| MapId(u32::from(n == "b") ^ u32::from(names[0] == "b")))
                    .to_vec(),
            ));
            w.add_attribute("made", who);
        })
    };
    let same = |name: &str, role| Group::new(name, role, vec![MapId(0), MapId(1)]);
    let parts = vec![
        make(["a", "b"], [0, 0, 32, 45], "me"),
        make(["a", "b"], [32, 0, 70, 45], "you"),
    ];
    let stitch = Join::stitch(named(parts)).unwrap();
    assert_eq!(
        stitch.notes(),
        ["the attributes differ: those of part 0 are kept"]
    );
    let joined = file(|w| stitch.write(w, &[levels(Codec::None)]).unwrap());
    assert_eq!(joined.groups(), [same("all", GroupRole::Clusters)]);
    assert_eq!(joined.attributes(), [("made".into(), "me".into())]);
    assert_eq!(
        joined.maps()[1].header.attributes,
        [("who".into(), "me".into())]
    );
    for m in 0..2 {
        for (x, y) in [(0, 20), (31, 44), (32, 3), (69, 44)] {
            let mut curve = Curve::lit(1);
            ray(m as u64, false, x, y).flatten(1e-4, &mut curve);
            let f = joined
                .function(MapId(m as u32).level(0), Pixel::new(x, y))
                .unwrap();
            assert!(curve.deviation(&f).error <= 0.011);
        }
    }
}

/// A change to a header, and words of the error that it causes.
type Case<'a> = (&'a dyn Fn(&mut MapHeader), &'a str);

#[test]
fn a_part_that_does_not_fit_is_named() {
    let plain = |change: &dyn Fn(&mut MapHeader)| {
        let mut header = header("key", true, [32, 0, 64, 32]);
        change(&mut header);
        file(|w| {
            w.add_map(header, Encoding::default()).unwrap();
        })
    };
    let first = || plain(&|h| (h.data_origin, h.width) = (ORIGIN, 32));
    let error_of = |second: DsmFile| {
        let e = Join::stitch(named(vec![first(), second])).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
        e.to_string()
    };
    Join::stitch(named(vec![first(), plain(&|_| {})])).unwrap();
    let cases: [Case; 14] = [
        (
            &|h| h.name = "fill".into(),
            "part 1: it has no map \"key\", as part 0 has",
        ),
        (
            &|h| h.camera.ndc_from_world = Some([0.5; 16]),
            "another camera than in part 0",
        ),
        (&|h| h.display_window[2] = 98, "another display window"),
        (
            &|h| h.depth_kind = DepthKind::RayDistance,
            "another kind of depth",
        ),
        (&|h| h.depth_unit = 2.0, "another unit of depth"),
        (
            &|h| h.interpretation = Interpretation::Discrete,
            "another interpretation",
        ),
        (&|h| h.channels = 1, "another number of channels"),
        (&|h| h.tile_size = 32, "another tile size"),
        (
            &|h| h.data_origin[0] += 8,
            "begins at 35,7: no whole tiles of 16 from -5,7",
        ),
        (
            &|h| h.data_origin[1] -= 15,
            "begins at 27,-8: no whole tiles",
        ),
        (
            &|h| h.data_origin[0] -= 16,
            "overlaps that of part 0 from pixel 11,7 on",
        ),
        (&|h| h.data_origin = ORIGIN, "overlaps"),
        (
            &|h| (h.data_origin[0], h.width) = (ORIGIN[0] - 32, 31),
            "31 pixels wide: no whole tiles",
        ),
        (&|h| h.data_origin[0] = 0x7FFF_FFFB - 16, "span"),
    ];
    for (change, words) in cases {
        let line = error_of(plain(change));
        assert!(line.contains(words), "{line}");
        assert!(line.starts_with("part 1: ") || words == "span", "{line}");
    }
    let more = file(|w| {
        for name in ["key", "fill"] {
            let header = header(name, true, [32, 0, 64, 32]);
            w.add_map(header, Encoding::default()).unwrap();
        }
    });
    assert!(error_of(more).contains("has a map \"fill\", which part 0 has not"));
    let grouped = file(|w| {
        let header = header("key", true, [32, 0, 64, 32]);
        w.add_map(header, Encoding::default()).unwrap();
        let (name, role) = ("all", GroupRole::Faces);
        w.add_group(Group::new(name, role, vec![MapId(0)]));
    });
    assert!(error_of(grouped).contains("groups"));
    assert!(Join::stitch(Vec::new()).is_err());
    assert!(Join::merge(Vec::new()).is_err());
}

#[test]
fn a_damaged_tile_is_reported_with_the_name_of_its_part() {
    let header = header("key", false, WHOLE);
    let mut bytes = written(|w| add_map(w, 0, header, WHOLE, &Encoding::default()));
    bytes[100] ^= 1;
    let damaged = DsmFile::from_bytes(bytes).unwrap();
    let stitch = Join::stitch(named(vec![damaged])).unwrap();
    let mut writer = Writer::in_memory();
    let e = stitch
        .write(&mut writer, &[Encoding::default()])
        .unwrap_err();
    assert_eq!((e.rule(), e.file()), (Some("TILE-CRC"), Some("part 0")));
    assert!(
        e.to_string()
            .starts_with("part 0: file breaks rule TILE-CRC")
    );
}

/// A file of one map that holds an object as a whole.
fn whole(object: u64, coloured: bool, side: u32, tolerance: f64) -> DsmFile {
    let encoding = Encoding::new(tolerance);
    let mut header = header("key", coloured, WHOLE);
    header.tile_size = side;
    file(|w| add_map(w, object, header, WHOLE, &encoding))
}

#[test]
fn a_merged_map_is_the_product_within_its_max_error() {
    for (coloured, sides, max_errors, tolerance) in [
        ([false, false], [16, 16], [0.01, 0.01], 0.03),
        ([false, true], [16, 64], [0.01, 0.002], 0.015),
        ([true, true], [8, 32], [0.03, 0.05], 0.1),
    ] {
        let files = || -> Vec<DsmFile> {
            let files = (0..2).map(|i| whole(i as u64, coloured[i], sides[i], max_errors[i]));
            files.collect()
        };
        let merge = Join::merge(named(files())).unwrap();
        let source_error = merge.source_error(MapId(0));
        let sum = max_errors[0] + max_errors[1];
        assert!(source_error >= sum && source_error <= sum + 1e-15);
        assert_eq!(
            merge.default_tolerance(MapId(0)),
            source_error + max_errors[0].max(max_errors[1])
        );
        let encoding = Encoding::new(tolerance).compressor(Compressor::Minimal);
        let merged = file(|w| merge.write(w, std::slice::from_ref(&encoding)).unwrap());
        let header = &merged.maps()[0].header;
        assert_eq!(header.channels, if coloured[1] { 3 } else { 1 });
        assert_eq!(header.tile_size, sides[0]);
        assert!(
            merged.maps()[0]
                .levels
                .iter()
                .all(|l| l.max_error <= tolerance)
        );
        let parts = files();
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let [a, b] = [0, 1].map(|i: usize| {
                    parts[i]
                        .function(MapId(0).level(0), Pixel::new(x, y))
                        .unwrap()
                });
                let f = merged
                    .function(MapId(0).level(0), Pixel::new(x, y))
                    .unwrap();
                check_product(&f, &a, &b, tolerance - source_error);
            }
        }
        // It is also within its maximum error of the rays with all samples of both objects.
        check_max_errors(&merged, |x, y| both(coloured, x, y));
    }
}

/// The samples of both objects in one ray.
fn both(coloured: [bool; 2], x: u32, y: u32) -> Ray {
    let mut all = Ray::new();
    (0..2).for_each(|i| add_samples(&mut all, i as u64, coloured[i], x, y));
    all
}

/// Checks that `f` is the product of `a` and `b` within `bound`.
///
/// Checks both sides of every vertex of the three, the floats next to it, and the middles.
fn check_product(f: &Visibility, a: &Visibility, b: &Visibility, bound: f64) {
    let mut depths = [f.depths(), a.depths(), b.depths()].concat();
    depths.sort_by(f32::total_cmp);
    depths.dedup();
    let middles: Vec<f32> = depths.windows(2).map(|p| (p[0] + p[1]) / 2.0).collect();
    let neighbours = depths.iter().flat_map(|z| [z.next_down(), z.next_up()]);
    let all: Vec<f32> = neighbours
        .chain(middles)
        .chain(depths.iter().copied())
        .collect();
    for z in all {
        for behind in [false, true] {
            let value = |f: &Visibility| match behind {
                false => f.visibility_rgb(z).map(f64::from),
                true => f.visibility_behind_rgb(z).map(f64::from),
            };
            let [f, a, b] = [f, a, b].map(value);
            for c in 0..3 {
                let error = (f[c] - a[c] * b[c]).abs();
                assert!(
                    error <= bound + 2f64.powi(-21),
                    "{error} at {z}, behind {behind}"
                );
            }
        }
    }
}

#[test]
fn a_map_that_cannot_be_merged_is_named() {
    let make = |change: &dyn Fn(&mut MapHeader), names: &[&str]| {
        file(|w| {
            for name in names {
                let mut header = header(name, true, WHOLE);
                change(&mut header);
                w.add_map(header, Encoding::default()).unwrap();
            }
        })
    };
    let plain = |names: &[&str]| make(&|_| {}, names);
    let cases: [Case; 7] = [
        (&|h| h.width = 69, "another size"),
        (&|h| h.height = 46, "another size"),
        (&|h| h.data_origin[1] = 0, "another data origin"),
        (
            &|h| h.camera.camera_from_world = Some([0.5; 16]),
            "another camera",
        ),
        (&|h| h.display_window[3] = 98, "another display window"),
        (
            &|h| h.depth_kind = DepthKind::Unspecified,
            "another kind of depth",
        ),
        (&|h| h.depth_unit = 2.0, "another unit of depth"),
    ];
    for (change, words) in cases {
        let files = vec![plain(&["key"]), make(change, &["key"])];
        let line = Join::merge(named(files)).unwrap_err().to_string();
        assert!(
            line.starts_with("part 1: map \"key\" has ") && line.contains(words),
            "{line}"
        );
    }
    // Single maps merge whatever their names are; several are matched by name, or chosen by id.
    let merge = Join::merge(named(vec![plain(&["hair"]), plain(&["smoke"])])).unwrap();
    assert_eq!(merge.headers()[0].name, "hair");
    let merge = Join::merge(named(vec![plain(&["a", "b"]), plain(&["b", "a"])])).unwrap();
    assert_eq!(merge.headers().len(), 2);
    let files = || named(vec![plain(&["a", "b"]), plain(&["c"])]);
    assert!(
        Join::merge(files())
            .unwrap_err()
            .to_string()
            .contains("part 1: it has no map \"a\"")
    );
    assert_eq!(
        Join::merge_maps(files(), vec![MapId(1), MapId(0)])
            .unwrap()
            .headers()[0]
            .name,
        "b"
    );
    assert!(
        Join::merge_maps(files(), vec![MapId(0), MapId(1)])
            .unwrap_err()
            .to_string()
            .starts_with("part 1: ")
    );
    assert!(Join::merge_maps(files(), vec![MapId(0)]).is_err());
    // The tolerance must exceed the sum of the maximum errors.
    let mut writer = Writer::in_memory();
    let encoding = |tolerance, mip_tolerance| Encoding::new(tolerance).mip_tolerance(mip_tolerance);
    let merge = Join::merge(named(vec![plain(&["a"]), plain(&["a"])])).unwrap();
    for (tolerance, mip) in [(0.02, None), (0.0, None), (0.5, Some(0.02))] {
        let e = merge
            .write(&mut writer, &[encoding(tolerance, mip)])
            .unwrap_err();
        assert!(e.to_string().contains("sum of the largest errors"), "{e}");
    }
    assert!(merge.write(&mut writer, &[]).is_err());
}

#[test]
fn three_files_merge_and_exact_ones_need_no_tolerance() {
    let wall = |v: f64, exact: bool| {
        file(|w| {
            let encoding = Encoding::default().source_error(0.0);
            let header = header("key", false, [0, 0, 16, 16]);
            let map = w.add_map(header, encoding).unwrap();
            let f = Visibility::mono(vec![Vertex::new(1.0, 1.0), Vertex::new(2.0, v as f32)]);
            let pixels = match exact {
                true => Pixels::Functions(vec![f.unwrap(); 256]),
                false => Pixels::Curves(vec![
                    Curve::mono(vec![1.0, 2.0], vec![1.0, v]).unwrap();
                    256
                ]),
            };
            w.tile(map, TileId::new(0, 0), pixels).unwrap();
        })
    };
    let exact = || vec![wall(0.5, true), wall(0.25, true), wall(0.75, true)];
    let merge = Join::merge(named(exact())).unwrap();
    assert_eq!(
        (
            merge.source_error(MapId(0)),
            merge.default_tolerance(MapId(0))
        ),
        (0.0, 0.001)
    );
    for tolerance in [0.0, 0.001] {
        let encoding = Encoding::new(tolerance).mips(Mips::None);
        let merged = file(|w| merge.write(w, std::slice::from_ref(&encoding)).unwrap());
        let f = merged
            .function(MapId(0).level(0), Pixel::new(3, 3))
            .unwrap();
        let bound = tolerance.max(Encoding::MIN_TOLERANCE) + 2f64.powi(-22);
        for i in 0..=64 {
            let t = f64::from(i) / 64.0;
            let exact: f64 = [0.5, 0.25, 0.75]
                .map(|v| 1.0 + (v - 1.0) * t)
                .iter()
                .product();
            let error = (f64::from(f.visibility(1.0 + t as f32)) - exact).abs();
            assert!(error <= bound, "{error} at {t}");
        }
    }
    let lossy = Join::merge(named(vec![
        wall(0.5, false),
        wall(0.25, false),
        wall(0.0, false),
    ]))
    .unwrap();
    let encoding = Encoding::new(lossy.default_tolerance(MapId(0)));
    let merged = file(|w| lossy.write(w, std::slice::from_ref(&encoding)).unwrap());
    assert_eq!(
        merged
            .function(MapId(0).level(0), Pixel::new(3, 3))
            .unwrap()
            .end_rgb(),
        [0.0; 3]
    );
}
