//! `--verify --against`.

use std::fs::File;
use std::path::{Path, PathBuf};

use deepshadow_exr::{Channel, ChannelData, DeepBlock, DeepWriter, Part, Rect, SampleType};
use serde_json::Value;

use super::files::{Fixture, info, json, output, run, wall};

/// A deep image of 32 x 32 beside the file, whose pixels in row 0 hold one sample of opacity `a` at
/// depth 2 + x.
fn image(f: &Fixture, a: f32) -> PathBuf {
    let path = f.beside("source.exr");
    let window = Rect {
        x: 0,
        y: 0,
        width: 32,
        height: 32,
    };
    let channels = ["A", "Z"].map(|name| Channel::new(name, SampleType::Float));
    let part = Part::deep_scanline(window, channels.to_vec());
    let mut writer = DeepWriter::new(File::create(&path).unwrap(), vec![part.clone()]).unwrap();
    for block in 0.. {
        let Some(rect) = part.block_rect(block) else {
            break;
        };
        let first = if rect.y == 0 { 32 } else { 0 };
        let pixels = rect.width * rect.height;
        let depths = (0..first).map(|x| 2.0 + x as f32).collect();
        let block_data = DeepBlock {
            rect,
            offsets: (0..=pixels).map(|i| i.min(first)).collect(),
            channels: vec![
                ChannelData::Float(vec![a; first as usize]),
                ChannelData::Float(depths),
            ],
        };
        writer.write(0, &block_data).unwrap();
    }
    writer.finish().unwrap();
    path
}

fn arguments(source: &Path) -> [&str; 3] {
    ["--verify", "--against", source.to_str().unwrap()]
}

#[test]
fn a_promise_that_is_kept_is_said_to_be_kept() {
    let f = wall(0.5, |_, _| ());
    let source = image(&f, 0.5);
    let text = output(&f.path, &arguments(&source));
    assert!(text.contains("ok, ") && text.contains("against"), "{text}");
    assert_eq!(text.matches("kept").count(), 6, "{text}");
    let j = json(&f.path, &arguments(&source));
    let levels = j["against"]["levels"].as_array().unwrap();
    assert_eq!((levels.len(), &j["against"]["kept"]), (6, &true.into()));
    for (level, said) in levels
        .iter()
        .zip(j["maps"][0]["levels"].as_array().unwrap())
    {
        assert_eq!(level["promise"], said["max_error"]);
        assert!(level["error"].as_f64() <= said["max_error"].as_f64());
    }
}

#[test]
fn a_promise_that_is_broken_fails_and_says_where() {
    let f = wall(0.5, |_, _| ());
    let source = image(&f, 0.75);
    let (code, stdout, stderr) = run(info().args(arguments(&source)).arg(&f.path));
    assert_eq!(code, 1);
    assert!(stdout.contains("BROKEN"), "{stdout}");
    let says = "map \"m\", level 0: the error is 0.25 at pixel 0,0, behind z 2";
    assert!(stderr.contains(says), "{stderr}");
    let (code, stdout, _) = run(info().arg("--json").args(arguments(&source)).arg(&f.path));
    let j: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!((code, &j["against"]["kept"]), (1, &false.into()));
    assert_eq!(j["verify"]["ok"], true);
}

#[test]
fn the_image_is_taken_as_the_converter_took_it() {
    let f = wall(0.5, |_, _| ());
    let source = image(&f, 0.5);
    let twice = [&arguments(&source)[..], &["--zscale", "2"]].concat();
    assert_eq!(run(info().args(twice).arg(&f.path)).0, 1);
    let once = [&arguments(&source)[..], &["--zscale", "1", "--discrete"]].concat();
    assert_eq!(run(info().args(once).arg(&f.path)).0, 0);
}

#[test]
fn an_image_that_does_not_fit_or_is_none_is_named() {
    let f = wall(0.5, |h, _| h.width = 40);
    let source = image(&f, 0.5);
    let (code, _, stderr) = run(info().args(arguments(&source)).arg(&f.path));
    assert_eq!(code, 1);
    assert!(
        stderr.contains("source.exr") && stderr.contains("40 x 32"),
        "{stderr}"
    );
    std::fs::write(&source, "no image").unwrap();
    let (code, _, stderr) = run(info().args(arguments(&source)).arg(&f.path));
    assert_eq!(code, 1);
    assert!(
        stderr.contains("source.exr: not an OpenEXR file"),
        "{stderr}"
    );
}
