//! Options for the encoding of maps. They are the same in every program that writes maps.

use clap::Args;
use deepshadow::raw::Precision;
use deepshadow::{Codec, Compressor, Encoding, Mips};

use crate::args::{fraction, number};
use crate::{Failure, Result, choice};

/// Options for levels, compressor and codec.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Storage {
    /// Largest error of visibility in the levels above the base, 0 to 1
    #[arg(long, value_name = "E", value_parser = fraction)]
    pub mip_tolerance: Option<f64>,
    /// Method that chooses the vertices; the error bound is the same for all
    #[arg(long, value_name = "NAME", value_parser = choice(Compressor::ALL))]
    pub compressor: Option<Compressor>,
    /// Compression of tiles, by name.
    #[arg(short = 'z', long, value_name = "NAME", help = codecs())]
    pub compression: Option<String>,
    /// Write only the base level
    #[arg(short = 'm', long)]
    pub nomipmap: bool,
}

/// Options for the base level of a map.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Base {
    /// Largest error of visibility, 0 to 1
    #[arg(long, value_name = "E", value_parser = fraction)]
    pub tolerance: Option<f64>,
    /// Side of a tile in pixels: 8, 16, 32, 64, 128 or 256
    #[arg(short, long, value_name = "PIXELS", value_parser = tile)]
    pub tile: Option<u32>,
}

/// Option for the precision of visibilities.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Lattice {
    /// Store visibilities as multiples of 1/STEPS; 0 stores them as 32-bit floats [default:
    /// 2/tolerance]
    #[arg(long, value_name = "STEPS")]
    pub lattice: Option<u16>,
}

/// The default encoding of the programs: one codec for all, and the compressor that suits the
/// program (`docs/design/tools.md`).
pub fn usual(compressor: Compressor) -> Encoding {
    Encoding::default()
        .compressor(compressor)
        .codec(Codec::Zstd(15))
}

impl Storage {
    /// Returns the encoding of a map: `usual`, changed by the options.
    ///
    /// # Errors
    /// `Usage` for an unknown codec.
    pub fn encoding(&self, usual: Encoding) -> Result<Encoding> {
        let mut encoding = usual;
        if let Some(name) = &self.compression {
            // The error of the library lists the codecs.
            let failure = |e| Failure::Usage(format!("--compression {name}: {e}"));
            encoding.codec = match (name.as_str(), encoding.codec) {
                // The program's own default level.
                ("zstd", codec @ Codec::Zstd(_)) => codec,
                (name, _) => name.parse().map_err(failure)?,
            };
        }
        encoding.mip_tolerance = self.mip_tolerance.or(encoding.mip_tolerance);
        encoding.compressor = self.compressor.unwrap_or(encoding.compressor);
        if self.nomipmap {
            encoding.mips = Mips::None;
        }
        Ok(encoding)
    }
}

impl Lattice {
    /// Returns the precision that the user asked for, for functions within `tolerance`.
    ///
    /// # Errors
    /// `Usage` for a lattice whose steps are larger than the tolerance.
    pub fn precision(&self, tolerance: f64) -> Result<Option<Precision>> {
        match self.lattice {
            None => Ok(None),
            Some(0) => Ok(Some(Precision::F32)),
            Some(l) if f64::from(l) * tolerance < 1.0 => Err(Failure::Usage(format!(
                "--lattice {l}: coarser than the tolerance {tolerance}; use more steps, or 0"
            ))),
            Some(l) => Ok(Some(Precision::Lattice(l))),
        }
    }
}

/// Returns the lattice that gives the smallest files: its steps are half of the tolerance. The
/// library's own choice, a quarter, saves a few vertices but makes the maps of deep images 2 to 3 %
/// larger.
pub fn small_lattice(tolerance: f64) -> Precision {
    match (2.0 / tolerance.max(Encoding::MIN_TOLERANCE)).floor() {
        steps if steps > 65_535.0 => Precision::F32,
        steps => Precision::Lattice(steps.max(4.0) as u16),
    }
}

/// The help of `--compression`, with the names of all codecs.
fn codecs() -> String {
    let names = Codec::ALL.iter().map(|codec| match codec {
        Codec::Zstd(_) => "zstd, or zstd:LEVEL with a LEVEL from 1 to 22".to_owned(),
        codec => codec.to_string(),
    });
    format!(
        "Compression of tiles: {}",
        names.collect::<Vec<_>>().join(", ")
    )
}

fn tile(text: &str) -> std::result::Result<u32, String> {
    let fits = |side: &u32| side.is_power_of_two() && (8..=256).contains(side);
    number(text, fits, "one of 8, 16, 32, 64, 128 and 256")
}
