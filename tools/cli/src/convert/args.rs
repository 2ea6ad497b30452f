//! The command line of `dsm-convert`.

use std::fmt;
use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory, Parser, ValueEnum};
use deepshadow::{Compressor, DepthKind, Encoding, Filter, MapHeader};
use deepshadow_exr::Compression;

use super::explicit::ExplicitOptions;
use crate::label::Label;
use crate::source::{SourceArgs, SourceOptions};
use deepshadow_frame::args::{
    Region, Running, from_matches, matches, number, region, width, with_defaults,
};
use deepshadow_frame::storage::{Base, Lattice, Storage, usual};
use deepshadow_frame::stream::is_standard_output;
use deepshadow_frame::{Failure, Result, choice};

/// Converts deep images to deep shadow maps, and maps to images and arrays.
///
/// The content of INPUT and the extension of OUTPUT (or --to) choose the conversion:
///
///   deep or flat .exr -> .dsm   compresses within --tolerance
///   .dsm -> .dsm                changes codec, tiles, levels, region or tolerance; otherwise every
///                               function and error bound stays the same
///   .dsm -> .exr                deep image
///   either -> .exr or .png      flat image of --depth, --opacity or --count; a .png has 16 bits
///   either -> .npz              NumPy arrays of all functions (docs/arrays.md)
///
/// Several INPUTs need a folder as OUTPUT: dsm-convert *.exr maps/. INPUT and OUTPUT may be - for
/// standard input and output. dsm-join joins several .dsm files. OUTPUT is written atomically and
/// may be the INPUT.
#[derive(Clone, Debug, Parser)]
#[command(
    name = "dsm-convert",
    version,
    verbatim_doc_comment,
    max_term_width = 100,
    allow_negative_numbers = true
)]
pub struct Args {
    /// Files to read: OpenEXR or .dsm
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// File to write: .dsm, .exr, .png or .npz; or a folder
    #[arg(value_name = "OUTPUT")]
    pub target: PathBuf,
    /// The file that is being read.
    #[arg(skip)]
    pub input: PathBuf,
    /// The file that is being written.
    #[arg(skip)]
    pub output: PathBuf,
    /// Kind of the output [default: by the extension of OUTPUT; dsm in a folder]
    #[arg(long, value_name = "KIND", value_enum)]
    pub to: Option<Output>,
    /// Skip inputs whose outputs exist
    #[arg(long)]
    pub skip_existing: bool,

    /// Tolerance and tiles.
    #[command(flatten)]
    pub base: Base,
    /// Levels, vertices and bytes.
    #[command(flatten)]
    pub storage: Storage,
    /// The lattice of visibilities.
    #[command(flatten)]
    pub lattice: Lattice,

    /// Keep at most N levels, including the base (.dsm to .dsm)
    #[arg(
        long,
        value_name = "N",
        value_parser = |n: &str| number(n, |n: &usize| *n > 0, "a whole number above 0"),
        conflicts_with = "nomipmap",
        help_heading = "Levels, maps and regions"
    )]
    pub levels: Option<usize>,
    /// Recompute the levels from the base (.dsm to .dsm)
    #[arg(
        long,
        conflicts_with = "nomipmap",
        help_heading = "Levels, maps and regions"
    )]
    pub remip: bool,
    /// Map to convert, by name or index [default: all maps to .dsm, else the only map]
    #[arg(
        long,
        value_name = "NAME|INDEX",
        help_heading = "Levels, maps and regions"
    )]
    pub map: Option<String>,
    /// Level to convert; in a .dsm file it becomes level 0 [default: 0]
    #[arg(long, value_name = "L", help_heading = "Levels, maps and regions")]
    pub level: Option<u32>,
    /// Keep only a rectangle of pixels of the level (.dsm to .dsm, flat images, .npz)
    #[arg(
        long,
        value_name = "X,Y,W,H",
        value_parser = region,
        help_heading = "Levels, maps and regions"
    )]
    pub region: Option<Region>,

    /// The image and its samples.
    #[command(flatten)]
    pub source: SourceArgs,
    /// Let light fall from Z to ZBack; without ZBack, samples are surfaces (the default)
    #[arg(
        long,
        conflicts_with = "discrete",
        help_heading = "Deep images to read"
    )]
    pub continuous: bool,
    /// Fail on invalid samples (NaN, opacity outside 0 to 1, ZBack before Z) instead of repairing
    /// them
    #[arg(long, help_heading = "Deep images to read")]
    pub strict: bool,

    /// Name and attributes.
    #[command(flatten)]
    pub label: Label,
    /// Quantity that depths measure [default: planar if there is a camera, else unspecified]
    #[arg(
        long,
        value_name = "KIND",
        value_parser = choice(DepthKind::ALL),
        help_heading = "Description of the map"
    )]
    pub depth_kind: Option<DepthKind>,
    /// Metres in one unit of depth
    #[arg(
        long,
        value_name = "METRES",
        value_parser = |u: &str| number(u, is_unit, "above 0 metres"),
        help_heading = "Description of the map"
    )]
    pub depth_unit: Option<f64>,
    /// Matrix worldToCamera: 16 numbers, row by row, for row vectors (p' = p M), each an argument
    /// of its own, as for maketx
    #[arg(
        long = "Mcamera",
        value_names = ["M11", "M12"],
        num_args = 16,
        value_parser = finite,
        allow_negative_numbers = true,
        help_heading = "Description of the map"
    )]
    pub mcamera: Option<Vec<f64>>,
    /// Matrix worldToNDC: 16 numbers; NDC is (0,0) at the upper left and (1,1) at the lower right
    /// of the display window
    #[arg(
        long = "MNDC",
        value_names = ["M11", "M12"],
        num_args = 16,
        value_parser = finite,
        allow_negative_numbers = true,
        help_heading = "Description of the map"
    )]
    pub mndc: Option<Vec<f64>>,

    /// Write tiles of the map's tile size instead of scanlines (Nuke reads scanlines only)
    #[arg(long, help_heading = "Images to write")]
    pub tiled: bool,
    /// Write opacity as 32-bit floats (deep .exr)
    #[arg(long, conflicts_with = "half", help_heading = "Images to write")]
    pub float: bool,
    /// Write opacity as 16-bit floats (deep .exr, the default)
    #[arg(long, help_heading = "Images to write")]
    pub half: bool,
    /// Write a flat image of the visibility at depth Z
    #[arg(
        long,
        value_name = "Z",
        allow_negative_numbers = true,
        value_parser = |z: &str| number(z, |z: &f32| !z.is_nan(), "a number or inf"),
        conflicts_with_all = ["opacity", "count"],
        help_heading = "Images to write"
    )]
    pub depth: Option<f32>,
    /// With --depth: filter over a footprint W pixels of level 0 wide at each pixel centre, using
    /// the levels; pixels at the border repeat outside the map
    #[arg(
        long,
        value_name = "W",
        value_parser = width,
        allow_negative_numbers = true,
        requires = "depth",
        help_heading = "Images to write"
    )]
    pub width: Option<f32>,
    /// Filter of --width [default: triangle]
    #[arg(
        long,
        value_parser = choice(Filter::ALL),
        value_name = "NAME",
        requires = "width",
        help_heading = "Images to write"
    )]
    pub filter: Option<Filter>,
    /// Write a flat image of the opacity behind all vertices
    #[arg(long, conflicts_with = "count", help_heading = "Images to write")]
    pub opacity: bool,
    /// Write a flat image of the number of vertices; in a .png, white is the largest number, which
    /// is printed
    #[arg(long, help_heading = "Images to write")]
    pub count: bool,

    /// Print the time and the numbers of vertices and bytes
    #[arg(long, help_heading = "Running")]
    pub runstats: bool,
    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

/// The kind of an output, by its extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
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
    /// Returns the kind of the output at `path`.
    ///
    /// # Errors
    /// `Usage` for another extension, and for standard output, which has none.
    pub fn of(path: &Path) -> Result<Self> {
        if is_standard_output(path) {
            let line = "-: standard output has no extension; use --to dsm, exr, png or npz";
            return Err(Failure::Usage(line.into()));
        }
        let extension = path.extension().map(|e| e.to_ascii_lowercase());
        match extension.as_ref().and_then(|e| e.to_str()) {
            Some("dsm") => Ok(Output::Dsm),
            Some("exr") => Ok(Output::Exr),
            Some("png") => Ok(Output::Png),
            Some("npz") => Ok(Output::Npz),
            _ => Err(Failure::Usage(format!(
                "{}: unknown extension of the output; use .dsm, .exr, .png or .npz, or --to",
                path.display()
            ))),
        }
    }
}

impl Args {
    /// Builds the command, with the defaults of this program in its help.
    pub fn command() -> Command {
        let defaults = [
            (
                "tolerance",
                "0.01 from .exr to .dsm, else 0.001; 0.002 to deep .exr, added to the error of the \
                 map",
            ),
            ("mip_tolerance", "the tolerance"),
            ("compressor", "minimal"),
            (
                "compression",
                "zstd:15; deep .exr takes none, rle, zips or zstd, with the default zips",
            ),
            ("tile", "32, or the input's"),
            ("name", "the name of the part, or main"),
        ];
        with_defaults(<Args as CommandFactory>::command(), &defaults)
    }

    /// Parses the arguments of the process. Also returns which options the user wrote.
    ///
    /// # Errors
    /// `Usage`, in one line.
    pub fn from_command_line() -> Result<(Self, ExplicitOptions)> {
        let matches = matches(Args::command(), std::env::args_os())?;
        Ok((from_matches(&matches)?, ExplicitOptions::of(&matches)))
    }

    /// Returns the encoding of `.dsm` output.
    ///
    /// # Errors
    /// `Usage` for an unknown codec.
    pub fn encoding(&self) -> Result<Encoding> {
        self.storage.encoding(usual(Compressor::Minimal))
    }

    /// Whether the output is a flat image.
    pub fn is_flat(&self) -> bool {
        self.depth.is_some() || self.opacity || self.count
    }

    /// Returns the options for samples of a deep image.
    pub fn source_options(&self) -> SourceOptions {
        SourceOptions {
            strict: self.strict,
            ..self.source.options()
        }
    }

    /// Returns the compression of deep OpenEXR output.
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
                "--compression {name}: unknown for .exr; known are none, rle, zips and zstd"
            ))),
        }
    }

    /// Applies the options that describe a map to `header`.
    pub fn describe(&self, header: &mut MapHeader) {
        self.label.describe(header);
        header.tile_size = self.base.tile.unwrap_or(header.tile_size);
        let camera = &mut header.camera;
        for (given, place) in [
            (&self.mcamera, &mut camera.camera_from_world),
            (&self.mndc, &mut camera.ndc_from_world),
        ] {
            let matrix = given.as_ref().map(|m| <[f64; 16]>::try_from(m.as_slice()));
            let Some(Ok(matrix)) = matrix else { continue };
            *place = Some(matrix);
            if header.depth_kind == DepthKind::Unspecified {
                header.depth_kind = DepthKind::Planar;
            }
        }
        header.depth_kind = self.depth_kind.unwrap_or(header.depth_kind);
        header.depth_unit = self.depth_unit.unwrap_or(header.depth_unit);
    }
}

fn finite(text: &str) -> std::result::Result<f64, String> {
    number(text, |v: &f64| v.is_finite(), "a finite number")
}

fn is_unit(metres: &f64) -> bool {
    *metres > 0.0 && metres.is_finite()
}
