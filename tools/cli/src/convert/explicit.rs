//! The options of `dsm-convert` that apply to each conversion.

use clap::ArgMatches;
use clap::parser::ValueSource;

use super::args::{Args, Output};
use deepshadow_frame::foreign::FileKind;
use deepshadow_frame::{Failure, Result};

/// The options that the user wrote, by id.
#[derive(Debug)]
pub struct ExplicitOptions(Vec<String>);

const ALWAYS: &[&str] = &[
    "inputs",
    "target",
    "to",
    "skip_existing",
    "threads",
    "memory",
    "runstats",
    "quiet",
    "verbose",
];
/// Options for reading a deep image.
const IMAGE: &[&str] = &[
    "tolerance",
    "part",
    "layer",
    "zscale",
    "opacitylimit",
    "discrete",
    "continuous",
    "strict",
];
/// Options for the description of a map.
const HEADER: &[&str] = &[
    "name",
    "depth_kind",
    "depth_unit",
    "mcamera",
    "mndc",
    "attrib",
];
/// Options for the encoding of a map, besides the tolerance.
const STORAGE: &[&str] = &[
    "mip_tolerance",
    "compressor",
    "lattice",
    "compression",
    "tile",
    "nomipmap",
];
const COPY: &[&str] = &["tolerance", "levels", "remip", "map", "level", "region"];
const DEEP: &[&str] = &[
    "tolerance",
    "compression",
    "map",
    "level",
    "tiled",
    "float",
    "half",
];
const FLAT: &[&str] = &["map", "level", "region", "depth", "opacity", "count"];
const SLICE: &[&str] = &["map", "region", "depth", "width", "filter"];
const NPZ: &[&str] = &["map", "level", "region"];

impl ExplicitOptions {
    /// Collects the options of the command line.
    pub fn of(matches: &ArgMatches) -> Self {
        let command = Args::command();
        let ids = command.get_arguments().map(|a| a.get_id().as_str());
        let written = |id: &&str| {
            matches.try_contains_id(id).unwrap_or(false)
                && matches.value_source(id) == Some(ValueSource::CommandLine)
        };
        ExplicitOptions(ids.filter(written).map(str::to_owned).collect())
    }

    /// Checks that every option applies to this conversion.
    ///
    /// # Errors
    /// `Usage`, naming an option that does not apply.
    pub fn check(&self, input: FileKind, output: Output, args: &Args) -> Result<()> {
        let is_flat = args.is_flat();
        if output == Output::Png && !is_flat {
            return Err(Failure::Usage(
                "output to .png needs --depth Z, --opacity or --count".into(),
            ));
        }
        let (what, allowed): (_, &[&str]) = match output {
            Output::Dsm if input == FileKind::OpenExr => ("from OpenEXR to .dsm", &[]),
            Output::Dsm => ("from .dsm to .dsm", COPY),
            Output::Npz => ("to .npz", NPZ),
            Output::Exr if !is_flat => ("to deep .exr", DEEP),
            _ if args.width.is_some() => ("with --width", SLICE),
            Output::Exr => ("to a flat .exr", FLAT),
            Output::Png => ("to .png", FLAT),
        };
        let from: &[&str] = if input == FileKind::OpenExr {
            IMAGE
        } else {
            &[]
        };
        let stored: &[&[&str]] = match output {
            Output::Dsm => &[HEADER, STORAGE],
            _ => &[],
        };
        let allowed = [&[ALWAYS, allowed, from], stored].concat().concat();
        match self.0.iter().find(|id| !allowed.contains(&id.as_str())) {
            Some(id) => Err(Failure::Usage(format!(
                "--{} does not apply {what}",
                option_name(id)
            ))),
            None => Ok(()),
        }
    }
}

fn option_name(id: &str) -> String {
    let command = Args::command();
    let long = command.get_arguments().find(|a| a.get_id() == id);
    long.and_then(|a| a.get_long()).unwrap_or(id).to_owned()
}
