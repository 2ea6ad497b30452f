//! `dsm-convert`: deep images to deep shadow maps, and back.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@args`] | the command line |
//! | [`mod@given`] | which options go with which formats |
//! | [`mod@from_exr`] | deep and flat OpenEXR to `.dsm` |
//! | [`mod@copy`] | `.dsm` to `.dsm`: other codecs, tiles, levels, regions, tolerances |
//! | [`mod@deep`] | `.dsm` to deep OpenEXR |
//! | [`mod@fit`] | one visibility function as samples of a deep image |
//! | [`mod@flat`] | `.dsm` to a flat image of one number per pixel |
//! | [`mod@slice`] | the values of a filtered one |
//! | [`mod@picture`] | the image itself, as OpenEXR or PNG |
//! | [`mod@npz`] | `.dsm` to NumPy arrays |
//! | [`mod@level`] | the functions of a level, band by band |

pub mod args;
pub mod copy;
pub mod deep;
pub mod flat;
pub mod from_exr;
pub mod given;
pub mod level;
pub mod npz;
pub mod picture;
pub mod slice;

use std::path::Path;

use deepshadow::DsmFile;

use crate::inputs::recognise;
use crate::source::FileKind;
use args::{Args, Output};
use deepshadow_frame::{Failure, InFile, Result};

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that make no sense together, `Failed` for everything else, with one line that names the file.
pub fn run() -> Result<()> {
    let (args, given) = Args::from_command_line()?;
    let output = Output::of(&args.output)?;
    let console = args.running.start("dsm-convert")?;
    let input = args.input.as_path();
    let kind = recognise(input)?;
    given.check(kind, output, &args)?;
    match (kind, output) {
        (FileKind::OpenExr, Output::Dsm) => from_exr::convert(&args, console),
        (FileKind::Dsm, output) => {
            let file = DsmFile::open(input).in_file(input)?;
            match output {
                Output::Dsm => copy::convert(&args, &file, console),
                Output::Exr if args.is_flat() => flat::convert(&args, file, output, console),
                Output::Exr => deep::convert(&args, &file, console),
                Output::Png => flat::convert(&args, file, output, console),
                Output::Npz => npz::convert(&args, &file, console),
            }
            .map_err(|e| about(e, input, &args.output))
        }
        (_, output) => Err(Failure::Usage(format!(
            "{}: OpenEXR files become .dsm files, not {output}",
            input.display()
        ))),
    }
}

/// Puts the input's name before a failure that names neither file.
fn about(failure: Failure, input: &Path, output: &Path) -> Failure {
    match failure {
        Failure::Failed(line) if !line.contains(&*output.to_string_lossy()) => {
            match Err::<(), _>(Failure::Failed(line)).in_file(input) {
                Err(failure) => failure,
                Ok(()) => unreachable!("an error stays one"),
            }
        }
        failure => failure,
    }
}
