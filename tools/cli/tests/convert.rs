//! `dsm-convert`: what goes in comes out within the promise, whatever the formats and the options.

use crate::convert_support::*;
use deepshadow::{Attribute, DepthKind, DsmFile, Interpretation, MapId, Pixel};
use deepshadow_cli::source::{DeepSource, SourceOptions, against};

const LOOKS: [Look; 4] = [
    Look {
        coloured: false,
        thick: false,
        tiled: false,
    },
    Look {
        coloured: false,
        thick: true,
        tiled: true,
    },
    Look {
        coloured: true,
        thick: false,
        tiled: true,
    },
    Look {
        coloured: true,
        thick: true,
        tiled: false,
    },
];

#[test]
fn deep_images_become_maps_that_keep_their_promises() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "out.dsm"].map(|n| folder.path().join(n));
    for look in LOOKS {
        image(&exr, look);
        for options in [
            &[][..],
            &[
                "--tolerance",
                "0.05",
                "--compressor",
                "croquet",
                "--tile",
                "8",
                "--compression",
                "none",
            ],
            &[
                "--tolerance",
                "0.02",
                "--mip-tolerance",
                "0.1",
                "--compressor",
                "lookahead",
                "-z",
                "lz4",
            ],
            &["--nomipmap", "-z", "zstd:3", "-j", "1", "--lattice", "0"],
            &["--tolerance", "0.001", "--lattice", "1000"],
        ] {
            convert(&exr, &dsm, options);
            keeps_promises(&dsm, &exr, &SourceOptions::default());
            let file = DsmFile::open(&dsm).unwrap();
            file.verify(|_, _| true).unwrap();
            assert_eq!(
                file.maps()[0].levels.len() == 1,
                options.contains(&"--nomipmap")
            );
        }
    }
}

#[test]
fn the_header_says_what_the_image_said() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, back] = ["in.exr", "out.dsm", "back.exr"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[1]);
    let matrix = "1 0 0 0 0 1 0 0 0 0 1 0 -0.5 2 0 1";
    let mut options = vec![
        "--depth-kind",
        "ray",
        "--depth-unit",
        "0.01",
        "--name",
        "moon",
        "--MNDC",
    ];
    options.extend(matrix.split(' '));
    options.extend([
        "--attrib", "shot", "12", "--attrib", "note", "-x y", "--attrib", "owner", "me",
    ]);
    convert(&exr, &dsm, &options);
    let file = DsmFile::open(&dsm).unwrap();
    let header = &file.maps()[0].header;
    assert_eq!((header.name.as_str(), header.depth_unit), ("moon", 0.01));
    assert_eq!(header.depth_kind, DepthKind::RayDistance);
    assert_eq!(header.interpretation, Interpretation::Continuous);
    assert_eq!(
        (header.data_origin, header.display_window),
        ([-3, 7], [0, 0, 63, 47])
    );
    assert_eq!(header.camera.camera_from_world.unwrap()[3], 1.75);
    assert_eq!(
        header.camera.ndc_from_world.unwrap()[12..],
        [-0.5, 2.0, 0.0, 1.0]
    );
    let value = |name: &str| {
        let found = header.attributes.iter().find(|(n, _)| n == name);
        &found.unwrap().1
    };
    assert_eq!(*value("shot"), Attribute::Integers(vec![12]));
    assert_eq!(*value("note"), Attribute::Text("-x y".into()));
    assert_eq!(*value("owner"), Attribute::Text("me".into()));
    let bytes = 0.5f32.to_le_bytes().to_vec();
    let exposure = Attribute::Opaque {
        type_name: "exr:float".into(),
        bytes,
    };
    assert_eq!(*value("expTime"), exposure);

    convert(&dsm, &back, &[]);
    let reader = deepshadow_exr::DeepReader::open(&back).unwrap();
    let part = &reader.parts()[0];
    assert_eq!((part.data_window, part.display_window.width), (WINDOW, 64));
    assert_eq!(part.attribute("expTime").unwrap().as_float(), Some(0.5));
    assert_eq!(part.attribute("owner").unwrap().as_text(), Some("me"));
    assert_eq!(part.attribute("shot").unwrap().as_int(), Some(12));
    assert_eq!(
        part.attribute("worldToCamera").unwrap().as_m44f().unwrap()[3],
        1.75
    );
    assert_eq!(
        part.attribute("worldToNDC").unwrap().as_m44f().unwrap()[13],
        2.0
    );
}

#[test]
fn depths_scale_and_thickness_is_ignored_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "out.dsm"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[1]);
    for (options, zscale, opacity_limit, discrete) in [
        (&["--zscale", "0.1"][..], 0.1, None, false),
        (&["-s", "-2.5", "--continuous"], -2.5, None, false),
        (&["--discrete"], 1.0, None, true),
        (&["--opacitylimit", "0.6"], 1.0, Some(0.6), false),
        (
            &["-l", "1", "--discrete", "-s", "-1"],
            -1.0,
            Some(1.0),
            true,
        ),
    ] {
        let (_, err) = convert(&exr, &dsm, options);
        assert_eq!(
            err.contains("--opacitylimit made"),
            opacity_limit == Some(0.6),
            "{err}"
        );
        let options = SourceOptions {
            zscale,
            opacity_limit,
            discrete,
            ..SourceOptions::default()
        };
        keeps_promises(&dsm, &exr, &options);
    }
    let source = DeepSource::open(
        &exr,
        &SourceOptions {
            opacity_limit: Some(0.6),
            ..Default::default()
        },
    );
    let source = source.unwrap();
    let exact = DeepSource::open(&exr, &SourceOptions::default()).unwrap();
    let rays = |s: &DeepSource| s.rays(0, 0, 45, 37).unwrap();
    for (limited, exact) in rays(&source).iter().zip(rays(&exact)) {
        let (end, exact_end) = (limited.visibility_behind(1e9), exact.visibility_behind(1e9));
        assert!(
            end == if exact_end <= 1.0 - f64::from(0.6f32) {
                0.0
            } else {
                exact_end
            }
        );
    }
}

#[test]
fn maps_become_deep_images_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, back, again] =
        ["in.exr", "map.dsm", "back.exr", "again.dsm"].map(|n| folder.path().join(n));
    for look in LOOKS {
        image(&exr, look);
        convert(&exr, &dsm, &[]);
        let file = DsmFile::open(&dsm).unwrap();
        for (options, level, tolerance) in [
            (&[][..], 0, 0.002),
            (&["--tiled", "-z", "zstd", "--level", "2"], 2, 0.002),
            (
                &["--float", "--tolerance", "0.00002", "-z", "none"],
                0,
                0.00002,
            ),
            (
                &["--half", "--tolerance", "0.05", "-z", "rle", "--map", "key"],
                0,
                0.05,
            ),
        ] {
            convert(&dsm, &back, options);
            comes_back(&back, &file, 0, level, tolerance);
        }
        convert(&back, &again, &[]);
    }
}

#[test]
fn copies_keep_every_function_and_promise() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, copy] = ["in.exr", "map.dsm", "copy.dsm"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[3]);
    convert(&exr, &dsm, &["--mip-tolerance", "0.03"]);
    let file = DsmFile::open(&dsm).unwrap();
    for options in [
        &["-z", "none"][..],
        &["-z", "lz4", "--tile", "8"],
        &["--tile", "256"],
        &["--levels", "3", "--tile", "16"],
        &["--nomipmap"],
    ] {
        convert(&dsm, &copy, options);
        let made = DsmFile::open(&copy).unwrap();
        made.verify(|_, _| true).unwrap();
        let (old, new) = (&file.maps()[0], &made.maps()[0]);
        let levels = match options[0] {
            "--levels" => 3,
            "--nomipmap" => 1,
            _ => old.levels.len(),
        };
        assert_eq!(new.levels.len(), levels);
        for (l, level) in new.levels.iter().enumerate() {
            assert_eq!(level.max_error, old.levels[l].max_error);
            assert_eq!(level.vertices, old.levels[l].vertices);
            for y in 0..level.shape.height {
                for x in 0..level.shape.width {
                    let [a, b] = [&file, &made].map(|f| {
                        f.function(MapId(0).level(l as u32), Pixel::new(x, y))
                            .unwrap()
                    });
                    assert_eq!(a, b);
                }
            }
        }
    }
    // The file itself may be the output.
    let before = file.maps()[0].levels[1].clone();
    convert(&dsm, &dsm, &["-z", "none"]);
    assert_eq!(
        DsmFile::open(&dsm).unwrap().maps()[0].levels[1].max_error,
        before.max_error
    );
}

#[test]
fn regions_and_larger_tolerances_keep_promises_too() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, copy] = ["in.exr", "map.dsm", "copy.dsm"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[1]);
    convert(&exr, &dsm, &["--tile", "8"]);
    for options in [
        &["--tolerance", "0.03"][..],
        &[
            "--tolerance",
            "0.03",
            "--mip-tolerance",
            "0.05",
            "--tile",
            "16",
            "--compressor",
            "lookahead",
        ],
        &["--remip"],
        &["--mip-tolerance", "0.05"],
    ] {
        convert(&dsm, &copy, options);
        keeps_promises(&copy, &exr, &SourceOptions::default());
    }
    let (_, err) = convert(&dsm, &copy, &["--region", "5,9,30,20", "--tile", "16"]);
    assert!(err.contains("recomputed"), "{err}");
    let [whole, part] = [&dsm, &copy].map(|p| DsmFile::open(p).unwrap());
    let header = &part.maps()[0].header;
    assert_eq!(
        (header.width, header.height, header.data_origin),
        (30, 20, [2, 16])
    );
    for (x, y) in [(0, 0), (29, 19), (7, 12), (16, 15)] {
        let [a, b] = [
            whole.function(MapId(0).level(0), Pixel::new(x + 5, y + 9)),
            part.function(MapId(0).level(0), Pixel::new(x, y)),
        ];
        assert_eq!(a.unwrap(), b.unwrap());
    }
    assert!(part.maps()[0].levels.len() > 1);
}

#[test]
fn numpy_archives_hold_the_functions() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, npz] = ["in.exr", "map.dsm", "map.npz"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[2]);
    convert(&exr, &dsm, &[]);
    convert(&dsm, &npz, &["--level", "1"]);
    let bytes = std::fs::read(&npz).unwrap();
    let file = DsmFile::open(&dsm).unwrap();
    let level = file.level(MapId(0).level(1)).unwrap();
    // Stored members in a fixed order: found by their headers.
    let member = |name: &str| {
        let at = bytes
            .windows(name.len())
            .position(|w| w == name.as_bytes())
            .unwrap();
        let size = u32::from_le_bytes(bytes[at - 8..at - 4].try_into().unwrap()) as usize;
        let npy = &bytes[at + name.len()..][..size];
        assert_eq!(&npy[..8], b"\x93NUMPY\x01\0");
        let header = 10 + usize::from(npy[8]) + 256 * usize::from(npy[9]);
        assert_eq!(header % 64, 0);
        (
            String::from_utf8(npy[10..header].to_vec()).unwrap(),
            npy[header..].to_vec(),
        )
    };
    let n = level.vertices;
    let pixels = 23 * 19;
    for (name, descr, shape, size) in [
        (
            "offsets.npy",
            "<u8",
            format!("({},)", pixels + 1),
            8 * (pixels + 1),
        ),
        ("z.npy", "<f4", format!("({n},)"), 4 * n),
        ("visibility.npy", "<f4", format!("({n}, 3)"), 12 * n),
        ("mono.npy", "|b1", format!("({pixels},)"), pixels),
        ("max_error.npy", "<f8", "()".into(), 8),
        ("shape.npy", "<i8", "(2,)".into(), 16),
        ("level.npy", "<i8", "()".into(), 8),
        ("name.npy", "<U3", "()".into(), 12),
        ("depth_kind.npy", "<U6", "()".into(), 24),
        ("depth_unit.npy", "<f8", "()".into(), 8),
        ("data_origin.npy", "<i8", "(2,)".into(), 16),
        ("display_window.npy", "<i8", "(4,)".into(), 32),
        ("world_to_camera.npy", "<f8", "(4, 4)".into(), 128),
    ] {
        let (header, data) = member(name);
        assert!(header.contains(&format!("'descr': '{descr}'")), "{header}");
        assert!(header.contains(&format!("'shape': {shape},")), "{header}");
        assert_eq!(data.len() as u64, size);
    }
    assert_eq!(member("max_error.npy").1, level.max_error.to_le_bytes());
    let text = |name: &str| {
        let units = member(name).1;
        let unit = |b: &[u8]| u32::from_le_bytes(b.try_into().unwrap());
        let all = units.chunks(4).map(|b| char::from_u32(unit(b)).unwrap());
        all.collect::<String>()
    };
    assert_eq!(
        (text("name.npy"), text("depth_kind.npy")),
        ("key".into(), "planar".into())
    );
    let integers = |name: &str| {
        let integer = |b: &[u8]| i64::from_le_bytes(b.try_into().unwrap());
        member(name).1.chunks(8).map(integer).collect::<Vec<_>>()
    };
    assert_eq!(integers("shape.npy"), [19, 23]);
    assert_eq!(integers("level.npy"), [1]);
    assert_eq!(integers("data_origin.npy"), [-2, 3]);
    assert_eq!(integers("display_window.npy"), [0, 0, 31, 23]);
    assert_eq!(member("world_to_camera.npy").1[..8], 0.25f64.to_le_bytes());
    assert!(!bytes.windows(12).any(|w| w == b"world_to_ndc"));
    let offsets = member("offsets.npy").1;
    let offset =
        |p: usize| u64::from_le_bytes(offsets[8 * p..8 * p + 8].try_into().unwrap()) as usize;
    let z = member("z.npy").1;
    for (x, y) in [(22, 0), (10, 3), (7, 18)] {
        let p = (y * 23 + x) as usize;
        let f = file.function(MapId(0).level(1), Pixel::new(x, y)).unwrap();
        let depths: Vec<u8> = f.depths().iter().flat_map(|z| z.to_le_bytes()).collect();
        assert_eq!(z[4 * offset(p)..4 * offset(p + 1)], depths);
    }
}

#[test]
fn flat_images_hold_one_number_a_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, png, flat] =
        ["in.exr", "map.dsm", "out.PNG", "flat.exr"].map(|n| folder.path().join(n));
    for look in [LOOKS[0], LOOKS[3]] {
        image(&exr, look);
        convert(&exr, &dsm, &[]);
        let file = DsmFile::open(&dsm).unwrap();
        for options in [&["--depth", "4.5"][..], &["--opacity"], &["--count"]] {
            convert(&dsm, &flat, options);
            let reader = deepshadow_exr::DeepReader::open(&flat).unwrap();
            let part = &reader.parts()[0];
            assert!(!part.deep && part.data_window == WINDOW);
            assert!(part.attribute("worldToCamera").is_some());
            let colours = look.coloured && options[0] != "--count";
            assert_eq!(part.channels.len(), if colours { 3 } else { 1 });
            let block = reader.read_rect(0, WINDOW).unwrap();
            let red = &block.channels[if colours { 2 } else { 0 }];
            for (x, y) in [(10, 3), (44, 36), (3, 3)] {
                let f = file.function(MapId(0).level(0), Pixel::new(x, y)).unwrap();
                let expected = match options[0] {
                    "--depth" => f.visibility(4.5),
                    "--opacity" => 1.0 - f.end(),
                    _ => f.len() as f32,
                };
                assert_eq!(red.get((y * 45 + x) as usize), expected);
            }
            let (out, _) = convert(&dsm, &png, options);
            assert_eq!(out.contains("white is"), options[0] == "--count");
            let decoder =
                png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&png).unwrap()));
            let mut reader = decoder.read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut pixels).unwrap();
            assert_eq!(
                (info.width, info.height, info.bit_depth),
                (45, 37, png::BitDepth::Sixteen)
            );
            if options[0] == "--opacity" {
                let f = file.function(MapId(0).level(0), Pixel::new(10, 3)).unwrap();
                let at = (3 * 45 + 10) * if colours { 6 } else { 2 };
                let found = u16::from(pixels[at]) << 8 | u16::from(pixels[at + 1]);
                assert_eq!(found, ((1.0 - f64::from(f.end())) * 65535.0).round() as u16);
            }
        }
    }
}

#[test]
fn statistics_say_what_became_of_vertices_and_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, back] = ["in.exr", "map.dsm", "back.exr"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[0]);
    let (out, _) = convert(&exr, &dsm, &["--runstats", "-v"]);
    for word in [
        "time",
        "samples in",
        "vertices in",
        "forced steps",
        "level 0",
        "level 6",
        "bytes",
    ] {
        assert!(out.contains(word), "{out}");
    }
    assert!(
        convert(&dsm, &back, &["--runstats"])
            .0
            .contains("samples out")
    );
}

#[test]
fn another_image_is_found_out_at_every_level() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "map.dsm"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[1]);
    convert(&exr, &dsm, &["--discrete"]);
    let file = DsmFile::open(&dsm).unwrap();
    let source = DeepSource::open(&exr, &SourceOptions::default()).unwrap();
    let mut seen = (0, 0);
    let levels = against(&file, MapId(0), &source, |done, total| seen = (done, total)).unwrap();
    assert_eq!(seen.0, seen.1);
    assert_eq!(levels.len(), file.maps()[0].levels.len());
    for level in levels {
        assert!(!level.is_kept() && level.worst.error <= 1.0, "{level:?}");
        let Pixel { x, y } = level.pixel;
        let f = file
            .function(MapId(0).level(level.level), level.pixel)
            .unwrap();
        // The error is where it is said to be; behind a depth, up to what falls before the next
        // f32.
        let (w, h) = (1 << level.level, 1 << level.level);
        let (left, top) = (x << level.level, y << level.level);
        let rays = source
            .rays(left, top, w.min(45 - left), h.min(37 - top))
            .unwrap();
        let exact = |z| match level.worst.behind {
            false => rays.iter().map(|r| r.visibility(z)).sum::<f64>(),
            true => rays.iter().map(|r| r.visibility_behind(z)).sum(),
        };
        let stored = match level.worst.behind {
            false => f.visibility(level.worst.depth),
            true => f.visibility_behind(level.worst.depth),
        };
        let error = (exact(level.worst.depth) / rays.len() as f64 - f64::from(stored)).abs();
        assert!(
            (error - level.worst.error).abs() <= level.slack + 1e-4,
            "{level:?}: {error}"
        );
    }
}

#[test]
fn every_level_of_real_images_keeps_its_promise() {
    let folder = tempfile::tempdir().unwrap();
    let dsm = folder.path().join("map.dsm");
    for exr in data("deep-exr") {
        // A colour image without depths is none of ours.
        if exr.ends_with("cortex_coneAndSphere_FLAT.exr") {
            refuse(1, &exr, &dsm, &[]);
            continue;
        }
        convert(&exr, &dsm, &[]);
        DsmFile::open(&dsm).unwrap().verify(|_, _| true).unwrap();
        keeps_promises(&dsm, &exr, &SourceOptions::default());
        let file = DsmFile::open(&dsm).unwrap();
        let back = folder.path().join("back.exr");
        convert(&dsm, &back, &[]);
        comes_back(&back, &file, 0, 0, 0.002);
    }
}
