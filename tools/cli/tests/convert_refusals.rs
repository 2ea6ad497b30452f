//! `dsm-convert`: what it refuses, how it says so, and that nothing is left behind.

use std::time::{Duration, Instant};

use crate::convert_support::*;
use deepshadow::{Curve, DsmFile, Encoding, Group, GroupRole, MapHeader, MapId, Pixel, Writer};

#[test]
fn options_that_make_no_sense_are_usage_errors() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, out, png, npz, tga] = [
        "in.exr", "map.dsm", "out.dsm", "out.png", "out.npz", "out.tga",
    ]
    .map(|n| folder.path().join(n));
    image(&exr, Look::default());
    convert(&exr, &dsm, &[]);
    assert!(refuse(2, &exr, &tga, &[]).contains("extension"));
    assert!(refuse(2, &dsm, &png, &[]).contains("--depth"));
    assert!(refuse(2, &exr, &out, &["--region", "0,0,1,1"]).contains("--region does not apply"));
    assert!(refuse(2, &dsm, &npz, &["--tile", "8"]).contains("--tile does not apply to .npz"));
    assert!(refuse(2, &dsm, &exr, &["--count", "--float"]).contains("--float"));
    for options in [
        &["--tile", "48"][..],
        &["--tolerance", "-1"],
        &["--tolerance", "nan"],
        &["--mip-tolerance", "2"],
        &["--lattice", "3"],
        &["--compression", "zip"],
        &["--compression", "zstd:40"],
        &["--zscale", "0"],
        &["--opacitylimit", "1.5"],
        &["--depth-unit", "-1"],
        &[
            "--Mcamera",
            "nan",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
            "0",
        ],
    ] {
        let line = run_usage(&exr, &out, options);
        assert!(line.contains(options[0]), "{line}");
    }
    assert!(refuse(2, &dsm, &out, &["--compressor", "croquet"]).contains("--tolerance"));
    assert!(refuse(2, &dsm, &out, &["--region", "0,0,4,4", "--levels", "2"]).contains("--levels"));
    // What clap finds itself.
    for options in [
        &["--region", "1,2,3"][..],
        &["--nonsense"],
        &["--discrete", "--continuous"],
    ] {
        let mut arguments = vec![dsm.to_str().unwrap(), out.to_str().unwrap()];
        arguments.extend(options);
        assert_eq!(run(&arguments).0, 2);
    }
    assert!(!out.exists() && !png.exists() && !npz.exists());
    assert_eq!(run(&["--help"]).0, 0);
}

/// clap says more than one line where it finds the error itself.
fn run_usage(exr: &std::path::Path, out: &std::path::Path, options: &[&str]) -> String {
    let mut arguments = vec![exr.to_str().unwrap(), out.to_str().unwrap()];
    arguments.extend(options);
    let (code, _, err) = run(&arguments);
    assert_eq!(code, 2, "{options:?}: {err}");
    assert!(!out.exists());
    err
}

#[test]
fn what_cannot_be_done_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, out, back] =
        ["in.exr", "map.dsm", "out.dsm", "back.exr"].map(|n| folder.path().join(n));
    image(&exr, Look::default());
    convert(&exr, &dsm, &[]);
    assert!(refuse(1, &dsm, &out, &["--tolerance", "0.01"]).contains("more exact than the map"));
    assert!(
        refuse(1, &dsm, &out, &["--region", "40,0,6,1"]).contains("--region 40,0,6,1: not inside")
    );
    assert!(refuse(1, &dsm, &back, &["--level", "9"]).contains("no level 9"));
    assert!(refuse(1, &dsm, &back, &["--map", "sun"]).contains("key"));
    assert!(refuse(1, &dsm, &back, &["--tolerance", "0.0000001"]).contains("--float"));
    assert!(refuse(1, &exr, &out, &["--part", "beauty"]).contains("no part"));
    assert!(refuse(1, &exr, &out, &["--layer", "smoke"]).contains("no Z"));
    let nowhere = folder.path().join("no/such/out.dsm");
    assert!(refuse(1, &exr, &nowhere, &[]).contains("no/such"));
    let missing = folder.path().join("missing.exr");
    assert!(refuse(1, &missing, &out, &[]).contains("missing.exr"));
    assert!(refuse(1, folder.path(), &out, &[]).contains("folder"));
    // What stands there stays when the work fails.
    std::fs::write(&out, b"precious").unwrap();
    refuse(1, &exr, &out, &["--part", "beauty"]);
    assert_eq!(std::fs::read(&out).unwrap(), b"precious");
    // A map that is damaged where a tile lies.
    let mut bytes = std::fs::read(&dsm).unwrap();
    bytes[200] ^= 1;
    std::fs::write(&dsm, bytes).unwrap();
    assert!(refuse(1, &dsm, &back, &[]).contains("TILE-CRC"));
    assert!(refuse(1, &dsm, &out, &["-z", "none"]).contains("TILE-CRC"));
    // No temporary file is left.
    let mut left: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(left, ["in.exr", "map.dsm", "out.dsm"]);
}

#[test]
fn files_of_other_kinds_are_called_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.dsm");
    for (magic, name) in [
        (&b"\x89PNG\r\n\x1a\n"[..], "PNG"),
        (b"II*\0", "TIFF"),
        (b"\xde\x32\x04\0", "PRMan"),
        (b"MSD3", "3Delight"),
        (b"fbtH", "Houdini"),
        (b"PK\x03\x04", "zip"),
        (b"", "empty"),
        (b"what", "text"),
        (b"\x07\x07", "unknown"),
    ] {
        for file in ["a.exr", "a.dsm", "a"] {
            let path = folder.path().join(file);
            std::fs::write(&path, magic).unwrap();
            let line = refuse(1, &path, &out, &[]);
            assert!(line.contains(name), "{line}");
        }
    }
    let exr = folder.path().join("image.dsm");
    image(&exr, Look::default());
    assert!(refuse(1, &exr, &out, &[]).contains("but an OpenEXR file"));
    for path in data("dsm-in-the-wild") {
        let line = refuse(1, &path, &out, &[]);
        assert!(!line.contains("unknown"), "{line}");
    }
}

#[test]
fn strict_reading_refuses_what_is_mended_otherwise() {
    use deepshadow_exr::{Channel, ChannelData, DeepBlock, DeepWriter, Part, Rect, SampleType};
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "out.dsm"].map(|n| folder.path().join(n));
    let window = Rect {
        x: 0,
        y: 0,
        width: 1,
        height: 1,
    };
    let names = ["A", "Z"];
    let channels = names
        .iter()
        .map(|n| Channel::new(*n, SampleType::Float))
        .collect();
    let file = std::fs::File::create(&exr).unwrap();
    let mut writer = DeepWriter::new(file, vec![Part::deep_scanline(window, channels)]).unwrap();
    let block = DeepBlock {
        rect: window,
        offsets: vec![0, 2],
        channels: vec![
            ChannelData::Float(vec![1.5, 0.5]),
            ChannelData::Float(vec![1.0, f32::NAN]),
        ],
    };
    writer.write(0, &block).unwrap();
    writer.finish().unwrap();
    assert!(refuse(1, &exr, &dsm, &["--strict"]).contains("opacity is 1.5"));
    let (_, err) = convert(&exr, &dsm, &[]);
    assert_eq!(err.lines().count(), 1);
    assert!(
        err.contains("1 sample dropped (not a number), 1 opacity clamped"),
        "{err}"
    );
}

#[test]
fn files_of_several_maps_keep_what_still_holds() {
    let folder = tempfile::tempdir().unwrap();
    let [dsm, out, back] = ["map.dsm", "out.dsm", "back.exr"].map(|n| folder.path().join(n));
    let mut writer = Writer::create(&dsm).unwrap();
    for name in ["left", "right", "top"] {
        let map = writer
            .add_map(MapHeader::new(name, 20, 10), Encoding::default())
            .unwrap();
        let wall = Curve::mono(vec![2.0], vec![0.0]).unwrap();
        writer.pixel(map, Pixel::new(3, 4), &wall).unwrap();
    }
    let group = |name: &str, maps: &[u32]| {
        let maps = maps.iter().copied().map(MapId).collect();
        Group::new(name, GroupRole::Clusters, maps)
    };
    writer.add_group(group("all", &[0, 1, 2]));
    writer.add_group(group("end", &[2]));
    writer.add_attribute("who", "me");
    writer.finish().unwrap();
    assert!(refuse(1, &dsm, &back, &[]).contains("\"left\", \"right\", \"top\""));
    convert(&dsm, &out, &["-z", "none"]);
    let file = DsmFile::open(&out).unwrap();
    assert_eq!(
        (
            file.maps().len(),
            file.groups().len(),
            file.attributes().len()
        ),
        (3, 2, 1)
    );
    convert(&dsm, &out, &["--map", "2", "--name", "roof"]);
    let file = DsmFile::open(&out).unwrap();
    assert_eq!(file.maps()[0].header.name, "roof");
    assert_eq!(file.groups(), [group("end", &[0])]);
    assert_eq!(
        file.function(MapId(0).level(0), Pixel::new(3, 4))
            .unwrap()
            .visibility_behind(2.0),
        0.0
    );
}

#[test]
fn broken_images_fail_with_one_line_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.dsm");
    for path in data("corrupt-exr") {
        let start = Instant::now();
        let line = refuse(1, &path, &out, &[]);
        assert!(
            line.contains(&*path.file_name().unwrap().to_string_lossy()),
            "{line}"
        );
        assert!(start.elapsed() < Duration::from_secs(10), "{line}");
    }
}
