//! The command line of `dsm-join`.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Command, CommandFactory, Parser, Subcommand};
use deepshadow::GroupRole;
use deepshadow_frame::args::{Running, with_defaults};
use deepshadow_frame::storage::{Base, Lattice, Storage};

use crate::label::Label;

/// Makes one .dsm file of several.
///
/// OUTPUT appears whole or not at all; it may be an INPUT.
#[derive(Debug, Parser)]
#[command(name = "dsm-join", version, max_term_width = 100)]
pub struct Args {
    /// How files are joined.
    #[command(subcommand)]
    pub how: How,
}

/// How files are joined.
#[derive(Debug, Subcommand)]
pub enum How {
    /// Puts the parts of maps beside each other.
    ///
    /// All files hold the same maps by name. Each part lies where its data origin says, whole tiles
    /// from the others. The tiles of the base are copied byte for byte, and the levels are made
    /// anew from them. Pixels that no part covers are lit, and a note says how many there are.
    Stitch(StitchArgs),
    /// Multiplies the maps of one camera, such as hair and smoke.
    ///
    /// Maps belong together by name, or because each file holds only one. Their functions are
    /// multiplied, and their errors add up. The functions in the files are averages over each pixel
    /// already, so joint coverage inside a pixel is lost: two things that each cover half of a
    /// pixel count as independent, even if they cover the same half.
    Merge(MergeArgs),
    /// Copies maps of one file or several into one file.
    ///
    /// Each INPUT is FILE for all its maps, FILE:MAP for one of them by name or number, or
    /// FILE:MAP=NAME for one under a new name; FILE=NAME does for a file with one map. Tiles are
    /// copied byte for byte, all levels with their errors, and attributes stay. A group stays if
    /// all its maps do.
    Collect(CollectArgs),
}

/// Options of every way to join.
#[derive(Debug, clap::Args)]
pub struct Common {
    /// Say how long it took, and how large the levels are
    #[arg(long, help_heading = "Running")]
    pub runstats: bool,
    /// Threads and notes.
    #[command(flatten)]
    pub running: Running,
}

/// The arguments of `dsm-join stitch`.
#[derive(Debug, clap::Args)]
pub struct StitchArgs {
    /// Files with parts of the same maps
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The .dsm file to write
    pub output: PathBuf,
    /// Levels, vertices and bytes.
    #[command(flatten)]
    pub storage: Storage,
    /// What every way to join takes.
    #[command(flatten)]
    pub common: Common,
}

/// The arguments of `dsm-join merge`.
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// Two files or more, with maps of the same cameras
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// The .dsm file to write
    pub output: PathBuf,
    /// The map to merge, by name or number in each file
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
    /// What every way to join takes.
    #[command(flatten)]
    pub common: Common,
}

/// The arguments of `dsm-join collect`.
#[derive(Debug, clap::Args)]
pub struct CollectArgs {
    /// The maps to copy
    #[arg(required = true, value_name = "FILE[:MAP][=NAME]")]
    pub inputs: Vec<OsString>,
    /// The .dsm file to write
    pub output: PathBuf,
    /// Make a group of maps, by their names in OUTPUT or by number; it replaces a group of the same
    /// name. May be repeated
    #[arg(long = "group", value_name = "NAME=faces|clusters:MAP,MAP", value_parser = new_group)]
    pub groups: Vec<NewGroup>,
    /// What every way to join takes.
    #[command(flatten)]
    pub common: Common,
}

/// A group of maps by name.
#[derive(Clone, Debug, PartialEq)]
pub struct NewGroup {
    /// Its name.
    pub name: String,
    /// What its maps are to each other.
    pub role: GroupRole,
    /// Names or numbers of its maps.
    pub maps: Vec<String>,
}

/// A group from `NAME=faces|clusters:MAP,MAP`.
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
    /// The command, its help complete.
    pub fn command() -> Command {
        let usual = [("compressor", "minimal"), ("compression", "zstd:15")];
        <Args as CommandFactory>::command()
            .mut_subcommand("stitch", |command| {
                let added = "what the base promises; it is added to that";
                with_defaults(with_defaults(command, &usual), &[("mip_tolerance", added)])
            })
            .mut_subcommand("merge", |command| {
                let own = [
                    (
                        "tolerance",
                        "the sum of the inputs' errors and the largest of them once more, but at least 0.001 more",
                    ),
                    ("mip_tolerance", "the tolerance"),
                    ("tile", "the first input's"),
                ];
                with_defaults(with_defaults(command, &usual), &own)
            })
    }
}
