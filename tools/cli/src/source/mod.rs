//! Deep images: the exact transmittance function of each pixel.
//!
//! | module | contents |
//! |---|---|
//! | this one | [`DeepSource`]: opening an image, one [`Ray`] per pixel |
//! | [`mod@header`] | the headers of images converted to those of maps, and back |
//! | [`mod@against`] | the largest true error of each level of a map |

pub mod against;
pub mod args;
pub mod header;

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use deepshadow::{Interpretation, MapHeader, Ray};
use deepshadow_exr::samples::{DeepSample, Policy, Repairs, SampleChannels};
use deepshadow_exr::{DeepReader, Part, Rect};

pub use against::{LevelDeviation, against};
pub use args::SourceArgs;
use deepshadow_frame::foreign::FileKind;
use deepshadow_frame::stream::Input;
use deepshadow_frame::{Failure, InFile, Result};

/// Options for the samples of a deep image.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceOptions {
    /// Name or index of the part. `None` is the first deep part, else the first with a channel `Z`.
    pub part: Option<String>,
    /// Prefix of the channels, such as `smoke` in `smoke.Z`. `None` is no prefix, else the only
    /// layer with a channel `Z`.
    pub layer: Option<String>,
    /// Factor for all depths, in f32 arithmetic. A negative factor swaps the ends of samples.
    pub zscale: f32,
    /// A pixel becomes opaque at the first depth where the samples that end there or in front of it
    /// have at least this opacity together, in every channel.
    pub opacity_limit: Option<f32>,
    /// Whether samples are surfaces at `Z`; ignores `ZBack`.
    pub discrete: bool,
    /// Whether invalid samples are an error. Otherwise they are repaired or dropped.
    pub strict: bool,
}

impl Default for SourceOptions {
    fn default() -> Self {
        SourceOptions {
            part: None,
            layer: None,
            zscale: 1.0,
            opacity_limit: None,
            discrete: false,
            strict: false,
        }
    }
}

/// Counts of the pixels read from a deep image. A pixel that is read twice counts twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Pixels read.
    pub pixels: u64,
    /// Samples with opacity above 0.
    pub samples: u64,
    /// Samples repaired or dropped.
    pub repairs: Repairs,
    /// Pixels that became opaque by [`SourceOptions::opacity_limit`].
    pub limited: u64,
}

impl Tally {
    fn add(&mut self, other: &Tally) {
        self.pixels += other.pixels;
        self.samples += other.samples;
        self.repairs.add(&other.repairs);
        self.limited += other.limited;
    }
}

/// A deep image, or a flat image of depths, as exact functions of its pixels.
///
/// A sample without thickness is a surface. In a thick sample, light falls exponentially
/// (`spec/semantics.md`, section 4). Without a channel of opacity, samples are opaque. Pixels are
/// read on each call and not cached. Any number of threads may read.
#[derive(Debug)]
pub struct DeepSource {
    path: PathBuf,
    reader: DeepReader,
    part: usize,
    channels: SampleChannels,
    options: SourceOptions,
    header: MapHeader,
    tally: Mutex<Tally>,
}

impl DeepSource {
    /// Opens the image at `path`.
    ///
    /// # Errors
    /// `Failed` in one line that names the file: for a file of another kind, for damage, and for an
    /// unknown part or layer.
    pub fn open(path: impl AsRef<Path>, options: &SourceOptions) -> Result<Self> {
        let path = path.as_ref();
        Self::of(path, Input::open(path).in_file(path)?, options)
    }

    /// Reads an open image; errors name it `path`.
    ///
    /// # Errors
    /// As [`DeepSource::open`].
    pub fn of(path: &Path, input: Input, options: &SourceOptions) -> Result<Self> {
        Self::unnamed(path, input, options).in_file(path)
    }

    fn unnamed(path: &Path, mut input: Input, options: &SourceOptions) -> Result<Self> {
        match input.kind()? {
            FileKind::OpenExr => {}
            other => return Err(Failure::Failed(format!("not an OpenEXR file, but {other}"))),
        }
        if !(options.zscale.is_finite() && options.zscale != 0.0) {
            return Err(Failure::Usage(format!(
                "the depth scale {} must be finite and not 0",
                options.zscale
            )));
        }
        let reader = DeepReader::from_file(input.file()?)?;
        let part = find_part(&reader, options.part.as_deref())?;
        let description = &reader.parts()[part];
        let channels = SampleChannels::of(description, options.layer.as_deref())?;
        let mut header = header::map_header(description, &channels)?;
        header.interpretation = match channels.has_z_back() && !options.discrete {
            true => Interpretation::Continuous,
            false => Interpretation::Discrete,
        };
        Ok(DeepSource {
            path: path.to_owned(),
            reader,
            part,
            channels,
            options: options.clone(),
            header,
            tally: Mutex::default(),
        })
    }

    /// Returns the header of a map of this image: size, name, windows, camera and attributes, and
    /// three channels if the image has colour. Depths are planar, as in OpenEXR, if the image has a
    /// camera, else unspecified.
    pub fn header(&self) -> &MapHeader {
        &self.header
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The part of the file to read.
    pub fn part(&self) -> &Part {
        &self.reader.parts()[self.part]
    }

    /// Whether samples may be thick.
    pub fn has_thickness(&self) -> bool {
        self.channels.has_z_back() && !self.options.discrete
    }

    /// Rows in a block of the file. Bands of a multiple of this are the fastest to read.
    pub fn block_rows(&self) -> u32 {
        self.part().block_rect(0).map_or(1, |r| r.height)
    }

    /// Reads the exact functions of a rectangle of pixels, row by row. (0, 0) is the first pixel of
    /// the data window.
    ///
    /// # Errors
    /// `Failed` in one line that names the file: for damage, for a limit, for an invalid sample if
    /// the options are strict, and for a rectangle that is empty or outside the image.
    pub fn rays(&self, x: u32, y: u32, width: u32, height: u32) -> Result<Vec<Ray>> {
        let (rays, tally) = self.read(x, y, width, height).in_file(&self.path)?;
        self.tally.lock().expect("no holder panics").add(&tally);
        Ok(rays)
    }

    fn read(&self, x: u32, y: u32, width: u32, height: u32) -> Result<(Vec<Ray>, Tally)> {
        let window = self.part().data_window;
        let inside =
            |at: u32, n: u32, side: u32| n > 0 && u64::from(at) + u64::from(n) <= u64::from(side);
        if !inside(x, width, window.width) || !inside(y, height, window.height) {
            let what = format!("no {width} x {height} pixels at {x},{y}");
            return Err(Failure::Failed(what));
        }
        let rect = Rect {
            x: window.x.wrapping_add_unsigned(x),
            y: window.y.wrapping_add_unsigned(y),
            width,
            height,
        };
        let block = self.reader.read_rect(self.part, rect)?;
        let policy = match self.options.strict {
            true => Policy::Strict,
            false => Policy::Repair,
        };
        let pixels = rect.pixels() as usize;
        let mut tally = Tally {
            pixels: pixels as u64,
            ..Tally::default()
        };
        let mut rays = Vec::with_capacity(pixels);
        let mut samples = Vec::new();
        for p in 0..pixels {
            self.channels
                .pixel(&block, p, policy, &mut tally.repairs, &mut samples)?;
            self.adapt(&mut samples, &mut tally);
            tally.samples += samples.len() as u64;
            let mut ray = Ray::new();
            for s in &samples {
                ray.thick(s.z, s.z_back, s.opacity)?;
            }
            if let Some(z) = self.opaque_from(&mut samples) {
                ray.surface(z, 1.0)?;
                tally.limited += 1;
            }
            rays.push(ray);
        }
        Ok((rays, tally))
    }

    /// Scales depths and removes thickness, as the options ask.
    fn adapt(&self, samples: &mut Vec<DeepSample>, tally: &mut Tally) {
        let scale = self.options.zscale;
        if scale != 1.0 {
            samples.retain_mut(|s| {
                let (front, back) = (s.z * scale, s.z_back * scale);
                (s.z, s.z_back) = (front.min(back), front.max(back));
                let fits = s.z.is_finite() && s.z_back.is_finite();
                tally.repairs.infinite += u64::from(!fits);
                fits
            });
        }
        if self.options.discrete {
            // Keep the end that faces the light.
            samples.iter_mut().for_each(|s| match scale > 0.0 {
                true => s.z_back = s.z,
                false => s.z = s.z_back,
            });
        }
    }

    /// Returns the depth at which the accumulated opacity reaches the limit, unless it is 1 there.
    fn opaque_from(&self, samples: &mut [DeepSample]) -> Option<f32> {
        let limit = f64::from(self.options.opacity_limit?);
        let end = |s: &DeepSample| if s.opacity == [1.0; 3] { s.z } else { s.z_back };
        samples.sort_by(|a, b| end(a).total_cmp(&end(b)));
        let mut left = [1.0; 3];
        for s in samples.iter() {
            for (left, opacity) in left.iter_mut().zip(s.opacity) {
                *left *= 1.0 - f64::from(opacity);
            }
            if left.iter().all(|left| 1.0 - left >= limit) {
                return (left != [0.0; 3]).then_some(end(s));
            }
        }
        None
    }

    /// Counts of all pixels that [`DeepSource::rays`] has read.
    pub fn tally(&self) -> Tally {
        *self.tally.lock().expect("no holder panics")
    }

    /// Counts of the samples that were repaired or dropped.
    pub fn repairs(&self) -> Repairs {
        self.tally().repairs
    }
}

/// Returns the index of the part with this name, else with this index; by default, of the first
/// part with depths.
fn find_part(reader: &DeepReader, name: Option<&str>) -> Result<usize> {
    let parts = reader.parts();
    let Some(name) = name else {
        return reader.first_depth_part().ok_or_else(|| {
            Failure::Failed("no part is deep or has a channel Z, so the image has no depths".into())
        });
    };
    let named = parts.iter().position(|p| p.name.as_deref() == Some(name));
    let numbered = || name.parse().ok().filter(|&i: &usize| i < parts.len());
    named.or_else(numbered).ok_or_else(|| {
        let names = parts.iter().take(20).enumerate();
        let names: Vec<_> = names
            .map(|(i, p)| p.name.clone().unwrap_or_else(|| i.to_string()))
            .collect();
        Failure::Failed(format!(
            "no part {name:?}; the file has {}",
            names.join(", ")
        ))
    })
}
