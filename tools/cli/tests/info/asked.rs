//! What the program says of good files.

use deepshadow::raw::directory::TileKind;
use deepshadow::{DsmFile, MapId, Pixel, TileId};
use serde_json::json;

use crate::convert_support::{Look, convert, image};

use super::files::{info, json, output, rich, run, wall};

#[test]
fn the_summary_names_all_and_fits_a_terminal() {
    let f = rich();
    let text = output(&f.path, &[]);
    for part in [
        "version 1",
        "3 maps, 2 groups",
        "map 0 \"key\"",
        "40 x 20 pixels, 1 channel, tiles of 16 x 16",
        "planar (camera z), unit 0.01 m",
        "continuous",
        "worldToCamera",
        "origin -2,5 in a display window of 0,0 to 63,31",
        "Software        \"test \\u{1b}[2J\"",
        "frames          1 -2",
        "time            exr:rational (3 bytes)",
        "group \"all\": clusters (a lookup multiplies all), maps 0, 1, 2",
        "group \"cube\": faces (a lookup reads one), maps 2, 0",
        "numbers         0.5 inf",
        "camera          unknown",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let folder = f.path.parent().unwrap().to_str().unwrap();
    let text = text.replace(folder, "");
    assert!(text.lines().all(|l| l.chars().count() <= 100), "{text}");
    assert!(!text.contains("-7.5"), "matrices are for -a");
    let all = output(&f.path, &["-a"]);
    assert!(all.contains("exr:rational (3 bytes: 0102fe)"), "{all}");
    assert!(all.contains("0     0  -7.5     1"), "{all}");
}

#[test]
fn json_says_what_the_library_says() {
    let f = rich();
    let file = DsmFile::open(&f.path).unwrap();
    let j = json(&f.path, &[]);
    assert_eq!(j["version"], 1);
    assert_eq!(j["file_bytes"], file.length());
    let maps = j["maps"].as_array().unwrap();
    assert_eq!(maps.len(), file.maps().len());
    for (j, map) in maps.iter().zip(file.maps()) {
        let h = &map.header;
        assert_eq!(j["name"], h.name.as_str());
        assert_eq!(
            (&j["width"], &j["height"]),
            (&json!(h.width), &json!(h.height))
        );
        assert_eq!(j["channels"], h.channels);
        assert_eq!(j["tile_size"], h.tile_size);
        assert_eq!(j["worldToCamera"], json!(h.camera.camera_from_world));
        assert_eq!(j["worldToNDC"], json!(null));
        assert_eq!(j["data_origin"], json!(h.data_origin));
        assert_eq!(j["display_window"], json!(h.display_window));
        let levels = j["levels"].as_array().unwrap();
        assert_eq!(levels.len(), map.levels.len());
        for (j, level) in levels.iter().zip(&map.levels) {
            assert_eq!(j["width"], level.shape.width);
            assert_eq!(j["height"], level.shape.height);
            assert_eq!(j["max_error"].as_f64(), Some(level.max_error));
            assert_eq!(j["vertices"], level.vertices);
            assert_eq!(j["tiles"], level.shape.tiles());
            assert_eq!(j["bytes"], level.payload_bytes);
        }
    }
    assert_eq!(j["maps"][0]["depth_kind"], "planar");
    assert_eq!(j["maps"][0]["depth_unit"], 0.01);
    assert_eq!(j["maps"][1]["depth_unit"], json!(null));
    assert_eq!(j["maps"][0]["interpretation"], "continuous");
    assert_eq!(j["maps"][0]["attributes"]["frames"], json!([1, -2]));
    assert_eq!(j["maps"][0]["attributes"]["Software"], "test \u{1b}[2J");
    assert_eq!(
        j["maps"][0]["attributes"]["time"],
        json!({ "type": "exr:rational", "bytes": 3 })
    );
    assert_eq!(j["attributes"]["numbers"], json!([0.5, "inf"]));
    assert_eq!(
        j["groups"][1],
        json!({ "name": "cube", "role": "faces", "maps": [2, 0] })
    );
}

#[test]
fn several_files_are_an_array_and_a_bad_one_does_not_hide_the_others() {
    let (a, b) = (rich(), wall(0.5, |_, _| ()));
    let missing = a.beside("missing.dsm");
    let mut command = info();
    command.arg("--json").args([&a.path, &missing, &b.path]);
    let (code, stdout, stderr) = run(&mut command);
    assert_eq!(code, 1);
    let prefix = format!("dsm-info: {}: ", missing.display());
    assert!(stderr.starts_with(&prefix), "{stderr}");
    let j: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(j[0]["maps"].as_array().unwrap().len(), 3);
    assert!(j[1]["error"].as_str().unwrap().contains("No such file"));
    assert_eq!(j[2]["maps"][0]["name"], "m");
}

#[test]
fn statistics_add_up() {
    let f = rich();
    let j = json(&f.path, &["--stats"]);
    let bytes = &j["stats"]["bytes"];
    let number = |v: &serde_json::Value| v.as_u64().unwrap();
    let levels = bytes["tiles"].as_array().unwrap().iter();
    let tiles: u64 = levels.flat_map(|m| m.as_array().unwrap()).map(number).sum();
    let parts: u64 = ["header", "directory", "footer", "trailer"]
        .iter()
        .map(|k| number(&bytes[k]))
        .sum();
    assert_eq!(tiles + parts, number(&j["file_bytes"]));
    let key = &j["stats"]["maps"][0];
    let ones = json!({ "from": 1, "to": 1, "pixels": 40 });
    assert_eq!(key["histogram"][1], ones);
    assert_eq!(key["histogram"][2]["from"], 4);
    assert_eq!(
        (number(&key["pixels"]), number(&key["lit_pixels"])),
        (800, 759)
    );
    assert_eq!(
        (number(&key["steps"]), number(&key["dark_pixels"])),
        (41, 40)
    );
    assert_eq!(key["depths"], json!([1.0, 5.0]));
    assert_eq!(key["vertices"], j["maps"][0]["levels"][0]["vertices"]);
    assert_eq!(key["stored"][0]["codec"], "lz4");
    assert_eq!(j["stats"]["maps"][1]["mono_pixels"], 0);
    assert_eq!(j["stats"]["maps"][2]["depths"], json!(null));

    let text = output(&f.path, &["--stats", "--map", "key", "--level", "1"]);
    assert!(text.contains("map 0 \"key\", level 1"), "{text}");
    assert!(!text.contains("\"fill\", level 0\n"), "{text}");
    assert!(text.contains("transform delta"), "{text}");
    assert!(text.contains("trailer"), "{text}");
}

#[test]
fn tiles_are_those_of_the_directory() {
    let f = rich();
    let file = DsmFile::open(&f.path).unwrap();
    let j = json(&f.path, &["--tiles", "--map", "0", "--level", "0"]);
    let tiles = j["tiles"].as_array().unwrap();
    assert_eq!(tiles.len(), 6);
    for t in tiles {
        let at = |k: &str| t[k].as_u64().unwrap();
        let e = file
            .entry(
                MapId(0).level(0),
                TileId::new(at("tx") as u32, at("ty") as u32),
            )
            .unwrap();
        assert_eq!(at("vertices"), u64::from(e.vertices));
        if e.kind == TileKind::Data {
            assert_eq!(at("offset"), e.offset);
            assert_eq!(t["crc"], format!("{:08x}", e.crc));
        }
    }
    let text = output(&f.path, &["--tiles"]);
    let all: u64 = file
        .maps()
        .iter()
        .flat_map(|m| &m.levels)
        .map(|l| l.shape.tiles())
        .sum();
    assert_eq!(text.lines().count() as u64, all + 1);
    assert!(text.contains("constant") || text.contains("data"), "{text}");
}

#[test]
fn a_pixel_shows_its_ramp_and_its_step() {
    let f = rich();
    let text = output(&f.path, &["--pixel", "3,4"]);
    let rows: Vec<Vec<&str>> = text
        .lines()
        .skip(2)
        .map(|l| l.split_whitespace().collect())
        .collect();
    let kinds: Vec<_> = rows.iter().map(|r| (r[1], r[3])).collect();
    assert_eq!(
        kinds,
        [("1", "start"), ("2", "ramp"), ("3", "level"), ("3", "step")]
    );
    let text = output(&f.path, &["--pixel", "0,18"]);
    assert!(text.contains("1 vertex, mono"), "{text}");
    assert!(
        text.lines()
            .nth(2)
            .unwrap()
            .ends_with("5           0  step"),
        "{text}"
    );
    let text = output(&f.path, &["--pixel", "7,0", "--map", "fill"]);
    assert!(text.contains("red") && text.contains("rgb"), "{text}");
}

#[test]
fn a_lit_pixel_is_said_to_be_lit() {
    let f = rich();
    let text = output(&f.path, &["--pixel", "99,0", "--map", "lit"]);
    assert!(text.contains("lit at every depth"), "{text}");
    let j = json(&f.path, &["--pixel", "0,0"]);
    assert_eq!(j["pixel"]["lit"], true);
    assert_eq!(j["pixel"]["vertices"], json!([]));
}

#[test]
fn a_pixel_in_json_is_what_the_library_reads() {
    let f = rich();
    let file = DsmFile::open(&f.path).unwrap();
    let function = file.function(MapId(0).level(1), Pixel::new(1, 2)).unwrap();
    let j = json(&f.path, &["--pixel", "1,2", "--level", "1"]);
    let j = &j["pixel"];
    assert_eq!((&j["name"], &j["level"]), (&json!("key"), &json!(1)));
    let vertices = j["vertices"].as_array().unwrap();
    assert_eq!(vertices.len(), function.len());
    for (i, v) in vertices.iter().enumerate() {
        assert_eq!(v["z"].as_f64().unwrap() as f32, function.depths()[i]);
        let value = v["visibility"][0].as_f64().unwrap() as f32;
        assert_eq!(value, function.values(0)[i]);
    }
}

#[test]
fn the_hash_is_that_of_the_content() {
    let (a, b) = (
        wall(0.5, |_, _| ()),
        wall(0.5, |_, e| e.codec = deepshadow::Codec::None),
    );
    let hash = DsmFile::open(&a.path)
        .unwrap()
        .content_hash(|_, _| true)
        .unwrap();
    let hex: String = hash.iter().map(|b| format!("{b:02x}")).collect();
    assert_eq!(output(&a.path, &["--hash"]), hex.clone() + "\n");
    assert_eq!(json(&b.path, &["--hash"])["hash"], hex);
    let mut command = info();
    let (code, stdout, _) = run(command.arg("--hash").args([&a.path, &b.path]));
    assert_eq!((code, stdout.matches(&format!("{hex}  ")).count()), (0, 2));
}

#[test]
fn verify_counts_what_it_checked() {
    let f = rich();
    let text = output(&f.path, &["--verify"]);
    assert!(
        text.starts_with(&format!("{}: ok, ", f.path.display())),
        "{text}"
    );
    let report = DsmFile::open(&f.path).unwrap().verify(|_, _| true).unwrap();
    assert!(text.contains(&format!("{} tiles", report.tiles)), "{text}");
    let j = json(&f.path, &["--verify"]);
    assert_eq!(
        (&j["verify"]["ok"], &j["verify"]["vertices"]),
        (&json!(true), &json!(report.vertices))
    );
}

#[test]
fn wrong_usage_exits_2_in_one_line() {
    let f = rich();
    let file = f.path.to_str().unwrap();
    for args in [
        &[][..],
        &["--nonsense", file],
        &["--pixel", "3", file],
        &["--pixel", "-1,3", file],
        &["--pixel", "3,4,5", file],
        &["--map", "key", file],
        &["--level", "0", "--hash", file],
        &["--level", "x", "--tiles", file],
        &["--fail", "0.1", file],
        &["--compare", file, "--fail", "NaN", file],
        &["-o", "x.svg", file],
        &["--against", "x.exr", file],
        &["--verify", "--zscale", "2", file],
        &["--plot", "1,1", file, file],
        &["--plot", "1,1", "--hash", file],
    ] {
        let (code, stdout, stderr) = run(info().args(args));
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}");
        assert!(stderr.starts_with("dsm-info: "), "{args:?}: {stderr}");
    }
}

#[test]
fn what_is_not_in_the_file_exits_1_and_says_what_is() {
    let f = rich();
    let file = f.path.to_str().unwrap();
    for (args, says) in [
        (&["--pixel", "40,0"][..], "40,0"),
        (&["--pixel", "0,0", "--level", "9"], "level 9"),
        (
            &["--pixel", "0,0", "--map", "rim"],
            "\"key\", \"fill\", \"lit\"",
        ),
        (&["--tiles", "--map", "3"], "no map \"3\""),
        (&["--stats", "--level", "2", "--map", "fill"], "level 2"),
    ] {
        let (code, _, stderr) = run(info().args(args).arg(file));
        assert_eq!(code, 1, "{args:?}");
        assert!(
            stderr.starts_with(&format!("dsm-info: {file}: ")),
            "{stderr}"
        );
        assert!(stderr.contains(says), "{stderr}");
    }
}

#[test]
fn help_shows_examples_and_version_a_number() {
    let (code, stdout, _) = run(info().arg("--help"));
    assert_eq!(code, 0);
    assert!(stdout.contains("Examples:") && stdout.contains("Exit codes:"));
    assert!(stdout.lines().all(|l| l.len() <= 100), "{stdout}");
    let (code, stdout, _) = run(info().arg("--version"));
    assert_eq!(code, 0);
    assert!(stdout.starts_with("dsm-info "), "{stdout}");
}

#[test]
#[cfg(unix)]
fn a_reader_who_goes_away_is_no_panic() {
    use std::process::{Command, Stdio};
    let f = wall(0.5, |h, _| (h.width, h.height, h.tile_size) = (512, 512, 8));
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("dsm-info"))
        .arg("--tiles")
        .arg(&f.path)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let out = child.wait_with_output().unwrap();
    assert_eq!(String::from_utf8_lossy(&out.stderr), "");
    assert_eq!(out.status.code(), Some(0));
}

#[test]
fn a_string_of_an_openexr_file_is_printed_as_text() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "out.dsm"].map(|name| folder.path().join(name));
    image(&exr, Look::default());
    convert(&exr, &dsm, &[]);
    let text = output(&dsm, &[]);
    assert!(
        text.contains("\"nobody\"") && !text.contains("exr:string"),
        "{text}"
    );
    assert_eq!(json(&dsm, &[])["maps"][0]["attributes"]["owner"], "nobody");
}
