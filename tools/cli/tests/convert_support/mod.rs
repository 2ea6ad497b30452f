//! Deep images to convert, and the program to do it.

use std::path::Path;

use assert_cmd::Command;
use deepshadow::{DsmFile, MapId, Ray};
use deepshadow_cli::convert::level::Level;
use deepshadow_cli::source::{DeepSource, SourceOptions, against};
use deepshadow_exr::{Attribute, Channel, DeepBlock, DeepWriter, Part, Rect, SampleType, Tiles};

#[path = "../../../exr/tests/common/data.rs"]
mod data;
pub use data::data;

/// Runs dsm-convert; gives exit code, standard output and standard error.
pub fn run(arguments: &[&str]) -> (i32, String, String) {
    run_program("dsm-convert", arguments)
}

/// Runs a program; gives exit code, standard output and standard error.
pub fn run_program(name: &str, arguments: &[&str]) -> (i32, String, String) {
    let mut command = Command::cargo_bin(name).unwrap();
    let output = command.args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let code = output.status.code().unwrap();
    (code, text(output.stdout), text(output.stderr))
}

/// Runs the program, which must succeed; gives standard output and standard error.
pub fn convert(input: &Path, output: &Path, options: &[&str]) -> (String, String) {
    let mut arguments = vec![input.to_str().unwrap(), output.to_str().unwrap()];
    arguments.extend(options);
    let (code, out, err) = run(&arguments);
    assert_eq!(code, 0, "{arguments:?}: {err}");
    (out, err)
}

/// Runs the program, which must fail with this code and one line, and leave no output; gives the
/// line.
pub fn refuse(code: i32, input: &Path, output: &Path, options: &[&str]) -> String {
    let mut arguments = vec![input.to_str().unwrap(), output.to_str().unwrap()];
    arguments.extend(options);
    let before = std::fs::read(output).ok();
    let (found, _, err) = run(&arguments);
    assert_eq!(found, code, "{arguments:?}: {err}");
    assert_eq!(
        std::fs::read(output).ok(),
        before,
        "{arguments:?} left a file"
    );
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.starts_with("dsm-convert: "), "{err}");
    err
}

/// Properties of a test image.
#[derive(Clone, Copy, Default)]
pub struct Look {
    pub coloured: bool,
    pub thick: bool,
    pub tiled: bool,
}

pub const WINDOW: Rect = Rect {
    x: -3,
    y: 7,
    width: 45,
    height: 37,
};

/// Writes a deep image with empty pixels, surfaces, thick samples that overlap, opaque ones.
pub fn image(path: &Path, look: Look) {
    let names: &[&str] = match (look.coloured, look.thick) {
        (false, false) => &["A", "Z"],
        (false, true) => &["A", "Z", "ZBack"],
        (true, false) => &["AB", "AG", "AR", "Z"],
        (true, true) => &["AB", "AG", "AR", "Z", "ZBack"],
    };
    let channels = names
        .iter()
        .map(|n| Channel::new(*n, SampleType::Float))
        .collect();
    let mut part = match look.tiled {
        true => Part::deep_tiled(WINDOW, channels, Tiles::new(16, 16)),
        false => Part::deep_scanline(WINDOW, channels),
    };
    part.display_window = Rect {
        x: 0,
        y: 0,
        width: 64,
        height: 48,
    };
    part.name = Some("key".into());
    let matrix = std::array::from_fn(|i| i as f32 * 0.5 + 0.25);
    part.attributes = vec![
        Attribute::m44f("worldToCamera", matrix),
        Attribute::text("owner", "nobody"),
        Attribute::float("expTime", 0.5),
    ];
    let mut state = 1u64;
    let mut dice = |n: u32| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        ((state >> 33) % u64::from(n)) as u32
    };
    let mut block = DeepBlock::with_channels(WINDOW, &part.channels);
    for p in 0..WINDOW.pixels() {
        // A band of empty pixels, and few or many samples elsewhere.
        let count = if p % 45 < 9 { 0 } else { dice(7) };
        for _ in 0..count {
            let z = 1.0 + dice(64) as f32 * 0.25;
            let a = [0.1, 0.25, 0.5, 1.0, 0.03, 0.75][dice(6) as usize];
            let thickness = dice(3) as f32 * 0.4;
            for (channel, data) in part.channels.iter().zip(&mut block.channels) {
                data.push(match channel.name.as_str() {
                    "Z" => z,
                    "ZBack" => z + thickness,
                    "AG" => a * 0.5,
                    _ => a,
                });
            }
        }
        block.push_pixel();
    }
    let file = std::fs::File::create(path).unwrap();
    let mut writer = DeepWriter::new(file, vec![part.clone()]).unwrap();
    for (_, rect) in part.blocks() {
        writer.write(0, &block.crop(rect).unwrap()).unwrap();
    }
    writer.finish().unwrap();
}

/// Shows that every level of map 0 keeps its promise.
pub fn keeps_promises(path: &Path, source: &Path, options: &SourceOptions) {
    let file = DsmFile::open(path).unwrap();
    let source = DeepSource::open(source, options).unwrap();
    for level in against(&file, MapId(0), &source, |_, _| {}).unwrap() {
        assert!(level.is_kept(), "{}: {level:?}", path.display());
    }
}

/// Shows that the rays of the deep image at `path` are within `tolerance` of the functions of a
/// level.
pub fn comes_back(path: &Path, file: &DsmFile, map: usize, level: usize, tolerance: f64) {
    let source = DeepSource::open(path, &SourceOptions::default()).unwrap();
    let id = MapId(map as u32).level(level as u32);
    let shape = file.level(id).unwrap().shape;
    let rays: Vec<Ray> = source.rays(0, 0, shape.width, shape.height).unwrap();
    assert_eq!(
        (source.header().width, source.header().height),
        (shape.width, shape.height)
    );
    let functions = Level::new(file, id).unwrap();
    let functions = functions
        .functions([0, 0, shape.width, shape.height])
        .unwrap();
    for (i, (ray, f)) in rays.iter().zip(&functions.0).enumerate() {
        let (x, y) = (i as u32 % shape.width, i as u32 / shape.width);
        let worst = ray.deviation(f);
        assert!(worst.error <= tolerance, "pixel {x},{y}: {worst:?}");
    }
}
