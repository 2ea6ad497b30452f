//! `--lookup`.

use deepshadow::{
    Border, DsmFile, Filter, LevelChoice, MapHeader, MapId, Mips, Pixel, Query, Sampler,
    SamplerOptions, TileCache, TileId,
};
use serde_json::{Value, json};

use super::files::{Fixture, exact, info, json, output, rich, run, wall};

/// Numbers of an array.
fn numbers(v: &Value) -> Vec<f32> {
    let numbers = v.as_array().unwrap().iter();
    numbers.map(|v| v.as_f64().unwrap() as f32).collect()
}

#[test]
fn a_lookup_says_what_a_sampler_answers() {
    let f = rich();
    let light = TileCache::new(1 << 20).add(DsmFile::open(&f.path).unwrap());
    for (filter, name) in [
        (Filter::Nearest, "nearest"),
        (Filter::Box, "box"),
        (Filter::Triangle, "triangle"),
        (Filter::Gaussian, "gaussian"),
        (Filter::CatmullRom, "catmull-rom"),
    ] {
        for (levels, levels_name) in [
            (LevelChoice::Blend, "blend"),
            (LevelChoice::One, "one"),
            (LevelChoice::Base, "base"),
        ] {
            for (border, border_name) in [(Border::Lit, "lit"), (Border::Clamp, "clamp")] {
                let options = SamplerOptions::new(filter).levels(levels).border(border);
                let mut sampler = Sampler::with_options(&light, MapId(0), options).unwrap();
                for (x, y, z, width) in [
                    (3.25, 4.75, 3.0, 1.0),
                    (7.5, 18.25, 6.0, 1.0),
                    (4.0, 4.25, 2.5, 3.0),
                    (-0.5, 18.0, 9.0, 2.5),
                ] {
                    let query = Query::new(x, y, z).width(width).bias(0.25);
                    let args = [
                        "--lookup",
                        &format!("{x},{y},{z}"),
                        "--width",
                        &width.to_string(),
                        "--filter",
                        name,
                        "--levels",
                        levels_name,
                        "--border",
                        border_name,
                        "--bias",
                        "0.25",
                    ];
                    let j = &json(&f.path, &args)["lookup"];
                    let visibility = sampler.visibility(&query).unwrap();
                    assert_eq!(numbers(&j["visibility"]), [visibility], "{args:?}");
                    assert_eq!(numbers(&j["opacity"]), [sampler.opacity(&query).unwrap()]);
                    let range = sampler.depth_range(&query).unwrap();
                    assert_eq!(j["depths"], json!(range), "{args:?}");
                    let half = sampler.depth_below(&query, 0.5).unwrap();
                    assert_eq!(j["below_half"], json!([half]), "{args:?}");
                    // The pixels that are listed make the answer.
                    let pixels = j["pixels"].as_array().unwrap();
                    assert_eq!(j["pixel_count"], pixels.len());
                    let outside = j["outside"].as_f64().unwrap();
                    assert!(border == Border::Lit || outside == 0.0);
                    let mut sum = outside;
                    for p in pixels {
                        let at = |i: usize| p["pixel"][i].as_u64().unwrap() as u32;
                        let level = p["level"].as_u64().unwrap() as usize;
                        let function = light
                            .file()
                            .function(MapId(0).level(level as u32), Pixel::new(at(0), at(1)))
                            .unwrap();
                        sum += p["weight"].as_f64().unwrap()
                            * f64::from(function.visibility(z - 0.25));
                    }
                    let sum = sum.clamp(0.0, 1.0) as f32;
                    assert!((sum - visibility).abs() < 1e-5, "{args:?}: {sum}");
                }
            }
        }
    }
}

#[test]
fn colours_are_three_numbers_each_with_its_own_depth_of_one_half() {
    let f = rich();
    let args = ["--map", "fill", "--filter", "nearest", "--lookup"];
    let j = &json(&f.path, &[&args[..], &["7.5,0.5,inf"]].concat())["lookup"];
    assert_eq!((&j["name"], &j["depth"]), (&json!("fill"), &json!("inf")));
    assert_eq!(j["visibility"], json!([0.5, 0.25, 0.0]));
    assert_eq!(j["opacity"], json!([0.5, 0.75, 1.0]));
    assert_eq!(j["depths"], json!([-1.0, 2.0]));
    // Red never falls below, green half way down its ramp, blue at its step.
    let green = j["below_half"][1].as_f64().unwrap() as f32;
    let light = TileCache::new(1 << 20).add(DsmFile::open(&f.path).unwrap());
    let nearest = SamplerOptions::default().filter(Filter::Nearest);
    let mut sampler = Sampler::with_options(&light, MapId(1), nearest).unwrap();
    let mut at = |z: f32| sampler.visibility_rgb(&Query::new(7.5, 0.5, z)).unwrap()[1];
    assert!(at(green) >= 0.5 && at(green.next_up()) < 0.5, "{green}");
    assert!((green - 0.5).abs() < 0.01, "{green}");
    assert_eq!(j["below_half"], json!([null, green, -1.0]));
    let text = output(&f.path, &[&args[..], &["7.5,0.5,inf"]].concat());
    assert!(text.contains("red 0.5, green 0.25, blue 0\n"), "{text}");
    assert!(
        text.contains("red nowhere, green behind 0.4") && text.contains(", blue behind -1\n"),
        "{text}"
    );

    let mut sampler = Sampler::new(&light, MapId(1)).unwrap();
    let query = Query::new(6.5, 1.0, 1.0).width(1.5);
    let args = ["--map", "fill", "--lookup", "6.5,1,1", "--width", "1.5"];
    let found = numbers(&json(&f.path, &args)["lookup"]["visibility"]);
    assert_eq!(found, sampler.visibility_rgb(&query).unwrap());
}

#[test]
fn negative_coordinates_need_no_equals_sign() {
    let f = rich();
    for args in [
        &["--lookup=-0.5,2,3"][..],
        &["--lookup", "-0.5,2,3"],
        &["--lookup", " -0.5, 2, 3 "],
    ] {
        let j = json(&f.path, args);
        assert_eq!(j["lookup"]["at"], json!([-0.5, 2.0]));
    }
    // Half a pixel from the border: all light comes from outside.
    let text = output(&f.path, &["--lookup", "-0.5,2.5,3", "--bias", "-1"]);
    assert!(
        text.contains("outside         lit, weight 1\n") && text.contains("bias -1"),
        "{text}"
    );
    let text = output(&f.path, &["--lookup", "0,2.5,3"]);
    for part in ["outside         lit, weight 0.5\n", "0  0  2     0.5\n"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let text = output(&f.path, &["--lookup", "-9,2,-inf", "--border", "clamp"]);
    assert!(!text.contains("outside"), "{text}");
    assert!(text.contains("depths          none, lit at every depth"));
}

#[test]
fn many_pixels_are_counted_and_the_first_are_shown() {
    let f = wall(0.5, |_, _| ());
    let args = ["--lookup", "16,16,99", "--width", "32"];
    let base = [&args[..], &["--levels", "base", "--filter", "box"]].concat();
    let text = output(&f.path, &base);
    assert!(
        text.contains("level 0         1,024 pixels, weight 1"),
        "{text}"
    );
    assert!(
        text.ends_with("the first 16 of 1,024 pixels\n") && text.lines().count() == 25,
        "{text}"
    );
    let text = output(&f.path, &args);
    assert!(text.contains("level 5         1 pixel, weight "), "{text}");
    let wide = [
        "--lookup", "16,16,99", "--width", "64", "--levels", "base", "--border", "clamp",
    ];
    let j = &json(&f.path, &wide)["lookup"];
    let weights = j["pixels"].as_array().unwrap().iter();
    let sum: f64 = weights.map(|p| p["weight"].as_f64().unwrap()).sum();
    assert!((sum - 1.0).abs() < 1e-5, "{sum}");
    assert_eq!(j["pixel_count"], 1024); // those at the border stand for many, and are there once
}

#[test]
fn wrong_lookups_exit_2_in_one_line() {
    let f = rich();
    for (args, says) in [
        (&["--lookup", "1,2"][..], "three numbers"),
        (&["--lookup", "1,2,3,4"], "three numbers"),
        (&["--lookup", "1,two,3"], "three numbers"),
        (&["--lookup", "1,2,nan"], "three numbers"),
        (&["--lookup", "nan,2,3"], "three numbers"),
        (&["--lookup", "1,inf,3"], "three numbers"),
        (&["--lookup", "1e39,2,3"], "three numbers"),
        (&["--lookup", "--json"], "three numbers"),
        (&["--lookup", "1,2,3", "--width", "-1"], "at least 0"),
        (&["--lookup", "1,2,3", "--width", "nan"], "at least 0"),
        (&["--lookup", "1,2,3", "--width", "inf"], "at least 0"),
        (&["--lookup", "1,2,3", "--bias", "inf"], "bias"),
        (&["--lookup", "1,2,3", "--filter", "sinc"], "triangle"),
        (&["--lookup", "1,2,3", "--level", "1"], "--pixel"),
        (&["--width", "2"], "--lookup"),
        (&["--filter", "box"], "--lookup"),
        (&["--lookup", "1,2,3", "--plot", "1,1"], "-o"),
    ] {
        let (code, stdout, stderr) = run(info().arg(&f.path).args(args));
        assert_eq!((code, stdout.as_str()), (2, ""), "{args:?}: {stderr}");
        assert!(stderr.contains(says), "{args:?}: {stderr}");
    }
}

#[test]
fn what_cannot_be_looked_up_exits_1_and_says_why() {
    let f = rich();
    let (code, _, stderr) = run(info()
        .args(["--lookup", "1,2,3", "--map", "rim"])
        .arg(&f.path));
    assert_eq!(code, 1);
    assert!(stderr.contains("\"key\", \"fill\", \"lit\""), "{stderr}");

    let file = DsmFile::open(&f.path).unwrap();
    let tile = (0..6).map(|i| {
        (
            i,
            file.entry(MapId(0).level(0), TileId::new(i as u32 % 3, i as u32 / 3))
                .unwrap(),
        )
    });
    let (number, entry) = tile.into_iter().find(|(_, e)| e.offset > 0).unwrap();
    let mut bytes = std::fs::read(&f.path).unwrap();
    bytes[entry.offset as usize] ^= 1;
    std::fs::write(&f.path, bytes).unwrap();
    let (x, y) = (number % 3 * 16 + 8, number / 3 * 16 + 2);
    let lookup = format!("{x},{y},3");
    let (code, stdout, stderr) = run(info().args(["--lookup", &lookup]).arg(&f.path));
    assert_eq!((code, stdout.as_str()), (1, ""));
    assert!(stderr.contains("TILE-CRC"), "{stderr}");
    let place = format!("map 0, level 0, tile {number}");
    assert!(stderr.contains(&place), "{stderr}");
    let j = run(info().args(["--json", "--lookup", &lookup]).arg(&f.path));
    let j: Value = serde_json::from_str(&j.1).unwrap();
    assert!(j["error"].as_str().unwrap().contains("TILE-CRC"));
    // Elsewhere the file is sound.
    output(
        &f.path,
        &["--lookup", "3,3,3", "--map", "fill", "--width", "4"],
    );
}

#[test]
fn a_footprint_over_too_many_pixels_is_refused() {
    let f = Fixture::new(|w| {
        let mut header = MapHeader::new("large", 8192, 8192);
        header.tile_size = 256;
        let encoding = exact().mips(Mips::None);
        w.add_map(header, encoding).unwrap();
    });
    for (width, code) in [("1e30", 1), ("5000", 1), ("1000", 0)] {
        let args = ["--lookup", "4096,4096,1", "--width", width];
        let (found, _, stderr) = run(info().args(args).arg(&f.path));
        assert_eq!(found, code, "{width}: {stderr}");
        assert!(code == 0 || stderr.contains("smaller --width"), "{stderr}");
    }
}
