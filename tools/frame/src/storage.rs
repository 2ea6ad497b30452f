//! Options for how maps are stored: the same in every program that writes them.

use clap::Args;
use deepshadow::{Codec, Compressor, Encoding, Mips, Precision};

use crate::{Failure, Result, choice};

/// How the levels, the tiles and the vertices of a map are stored.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Storage {
    /// Largest error of the levels above the base
    #[arg(long, value_name = "E")]
    pub mip_tolerance: Option<f64>,
    /// How hard to try for few vertices
    #[arg(long, value_parser = choice(Compressor::ALL))]
    pub compressor: Option<Compressor>,
    /// Compression of tiles: none, lz4, zstd or zstd:LEVEL
    #[arg(short = 'z', long, value_name = "NAME")]
    pub compression: Option<String>,
    /// The base level alone
    #[arg(short = 'm', long)]
    pub nomipmap: bool,
}

/// How the base level of a map is stored.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Base {
    /// Largest error of a function
    #[arg(long, value_name = "E")]
    pub tolerance: Option<f64>,
    /// Side of a tile: 8, 16, 32, 64, 128 or 256
    #[arg(short, long, value_name = "PIXELS")]
    pub tile: Option<u32>,
}

/// How visibilities are stored.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Precision and size")]
pub struct Lattice {
    /// Steps of the lattice that visibilities are stored on; 0 for plain f32 [default: 2 /
    /// tolerance]
    #[arg(long, value_name = "STEPS")]
    pub lattice: Option<u16>,
}

impl Storage {
    /// The encoding of a map: `usual`, changed by the options.
    ///
    /// # Errors
    /// `Usage` for an unknown codec, and for a tolerance that is not from 0 to 1.
    pub fn encoding(&self, usual: Encoding) -> Result<Encoding> {
        let mut encoding = usual;
        if let Some(name) = &self.compression {
            let failure = |_| {
                let names = "none, lz4, zstd, zstd:1 to zstd:22";
                Failure::Usage(format!("--compression {name} is none of {names}"))
            };
            encoding.codec = match (name.as_str(), encoding.codec) {
                // The usual level of the program.
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

    /// The tolerance of the levels above the base.
    ///
    /// # Errors
    /// `Usage` if it is not from 0 to 1.
    pub fn mip_tolerance(&self) -> Result<Option<f64>> {
        tolerance("mip-tolerance", self.mip_tolerance)
    }
}

impl Base {
    /// The tolerance of the base.
    ///
    /// # Errors
    /// `Usage` if it is not from 0 to 1.
    pub fn tolerance(&self) -> Result<Option<f64>> {
        tolerance("tolerance", self.tolerance)
    }

    /// The side of a tile.
    ///
    /// # Errors
    /// `Usage` if there are no such tiles.
    pub fn tile(&self) -> Result<Option<u32>> {
        match self.tile {
            Some(tile) if !tile.is_power_of_two() || !(8..=256).contains(&tile) => Err(
                Failure::Usage(format!("--tile {tile} is none of 8, 16, 32, 64, 128, 256")),
            ),
            tile => Ok(tile),
        }
    }
}

impl Lattice {
    /// The precision that the user asked for, for functions within `tolerance`.
    ///
    /// # Errors
    /// `Usage` for a lattice that is coarser than the tolerance.
    pub fn precision(&self, tolerance: f64) -> Result<Option<Precision>> {
        match self.lattice {
            None => Ok(None),
            Some(0) => Ok(Some(Precision::F32)),
            Some(l) if f64::from(l) * tolerance < 1.0 => Err(Failure::Usage(format!(
                "--lattice {l} has steps that are coarser than the tolerance {tolerance}"
            ))),
            Some(l) => Ok(Some(Precision::Lattice(l))),
        }
    }
}

/// The lattice with the smallest files: its steps are half of the tolerance. Steps of a quarter,
/// the library's choice, save a few vertices and cost 2 to 3 % of the bytes of deep images.
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
