//! The command line of `dsm-info`.

use std::path::PathBuf;

use clap::{ArgGroup, Command, CommandFactory, Parser};

use deepshadow::Pixel;

use super::lookup::{self, LookupArgs};
use deepshadow_frame::args::{Running, fraction, numbers};
use deepshadow_frame::stream::is_standard_output;
use deepshadow_frame::{Failure, Result};

use crate::source::SourceArgs;

const EXAMPLES: &str = "\
Examples:
  dsm-info light.dsm                            maps, levels, groups and attributes
  dsm-info --stats --level 2 light.dsm          vertices, bytes and codecs of level 2
  dsm-info --pixel 120,45 --map key light.dsm   one visibility function as a table
  dsm-info --plot 120,45 -o pixel.svg light.dsm the same as a picture
  dsm-info --lookup 120.5,45.5,3 --width 4 light.dsm
                                                the filtered light at a point, and its pixels
  dsm-info --verify *.dsm                       check every byte and every rule
  dsm-info --verify --against hair.exr hair.dsm measure the true error of every level
  dsm-info --compare old.dsm --fail 0.01 new.dsm
  dsm-info --json --stats light.dsm | jq '.maps[0].levels[0].bytes'

Exit codes:
  0  success; with --compare: the maps can be compared and differ by at most --fail
  1  a file or the operation failed; with --compare: the maps cannot be compared or differ by more
  2  wrong arguments";

/// The options that --map applies to.
const OF_MAP: [&str; 7] = [
    "stats", "tiles", "pixel", "plot", "lookup", "compare", "against",
];
/// The options that --level applies to.
const OF_LEVEL: [&str; 4] = ["stats", "tiles", "pixel", "plot"];

/// Shows the contents of deep shadow map files.
///
/// Without other options, prints maps, levels, groups and attributes. With --json, prints all
/// results as one JSON document: an object for one FILE, an array of objects for several.
#[derive(Clone, Debug, Parser)]
#[command(name = "dsm-info", version, after_help = EXAMPLES, max_term_width = 100)]
#[command(group = ArgGroup::new("of_map").args(OF_MAP).multiple(true))]
#[command(group = ArgGroup::new("of_level").args(OF_LEVEL).multiple(true))]
pub struct Args {
    /// Deep shadow map files; - for standard input
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,

    /// Print matrices, and all attributes in full
    #[arg(short, long)]
    pub all_metadata: bool,

    /// Print JSON; each other option adds its result under its own name
    #[arg(long)]
    pub json: bool,

    /// Read all pixels and print a histogram of vertices, bytes by part, depths and codecs
    #[arg(long)]
    pub stats: bool,

    /// Print the tile directory, one line per tile
    #[arg(long)]
    pub tiles: bool,

    /// Print the visibility function of a pixel of the level as a table
    #[arg(long, value_name = "X,Y", value_parser = pair)]
    pub pixel: Option<Pixel>,

    /// Draw the visibility function of a pixel of the level, with the band of its error
    #[arg(long, value_name = "X,Y", value_parser = pair)]
    pub plot: Option<Pixel>,

    /// Look up the light that reaches a point, as a renderer does, and list the pixels used. X and
    /// Y are in pixels of level 0 from the upper left corner: the centre of the first pixel is
    /// 0.5,0.5. Z is a depth, or inf
    #[arg(long, value_name = "X,Y,Z", value_parser = lookup::place, allow_hyphen_values = true)]
    pub lookup: Option<[f32; 3]>,

    /// File for --plot, .svg or .png [default: SVG on standard output]
    #[arg(short, long, value_name = "PICTURE", requires = "plot")]
    pub output: Option<PathBuf>,

    /// Map to read, by name or index [default: the first for --pixel, --plot, --lookup and
    /// --against, else all]
    #[arg(long, value_name = "NAME|INDEX", requires = "of_map")]
    pub map: Option<String>,

    /// Level to read [default: all for --tiles, else 0]
    #[arg(long, value_name = "L", requires = "of_level")]
    pub level: Option<u32>,

    /// Check every byte and every rule of the format
    #[arg(long)]
    pub verify: bool,

    /// With --verify: measure the largest true error of every level against the OpenEXR image that
    /// the map was made from, and fail if it exceeds the error that the file states
    #[arg(long, value_name = "SOURCE.exr", requires = "verify")]
    pub against: Option<PathBuf>,

    /// Print the SHA-256 of the decoded content; it does not depend on codec, tile size or
    /// attributes
    #[arg(long)]
    pub hash: bool,

    /// Print the largest difference between the functions of FILE and another file, level by level;
    /// maps are matched by name, else by index
    #[arg(long, value_name = "OTHER")]
    pub compare: Option<PathBuf>,

    /// With --compare: fail if the largest difference exceeds E, 0 to 1
    #[arg(long, value_name = "E", requires = "compare", value_parser = fraction)]
    pub fail: Option<f64>,

    // Last, because the heading of a group applies to all options after it.
    /// Options of --lookup.
    #[command(flatten)]
    pub lookup_how: LookupArgs,

    /// Options of --against: the same as in the conversion.
    #[command(flatten)]
    pub source: SourceArgs,

    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

impl Args {
    /// Builds the command. The options of an image require `--against`.
    pub fn command() -> Command {
        let heading = "Options of --against, the same as for dsm-convert";
        SourceArgs::IDS
            .into_iter()
            .fold(<Args as CommandFactory>::command(), |command, id| {
                command.mut_arg(id, |arg| arg.requires("against").help_heading(heading))
            })
    }

    /// Whether to print the summary: no other result is asked for, or `--all-metadata` is.
    pub fn wants_summary(&self) -> bool {
        let others = self.stats || self.tiles || self.verify || self.hash;
        let more = self.pixel.is_some() || self.plot.is_some() || self.compare.is_some();
        let more = more || self.lookup.is_some();
        self.all_metadata || !(others || more)
    }

    /// Checks options that depend on each other.
    ///
    /// # Errors
    /// `Usage` for options that contradict each other.
    pub fn check(&self) -> Result<()> {
        if self.plot.is_none() {
            return Ok(());
        }
        let others = self.stats || self.tiles || self.verify || self.hash || self.json;
        let more = self.pixel.is_some() || self.compare.is_some() || self.all_metadata;
        let more = more || self.lookup.is_some();
        if self.files.len() > 1 {
            let line = "--plot: draws one picture; give one FILE";
            return Err(Failure::Usage(line.into()));
        }
        let to_file = self
            .output
            .as_ref()
            .filter(|path| !is_standard_output(path));
        let Some(path) = to_file else {
            if others || more {
                let line = "--plot: needs -o FILE with other options, which write to standard \
                            output too";
                return Err(Failure::Usage(line.into()));
            }
            return Ok(());
        };
        let is = |known: &str| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case(known))
        };
        if !is("svg") && !is("png") {
            let line = format!("--output {}: a plot is a .svg or .png file", path.display());
            return Err(Failure::Usage(line));
        }
        Ok(())
    }
}

fn pair(text: &str) -> std::result::Result<Pixel, String> {
    let pixel = numbers(text, ',').map(|[x, y]| Pixel::new(x, y));
    pixel.ok_or_else(|| "not two whole numbers X,Y, such as 120,45".into())
}
