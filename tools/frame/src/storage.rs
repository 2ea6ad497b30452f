//! Options for the encoding of maps. They are the same in every program that writes maps.

use clap::Args;
use deepshadow::raw::Precision;
use deepshadow::{Codec, Compressor, Encoding, Mips};

use crate::{Failure, Result, choice};

/// Options for levels, compressor and codec.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Storage {
    /// Largest error of visibility in the levels above the base, 0 to 1
    #[arg(long, value_name = "E")]
    pub mip_tolerance: Option<f64>,
    /// Method that chooses the vertices; the error bound is the same for all
    #[arg(long, value_name = "NAME", value_parser = choice(Compressor::ALL))]
    pub compressor: Option<Compressor>,
    /// Compression of tiles: none, lz4, zstd, or zstd:LEVEL with a LEVEL from 1 to 22
    #[arg(short = 'z', long, value_name = "NAME")]
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
    #[arg(long, value_name = "E")]
    pub tolerance: Option<f64>,
    /// Side of a tile in pixels: 8, 16, 32, 64, 128 or 256
    #[arg(short, long, value_name = "PIXELS")]
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

impl Storage {
    /// Returns the encoding of a map: `usual`, changed by the options.
    ///
    /// # Errors
    /// `Usage` for an unknown codec, and for a tolerance that is not from 0 to 1.
    pub fn encoding(&self, usual: Encoding) -> Result<Encoding> {
        let mut encoding = usual;
        if let Some(name) = &self.compression {
            let failure = |_| {
                let names = "none, lz4, zstd and zstd:1 to zstd:22";
                Failure::Usage(format!(
                    "--compression {name} is unknown; known are {names}"
                ))
            };
            encoding.codec = match (name.as_str(), encoding.codec) {
                // The program's own default level.
                ("zstd", codec @ Codec::Zstd(_)) => codec,
                (name, _) => name.parse().map_err(failure)?,
            };
        }
        encoding.mip_tolerance = self.mip_tolerance()?.or(encoding.mip_tolerance);
        encoding.compressor = self.compressor.unwrap_or(encoding.compressor);
        if self.nomipmap {
            encoding.mips = Mips::None;
        }
        Ok(encoding)
    }

    /// Returns the tolerance of the levels above the base.
    ///
    /// # Errors
    /// `Usage` if it is not from 0 to 1.
    pub fn mip_tolerance(&self) -> Result<Option<f64>> {
        tolerance("mip-tolerance", self.mip_tolerance)
    }
}

impl Base {
    /// Returns the tolerance of the base.
    ///
    /// # Errors
    /// `Usage` if it is not from 0 to 1.
    pub fn tolerance(&self) -> Result<Option<f64>> {
        tolerance("tolerance", self.tolerance)
    }

    /// Returns the side of a tile.
    ///
    /// # Errors
    /// `Usage` for a side that the format does not allow.
    pub fn tile(&self) -> Result<Option<u32>> {
        match self.tile {
            Some(tile) if !tile.is_power_of_two() || !(8..=256).contains(&tile) => {
                Err(Failure::Usage(format!(
                    "--tile {tile} is not a tile size; use 8, 16, 32, 64, 128 or 256"
                )))
            }
            tile => Ok(tile),
        }
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
                "--lattice {l} is coarser than the tolerance {tolerance}: use more steps, or 0"
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

fn tolerance(option: &str, given: Option<f64>) -> Result<Option<f64>> {
    match given {
        Some(e) if !(0.0..=1.0).contains(&e) => {
            Err(Failure::Usage(format!("--{option} {e} is not from 0 to 1")))
        }
        given => Ok(given),
    }
}
