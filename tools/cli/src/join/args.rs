//! The command line of `dsm-join`.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Command, CommandFactory, Parser, Subcommand};
use deepshadow::GroupRole;
use deepshadow_frame::args::{Running, with_defaults};
use deepshadow_frame::storage::{Base, Lattice, Storage};

use crate::label::Label;

/// Joins several .dsm files into one.
///
/// OUTPUT is written atomically and may be an INPUT.
#[derive(Debug, Parser)]
#[command(
    name = "dsm-join",
    version,
    max_term_width = 100,
    arg_required_else_help = false
)]
pub struct Args {
    /// The command.
    #[command(subcommand)]
    pub how: How,
}

/// The ways to join files.
#[derive(Debug, Subcommand)]
pub enum How {
    /// Assembles maps from rectangular parts.
    ///
    /// All files must hold maps of the same names. The data origin gives the place of a part; the
    /// distances between parts must be whole tiles. The tiles of the base are copied byte for byte,
    /// and the levels are recomputed. Pixels that no part covers are lit; a note gives their
    /// number.
    Stitch(StitchArgs),
    /// Multiplies the maps of one camera, such as hair and smoke.
    ///
    /// Maps are matched by name, unless each file holds only one map. The errors of the maps add
    /// up. The functions are averages over each pixel, so the product treats objects inside a pixel
    /// as independent: two objects that cover the same half of a pixel let 1/4 of the light
    /// through, not 1/2.
    Merge(MergeArgs),
    /// Copies maps of one or several files into one file.
    ///
    /// INPUT is FILE for all its maps, FILE:MAP for one map by name or index, FILE:MAP=NAME for one
    /// map with a new name, or FILE=NAME for the only map of a file. All levels are copied byte for
    /// byte, with their errors and attributes. A group is copied if all its maps are.
    Collect(CollectArgs),
}

/// Options of all commands.
#[derive(Debug, clap::Args)]
pub struct Common {
    /// Print the time and the sizes of the levels
    #[arg(long, help_heading = "Running")]
    pub runstats: bool,
    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

/// The arguments of `dsm-join stitch`.
#[derive(Debug, clap::Args)]
pub struct StitchArgs {
    /// Files with parts of maps
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The .dsm file to write
    pub output: PathBuf,
    /// Levels, vertices and bytes.
    #[command(flatten)]
    pub storage: Storage,
    /// Options of all commands.
    #[command(flatten)]
    pub common: Common,
}

/// The arguments of `dsm-join merge`.
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// Two or more files with maps of the same cameras
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The .dsm file to write
    pub output: PathBuf,
    /// Map to merge, by name or index in each file [default: all maps]
    #[arg(long, value_name = "NAME|INDEX")]
    pub map: Option<String>,
    /// Tolerance and tiles.
    #[command(flatten)]
    pub base: Base,
    /// Levels, vertices and bytes.
    #[command(flatten)]
    pub storage: Storage,
    /// The lattice of visibilities.
    #[command(flatten)]
    pub lattice: Lattice,
    /// Name and attributes.
    #[command(flatten)]
    pub label: Label,
    /// Options of all commands.
    #[command(flatten)]
    pub common: Common,
}

/// The arguments of `dsm-join collect`.
#[derive(Debug, clap::Args)]
pub struct CollectArgs {
    /// Maps to copy
    #[arg(required = true, value_name = "FILE[:MAP][=NAME]")]
    pub inputs: Vec<OsString>,
    /// The .dsm file to write
    pub output: PathBuf,
    /// Make a group of maps, by their names in OUTPUT or by index; replaces a group of the same
    /// name; may be repeated. A lookup reads one map of a group of faces, and multiplies all maps
    /// of a group of clusters
    #[arg(long = "group", value_name = "NAME=faces|clusters:MAP,MAP", value_parser = new_group)]
    pub groups: Vec<NewGroup>,
    /// Options of all commands.
    #[command(flatten)]
    pub common: Common,
}

/// A group of maps by name.
#[derive(Clone, Debug, PartialEq)]
pub struct NewGroup {
    /// Its name.
    pub name: String,
    /// Role of its maps.
    pub role: GroupRole,
    /// Names or indices of its maps.
    pub maps: Vec<String>,
}

/// Parses a group `NAME=faces|clusters:MAP,MAP`.
fn new_group(text: &str) -> Result<NewGroup, String> {
    let form = "a group is NAME=faces:MAP,MAP or NAME=clusters:MAP,MAP";
    let (name, rest) = text.split_once('=').ok_or(form)?;
    let (role, maps) = rest.split_once(':').ok_or(form)?;
    Ok(NewGroup {
        name: name.into(),
        role: role.parse().map_err(|_| form)?,
        maps: maps.split(',').map(|m| m.trim().to_owned()).collect(),
    })
}

impl Args {
    /// Builds the command, with the defaults of this program in its help.
    pub fn command() -> Command {
        let usual = [("compressor", "minimal"), ("compression", "zstd:15")];
        <Args as CommandFactory>::command()
            .mut_subcommand("stitch", |command| {
                let added = "the error of the base; the two add up";
                with_defaults(with_defaults(command, &usual), &[("mip_tolerance", added)])
            })
            .mut_subcommand("merge", |command| {
                let own = [
                    (
                        "tolerance",
                        "the sum of the inputs' errors, plus the largest of them (at least 0.001)",
                    ),
                    ("mip_tolerance", "the tolerance"),
                    ("tile", "the first input's"),
                ];
                with_defaults(with_defaults(command, &usual), &own)
            })
    }
}
