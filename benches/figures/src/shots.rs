//! Pictures of the scenes in `docs/scenes/`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use deepshadow::{DsmFile, MapId, Pixel};
use deepshadow_frame::{InFile, Result};
use deepshadow_render::image::Image;
use deepshadow_render::render::{Report, Settings, Source, render};
use deepshadow_scene::build::{Report as Built, Settings as Storage, build};
use deepshadow_scene::scene::{Scene, file};

use crate::page::Page;

/// Bytes for the tile cache.
const CACHE: usize = 256 << 20;

/// Where maps are made and pictures taken.
#[derive(Debug)]
pub struct Studio {
    folder: tempfile::TempDir,
    /// Whether all is small and noisy.
    pub quick: bool,
}

/// A map that was made.
#[derive(Debug)]
pub struct Made {
    /// Its file.
    pub path: PathBuf,
    /// What the build did.
    pub report: Built,
    /// How long it took.
    pub time: Duration,
    /// Bytes of the base levels, and of all levels.
    pub bytes: [u64; 2],
}

impl Studio {
    /// A studio; what is made in it goes when it does.
    pub fn new(quick: bool) -> Result<Self> {
        Ok(Studio {
            folder: tempfile::tempdir()?,
            quick,
        })
    }

    /// A scene of `docs/scenes/`.
    pub fn scene(&self, name: &str) -> Result<Scene> {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/scenes"));
        let mut scene = file::read(&folder.join(name).with_extension("toml"))?;
        if self.quick {
            for light in &mut scene.lights {
                light.samples = light.samples.min(16);
                light.tolerance = None;
            }
        }
        Ok(scene)
    }

    /// Makes the maps of a scene.
    pub fn map(&self, scene: &Scene, name: &str) -> Result<Made> {
        let path = self.folder.path().join(name).with_extension("dsm");
        let started = Instant::now();
        let report = build(scene, &path, &Storage::default(), |_, _| {})?;
        let time = started.elapsed();
        let file = DsmFile::open(&path).in_file(&path)?;
        let bytes = |l: &[deepshadow::LevelInfo]| l.iter().map(|l| l.payload_bytes).sum::<u64>();
        let base = file.maps().iter().map(|m| bytes(&m.levels[..1])).sum();
        let all = file.maps().iter().map(|m| bytes(&m.levels)).sum();
        Ok(Made {
            path,
            report,
            time,
            bytes: [base, all],
        })
    }

    /// Takes a picture.
    pub fn shot(&self, scene: &Scene, settings: &Settings) -> Result<(Image, Report)> {
        let mut settings = settings.clone();
        if self.quick {
            settings.spp = settings.spp.min(2);
        }
        render(scene, &settings, |_, _, _| {})
    }
}

/// Shadows from a map.
pub fn from_map(made: &Made) -> Source {
    Source::Map(made.path.clone(), CACHE)
}

/// Usual settings for pictures on the page.
pub fn usual(shadows: Source) -> Settings {
    Settings {
        shadows,
        spp: 16,
        resolution: Some([480, 360]),
        ..Settings::default()
    }
}

/// Seconds with one digit.
pub fn seconds(time: Duration) -> String {
    format!("{:.1} s", time.as_secs_f64())
}

/// Bytes in units that are read at a glance.
pub fn size(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.2} GB", b / 1e9),
        b if b >= 1e6 => format!("{:.2} MB", b / 1e6),
        b => format!("{:.0} kB", b / 1e3),
    }
}

/// Figures 10 and 11.
pub fn clouds(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 10: a cloud with and without self-shadowing");
    let scene = studio.scene("cloud")?;
    let map = studio.map(&scene, "cloud")?;
    let (with, took) = studio.shot(&scene, &usual(from_map(&map)))?;
    let (without, plain) = studio.shot(&scene, &usual(Source::None))?;
    page.pictures(
        "cloud.png",
        "A cloud, with the shadow that it casts on itself and without",
        &[&with, &without],
    )?;
    page.text(&format!(
        "Left with its own shadow, right without: it is the shadow that makes it a cloud. One map of 512 x 512 pixels, {} rays a pixel, within {:.3}: made in {}, {} ({} with all levels). \
         Picture: {} with shadows, {} without.",
        scene.lights[0].samples,
        scene.lights[0].tolerance(),
        seconds(map.time),
        size(map.bytes[0]),
        size(map.bytes[1]),
        seconds(took.rendering),
        seconds(plain.rendering),
    ));
    page.section("Figure 11: a cloud with pipes, in one map");
    let scene = studio.scene("pipes")?;
    let map = studio.map(&scene, "pipes")?;
    let (with, took) = studio.shot(&scene, &usual(from_map(&map)))?;
    let (without, plain) = studio.shot(&scene, &usual(Source::None))?;
    page.pictures(
        "pipes.png",
        "Pipes in a cloud, with and without shadows",
        &[&with, &without],
    )?;
    page.text(&format!(
        "The pipes throw shadows into the cloud, the cloud on the pipes, and both on themselves; right, without. Surfaces and medium lie in one map: made in {}, {}. Picture: {} with shadows, {} without.",
        seconds(map.time),
        size(map.bytes[0]),
        seconds(took.rendering),
        seconds(plain.rendering),
    ));
    Ok(())
}

/// Figure 12.
pub fn motion(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 12: a ball that moves, with and without motion blur in its shadow");
    let scene = studio.scene("motion")?;
    let map = studio.map(&scene, "motion")?;
    let mut frozen = scene.clone();
    for object in &mut frozen.objects {
        let middle = object.motion[object.motion.len() / 2];
        let start = object.motion[0];
        object.motion = vec![
            start
                * glam::DAffine3::from_translation(
                    start
                        .inverse()
                        .transform_vector3((middle.translation - start.translation) / 2.0),
                ),
        ];
    }
    let still = studio.map(&frozen, "still")?;
    let (with, _) = studio.shot(&scene, &usual(from_map(&map)))?;
    let (without, _) = studio.shot(&scene, &usual(from_map(&still)))?;
    page.pictures(
        "motion.png",
        "A moving ball over ground, its shadow blurred by motion, and sharp as if it stood still",
        &[&with, &without],
    )?;
    page.text(&format!(
        "The ball crosses the picture while the shutter is open. Left its shadow is spread as it is: each of the {} rays of a pixel has a moment of its own. Right the map was made as if the ball stood still in the middle of its way; its light then frames it closer, so the two maps are not of the same size on the ball. \
         Made in {} and {}; {} and {}.",
        scene.lights[0].samples,
        seconds(map.time),
        seconds(still.time),
        size(map.bytes[0]),
        size(still.bytes[0]),
    ));
    Ok(())
}

/// Section 5.2.
pub fn colour(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Section 5.2: shadows in colour");
    let scene = studio.scene("glass")?;
    let map = studio.map(&scene, "glass")?;
    let (picture, took) = studio.shot(
        &scene,
        &Settings {
            resolution: Some([640, 480]),
            ..usual(from_map(&map))
        },
    )?;
    page.pictures(
        "glass.png",
        "Smoke and two panes of glass that throw coloured shadows on the ground",
        &[&picture],
    )?;
    let file = DsmFile::open(&map.path).in_file(&map.path)?;
    let mut coloured = 0u64;
    let shape = file.maps()[0].levels[0].shape;
    for y in 0..shape.height {
        for x in 0..shape.width {
            coloured += u64::from(
                file.function(MapId(0).level(0), Pixel::new(x, y))?
                    .channels()
                    == 3,
            );
        }
    }
    page.text(&format!(
        "Smoke that stops blue light before red, and two panes of tinted glass that cross; where their shadows cross, the colours multiply. {:.0} % of the pixels of the map hold three channels, the others one. Made in {}, {}. Picture: {}.",
        100.0 * coloured as f64 / (f64::from(shape.width) * f64::from(shape.height)),
        seconds(map.time),
        size(map.bytes[0]),
        seconds(took.rendering),
    ));
    Ok(())
}

/// Section 5.3.
pub fn blur(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Section 5.3: levels, under a blur that grows");
    let scene = studio.scene("hairball")?;
    let map = studio.map(&scene, "blur")?;
    let mut pictures = Vec::new();
    let mut times = Vec::new();
    for blur in [1.0, 8.0, 32.0, 96.0] {
        let settings = Settings {
            blur,
            bias: Some(0.02),
            only_light: Some("key".into()),
            resolution: Some([480, 360]),
            crop: Some([120, 150, 240, 180]),
            ..usual(from_map(&map))
        };
        let (picture, took) = studio.shot(&scene, &settings)?;
        times.push(seconds(took.rendering));
        pictures.push(picture);
    }
    let pictures: Vec<_> = pictures.iter().collect();
    page.pictures(
        "blur.png",
        "The hair ball and its shadow under footprints of 1, 8, 32 and 96 pixels of the map",
        &pictures,
    )?;
    page.text(&format!(
        "Footprints at least 1, 8, 32 and 96 pixels of the map wide, for one of the lights. A lookup reads a few pixels of the level that fits, whatever the width: the pictures took {}.",
        times.join(", "),
    ));
    Ok(())
}
