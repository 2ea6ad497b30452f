//! `--compare`.

use deepshadow::Codec;
use serde_json::json;

use super::files::{exact, info, json, output, rich, run, wall};

#[test]
fn a_file_is_identical_to_itself() {
    let f = rich();
    let other = f.path.to_str().unwrap();
    let text = output(&f.path, &["--compare", other]);
    assert!(text.ends_with("identical\n"), "{text}");
    let j = json(&f.path, &["--compare", other, "--fail", "0"]);
    let c = &j["compare"];
    assert_eq!(
        (&c["identical"], &c["difference"]),
        (&json!(true), &json!(0.0))
    );
    assert_eq!(c["levels"][0]["pixel"], json!(null));
}

#[test]
fn the_same_functions_in_other_tiles_and_codecs_do_not_differ() {
    let a = wall(0.5, |_, _| ());
    let b = wall(0.5, |h, e| (h.tile_size, e.codec) = (8, Codec::None));
    let text = output(&a.path, &["--compare", b.path.to_str().unwrap()]);
    assert!(text.contains("tile size 32, 8 in the other file"), "{text}");
    assert!(text.ends_with("the same functions\n"), "{text}");
}

#[test]
fn the_largest_difference_is_found_where_it_is_whoever_comes_first() {
    let a = wall(0.5, |_, _| ());
    let b = wall(0.25, |h, _| h.tile_size = 8);
    for (a, b) in [(&a, &b), (&b, &a)] {
        let j = json(&a.path, &["--compare", b.path.to_str().unwrap()]);
        let c = &j["compare"];
        let base = &c["levels"][0];
        assert!(
            (c["difference"].as_f64().unwrap() - 0.25).abs() < 1e-4,
            "{c}"
        );
        assert_eq!(base["differing_pixels"], 32);
        assert_eq!(base["pixel"], json!([0, 0]));
        assert_eq!((&base["z"], &base["side"]), (&json!(2.0), &json!("behind")));
        assert_eq!(base["vertices"], json!([32, 32]));
        assert_eq!(c["comparable"], true);
    }
}

#[test]
fn fail_draws_a_line() {
    let (a, b) = (wall(0.5, |_, _| ()), wall(0.25, |_, _| ()));
    let mut args = ["--compare", b.path.to_str().unwrap(), "--fail", "0.26"];
    output(&a.path, &args);
    args[3] = "0.24";
    let (code, stdout, stderr) = run(info().args(args).arg(&a.path));
    assert_eq!(code, 1);
    assert!(stdout.contains("largest difference 0.25"), "{stdout}");
    let said = |words: &str| assert!(stderr.contains(words), "{stderr}");
    said("failed: differs from");
    said("by 0.25, 0.01 more than --fail 0.24");
}

#[test]
fn maps_of_other_sizes_cannot_be_compared() {
    let a = wall(0.5, |_, _| ());
    let b = wall(0.5, |h, _| h.height = 31);
    let other = b.path.to_str().unwrap();
    let (code, stdout, stderr) = run(info().args(["--compare", other]).arg(&a.path));
    assert_eq!(code, 1);
    assert!(
        stdout.contains("32 x 32 pixels, 32 x 31 pixels in the other file"),
        "{stdout}"
    );
    assert!(stderr.contains("cannot be compared"), "{stderr}");
    let (code, stdout, _) = run(info().args(["--json", "--compare", other]).arg(&a.path));
    let j: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((code, &j["compare"]["comparable"]), (1, &json!(false)));

    let rich = rich();
    let (code, _, stderr) = run(info().arg("--compare").args([&rich.path, &a.path]));
    assert_eq!(code, 1);
    assert!(stderr.contains("1 map, 3 in the other file"), "{stderr}");
}

#[test]
fn metadata_and_promises_that_differ_are_named() {
    let a = wall(0.5, |_, _| ());
    let b = wall(0.5, |h, e| {
        h.depth_unit = 2.0;
        *e = exact().tolerance(0.01);
    });
    let text = output(&a.path, &["--compare", b.path.to_str().unwrap()]);
    assert!(text.contains("depth unit 0, 2 in the other file"), "{text}");
    assert!(text.contains("promises 0.001"), "{text}");
}

#[test]
fn the_other_file_is_named_when_it_is_the_one_that_is_bad() {
    let f = rich();
    let bad = f.beside("bad.dsm");
    std::fs::write(&bad, "not me").unwrap();
    let (code, _, stderr) = run(info().arg("--compare").args([&bad, &f.path]));
    assert_eq!(code, 1);
    assert!(
        stderr.contains(&format!("{}: not a .dsm file", bad.display())),
        "{stderr}"
    );
}
