//! Files that every reader must accept.

use super::*;
use crate::vectors_support::invalid::zstd_frame;

/// A valid file.
pub struct Vector {
    pub name: &'static str,
    pub bytes: Vec<u8>,
    /// Whether the bytes must not change; false if they depend on the version of a codec's library.
    pub golden: bool,
}

const PLAIN: (Codec, u8) = (Codec::None, 0);

/// Level `l` of a map; `f` yields the function of each pixel.
fn level(
    h: &MapHeader,
    l: u32,
    precision: Precision,
    how: (Codec, u8),
    f: impl Fn(u32, u32) -> Visibility,
) -> RawLevel {
    RawLevel {
        max_error: 0.0,
        tiles: tiles_of(LevelShape::of(h, l), precision, how, f),
        directory: Codec::None,
    }
}

/// A file of one map with one level.
fn single(
    h: MapHeader,
    precision: Precision,
    how: (Codec, u8),
    f: impl Fn(u32, u32) -> Visibility,
) -> RawFile {
    let level = level(&h, 0, precision, how, f);
    RawFile::of(h, vec![level])
}

/// By turns a lit function, a surface, a ramp, and ramps with a step; on the lattice 64.
pub fn mixed_mono(x: u32, y: u32) -> Visibility {
    let z = 1.0 + x as f32 * 0.25 + y as f32;
    match (x + 3 * y) % 5 {
        0 => Visibility::lit(),
        1 => mono(&[(z, 0.25)]),
        2 => mono(&[(z, 1.0), (z + 1.0, 0.5)]),
        3 => mono(&[
            (z, 0.984375),
            (z + 0.5, 0.75),
            (z + 0.5, 0.25),
            (z + 2.0, 0.0),
        ]),
        _ => mono(&[(z, 1.0), (z + 4.0, 0.75), (z + 4.0, 0.015625)]),
    }
}

/// By turns a coloured function and one of [`mixed_mono`].
pub fn mixed_rgb(x: u32, y: u32) -> Visibility {
    let z = 2.0 + x as f32 * 0.5 - y as f32;
    match (x + y) % 3 {
        0 => rgb(&[
            (z, [0.5, 0.75, 1.0]),
            (z + 1.0, [0.25, 0.75, 0.5]),
            (z + 1.0, [0.0, 0.5, 0.5]),
        ]),
        _ => mixed_mono(x, y),
    }
}

/// A function whose visibilities are on no small lattice.
pub fn off_lattice(x: u32, y: u32) -> Visibility {
    let v = 1.0 / (1.5 + (x + y) as f32);
    mono(&[(0.1 * (1 + x) as f32, v), (2.0 + y as f32 / 3.0, v / 3.0)])
}

/// Functions of which [`lookups`] asks.
fn at_steps(x: u32, _: u32) -> Visibility {
    let (tiny, next) = (f32::from_bits(1), 2f32.next_up());
    match x {
        0 => mono(&[(1.0, 1.0), (2.0, 0.75), (2.0, 0.25), (3.0, 0.0)]),
        1 => mono(&[(2.0, 0.5)]),
        2 => mono(&[
            (1.0, 1.0),
            (2.0, 0.75),
            (2.0, 0.5),
            (next, 0.5),
            (next, 0.25),
        ]),
        3 => mono(&[
            (-1.0, 1.0),
            (0.0, 1.0),
            (0.0, 0.5),
            (tiny, 0.5),
            (tiny, 0.25),
        ]),
        _ => rgb(&[
            (1.0, [1.0, 1.0, 0.5]),
            (2.0, [0.75, 1.0, 0.5]),
            (2.0, [0.75, 0.25, 0.5]),
        ]),
    }
}

/// Values of the vector `at-steps` around every vertex: at one float in front of it, at its depth
/// and one float behind it. A line holds the pixel, the depth, V at this depth, and V just behind.
pub fn lookups() -> String {
    let mut out = String::new();
    for x in 0..5 {
        let f = at_steps(x, 0);
        let depths = f
            .depths()
            .iter()
            .flat_map(|z| [z.next_down(), *z, z.next_up()]);
        let mut depths: Vec<f32> = depths.map(|z| z + 0.0).collect();
        depths.dedup();
        for z in depths {
            let list = |v: [f32; 3]| {
                let channels = &v[..f.channels()];
                channels
                    .iter()
                    .map(|v| text::short(*v))
                    .collect::<Vec<_>>()
                    .join(",")
            };
            let (at, behind) = (f.visibility_rgb(z), f.visibility_behind_rgb(z));
            out += &format!("{x},0 {} {} {}\n", text::short(z), list(at), list(behind));
        }
    }
    out
}

fn attributes() -> Vec<(String, Attribute)> {
    let a = |name: &str, value| (name.into(), value);
    vec![
        (
            "comments".into(),
            "tab\t, quote \", umlaut ü, a line\nand another".into(),
        ),
        ("empty".into(), "".into()),
        a(
            "frames",
            Attribute::Integers(vec![0, -1, i64::MAX, i64::MIN]),
        ),
        a(
            "numbers",
            Attribute::Numbers(vec![0.5, 1e300, -2.0, 5e-324, 0.1]),
        ),
        a(
            "exr:owner",
            Attribute::Opaque {
                type_name: "exr:string".into(),
                bytes: b"\x03\0\0\0abc".to_vec(),
            },
        ),
        a(
            "no bytes",
            Attribute::Opaque {
                type_name: "t".into(),
                bytes: vec![],
            },
        ),
        a(
            "of the future",
            Attribute::Unknown {
                kind: 200,
                bytes: vec![0, 255, 16],
            },
        ),
    ]
}

/// All valid files.
pub fn all() -> Vec<Vector> {
    let lattice = Precision::Lattice(64);
    let mut out = Vec::new();
    let mut add = |name, file: RawFile, golden| {
        out.push(Vector {
            name,
            bytes: file.assemble(),
            golden,
        })
    };
    let codecs = [Codec::None, Codec::Lz4, Codec::Zstd(3)];
    // Codecs and transforms.
    for (codec, transform, name) in [
        (0, 0, "codec-none"),
        (0, 1, "codec-none-delta-planes"),
        (1, 0, "codec-lz4-plain"),
        (1, 1, "codec-lz4"),
        (2, 0, "codec-zstd-plain"),
        (2, 1, "codec-zstd"),
    ] {
        let file = single(
            header("map", 11, 9, 1),
            lattice,
            (codecs[codec], transform),
            mixed_mono,
        );
        add(name, file, codec == 0);
    }
    for (codec, name) in [(1, "directory-lz4"), (2, "directory-zstd")] {
        let mut file = single(header("map", 20, 9, 1), lattice, PLAIN, mixed_mono);
        file.maps[0].1[0].directory = codecs[codec];
        add(name, file, false);
    }
    // The largest window, and a dictionary of number 0: none.
    let mut file = single(header("map", 3, 2, 1), lattice, PLAIN, mixed_mono);
    let (entry, content) = file.maps[0].1[0].tiles[0].clone();
    let size = (content.len() as u32).to_le_bytes();
    let frame = zstd_frame(&[&[0x81, 0x88, 0][..], &size].concat(), &content);
    file.maps[0].1[0].tiles[0] = stored(entry, 2, 0, content.len(), frame);
    add("codec-zstd-fields", file, true);
    // Types of values, and colour.
    for transform in [0, 1] {
        let how = (Codec::None, transform);
        let both = |plain, delta| if transform == 0 { plain } else { delta };
        add(
            both("f32", "f32-delta-planes"),
            single(header("map", 5, 4, 1), Precision::F32, how, off_lattice),
            true,
        );
        add(
            both("colour", "colour-delta-planes"),
            single(header("map", 9, 3, 3), lattice, how, mixed_rgb),
            true,
        );
        let third = |x: u32, y: u32| match x + y {
            0 => rgb(&[(0.5, [1.0 / 3.0, 0.1, 0.7]), (0.75, [1.0 / 7.0, 0.1, 0.0])]),
            n if n % 2 == 0 => rgb(&[(1.0, [0.9, 0.9, 0.3])]),
            _ => off_lattice(x, y),
        };
        add(
            both("colour-f32", "colour-f32-delta-planes"),
            single(header("map", 3, 3, 3), Precision::F32, how, third),
            true,
        );
    }
    add(
        "colour-everywhere",
        single(header("map", 2, 2, 3), lattice, PLAIN, |x, y| {
            rgb(&[((x + y) as f32, [0.5, 0.25, 0.0])])
        }),
        true,
    );
    add(
        "colour-map-without-colour",
        single(header("map", 5, 7, 3), lattice, PLAIN, mixed_mono),
        true,
    );
    // The smallest and the largest u16: 1/65535 and 65535/65535. The quotients are rounded.
    add(
        "lattice-65535",
        single(
            header("map", 3, 1, 1),
            Precision::Lattice(65535),
            PLAIN,
            |x, _| match x {
                0 => mono(&[
                    (1.0, 1.0),
                    (2.0, 65534.0 / 65535.0),
                    (3.0, 1.0 / 65535.0),
                    (4.0, 0.0),
                ]),
                1 => mono(&[(1.0, 21845.0 / 65535.0)]),
                _ => Visibility::lit(),
            },
        ),
        true,
    );
    add(
        "lattice-1",
        single(
            header("map", 2, 1, 1),
            Precision::Lattice(1),
            PLAIN,
            |x, _| match x {
                0 => mono(&[(1.0, 0.0)]),
                _ => mono(&[(1.0, 1.0), (3.0, 0.0)]),
            },
        ),
        true,
    );
    // Kinds of tiles.
    let kinds = |x: u32, y: u32| match x / 8 {
        0 => Visibility::lit(),
        1 => mono(&[(7.5, 0.5)]),
        _ => mixed_mono(x, y),
    };
    add(
        "tiles-of-every-kind",
        single(header("map", 24, 8, 1), lattice, PLAIN, kinds),
        true,
    );
    add(
        "empty-map",
        single(header("map", 12, 3, 1), lattice, PLAIN, |_, _| {
            Visibility::lit()
        }),
        true,
    );
    add(
        "constant-opaque",
        single(header("map", 8, 9, 3), lattice, PLAIN, |_, _| {
            mono(&[(-3.5, 0.0)])
        }),
        true,
    );
    let mut file = single(header("map", 24, 16, 1), lattice, PLAIN, mixed_mono);
    file.backwards = true;
    add("tiles-in-any-order", file, true);
    // A data tile may be constant; it only has to have a vertex.
    let mut file = single(header("map", 2, 2, 1), lattice, PLAIN, |x, y| {
        mono(&[(4.0, if x + y == 0 { 0.25 } else { 0.5 })])
    });
    let mut same = Vec::new();
    for v in [0u32, 1, 2, 3, 4] {
        same.extend_from_slice(&v.to_le_bytes());
    }
    (0..4).for_each(|_| same.extend_from_slice(&4f32.to_le_bytes()));
    (0..4).for_each(|_| same.extend_from_slice(&32u16.to_le_bytes()));
    same.resize(same.len().next_multiple_of(8), 0);
    let mut entry = file.maps[0].1[0].tiles[0].0;
    entry.ends = [0.5; 2];
    file.maps[0].1[0].tiles[0] = stored(entry, 0, 0, same.len(), same);
    add("data-tile-that-is-constant", file, true);
    // Sizes.
    add(
        "one-pixel",
        single(header("map", 1, 1, 1), lattice, PLAIN, |_, _| {
            mono(&[(2.0, 0.5)])
        }),
        true,
    );
    let h = header("map", 5, 7, 1);
    let levels = (0..4).map(|l| RawLevel {
        max_error: 0.01 * f64::from(l + 1),
        ..level(&h, l, lattice, PLAIN, |x, y| mixed_mono(x << l, y))
    });
    let levels = levels.collect();
    add("levels-all", RawFile::of(h, levels), true);
    let h = header("map", 21, 13, 3);
    let levels = (0..3).map(|l| RawLevel {
        max_error: 0.25,
        ..level(&h, l, lattice, (Codec::None, 1), |x, y| mixed_rgb(x + l, y))
    });
    let levels = levels.collect();
    add("levels-fewer-than-full", RawFile::of(h, levels), true);
    let wide = header("map", 300, 2, 1).tile_size(256);
    add(
        "tile-256",
        single(wide, lattice, (Codec::Zstd(3), 1), mixed_mono),
        false,
    );
    let sparse = |x: u32, y: u32| match (x, y) {
        (0, 0) | (265, 130) => mono(&[(1.0, 0.5)]),
        (130, 3) => mono(&[(2.0, 1.0), (3.0, 0.75)]),
        _ => Visibility::lit(),
    };
    let mut file = single(header("map", 266, 250, 1), lattice, PLAIN, sparse);
    file.maps[0].1[0].directory = Codec::Zstd(3);
    add("directory-of-two-blocks", file, false);
    // Depths.
    add(
        "negative-depths",
        single(header("map", 4, 2, 1), lattice, (Codec::None, 1), |x, y| {
            let z = -5.0 + x as f32 * 2.0 + y as f32;
            mono(&[(z, 1.0), (z + 1.0, 0.5), (z + 1.0, 0.25)])
        }),
        true,
    );
    let tiny = f32::from_bits(1);
    let odd = move |x: u32, _: u32| match x {
        0 => mono(&[
            (-tiny, 1.0),
            (0.0, 0.75),
            (tiny, 0.5),
            (f32::from_bits(2), 0.25),
        ]),
        1 => mono(&[
            (f32::MIN, 0.75),
            (-f32::MIN_POSITIVE, 0.5),
            (f32::MIN_POSITIVE, 0.25),
            (f32::MAX, 0.0),
        ]),
        2 => mono(&[(1.0, 1.0), (1f32.next_up(), 0.0)]),
        _ => mono(&[(1e10, 0.5)]),
    };
    add(
        "depths-denormal-and-huge",
        single(header("map", 4, 1, 1), lattice, PLAIN, odd),
        true,
    );
    add(
        "depths-denormal-and-huge-delta-planes",
        single(header("map", 4, 1, 1), lattice, (Codec::None, 1), odd),
        true,
    );
    add(
        "visibilities-denormal",
        single(
            header("map", 2, 1, 1),
            Precision::F32,
            PLAIN,
            move |x, _| {
                mono(&[
                    (1.0, 1f32.next_down()),
                    (2.0, f32::MIN_POSITIVE),
                    (3.0, tiny * (1 + x) as f32),
                    (4.0, 0.0),
                ])
            },
        ),
        true,
    );
    let steps = |x: u32, _: u32| match x {
        0 => mono(&[
            (1.0, 1.0),
            (2.0, 1.0),
            (2.0, 0.5),
            (3.0, 0.5),
            (3.0, 0.25),
            (4.0, 0.25),
            (4.0, 0.0),
        ]),
        1 => mono(&[(1.0, 0.5)]),
        2 => mono(&[(1.0, 0.75), (1f32.next_up(), 0.75), (1f32.next_up(), 0.5)]),
        _ => rgb(&[
            (1.0, [1.0, 1.0, 0.5]),
            (2.0, [1.0, 1.0, 0.5]),
            (2.0, [1.0, 0.75, 0.5]),
        ]),
    };
    add(
        "steps",
        single(header("map", 4, 1, 3), lattice, PLAIN, steps),
        true,
    );
    add(
        "steps-delta-planes",
        single(header("map", 4, 1, 3), lattice, (Codec::None, 1), steps),
        true,
    );
    add(
        "at-steps",
        single(header("map", 5, 1, 3), lattice, PLAIN, at_steps),
        true,
    );
    // Contents of the footer.
    let mut camera = header("light", 4, 3, 1);
    camera.depth_kind = DepthKind::Planar;
    camera.depth_unit = 0.01;
    camera.interpretation = Interpretation::Discrete;
    camera.camera.camera_from_world = Some(std::array::from_fn(|i| {
        if i % 5 == 0 { 1.0 } else { i as f64 * -0.1 }
    }));
    camera.camera.ndc_from_world = Some(std::array::from_fn(|i| 1.0 / (i + 1) as f64));
    camera.data_origin = [-2, 5];
    camera.display_window = [-10, -20, 100, 50];
    add(
        "camera",
        single(camera.clone(), lattice, PLAIN, mixed_mono),
        true,
    );
    camera.camera.camera_from_world = None;
    camera.depth_kind = DepthKind::RayDistance;
    camera.interpretation = Interpretation::Continuous;
    camera.display_window = [0, 0, 0, 0];
    add(
        "camera-ndc-only",
        single(camera.clone(), lattice, PLAIN, mixed_mono),
        true,
    );
    let mut odd = header("map ü \u{1F311} \"", 2, 1, 1);
    odd.attributes = attributes();
    let mut file = single(odd, lattice, PLAIN, mixed_mono);
    file.attributes = attributes();
    add("attributes", file, true);
    let mut file = single(header("map", 2, 1, 1), lattice, PLAIN, mixed_mono);
    file.optional_features = 1 << 63 | 5;
    add("optional-features", file, true);
    let long = "n".repeat(255);
    let mut file = RawFile::default();
    for (i, name) in ["+x", "-x", "+y", long.as_str()].into_iter().enumerate() {
        let h = header(name, 2 + i as u32, 3, 1).depth_kind(
            [
                DepthKind::Planar,
                DepthKind::RayDistance,
                DepthKind::Unspecified,
            ][i % 3],
        );
        let levels = (0..=i as u32 % 2)
            .map(|l| level(&h, l, lattice, PLAIN, |x, y| mixed_mono(x + i as u32, y)))
            .collect();
        file.maps.push((h, levels));
    }
    let group = |name: &str, role, maps: &[u32]| {
        Group::new(name, role, maps.iter().copied().map(MapId).collect())
    };
    file.groups = vec![
        group("cube", GroupRole::Faces, &[2, 0, 1]),
        group("all", GroupRole::Clusters, &[0, 1, 2, 3]),
        group("one", GroupRole::Faces, &[3]),
    ];
    add("maps-and-groups", file, true);
    let mut file = single(header("map", 3, 3, 1), lattice, PLAIN, mixed_mono);
    file.maps[0].1[0].max_error = 1.0;
    add("promise-of-one", file, true);
    // A file by the writer, with levels.
    out.push(Vector {
        name: "writer",
        bytes: by_the_writer(),
        golden: true,
    });
    out
}

/// A file by the library's writer: three compressed pixels, and mip levels.
fn by_the_writer() -> Vec<u8> {
    let mut writer = Writer::in_memory();
    let encoding = Encoding::new(1.0 / 64.0).codec(Codec::None);
    let map = writer.add_map(header("light", 12, 9, 3), encoding).unwrap();
    let fade: Vec<f64> = (0..40).map(|i| 1.0 - f64::from(i) / 50.0).collect();
    writer
        .pixel(
            map,
            Pixel::new(0, 0),
            &Curve::mono((0..40).map(|i| i as f32 / 8.0).collect(), fade).unwrap(),
        )
        .unwrap();
    writer
        .pixel(
            map,
            Pixel::new(11, 8),
            &Curve::mono(vec![1.5], vec![0.0]).unwrap(),
        )
        .unwrap();
    writer
        .pixel(
            map,
            Pixel::new(3, 7),
            &Curve::rgb(
                vec![1.0, 2.0, 2.0],
                vec![[1.0, 1.0, 0.75], [1.0, 0.5, 0.75], [0.5, 0.5, 0.5]],
            )
            .unwrap(),
        )
        .unwrap();
    writer.into_bytes().unwrap()
}
