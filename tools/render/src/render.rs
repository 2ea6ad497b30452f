//! Renders a scene to a picture, with rows in parallel.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use deepshadow::Filter;
use deepshadow::raw::CacheStats;
use deepshadow_frame::{Failure, Result};
use deepshadow_scene::demo::hash::Hash;
use deepshadow_scene::samples::Samples;
use deepshadow_scene::scene::Scene;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::image::Image;
use crate::kernel::Kernel;
use crate::lamp::Lamp;
use crate::shadow::{Shadows, deep::Deep, exact::Exact, plain::Plain};
use crate::trace::{Tracer, Work, World};

/// Options of a picture.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Source of shadows.
    pub shadows: Source,
    /// Camera rays per pixel.
    pub spp: u32,
    /// The filter over the rays of a pixel, as wide as the pixel.
    pub pixel_filter: Filter,
    /// Width and height in pixels. `None` is the camera's.
    pub resolution: Option<[u32; 2]>,
    /// The part to render: x, y, width, height.
    pub crop: Option<[u32; 4]>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether to render the fraction of light that arrives instead of colours.
    pub shadow_only: bool,
    /// Name of the only light to use. `None` is all lights.
    pub only_light: Option<String>,
    /// The filter of lookups.
    pub filter: Filter,
    /// Ratio of footprint width to camera ray width; also the least width in pixels of the map.
    pub blur: f64,
    /// Bias in units of depth. `None` is [`crate::lamp::BIAS`] footprints.
    pub bias: Option<f64>,
    /// Whether to time each lookup.
    pub timed: bool,
}

/// Source of shadows.
#[derive(Clone, Debug)]
pub enum Source {
    /// No shadows.
    None,
    /// A deep shadow map, and the capacity of its cache in bytes.
    Map(PathBuf, usize),
    /// Number of shadow rays: one to the point, or several over the footprint.
    Rays(u32),
    /// A plain shadow map: its longer side in pixels, and the taps per lookup.
    Plain(u32, u32),
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            shadows: Source::None,
            spp: 16,
            pixel_filter: Filter::Triangle,
            resolution: None,
            crop: None,
            seed: 0,
            shadow_only: false,
            only_light: None,
            filter: Filter::Triangle,
            blur: 1.0,
            bias: None,
            timed: false,
        }
    }
}

/// Times, counts and memory of a rendering.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Wall time until the first ray: building the hierarchies and the plain shadow map.
    pub preparing: Duration,
    /// Wall time of rendering.
    pub rendering: Duration,
    /// Time of rendering, summed over all threads.
    pub threads: Duration,
    /// Number of rays and lookups.
    pub work: Work,
    /// Statistics of the cache of a deep map.
    pub cache: Option<CacheStats>,
    /// Differences between the scene and the map, a line each.
    pub notes: Vec<String>,
    /// Bytes of memory for shadows: peak of the cache, plain map, or geometry for shadow rays.
    pub bytes: usize,
}

/// Renders a scene.
///
/// The picture depends on the scene and the settings only, not on the number of threads. A crop has
/// the same pixels as the whole picture. `progress` gets the name of the phase, the amount done and
/// the total.
///
/// # Errors
/// `Usage` for invalid settings. `Failed` for an invalid camera or light, or an unsuitable map.
pub fn render(
    scene: &Scene,
    settings: &Settings,
    mut progress: impl FnMut(&'static str, u64, u64),
) -> Result<(Image, Report)> {
    let started = Instant::now();
    let camera = Camera::of(scene, settings.resolution)?;
    let region = region(settings.crop, camera.resolution)?;
    let lamps = lamps(scene, settings)?;
    let shadows = shadows(scene, settings, &lamps, &mut progress)?;
    let world = World::new(scene, &camera, &lamps, &shadows, settings.shadow_only);
    let mut report = Report {
        preparing: started.elapsed(),
        ..Report::default()
    };
    let started = Instant::now();
    let image = picture(
        &world,
        &camera,
        region,
        settings,
        &mut report,
        |done, all| {
            progress("rendering", done, all);
        },
    )?;
    report.rendering = started.elapsed();
    report.bytes = match &shadows {
        Shadows::None => 0,
        Shadows::Deep(deep) => deep.cache().stats().peak_bytes,
        Shadows::Exact(exact) => exact.bytes(),
        Shadows::Plain(plain) => plain.bytes(),
    };
    if let Shadows::Deep(deep) = &shadows {
        report.notes = deep.unlike(&lamps);
        report.cache = Some(deep.cache().stats());
    }
    Ok((image, report))
}

fn region(crop: Option<[u32; 4]>, [width, height]: [u32; 2]) -> Result<[u32; 4]> {
    let Some([x, y, w, h]) = crop else {
        return Ok([0, 0, width, height]);
    };
    let fits = |from: u32, n: u32, all: u32| n > 0 && from.checked_add(n).is_some_and(|e| e <= all);
    if fits(x, w, width) && fits(y, h, height) {
        return Ok([x, y, w, h]);
    }
    Err(Failure::Usage(format!(
        "the crop {x},{y},{w},{h} is not inside the {width} x {height} pixels of the picture"
    )))
}

fn lamps<'a>(scene: &'a Scene, settings: &Settings) -> Result<Vec<Lamp<'a>>> {
    let only = settings.only_light.as_ref();
    if let Some(name) = only.filter(|n| scene.lights.iter().all(|l| l.name != **n)) {
        let names: Vec<_> = scene
            .lights
            .iter()
            .map(|l| format!("{:?}", l.name))
            .collect();
        return Err(Failure::Usage(format!(
            "no light is called {name:?}; there are {}",
            names.join(", ")
        )));
    }
    let lights = scene.lights.iter();
    lights
        .filter(|l| only.is_none_or(|name| l.name == *name))
        .map(|l| Lamp::new(l, scene, settings.blur, settings.bias))
        .collect()
}

fn shadows<'a>(
    scene: &'a Scene,
    settings: &Settings,
    lamps: &[Lamp<'_>],
    progress: &mut impl FnMut(&'static str, u64, u64),
) -> Result<Shadows<'a>> {
    let kernel = |n: u32| {
        Kernel::new(n, settings.filter, settings.seed ^ 0x7a95).ok_or_else(|| {
            Failure::Usage(
                "a filter with negative weights works with deep shadow maps alone".into(),
            )
        })
    };
    Ok(match &settings.shadows {
        Source::None => Shadows::None,
        Source::Map(path, budget) => {
            let lights: Vec<_> = lamps.iter().map(|l| l.light).collect();
            Shadows::Deep(Deep::open(path, &lights, settings.filter, *budget)?)
        }
        Source::Rays(n) => {
            let kernel = (*n > 1).then(|| kernel(*n)).transpose()?;
            Shadows::Exact(Exact::new(scene, lamps, kernel))
        }
        Source::Plain(side, taps) => {
            let progress = |done, all| progress("the shadow map", done, all);
            Shadows::Plain(Plain::new(scene, lamps, *side, kernel(*taps)?, progress)?)
        }
    })
}

fn picture(
    world: &World<'_>,
    camera: &Camera,
    [x, y, width, height]: [u32; 4],
    settings: &Settings,
    report: &mut Report,
    mut progress: impl FnMut(u64, u64),
) -> Result<Image> {
    let kernel = Kernel::new(settings.spp, settings.pixel_filter, settings.seed);
    let kernel = kernel.ok_or_else(|| {
        Failure::Usage("the filter of a picture's pixels has no negative weights".into())
    })?;
    let line = |row: u32, tracer: &mut Tracer, samples: &mut Samples| -> Result<_> {
        let pixels = (x..x + width).map(|column| {
            let chance = Hash::new(settings.seed).at(u64::from(row) << 32 | u64::from(column));
            let (mut sum, mut failed, mut ray) = ([0.0; 3], None, 0);
            kernel.places(chance.bits(), samples, |[dx, dy], time| {
                let way = camera.way(f64::from(column) + 0.5 + dx, f64::from(row) + 0.5 + dy);
                match world.colour(way, time, chance.at(ray), tracer) {
                    Ok(colour) => (0..3).for_each(|c| sum[c] += colour[c]),
                    Err(failure) => failed = Some(failure),
                }
                ray += 1;
            });
            match failed {
                Some(failure) => Err(failure),
                None => Ok(sum.map(|v| (v / kernel.count() as f64) as f32)),
            }
        });
        pixels.collect::<Result<Vec<_>>>()
    };
    let mut pixels = Vec::new();
    let rows: Vec<u32> = (y..y + height).collect();
    let at_once = 4 * rayon::current_num_threads();
    for some in rows.chunks(at_once) {
        let made = some.par_iter().map_init(
            || (world.tracer(settings.timed), Samples::default()),
            |(tracer, samples), &row| {
                let started = Instant::now();
                let tracer = match tracer {
                    Ok(tracer) => tracer,
                    Err(failure) => return Err(Failure::Failed(failure.to_string())),
                };
                let pixels = line(row, tracer, samples)?;
                Ok((pixels, std::mem::take(&mut tracer.work), started.elapsed()))
            },
        );
        for (line, work, took) in made.collect::<Result<Vec<_>>>()? {
            pixels.extend(line);
            report.work.rays += work.rays;
            report.work.lookups += work.lookups;
            report.work.looking_up += work.looking_up;
            report.threads += took;
        }
        progress(pixels.len() as u64, u64::from(width) * u64::from(height));
    }
    Ok(Image {
        width,
        height,
        pixels,
    })
}
