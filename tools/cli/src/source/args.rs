//! The options for how a deep image is read, in every program that reads one.

use clap::Args;
use deepshadow_frame::{Failure, Result};

use super::SourceOptions;

/// How a deep image is read.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Deep images in")]
pub struct SourceArgs {
    /// The part of the OpenEXR file [default: the first deep one, or else the first with a Z]
    #[arg(long, value_name = "NAME|INDEX")]
    pub part: Option<String>,
    /// The layer: `smoke` for channels smoke.Z, smoke.A [default: none, or the only one with a Z]
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Multiply all depths, in f32; the camera stays as it is
    #[arg(short = 's', long, value_name = "S", allow_negative_numbers = true)]
    pub zscale: Option<f32>,
    /// A pixel becomes opaque at the first depth at which the samples that end there or before it,
    /// together, stop at least this fraction of the light in every channel
    #[arg(short = 'l', long, value_name = "L")]
    pub opacitylimit: Option<f32>,
    /// Samples are surfaces at Z, ZBack is ignored
    #[arg(long)]
    pub discrete: bool,
}

impl SourceArgs {
    /// The ids of the options.
    pub const IDS: [&str; 5] = ["part", "layer", "zscale", "opacitylimit", "discrete"];

    /// How the samples are taken; samples that mean nothing are mended.
    ///
    /// # Errors
    /// `Usage` for numbers outside their domains.
    pub fn options(&self) -> Result<SourceOptions> {
        let zscale = self.zscale.unwrap_or(1.0);
        if !(zscale.is_finite() && zscale != 0.0) {
            return Err(Failure::Usage(format!("--zscale {zscale} is no scale")));
        }
        if let Some(limit) = self.opacitylimit.filter(|l| !(*l > 0.0 && *l <= 1.0)) {
            return Err(Failure::Usage(format!(
                "--opacitylimit {limit} is not above 0 and up to 1"
            )));
        }
        Ok(SourceOptions {
            part: self.part.clone(),
            layer: self.layer.clone(),
            zscale,
            opacity_limit: self.opacitylimit,
            discrete: self.discrete,
            strict: false,
        })
    }
}
