//! `dsm-join`: what it makes, what it says, and what it refuses.

use std::path::{Path, PathBuf};

use crate::convert_support::*;
use assert_cmd::Command;
use deepshadow::{
    Attribute, Codec, Curve, DsmFile, Encoding, Group, GroupRole, MapHeader, MapId, Pixel, TileId,
    Visibility, Writer,
};
use deepshadow_cli::source::SourceOptions;

const COLOURED: Look = Look {
    coloured: true,
    thick: true,
    tiled: false,
};

/// Runs the program on files, which must succeed; gives standard output and standard error.
fn join(files: &[&PathBuf], options: &[&str]) -> (String, String) {
    let (code, out, err) = try_join(files, options);
    assert_eq!(code, 0, "{options:?}: {err}");
    let output = files.last().unwrap();
    let info = Command::cargo_bin("dsm-info")
        .unwrap()
        .args([output.to_str().unwrap(), "--verify"])
        .output()
        .unwrap();
    assert!(info.status.success(), "{info:?}");
    (out, err)
}

fn try_join(files: &[&PathBuf], options: &[&str]) -> (i32, String, String) {
    let mut arguments = options.to_vec();
    arguments.extend(files.iter().map(|p| p.to_str().unwrap()));
    run_program("dsm-join", &arguments)
}

/// Runs the program on files, which must fail with this code and one line, and leave the output as
/// it was; gives the line.
fn refuse_join(code: i32, files: &[&PathBuf], options: &[&str]) -> String {
    let output = files.last().unwrap();
    let before = std::fs::read(output).ok();
    let (found, _, err) = try_join(files, options);
    assert_eq!(found, code, "{options:?}: {err}");
    assert_eq!(std::fs::read(output).ok(), before);
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.starts_with("dsm-join: "), "{err}");
    let folder = output.parent().unwrap();
    let hidden = |e: &std::fs::DirEntry| e.file_name().to_string_lossy().starts_with('.');
    let mut entries = folder.read_dir().unwrap().map(Result::unwrap);
    assert!(!entries.any(|e| hidden(&e)), "something half written");
    err
}

/// The base tile as it is stored, but for where.
fn payload(file: &DsmFile, tx: u32, ty: u32) -> (deepshadow::raw::directory::Entry, Vec<u8>) {
    let (mut entry, bytes) = file
        .payload(MapId(0).level(0), TileId::new(tx, ty))
        .unwrap();
    entry.offset = 0;
    (entry, bytes.into_owned())
}

/// Cuts the 45 x 37 pixels of `whole` into four parts along its tiles of 8.
fn cut(whole: &Path, folder: &Path, options: &[&str]) -> Vec<PathBuf> {
    let regions = ["24,0,21,16", "0,0,24,16", "0,16,40,21", "40,16,5,21"];
    let cut = |(i, region): (usize, &&str)| {
        let part = folder.join(format!("part{i}.dsm"));
        let mut options = options.to_vec();
        options.extend(["--region", region]);
        convert(whole, &part, &options);
        part
    };
    regions.iter().enumerate().map(cut).collect()
}

#[test]
fn what_was_cut_is_stitched_together_with_every_byte() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, whole, joined] = ["in.exr", "whole.dsm", "joined.dsm"].map(|n| folder.path().join(n));
    for (look, codec) in [
        (Look::default(), "none"),
        (COLOURED, "lz4"),
        (COLOURED, "zstd:3"),
    ] {
        image(&exr, look);
        convert(&exr, &whole, &["--tile", "8", "-z", codec]);
        let parts = cut(&whole, folder.path(), &["-z", codec]);
        let mut files: Vec<&PathBuf> = parts.iter().collect();
        files.push(&joined);
        let (out, err) = join(&files, &["stitch", "-z", codec, "--runstats"]);
        assert!(err.is_empty(), "{err}");
        assert!(out.contains("level 6"), "{out}");
        let [one, two] = [&whole, &joined].map(|p| DsmFile::open(p).unwrap());
        assert_eq!(one.maps()[0].header, two.maps()[0].header);
        for ty in 0..5 {
            for tx in 0..6 {
                assert_eq!(payload(&two, tx, ty), payload(&one, tx, ty), "{tx},{ty}");
            }
        }
        keeps_promises(&joined, &exr, &SourceOptions::default());
        // Other codecs, levels and tolerances touch no base tile.
        for options in [
            &["stitch", "-m"][..],
            &[
                "stitch",
                "--mip-tolerance",
                "0.05",
                "--compressor",
                "croquet",
                "-j",
                "1",
            ],
        ] {
            join(&files, options);
            let two = DsmFile::open(&joined).unwrap();
            assert_eq!(two.maps()[0].levels.len() == 1, options.contains(&"-m"));
            assert_eq!(payload(&two, 4, 3), payload(&one, 4, 3));
            keeps_promises(&joined, &exr, &SourceOptions::default());
        }
        // A part may be the output: it appears when all is done.
        files.pop();
        files.push(&parts[0]);
        join(&files, &["stitch", "-z", codec]);
        assert_eq!(
            DsmFile::open(&parts[0]).unwrap().maps()[0].header,
            one.maps()[0].header
        );
    }
}

#[test]
fn holes_are_lit_and_said() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, whole, joined] = ["in.exr", "whole.dsm", "joined.dsm"].map(|n| folder.path().join(n));
    image(&exr, COLOURED);
    convert(&exr, &whole, &["--tile", "8"]);
    let parts = cut(&whole, folder.path(), &[]);
    let (_, err) = join(&[&parts[0], &parts[2], &parts[3], &joined], &["stitch"]);
    assert_eq!(
        err,
        format!(
            "dsm-join: {}: 384 of the 45 x 37 pixels of map \"key\" are in no part and are lit\n",
            joined.display()
        )
    );
    let file = DsmFile::open(&joined).unwrap();
    assert!(
        file.function(MapId(0).level(0), Pixel::new(10, 10))
            .unwrap()
            .is_empty()
    );
    // One part is a whole, too.
    join(&[&whole, &joined], &["stitch"]);
}

#[test]
fn stitching_refuses_in_one_line_that_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, whole, out, other] = ["in.exr", "whole.dsm", "out.dsm", "other.dsm"].map(path);
    image(&exr, COLOURED);
    convert(&exr, &whole, &["--tile", "8"]);
    let parts = cut(&whole, folder.path(), &[]);
    let mut camera = vec!["--Mcamera"];
    camera.extend([
        "1", "0", "0", "0", "0", "1", "0", "0", "0", "0", "1", "0", "0", "0", "0", "1",
    ]);
    for (options, words) in [
        (
            &["--region", "0,0,24,16", "--tile", "16"][..],
            "another tile size",
        ),
        (
            &["--region", "0,0,24,16", "--name", "fill"],
            "it has no map \"key\", as ",
        ),
        (
            &["--region", "0,0,24,16", "--depth-kind", "ray"],
            "another kind of depth",
        ),
        (
            &["--region", "0,0,25,16"],
            "25 pixels wide: no whole tiles of 8",
        ),
        (&["--region", "3,0,24,16"], "no whole tiles of 8 from 21,7"),
        (&["--region", "0,0,32,16"], "overlaps that of "),
        (&camera, "another camera"),
    ] {
        convert(&whole, &other, options);
        let line = refuse_join(1, &[&parts[0], &other, &out], &["stitch"]);
        assert!(line.contains(words), "{line}");
        assert!(
            line.starts_with(&format!("dsm-join: {}: ", other.display())),
            "{line}"
        );
    }
    // Damage is found before anything is seen of the output.
    let mut bytes = std::fs::read(&parts[1]).unwrap();
    bytes[80] ^= 4;
    std::fs::write(&other, bytes).unwrap();
    let line = refuse_join(1, &[&parts[0], &other, &out], &["stitch"]);
    assert!(
        line.contains(&format!("{}: file breaks rule TILE-CRC", other.display())),
        "{line}"
    );
    assert!(refuse_join(1, &[&exr, &out], &["stitch"]).contains("not a .dsm file"));
    assert!(refuse_join(1, &[&whole, &path("none.dsm"), &out], &["stitch"]).contains("none.dsm: "));
    let nowhere = folder.path().join("none").join("out.dsm");
    let (code, _, err) = try_join(&[&whole, &nowhere], &["stitch"]);
    assert_eq!((code, err.lines().count()), (1, 1), "{err}");
}

/// The function of every pixel.
fn functions(path: &Path) -> Vec<Visibility> {
    let file = DsmFile::open(path).unwrap();
    let pixels = (0..37).flat_map(|y| (0..45).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| file.function(MapId(0).level(0), Pixel::new(x, y)).unwrap())
        .collect()
}

#[test]
fn merged_maps_are_products_within_what_was_asked() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, hair, smoke, both] = ["in.exr", "hair.dsm", "smoke.dsm", "both.dsm"].map(path);
    image(&exr, Look::default());
    convert(&exr, &hair, &["--tile", "8", "--tolerance", "0.01"]);
    image(&exr, COLOURED);
    convert(
        &exr,
        &smoke,
        &[
            "--tile",
            "16",
            "--tolerance",
            "0.004",
            "--name",
            "smoke",
            "-s",
            "1.5",
        ],
    );
    let given = 0.014;
    for (options, tolerance) in [
        (&["merge"][..], given + 0.01),
        (
            &["merge", "--tolerance", "0.016", "--tile", "32", "-z", "lz4"],
            0.016,
        ),
        (
            &[
                "merge",
                "--tolerance",
                "0.1",
                "--lattice",
                "0",
                "-m",
                "--name",
                "all",
            ],
            0.1,
        ),
        (
            &[
                "merge",
                "--mip-tolerance",
                "0.2",
                "--compressor",
                "croquet",
                "--map",
                "0",
            ],
            given + 0.01,
        ),
    ] {
        let (_, err) = join(&[&hair, &smoke, &both], options);
        let file = DsmFile::open(&both).unwrap();
        let info = &file.maps()[0];
        assert_eq!(
            info.header.name,
            if options.contains(&"all") {
                "all"
            } else {
                "key"
            }
        );
        assert_eq!(info.header.channels, 3);
        assert!((info.levels[0].max_error - tolerance).abs() < 1e-9);
        assert_eq!(info.levels.len() == 1, options.contains(&"-m"));
        assert!(
            err.lines().all(|l| l.contains("the result is within")),
            "{err}"
        );
        let [a, b, ab] = [&hair, &smoke, &both].map(|p| functions(p));
        for ((a, b), f) in a.iter().zip(&b).zip(&ab) {
            let depths = [a.depths(), b.depths(), f.depths()].concat();
            let beside = depths.iter().flat_map(|&z| [z, z.next_up(), z.next_down()]);
            for z in beside {
                let sides = [
                    [f, a, b].map(|f| f.visibility_rgb(z)),
                    [f, a, b].map(|f| f.visibility_behind_rgb(z)),
                ];
                for [f, a, b] in sides {
                    for c in 0..3 {
                        let exact = f64::from(a[c]) * f64::from(b[c]);
                        let error = (f64::from(f[c]) - exact).abs();
                        assert!(error <= tolerance - given + 1e-6, "{error} at {z}");
                    }
                }
            }
        }
    }
    // An input may be the output, three are one as well.
    join(&[&hair, &smoke, &hair, &hair], &["merge", "--runstats"]);
}

#[test]
fn merging_refuses_in_one_line_that_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, one, other, out] = ["in.exr", "one.dsm", "other.dsm", "out.dsm"].map(path);
    image(&exr, COLOURED);
    convert(&exr, &one, &[]);
    for (options, words) in [
        (&["--region", "0,0,45,36"][..], "another size"),
        (&["--depth-kind", "ray"], "another kind of depth"),
        (&["--depth-unit", "2"], "another unit of depth"),
    ] {
        convert(&one, &other, options);
        let line = refuse_join(1, &[&one, &other, &out], &["merge"]);
        assert!(line.contains(words), "{line}");
        assert!(
            line.starts_with(&format!("dsm-join: {}: ", other.display())),
            "{line}"
        );
    }
    for options in [&["--tolerance", "0.02"][..], &["--mip-tolerance", "0.015"]] {
        let mut all = vec!["merge"];
        all.extend(options);
        let line = refuse_join(1, &[&one, &one, &out], &all);
        assert!(line.contains("add up to 0.02"), "{line}");
    }
    let line = refuse_join(1, &[&one, &one, &out], &["merge", "--map", "none"]);
    assert!(line.contains("one.dsm: no map \"none\""), "{line}");
}

#[test]
fn options_that_do_not_go_together_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, dsm, out, png] = ["in.exr", "map.dsm", "out.dsm", "out.png"].map(path);
    image(&exr, Look::default());
    convert(&exr, &dsm, &[]);
    for (files, options, words) in [
        (vec![&dsm, &out], &["merge"][..], "two inputs"),
        (vec![&dsm, &dsm, &png], &["merge"], "must be a .dsm file"),
        (vec![&dsm, &png], &["stitch"], "must be a .dsm file"),
        (vec![&dsm, &png], &["collect"], "must be a .dsm file"),
        (vec![&out], &["collect"], "missing arguments"),
        (
            vec![&dsm, &out],
            &["stitch", "--tolerance", "0.1"],
            "'--tolerance'",
        ),
        (vec![&dsm, &out], &["stitch", "--map", "0"], "'--map'"),
        (vec![&dsm, &out], &["stitch", "--tile", "8"], "'--tile'"),
        (
            vec![&dsm, &out],
            &["stitch", "--mip-tolerance", "2"],
            "--mip-tolerance",
        ),
        (vec![&dsm, &out], &["stitch", "-z", "zip"], "--compression"),
        (vec![&dsm, &out], &["collect", "-z", "lz4"], "'-z'"),
        (
            vec![&dsm, &dsm, &out],
            &["merge", "--region", "0,0,8,8"],
            "'--region'",
        ),
        (vec![&dsm, &dsm, &out], &["merge", "--strict"], "--strict"),
        (
            vec![&dsm, &dsm, &out],
            &["merge", "--lattice", "9"],
            "--lattice 9",
        ),
        (
            vec![&dsm, &dsm, &out],
            &["merge", "--tile", "7"],
            "--tile 7",
        ),
        (
            vec![&dsm, &out],
            &["collect", "--group", "g=all:key"],
            "NAME=faces:MAP,MAP",
        ),
        (
            vec![&dsm, &out],
            &["collect", "--group", "g=faces:sun"],
            "no map \"sun\" is collected; the maps are key",
        ),
        (
            vec![&dsm, &out],
            &["collect", "--group", "g=faces:0", "--group", "g=faces:0"],
            "--group g is given twice",
        ),
    ] {
        let line = refuse_join(2, &files, options);
        assert!(line.contains(words), "{line}");
    }
    // dsm-convert takes one file.
    let files = [&dsm, &dsm, &out].map(|p| p.to_str().unwrap());
    assert_eq!(run(&files).0, 2);
    assert!(!out.exists());
    for (arguments, words) in [
        (&["--help"][..], &["stitch", "merge", "collect"][..]),
        (&["stitch", "--help"], &["must be whole tiles"]),
        (
            &["merge", "--help"],
            &[
                "objects inside a pixel as independent",
                "<INPUT>... <OUTPUT>",
            ],
        ),
        (
            &["collect", "--help"],
            &["FILE:MAP=NAME", "faces|clusters:MAP,MAP"],
        ),
    ] {
        let (code, help, _) = run_program("dsm-join", arguments);
        assert_eq!(code, 0);
        let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
        for words in words {
            assert!(help.contains(words), "{help}");
        }
    }
}

/// A map as it lies in a file: header, errors, and every tile of every level byte for byte.
type Everything = (deepshadow::MapHeader, Vec<f64>, Vec<Vec<u8>>);

fn everything(path: &Path, map: u32) -> Everything {
    let file = DsmFile::open(path).unwrap();
    let map = MapId(map);
    let info = file.map(map).unwrap();
    let mut tiles = Vec::new();
    for (l, level) in (0..).zip(&info.levels) {
        for ty in 0..level.shape.tiles_y() {
            for tx in 0..level.shape.tiles_x() {
                let (mut entry, bytes) = file.payload(map.level(l), TileId::new(tx, ty)).unwrap();
                entry.offset = 0;
                tiles.push([format!("{entry:?}").as_bytes(), &bytes].concat());
            }
        }
    }
    let errors = info.levels.iter().map(|l| l.max_error).collect();
    (info.header.clone(), errors, tiles)
}

/// Writes a file of small maps with these names, a group of the first two, and attributes.
fn maps(path: &Path, names: &[&str], group: &str) {
    let mut writer = Writer::create(path).unwrap();
    for (i, name) in names.iter().enumerate() {
        let encoding = Encoding::new(0.01 * (i + 1) as f64).codec(Codec::ALL[i % 3]);
        let mut header = MapHeader::new(*name, 40 + i as u32, 20);
        header.tile_size = 8 << (i % 2);
        let of = format!("{name} itself");
        header.attributes.push(("of".into(), of.into()));
        let map = writer.add_map(header, encoding).unwrap();
        for x in 0..40 {
            let wall = Curve::mono(vec![2.0, 3.0 + x as f32], vec![0.75, 0.125]).unwrap();
            writer.pixel(map, Pixel::new(x, 4 + x % 9), &wall).unwrap();
        }
    }
    writer.add_group(Group::new(
        group,
        GroupRole::Faces,
        vec![MapId(1), MapId(0)],
    ));
    writer.add_attribute("who", group);
    writer.add_attribute(group, "here");
    writer.finish().unwrap();
}

#[test]
fn collected_maps_are_copied_with_every_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [a, b, out] = ["a.dsm", "b.dsm", "out.dsm"].map(path);
    maps(&a, &["left", "right", "top"], "ends");
    maps(&b, &["left", "low"], "sides");
    let part = |file: &Path, rest: &str| PathBuf::from(format!("{}{rest}", file.display()));
    let (renamed, low) = (part(&b, ":left=far left"), part(&b, ":1"));
    let (_, err) = join(&[&a, &renamed, &low, &out], &["collect", "-v"]);
    assert!(err.contains("attribute \"who\" differs"), "{err}");
    let file = DsmFile::open(&out).unwrap();
    let names: Vec<_> = file.maps().iter().map(|m| &*m.header.name).collect();
    assert_eq!(names, ["left", "right", "top", "far left", "low"]);
    for (to, (from, map)) in [(&a, 0), (&a, 1), (&a, 2), (&b, 0), (&b, 1)]
        .into_iter()
        .enumerate()
    {
        let (mut expected, found) = (everything(from, map), everything(&out, to as u32));
        expected.0.name = names[to].into();
        assert!(found == expected, "map {to}");
    }
    let group = |name: &str, role, maps: &[u32]| {
        Group::new(name, role, maps.iter().copied().map(MapId).collect())
    };
    let ends = group("ends", GroupRole::Faces, &[1, 0]);
    let sides = group("sides", GroupRole::Faces, &[4, 3]);
    assert_eq!(file.groups(), [ends, sides.clone()]);
    assert_eq!(
        file.attributes(),
        [
            ("who".to_owned(), Attribute::from("ends")),
            ("ends".to_owned(), Attribute::from("here")),
            ("sides".to_owned(), Attribute::from("here"))
        ]
    );
    // New groups, one of them in place of an old one; a group that lacks a map goes.
    let right = part(&a, ":right");
    let (_, err) = join(
        &[&right, &b, &out],
        &[
            "collect",
            "--group",
            "sides=clusters:low,right,left",
            "--group",
            "one=faces:0",
            "-v",
        ],
    );
    assert!(err.contains("group \"ends\" is dropped"), "{err}");
    let file = DsmFile::open(&out).unwrap();
    assert_eq!(
        file.groups(),
        [
            group("sides", GroupRole::Clusters, &[2, 0, 1]),
            group("one", GroupRole::Faces, &[0])
        ]
    );
    // Quiet says nothing; an input may be the output, and a file with one map needs no map's name.
    let only = part(&a, ":top");
    join(&[&only, &out], &["collect"]);
    let named = part(&out, "=roof");
    let (said, err) = join(&[&named, &a, &out], &["collect", "-q"]);
    assert_eq!((&*said, &*err), ("", ""));
}

#[test]
fn collecting_refuses_in_one_line_that_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, a, b, out, other] = ["in.exr", "a.dsm", "b.dsm", "out.dsm", "other.dsm"].map(path);
    maps(&a, &["left", "right"], "ends");
    maps(&b, &["left", "low"], "ends");
    let part = |file: &Path, rest: &str| PathBuf::from(format!("{}{rest}", file.display()));
    let line = refuse_join(1, &[&a, &b, &out], &["collect"]);
    let advice = format!("as in {}:left=NAME", b.display());
    assert!(
        line.contains("two maps are called \"left\"") && line.contains(&advice),
        "{line}"
    );
    let twice = part(&a, ":0");
    assert!(refuse_join(1, &[&a, &twice, &out], &["collect"]).contains("two maps"));
    let (left, low) = (part(&b, ":left=l"), part(&b, ":low"));
    let line = refuse_join(1, &[&a, &left, &low, &out], &["collect"]);
    assert!(
        line.contains("two groups are called \"ends\"") && line.contains("--group ends=faces:"),
        "{line}"
    );
    for (rest, words) in [
        (":none", "no map \"none\"; the file has \"left\", \"right\""),
        (":2", "no map \"2\""),
        ("=new", "has 2 maps: choose the one to name \"new\""),
        (":left=", "name"),
    ] {
        let line = refuse_join(1, &[&part(&a, rest), &out], &["collect"]);
        assert!(line.contains(words), "{line}");
    }
    image(&exr, Look::default());
    assert!(refuse_join(1, &[&exr, &out], &["collect"]).contains("not a .dsm file"));
    let missing = path("none.dsm");
    assert!(refuse_join(1, &[&missing, &out], &["collect"]).contains("none.dsm: "));
    // A damaged tile is found before anything is seen of the output.
    let mut bytes = std::fs::read(&a).unwrap();
    bytes[80] ^= 4;
    std::fs::write(&other, bytes).unwrap();
    let line = refuse_join(1, &[&other, &out], &["collect"]);
    let expected = format!("{}: file breaks rule TILE-CRC", other.display());
    assert!(line.contains(&expected), "{line}");
}

/// A map "key" of one tile of 8 x 8 pixels, part of a display window of 264 x 264.
fn tile_part(path: &Path, x: i32, y: i32) {
    let mut header = MapHeader::new("key", 8, 8).data_origin([x, y]);
    (header.tile_size, header.channels) = (8, 1);
    header.display_window = [0, 0, 263, 263];
    let mut writer = Writer::in_memory();
    let map = writer.add_map(header, Encoding::default()).unwrap();
    let wall = Curve::mono(vec![1.0 + x as f32], vec![0.5]).unwrap();
    writer.pixel(map, Pixel::new(3, 4), &wall).unwrap();
    std::fs::write(path, writer.into_bytes().unwrap()).unwrap();
}

#[cfg(unix)]
#[test]
fn a_thousand_parts_are_stitched_with_few_open_files() {
    let folder = tempfile::tempdir().unwrap();
    for (x, y) in (0..33).flat_map(|y| (0..33).map(move |x| (x, y))) {
        tile_part(&folder.path().join(format!("{x}-{y}.dsm")), 8 * x, 8 * y);
    }
    let whole = folder.path().join("whole.dsm.new");
    let program = assert_cmd::cargo::cargo_bin("dsm-join");
    let script = format!(
        "ulimit -n 1024; exec {} stitch {}/*.dsm - > {}",
        program.display(),
        folder.path().display(),
        whole.display()
    );
    let output = std::process::Command::new("sh")
        .args(["-c", &script])
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
    let file = DsmFile::open(&whole).unwrap();
    assert_eq!(file.maps()[0].header.width, 264);
    for (x, y) in [(0, 0), (32, 5), (32, 32)] {
        let base = MapId(0).level(0);
        let f = file
            .function(base, Pixel::new(8 * x + 3, 8 * y + 4))
            .unwrap();
        assert_eq!(f.depths(), [1.0 + 8.0 * x as f32]);
    }
    assert!(file.verify(|_, _| true).is_ok());
}

#[test]
fn a_missing_outer_part_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let part = |x: i32, y: i32| {
        let path = folder.path().join(format!("{x}-{y}.dsm"));
        tile_part(&path, x, y);
        path
    };
    let whole = folder.path().join("whole.dsm");
    let (_, err) = join(&[&part(0, 0), &part(8, 0), &whole], &["stitch"]);
    assert_eq!(err.lines().count(), 1);
    let says = "map \"key\" covers 16 x 8 pixels from 0,0 on of a display window of 264 x 264";
    assert!(err.contains(says), "{err}");
    // An image whose data window lies inside its display window is whole.
    let (_, err) = join(&[&part(16, 16), &part(24, 16), &whole], &["stitch"]);
    assert_eq!(err, "");
}

#[test]
fn merging_notes_the_larger_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, dsm, both] = ["in.exr", "map.dsm", "both.dsm"].map(path);
    image(&exr, Look::default());
    convert(&exr, &dsm, &[]);
    let (_, err) = join(&[&dsm, &dsm, &both], &["merge"]);
    let max_error = DsmFile::open(&both).unwrap().maps()[0].levels[0].max_error;
    assert!((max_error - 0.03).abs() < 1e-6, "{max_error}");
    let says = "map \"key\": the result is within 0.03 of the exact functions; the errors of the \
                inputs add up to 0.02\n";
    assert!(err.ends_with(says), "{err}");
    assert_eq!(join(&[&dsm, &dsm, &both], &["merge", "-q"]).1, "");
}
