//! Builds the maps and renders the pictures of the scenes in `docs/scenes/`.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use deepshadow::{DsmFile, MapId, Pixel};
use deepshadow_frame::{InFile, Result};
use deepshadow_render::image::Image;
use deepshadow_render::render::{Report, Settings, Source, render};
use deepshadow_scene::build::{Report as BuildReport, Settings as BuildSettings, build};
use deepshadow_scene::scene::{Scene, file};

use crate::page::Page;

/// Capacity of the tile cache in bytes.
const CACHE: usize = 256 << 20;

/// Builds maps in a temporary folder and renders pictures with them.
///
/// Dropping it deletes the folder.
#[derive(Debug)]
pub struct Studio {
    folder: tempfile::TempDir,
    /// Whether to use few samples, for a quick test.
    pub quick: bool,
}

/// A file of maps built from a scene.
#[derive(Debug)]
pub struct BuiltMap {
    /// Path of the file.
    pub path: PathBuf,
    /// Report of the build.
    pub report: BuildReport,
    /// Duration of the build.
    pub build_time: Duration,
    /// Bytes of the tiles: of the base levels, and of all levels.
    pub bytes: [u64; 2],
}

impl Studio {
    /// Creates a temporary folder for the maps.
    pub fn new(quick: bool) -> Result<Self> {
        Ok(Studio {
            folder: tempfile::tempdir()?,
            quick,
        })
    }

    /// Reads the scene `name` of `docs/scenes/`.
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

    /// Builds the maps of all lights of a scene.
    pub fn map(&self, scene: &Scene, name: &str) -> Result<BuiltMap> {
        let path = self.folder.path().join(name).with_extension("dsm");
        let started = Instant::now();
        let report = build(scene, &path, &BuildSettings::default(), |_, _| {})?;
        let time = started.elapsed();
        let file = DsmFile::open(&path).in_file(&path)?;
        let bytes = |l: &[deepshadow::LevelInfo]| l.iter().map(|l| l.payload_bytes).sum::<u64>();
        let base = file.maps().iter().map(|m| bytes(&m.levels[..1])).sum();
        let all = file.maps().iter().map(|m| bytes(&m.levels)).sum();
        Ok(BuiltMap {
            path,
            report,
            build_time: time,
            bytes: [base, all],
        })
    }

    /// Renders a picture.
    pub fn shot(&self, scene: &Scene, settings: &Settings) -> Result<(Image, Report)> {
        let mut settings = settings.clone();
        if self.quick {
            settings.spp = settings.spp.min(2);
        }
        render(scene, &settings, |_, _, _| {})
    }
}

/// Shadows from a built map.
pub fn from_map(map: &BuiltMap) -> Source {
    Source::Map(map.path.clone(), CACHE)
}

/// Settings of most pictures on the page.
pub fn page_settings(shadows: Source) -> Settings {
    Settings {
        shadows,
        spp: 16,
        resolution: Some([480, 360]),
        ..Settings::default()
    }
}

/// Formats a duration in seconds with one decimal.
pub fn seconds(time: Duration) -> String {
    format!("{:.1} s", time.as_secs_f64())
}

/// Formats a number of bytes in kB, MB or GB.
pub fn size(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.2} GB", b / 1e9),
        b if b >= 1e6 => format!("{:.2} MB", b / 1e6),
        b => format!("{:.0} kB", b / 1e3),
    }
}

/// Writes figures 10 and 11: a cloud, and a cloud with pipes.
pub fn clouds(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 10: a cloud with and without self-shadowing");
    let scene = studio.scene("cloud")?;
    let map = studio.map(&scene, "cloud")?;
    let (with, took) = studio.shot(&scene, &page_settings(from_map(&map)))?;
    let (without, plain) = studio.shot(&scene, &page_settings(Source::None))?;
    page.pictures(
        "cloud.png",
        "A cloud with and without its shadow on itself",
        &[&with, &without],
    )?;
    page.paragraph(&format!(
        "A cloud: left with its shadow on itself, right without. The map has 512 x 512 pixels, {} \
         rays per pixel and a tolerance of {:.3}. It was built in {} and takes {} ({} with all \
         levels). The picture took {} with shadows and {} without.",
        scene.lights[0].samples,
        scene.lights[0].tolerance(),
        seconds(map.build_time),
        size(map.bytes[0]),
        size(map.bytes[1]),
        seconds(took.rendering),
        seconds(plain.rendering),
    ));
    page.section("Figure 11: a cloud with pipes, in one map");
    let scene = studio.scene("pipes")?;
    let map = studio.map(&scene, "pipes")?;
    let (with, took) = studio.shot(&scene, &page_settings(from_map(&map)))?;
    let (without, plain) = studio.shot(&scene, &page_settings(Source::None))?;
    page.pictures(
        "pipes.png",
        "Pipes in a cloud, with and without shadows",
        &[&with, &without],
    )?;
    page.paragraph(&format!(
        "The pipes cast shadows into the cloud, the cloud casts shadows on the pipes, and both \
         cast shadows on themselves. The right picture has no shadows. One map holds both surfaces \
         and medium. It was built in {} and takes {}. The picture took {} with shadows \
         and {} without.",
        seconds(map.build_time),
        size(map.bytes[0]),
        seconds(took.rendering),
        seconds(plain.rendering),
    ));
    Ok(())
}

/// Writes figure 12: motion blur in a shadow.
pub fn motion(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 12: a moving ball with and without motion blur in its shadow");
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
    let (with, _) = studio.shot(&scene, &page_settings(from_map(&map)))?;
    let (without, _) = studio.shot(&scene, &page_settings(from_map(&still)))?;
    page.pictures(
        "motion.png",
        "A moving ball above ground, with a motion-blurred shadow and with a sharp shadow",
        &[&with, &without],
    )?;
    page.paragraph(&format!(
        "The ball crosses the picture while the shutter is open. On the left its shadow is blurred \
         as the ball is: each of the {} rays of a pixel has its own time. On the right the map was \
         built as if the ball stood still in the middle of its path. Its light then frames the \
         ball more closely, so the two maps resolve the ball differently. The maps were built in \
         {} and {}, and take {} and {}.",
        scene.lights[0].samples,
        seconds(map.build_time),
        seconds(still.build_time),
        size(map.bytes[0]),
        size(still.bytes[0]),
    ));
    Ok(())
}

/// Writes the pictures of section 5.2: coloured shadows.
pub fn colour(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Section 5.2: coloured shadows");
    let scene = studio.scene("glass")?;
    let map = studio.map(&scene, "glass")?;
    let (picture, took) = studio.shot(
        &scene,
        &Settings {
            resolution: Some([640, 480]),
            ..page_settings(from_map(&map))
        },
    )?;
    page.pictures(
        "glass.png",
        "Smoke and two panes of glass that cast coloured shadows on the ground",
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
    page.paragraph(&format!(
        "Smoke that absorbs blue light more than red, and two crossing panes of tinted glass. The \
         colours multiply where the shadows of the panes cross. {:.0} % of the map's pixels hold \
         three channels, the others one. The map was built in {} and takes {}. The picture \
         took {}.",
        100.0 * coloured as f64 / (f64::from(shape.width) * f64::from(shape.height)),
        seconds(map.build_time),
        size(map.bytes[0]),
        seconds(took.rendering),
    ));
    Ok(())
}

/// Writes the pictures of section 5.3: levels.
pub fn blur(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Section 5.3: levels, for footprints of growing width");
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
            ..page_settings(from_map(&map))
        };
        let (picture, took) = studio.shot(&scene, &settings)?;
        times.push(seconds(took.rendering));
        pictures.push(picture);
    }
    let pictures: Vec<_> = pictures.iter().collect();
    page.pictures(
        "blur.png",
        "The hair ball and its shadow with footprints of 1, 8, 32 and 96 pixels of the map",
        &pictures,
    )?;
    page.paragraph(&format!(
        "One of the lights, with footprints at least 1, 8, 32 and 96 pixels of the map wide. A \
         lookup of any width reads a few pixels of the level that fits the footprint. The pictures \
         took {}.",
        times.join(", "),
    ));
    Ok(())
}
