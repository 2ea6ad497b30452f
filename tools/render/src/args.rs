//! The command line of `dsm-render`.

use std::path::PathBuf;

use clap::Parser;
use deepshadow::Filter;
use deepshadow_frame::args::{Region, Resolution, Running, number, region};
use deepshadow_frame::{Failure, Result, choice};

use crate::render::{Settings, Source};

/// Renders pictures of scenes with shadows, and compares pictures.
///
///   dsm-render SCENE.toml OUT.png --shadows MAP.dsm        deep shadow map, maps named like lights
///   dsm-render SCENE.toml OUT.exr --reference              shadow rays
///   dsm-render SCENE.toml OUT.exr --pcf --taps 400         plain shadow map
///   dsm-render --compare A.exr B.exr --difference D.png    difference between pictures
///
/// PNG is 8-bit sRGB, clamped to 0 to 1; EXR is linear. Light does not fall off with distance: a
/// surface that faces a light of colour 1 is as bright as its own colour. Points outside a light's
/// map are lit. OUT is written atomically. SCENE.toml may be - for standard input, OUT - for a PNG
/// on standard output.
#[derive(Debug, Parser)]
#[command(
    name = "dsm-render",
    version,
    verbatim_doc_comment,
    max_term_width = 100,
    allow_negative_numbers = true
)]
pub struct Args {
    /// Scene to render; with --compare the first picture, .png or .exr
    #[arg(value_name = "SCENE.toml")]
    pub first: PathBuf,
    /// Picture to write, .png or .exr; with --compare the second picture
    #[arg(value_name = "OUT")]
    pub second: PathBuf,

    /// Use a deep shadow map
    #[arg(
        long,
        value_name = "MAP.dsm",
        group = "source",
        help_heading = "Shadows, one of"
    )]
    pub shadows: Option<PathBuf>,
    /// Use shadow rays: one to each point at the time of the camera ray, or RAYS over the footprint
    /// and the shutter, the answer of a map without error
    #[arg(
        long,
        value_name = "RAYS",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "1",
        value_parser = count,
        group = "source",
        help_heading = "Shadows, one of"
    )]
    pub reference: Option<u32>,
    /// Use a plain shadow map, RESOLUTION pixels along its longer side [default: 4096]
    #[arg(
        long,
        value_name = "RESOLUTION",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "4096",
        value_parser = side,
        group = "source",
        help_heading = "Shadows, one of"
    )]
    pub pcf: Option<u32>,
    /// Render without shadows
    #[arg(long, group = "source", help_heading = "Shadows, one of")]
    pub no_shadows: bool,

    /// Filter of lookups
    #[arg(
        long,
        value_parser = choice(Filter::ALL),
        default_value_t,
        help_heading = "Lookups"
    )]
    pub filter: Filter,
    /// Make footprints F times as wide as camera rays, and at least F pixels of the map wide
    #[arg(
        long,
        value_name = "F",
        default_value_t = 1.0,
        value_parser = |f: &str| number(f, is_blur, "a number above 0, up to a million"),
        help_heading = "Lookups"
    )]
    pub blur: f64,
    /// Bias subtracted from the depth of surfaces, in units of depth, for all kinds of shadows
    /// [default: 1.5 widths of the footprint]
    #[arg(
        long,
        value_name = "DEPTH",
        value_parser = |b: &str| number(b, |b: &f64| b.is_finite(), "a finite number"),
        help_heading = "Lookups"
    )]
    pub bias: Option<f64>,
    /// Taps of a lookup in a plain map [default: 16]
    #[arg(long, value_name = "N", value_parser = count, help_heading = "Lookups")]
    pub taps: Option<u32>,
    /// Capacity of the cache of a deep map in MiB [default: a quarter of --memory]
    #[arg(long, value_name = "MIB", help_heading = "Lookups")]
    pub cache: Option<usize>,
    /// Use only this light
    #[arg(long, value_name = "NAME", help_heading = "Lookups")]
    pub only_light: Option<String>,

    /// Pixels of the picture: a side, or width and height [default: the scene's]
    #[arg(long, value_name = "N|WxH", help_heading = "Picture")]
    pub resolution: Option<Resolution>,
    /// Region to render, in pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = region, help_heading = "Picture")]
    pub crop: Option<Region>,
    /// Rays per pixel, 1 to 65536
    #[arg(
        long,
        value_name = "N",
        default_value_t = 16,
        value_parser = count,
        help_heading = "Picture"
    )]
    pub spp: u32,
    /// Filter over the rays of a pixel, as wide as the pixel
    #[arg(
        long,
        value_parser = choice(Filter::ALL),
        default_value_t,
        help_heading = "Picture"
    )]
    pub pixel_filter: Filter,
    /// Seed of all random numbers [default: the scene's]
    #[arg(long, value_name = "SEED", help_heading = "Picture")]
    pub seed: Option<u64>,
    /// Render the fraction of light that arrives, averaged over all lights, instead of colours
    #[arg(long, help_heading = "Picture")]
    pub shadow_only: bool,

    /// Compare two pictures
    #[arg(long, help_heading = "Comparison")]
    pub compare: bool,
    /// Picture of the difference to write: middle grey means equal
    #[arg(
        long,
        value_name = "D.png",
        requires = "compare",
        help_heading = "Comparison"
    )]
    pub difference: Option<PathBuf>,

    /// Print times, lookups and memory
    #[arg(long, help_heading = "Running")]
    pub runstats: bool,
    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

/// Most rays per pixel, rays per footprint and taps per lookup.
const MOST: u32 = 1 << 16;
/// Longest side of a picture and of a plain map, in pixels.
const LONGEST: u32 = 1 << 15;

impl Args {
    /// Converts the arguments to render settings.
    ///
    /// # Errors
    /// `Usage` for values outside their ranges, or without a source of shadows.
    pub fn settings(&self, scene_seed: u64) -> Result<Settings> {
        if self.taps.is_some() && self.pcf.is_none() {
            return Err(Failure::Usage("--taps: goes with --pcf".into()));
        }
        if self.cache.is_some() && self.shadows.is_none() {
            return Err(Failure::Usage("--cache: goes with --shadows".into()));
        }
        let shadows = match (&self.shadows, self.reference, self.pcf, self.no_shadows) {
            (Some(path), ..) => Source::Map(
                path.clone(),
                self.cache
                    .map_or(self.running.limits(1).memory as usize / 4, |mib| {
                        mib.saturating_mul(1 << 20)
                    }),
            ),
            (_, Some(rays), ..) => Source::Rays(rays),
            (_, _, Some(side), _) => Source::Plain(side, self.taps.unwrap_or(16)),
            (.., true) => Source::None,
            _ => {
                return Err(Failure::Usage(
                    "no source of shadows: use --shadows MAP.dsm, --reference, --pcf or \
                     --no-shadows"
                        .into(),
                ));
            }
        };
        let resolution = self.resolution.map(|r| [r.width, r.height]);
        if let Some([w, h]) = resolution.filter(|r| r.iter().any(|side| *side > LONGEST)) {
            return Err(Failure::Usage(format!(
                "--resolution {w}x{h}: more than {LONGEST} pixels along a side"
            )));
        }
        let filter = self.filter;
        if filter == Filter::CatmullRom && !matches!(shadows, Source::Map(..) | Source::None) {
            return Err(Failure::Usage(
                "--filter catmull-rom: has negative weights, and goes with --shadows".into(),
            ));
        }
        let pixel_filter = self.pixel_filter;
        if pixel_filter == Filter::CatmullRom {
            return Err(Failure::Usage(
                "--pixel-filter catmull-rom: has negative weights".into(),
            ));
        }
        Ok(Settings {
            shadows,
            spp: self.spp,
            pixel_filter,
            resolution,
            crop: self.crop,
            seed: self.seed.unwrap_or(scene_seed),
            shadow_only: self.shadow_only,
            only_light: self.only_light.clone(),
            filter,
            blur: self.blur,
            bias: self.bias,
            timed: self.runstats,
        })
    }
}

fn count(text: &str) -> std::result::Result<u32, String> {
    number(
        text,
        |n| (1..=MOST).contains(n),
        "a whole number from 1 to 65536",
    )
}

fn side(text: &str) -> std::result::Result<u32, String> {
    number(
        text,
        |n| (1..=LONGEST).contains(n),
        "a whole number from 1 to 32768",
    )
}

fn is_blur(factor: &f64) -> bool {
    *factor > 0.0 && *factor <= 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(rest: &[&str]) -> Result<Settings> {
        let line = ["dsm-render", "a.toml", "a.png"].iter().chain(rest);
        Args::try_parse_from(line)
            .map_err(|e| Failure::Usage(e.to_string()))?
            .settings(7)
    }

    #[test]
    fn options_with_a_number_have_a_default() {
        let source = |rest: &[&str]| args(rest).unwrap().shadows;
        assert!(matches!(source(&["--pcf"]), Source::Plain(4096, 16)));
        assert!(matches!(
            source(&["--pcf=512", "--taps", "9"]),
            Source::Plain(512, 9)
        ));
        assert!(matches!(source(&["--reference"]), Source::Rays(1)));
        assert!(matches!(source(&["--reference=64"]), Source::Rays(64)));
        assert_eq!(args(&["--no-shadows"]).unwrap().seed, 7);
        assert_eq!(args(&["--no-shadows", "--seed", "3"]).unwrap().seed, 3);
    }

    #[test]
    fn what_makes_no_sense_is_a_usage_error() {
        for wrong in [
            &[][..],
            &["--pcf", "--reference"],
            &["--no-shadows", "--spp", "0"],
            &["--no-shadows", "--blur", "nan"],
            &["--no-shadows", "--bias", "inf"],
            &["--no-shadows", "--crop", "1,2,3"],
            &["--no-shadows", "--resolution", "0x5"],
            &["--no-shadows", "--taps", "4"],
            &["--pcf=0"],
            &["--pcf", "--filter", "catmull-rom"],
            &["--no-shadows", "--pixel-filter", "catmull-rom"],
        ] {
            let refused = args(wrong).unwrap_err();
            assert!(matches!(refused, Failure::Usage(_)), "{wrong:?}: {refused}");
        }
    }
}
