//! Options for reading deep images. They are the same in every program that reads them.

use clap::Args;
use deepshadow_frame::args::number;

use super::SourceOptions;

/// Options for reading a deep image.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Deep images to read")]
pub struct SourceArgs {
    /// Part of the OpenEXR file [default: the first deep part, else the first with a channel Z]
    #[arg(long, value_name = "NAME|INDEX")]
    pub part: Option<String>,
    /// Layer, such as smoke for the channels smoke.Z and smoke.A [default: none, else the only
    /// layer with a channel Z]
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Multiply all depths by S; the camera does not change
    #[arg(
        short = 's',
        long,
        value_name = "S",
        allow_negative_numbers = true,
        value_parser = |s: &str| number(s, is_scale, "a finite number other than 0")
    )]
    pub zscale: Option<f32>,
    /// Make a pixel opaque at the first depth where the samples that end there or in front of it
    /// have at least opacity L together, in every channel; above 0, at most 1
    #[arg(
        short = 'l',
        long,
        value_name = "L",
        value_parser = |l: &str| number(l, is_limit, "a number above 0 and at most 1")
    )]
    pub opacitylimit: Option<f32>,
    /// Treat samples as surfaces at Z and ignore ZBack
    #[arg(long)]
    pub discrete: bool,
}

impl SourceArgs {
    /// The ids of the options.
    pub const IDS: [&str; 5] = ["part", "layer", "zscale", "opacitylimit", "discrete"];

    /// Returns the options for samples. Invalid samples are repaired.
    pub fn options(&self) -> SourceOptions {
        SourceOptions {
            part: self.part.clone(),
            layer: self.layer.clone(),
            zscale: self.zscale.unwrap_or(1.0),
            opacity_limit: self.opacitylimit,
            discrete: self.discrete,
            strict: false,
        }
    }
}

fn is_scale(scale: &f32) -> bool {
    scale.is_finite() && *scale != 0.0
}

fn is_limit(opacity: &f32) -> bool {
    *opacity > 0.0 && *opacity <= 1.0
}
