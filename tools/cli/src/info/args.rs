//! The command line of `dsm-info`.

use std::path::PathBuf;

use clap::{ArgGroup, Command, CommandFactory, Parser};

use super::lookup::{self, LookupArgs};
use deepshadow_frame::args::Running;
use deepshadow_frame::{Failure, Result};

use crate::source::SourceArgs;

const EXAMPLES: &str = "\
Examples:
  dsm-info light.dsm                            what is in the file
  dsm-info --stats --level 2 light.dsm          vertices, bytes and codecs of level 2
  dsm-info --pixel 120,45 --map key light.dsm   one visibility function as a table
  dsm-info --plot 120,45 -o pixel.svg light.dsm the same as a picture
  dsm-info --lookup 120.5,45.5,3 --width 4 light.dsm
                                                the light at a point, filtered, and from which pixels
  dsm-info --verify *.dsm                       check every byte and every rule
  dsm-info --verify --against hair.exr hair.dsm is the promise kept?
  dsm-info --compare old.dsm --fail 0.01 new.dsm
  dsm-info --json --stats light.dsm | jq '.maps[0].levels[0].bytes'

Exit codes:
  0  all is good; with --compare: the maps can be compared and differ by no more than --fail
  1  a file or the operation failed; with --compare: the maps cannot be compared, or differ by more
  2  the arguments make no sense";

/// Shows what is in deep shadow map files.
///
/// Without other options: maps, levels, groups and attributes. With --json everything that is asked for comes as one JSON document:
/// an object for one FILE, an array of objects for several.
#[derive(Clone, Debug, Parser)]
#[command(name = "dsm-info", version, after_help = EXAMPLES, max_term_width = 100)]
#[command(group = ArgGroup::new("of_map").args(["stats", "tiles", "pixel", "plot", "lookup", "compare", "against"]).multiple(true))]
#[command(group = ArgGroup::new("of_level").args(["stats", "tiles", "pixel", "plot"]).multiple(true))]
pub struct Args {
    /// Files to look at
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,

    /// Print matrices, and attributes in full
    #[arg(short, long)]
    pub all_metadata: bool,

    /// Print JSON; other options add their results under their names
    #[arg(long)]
    pub json: bool,

    /// Read all pixels: histogram of vertices, bytes by part, depths, codecs
    #[arg(long)]
    pub stats: bool,

    /// Print the tile directory, a line a tile
    #[arg(long)]
    pub tiles: bool,

    /// Print the visibility function of a pixel of the level
    #[arg(long, value_name = "X,Y", value_parser = pair)]
    pub pixel: Option<(u32, u32)>,

    /// Draw the visibility function of a pixel of the level, and the band that its promise leaves, as SVG
    #[arg(long, value_name = "X,Y", value_parser = pair)]
    pub plot: Option<(u32, u32)>,

    /// Look up the light that reaches a point, as a renderer does, and say which pixels went into it. X and Y are in pixels of
    /// level 0 from the upper left corner: the centre of the first pixel is 0.5,0.5. Z is a depth, or inf
    #[arg(long, value_name = "X,Y,Z", value_parser = lookup::place, allow_hyphen_values = true)]
    pub lookup: Option<[f32; 3]>,

    /// Where --plot goes, instead of standard output
    #[arg(short, long, value_name = "SVG", requires = "plot")]
    pub output: Option<PathBuf>,

    /// The map that is meant, by name or index [default: the first for --pixel, --plot and --lookup, else all]
    #[arg(long, value_name = "NAME|INDEX", requires = "of_map")]
    pub map: Option<String>,

    /// The level that is meant [default: all for --tiles, else 0]
    #[arg(long, value_name = "L", requires = "of_level")]
    pub level: Option<usize>,

    /// Check every byte and every rule of the format
    #[arg(long)]
    pub verify: bool,

    /// With --verify: measure the largest true error of every level against the OpenEXR image that the map was made from
    #[arg(long, value_name = "SOURCE.exr", requires = "verify")]
    pub against: Option<PathBuf>,

    /// Print the SHA-256 of the decoded content, which does not depend on codec, tile size or attributes
    #[arg(long)]
    pub hash: bool,

    /// Say how far the functions of another file are from those of FILE, level by level; maps are matched by name, else by index
    #[arg(long, value_name = "OTHER")]
    pub compare: Option<PathBuf>,

    /// With --compare: fail if the difference exceeds this
    #[arg(long, value_name = "E", requires = "compare", value_parser = tolerance)]
    pub fail: Option<f64>,

    // Last, for the heading of a group stands above all that follows it.
    /// How --lookup is made.
    #[command(flatten)]
    pub lookup_how: LookupArgs,

    /// How --against takes the image; what dsm-convert was given.
    #[command(flatten)]
    pub source: SourceArgs,

    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

impl Args {
    /// The command: the options of an image need `--against`.
    pub fn command() -> Command {
        let heading = "The image of --against, as dsm-convert was told";
        SourceArgs::IDS
            .into_iter()
            .fold(<Args as CommandFactory>::command(), |command, id| {
                command.mut_arg(id, |arg| arg.requires("against").help_heading(heading))
            })
    }

    /// Whether the summary is asked for: nothing else is, or it is by name.
    pub fn wants_summary(&self) -> bool {
        let others = self.stats || self.tiles || self.verify || self.hash;
        let more = self.pixel.is_some() || self.plot.is_some() || self.compare.is_some();
        let more = more || self.lookup.is_some();
        self.all_metadata || !(others || more)
    }

    /// # Errors
    /// `Usage` for options that do not go together.
    pub fn check(&self) -> Result<()> {
        self.source.options()?;
        if self.plot.is_none() {
            return Ok(());
        }
        let others = self.stats || self.tiles || self.verify || self.hash || self.json;
        let more = self.pixel.is_some() || self.compare.is_some() || self.all_metadata;
        let more = more || self.lookup.is_some();
        if self.files.len() > 1 {
            let line = "--plot draws one picture, so it takes one FILE";
            return Err(Failure::Usage(line.into()));
        }
        if self.output.is_none() && (others || more) {
            let line = "--plot beside other options needs -o: both would go to standard output";
            return Err(Failure::Usage(line.into()));
        }
        Ok(())
    }
}

fn pair(text: &str) -> std::result::Result<(u32, u32), String> {
    let parsed = text
        .split_once(',')
        .and_then(|(x, y)| Some((x.trim().parse().ok()?, y.trim().parse().ok()?)));
    parsed.ok_or_else(|| "a pixel is two whole numbers, as in 120,45".into())
}

fn tolerance(text: &str) -> std::result::Result<f64, String> {
    match text.parse() {
        Ok(e) if (0.0..=1.0).contains(&e) => Ok(e),
        _ => Err("a difference of visibilities is a number from 0 to 1".into()),
    }
}
