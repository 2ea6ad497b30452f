//! The command line of `dsm-convert`.

use std::fmt;
use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory, Parser};
use deepshadow::{Codec, Compressor, DepthKind, Encoding, Filter, MapHeader};
use deepshadow_exr::Compression;

use super::given::Given;
use crate::label::Label;
use crate::source::{SourceArgs, SourceOptions};
use deepshadow_frame::args::{Region, Running, from_matches, matches, region, with_defaults};
use deepshadow_frame::storage::{Base, Lattice, Storage};
use deepshadow_frame::{Failure, Result, choice};

/// Converts deep images to deep shadow maps, and back.
///
/// What INPUT is, its content says; what OUTPUT becomes, its extension:
///
///   deep or flat .exr -> .dsm   compressed within --tolerance
///   .dsm -> .dsm                other codec, tiles, levels, region, tolerance; without these, every function and promise stays
///   .dsm -> .exr                a deep image; with --depth, --opacity or --count a flat one
///   .dsm -> .png                with --depth, --opacity or --count, 16 bits
///   .dsm -> .npz                NumPy arrays: offsets, z, visibility, mono, max_error
///
/// dsm-join makes one .dsm of several.
///
/// OUTPUT appears whole or not at all; it may be an INPUT.
#[derive(Debug, Parser)]
#[command(
    name = "dsm-convert",
    version,
    verbatim_doc_comment,
    max_term_width = 100,
    allow_negative_numbers = true
)]
pub struct Args {
    /// The file to read: OpenEXR or .dsm
    pub input: PathBuf,
    /// The file to write: .dsm, .exr, .png or .npz
    pub output: PathBuf,
    /// Tolerance and tiles.
    #[command(flatten)]
    pub base: Base,
    /// Levels, vertices and bytes.
    #[command(flatten)]
    pub storage: Storage,
    /// The lattice of visibilities.
    #[command(flatten)]
    pub lattice: Lattice,

    /// At most so many levels, the base included (.dsm to .dsm)
    #[arg(
        long,
        value_name = "N",
        conflicts_with = "nomipmap",
        help_heading = "Levels, maps and regions"
    )]
    pub levels: Option<usize>,
    /// Make the levels anew from the base (.dsm to .dsm)
    #[arg(
        long,
        conflicts_with = "nomipmap",
        help_heading = "Levels, maps and regions"
    )]
    pub remip: bool,
    /// The map to convert, by name or number, in each file [default: all to .dsm, else the only one]
    #[arg(
        long,
        value_name = "NAME|INDEX",
        help_heading = "Levels, maps and regions"
    )]
    pub map: Option<String>,
    /// The level to convert [default: 0]
    #[arg(long, value_name = "L", help_heading = "Levels, maps and regions")]
    pub level: Option<u32>,
    /// Cut out a rectangle of the map's pixels (.dsm to .dsm)
    #[arg(long, value_name = "X,Y,W,H", value_parser = region, help_heading = "Levels, maps and regions")]
    pub region: Option<Region>,

    /// The image and its samples.
    #[command(flatten)]
    pub source: SourceArgs,
    /// Light falls from Z to ZBack; where there is no ZBack, samples are surfaces (the default)
    #[arg(long, conflicts_with = "discrete", help_heading = "Deep images in")]
    pub continuous: bool,
    /// Refuse samples that mean nothing (NaN, opacity beyond 0..1, ZBack before Z) instead of mending them
    #[arg(long, help_heading = "Deep images in")]
    pub strict: bool,

    /// Name and attributes.
    #[command(flatten)]
    pub label: Label,
    /// What depths measure [default: planar if there is a camera, else unspecified]
    #[arg(
        long,
        value_parser = choice(DepthKind::ALL),
        help_heading = "What the map says of itself"
    )]
    pub depth_kind: Option<DepthKind>,
    /// Metres in one unit of depth
    #[arg(
        long,
        value_name = "METRES",
        help_heading = "What the map says of itself"
    )]
    pub depth_unit: Option<f64>,
    /// worldToCamera, row by row, for row vectors (p' = p M)
    #[arg(
        long = "Mcamera",
        value_name = "M",
        num_args = 16,
        allow_negative_numbers = true,
        help_heading = "What the map says of itself"
    )]
    pub mcamera: Option<Vec<f64>>,
    /// worldToNDC, to (0,0) upper left .. (1,1) lower right of the display window
    #[arg(
        long = "MNDC",
        value_name = "M",
        num_args = 16,
        allow_negative_numbers = true,
        help_heading = "What the map says of itself"
    )]
    pub mndc: Option<Vec<f64>>,

    /// Tiles of the map's size instead of lines (Nuke reads lines only)
    #[arg(long, help_heading = "Images out")]
    pub tiled: bool,
    /// Opacity as 32-bit floats (deep .exr)
    #[arg(long, conflicts_with = "half", help_heading = "Images out")]
    pub float: bool,
    /// Opacity as 16-bit floats (deep .exr), the default
    #[arg(long, help_heading = "Images out")]
    pub half: bool,
    /// A flat image of the visibility at depth Z
    #[arg(long, value_name = "Z", allow_negative_numbers = true, conflicts_with_all = ["opacity", "count"], help_heading = "Images out")]
    pub depth: Option<f32>,
    /// With --depth: filtered at the centre of every pixel of level 0, over a footprint so many of its pixels wide, through the levels; at
    /// the border of the map its pixels go on
    #[arg(long, value_name = "W", help_heading = "Images out")]
    pub width: Option<f32>,
    /// The filter of --width [default: triangle]
    #[arg(
        long,
        value_parser = choice(Filter::ALL),
        hide_possible_values = true,
        value_name = "nearest|box|triangle|gaussian|catmull-rom",
        help_heading = "Images out"
    )]
    pub filter: Option<Filter>,
    /// A flat image of the opacity behind everything
    #[arg(long, conflicts_with = "count", help_heading = "Images out")]
    pub opacity: bool,
    /// A flat image of the number of vertices; white in a .png is the largest, which is reported
    #[arg(long, help_heading = "Images out")]
    pub count: bool,

    /// Say how long it took, and what became of vertices and bytes
    #[arg(long, help_heading = "Running")]
    pub runstats: bool,
    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

/// What an output is, by its extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// A deep shadow map.
    Dsm,
    /// An OpenEXR image.
    Exr,
    /// A PNG image.
    Png,
    /// NumPy arrays.
    Npz,
}

impl fmt::Display for Output {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Output::Dsm => ".dsm",
            Output::Exr => ".exr",
            Output::Png => ".png",
            Output::Npz => ".npz",
        })
    }
}

impl Output {
    /// # Errors
    /// `Usage` for another extension.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_ascii_lowercase());
        match extension.as_ref().and_then(|e| e.to_str()) {
            Some("dsm") => Ok(Output::Dsm),
            Some("exr") => Ok(Output::Exr),
            Some("png") => Ok(Output::Png),
            Some("npz") => Ok(Output::Npz),
            _ => Err(Failure::Usage(format!(
                "{}: the extension of the output is none of .dsm, .exr, .png, .npz",
                path.display()
            ))),
        }
    }
}

impl Args {
    /// The command, its help complete.
    pub fn command() -> Command {
        let defaults = [
            (
                "tolerance",
                "0.01 from .exr; 0.002 to deep .exr, where it adds to the map's promise",
            ),
            ("mip_tolerance", "the tolerance"),
            ("compressor", "minimal"),
            (
                "compression",
                "zstd:15; for deep .exr none, rle, zips or zstd, and zips",
            ),
            ("tile", "32, or the input's"),
            ("name", "the part's, or `main`"),
        ];
        with_defaults(<Args as CommandFactory>::command(), &defaults)
    }

    /// The arguments of the process, and which options they give.
    ///
    /// # Errors
    /// `Usage`, in one line.
    pub fn from_command_line() -> Result<(Self, Given)> {
        let matches = matches(Args::command(), std::env::args_os())?;
        Ok((from_matches(&matches)?, Given::of(&matches)))
    }

    /// How a `.dsm` file stores its maps.
    ///
    /// # Errors
    /// `Usage` for numbers outside their domains.
    pub fn encoding(&self) -> Result<Encoding> {
        self.base.tolerance()?;
        let usual = Encoding::default()
            .compressor(Compressor::Minimal)
            .codec(Codec::Zstd(15));
        self.storage.encoding(usual)
    }

    /// Whether a flat image is asked for.
    pub fn is_flat(&self) -> bool {
        self.depth.is_some() || self.opacity || self.count
    }

    /// How the samples of a deep image are taken.
    ///
    /// # Errors
    /// `Usage` for numbers outside their domains.
    pub fn source_options(&self) -> Result<SourceOptions> {
        Ok(SourceOptions {
            strict: self.strict,
            ..self.source.options()?
        })
    }

    /// How blocks of a deep OpenEXR file are packed.
    ///
    /// # Errors
    /// `Usage` for an unknown name.
    pub fn exr_compression(&self) -> Result<Compression> {
        match self.storage.compression.as_deref() {
            None | Some("zips") => Ok(Compression::Zips),
            Some("none") => Ok(Compression::None),
            Some("rle") => Ok(Compression::Rle),
            Some("zstd") => Ok(Compression::Zstd),
            Some(name) => Err(Failure::Usage(format!(
                "--compression {name} is none of none, rle, zips, zstd"
            ))),
        }
    }

    /// Changes in `header` what the options say of it.
    ///
    /// # Errors
    /// `Usage` for numbers outside their domains.
    pub fn describe(&self, header: &mut MapHeader) -> Result<()> {
        self.label.describe(header);
        if let Some(tile) = self.base.tile()? {
            header.tile_size = tile;
        }
        for (given, place, option) in [
            (
                &self.mcamera,
                &mut header.camera.camera_from_world,
                "Mcamera",
            ),
            (&self.mndc, &mut header.camera.ndc_from_world, "MNDC"),
        ] {
            if let Some(matrix) = given {
                let matrix = <[f64; 16]>::try_from(matrix.as_slice()).ok();
                let matrix = matrix.filter(|m| m.iter().all(|v| v.is_finite()));
                let wrong = || Failure::Usage(format!("--{option} takes 16 finite numbers"));
                *place = Some(matrix.ok_or_else(wrong)?);
                if header.depth_kind == DepthKind::Unspecified {
                    header.depth_kind = DepthKind::Planar;
                }
            }
        }
        header.depth_kind = self.depth_kind.unwrap_or(header.depth_kind);
        if let Some(unit) = self.depth_unit {
            if !(unit.is_finite() && unit > 0.0) {
                return Err(Failure::Usage(format!("--depth-unit {unit} is no length")));
            }
            header.depth_unit = unit;
        }
        Ok(())
    }
}
