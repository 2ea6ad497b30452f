//! The options of `dsm-convert` that apply to each conversion.

use clap::ArgMatches;
use clap::parser::ValueSource;

use super::args::{Args, Output};
use crate::source::FileKind;
use deepshadow_frame::{Failure, Result};

/// The options that the user wrote, by id.
#[derive(Debug)]
pub struct ExplicitOptions(Vec<String>);

const ALWAYS: &[&str] = &[
    "input", "output", "threads", "memory", "runstats", "quiet", "verbose",
];
const FROM_EXR: &[&str] = &[
    "tolerance",
    "mip_tolerance",
    "compressor",
    "lattice",
    "compression",
    "tile",
    "nomipmap",
    "part",
    "layer",
    "zscale",
    "opacitylimit",
    "discrete",
    "continuous",
    "strict",
    "name",
    "depth_kind",
    "depth_unit",
    "mcamera",
    "mndc",
    "attrib",
];
const COPY: &[&str] = &[
    "tolerance",
    "mip_tolerance",
    "compressor",
    "lattice",
    "compression",
    "tile",
    "nomipmap",
    "levels",
    "remip",
    "map",
    "region",
    "name",
    "depth_kind",
    "depth_unit",
    "mcamera",
    "mndc",
    "attrib",
];
const DEEP: &[&str] = &[
    "tolerance",
    "compression",
    "map",
    "level",
    "tiled",
    "float",
    "half",
];
const FLAT: &[&str] = &["map", "level", "depth", "opacity", "count"];
const SLICE: &[&str] = &["map", "depth", "width", "filter"];
const NPZ: &[&str] = &["map", "level"];

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
        let (what, allowed) = match (input, output) {
            (FileKind::OpenExr, Output::Dsm) => ("from OpenEXR to .dsm", FROM_EXR),
            (FileKind::OpenExr, _) => return Ok(()),
            (_, Output::Dsm) => ("from .dsm to .dsm", COPY),
            (_, Output::Npz) => ("to .npz", NPZ),
            (_, Output::Exr) if !args.is_flat() => ("to deep .exr", DEEP),
            _ if args.width.is_some() && args.depth.is_some() => ("with --width", SLICE),
            (_, Output::Exr) => ("to a flat .exr", FLAT),
            (_, Output::Png) => ("to .png", FLAT),
        };
        if matches!(output, Output::Png | Output::Exr) {
            check_slice(args)?;
        }
        if output == Output::Png && !args.is_flat() {
            return Err(Failure::Usage(
                "output to .png needs --depth Z, --opacity or --count".into(),
            ));
        }
        self.allow(what, allowed)
    }

    fn allow(&self, what: &str, allowed: &[&str]) -> Result<()> {
        let unknown =
            |id: &&String| !ALWAYS.contains(&id.as_str()) && !allowed.contains(&id.as_str());
        match self.0.iter().find(unknown) {
            Some(id) => Err(Failure::Usage(format!(
                "--{} does not apply {what}",
                option_name(id)
            ))),
            None => Ok(()),
        }
    }
}

/// Checks the options that `--width` and `--filter` need.
fn check_slice(args: &Args) -> Result<()> {
    let wrong = |line: String| Err(Failure::Usage(line));
    match (args.depth, args.width, args.filter) {
        (None, Some(_), _) => wrong("--width needs --depth Z".into()),
        (_, None, Some(_)) => wrong("--filter needs --depth Z and --width W".into()),
        (_, Some(w), _) if !(0.0..f32::INFINITY).contains(&w) => wrong(format!(
            "--width {w}: the width must be a number of pixels, at least 0"
        )),
        _ => Ok(()),
    }
}

fn option_name(id: &str) -> String {
    let command = Args::command();
    let long = command.get_arguments().find(|a| a.get_id() == id);
    long.and_then(|a| a.get_long()).unwrap_or(id).to_owned()
}
