//! `dsm-convert`: deep images to deep shadow maps, and maps to images and arrays.
//!
//! | module | contents |
//! |---|---|
//! | [`mod@args`] | the command line |
//! | [`mod@explicit`] | the options that apply to each conversion |
//! | [`mod@from_exr`] | deep and flat OpenEXR to `.dsm` |
//! | [`mod@copy`] | `.dsm` to `.dsm`: other codecs, tiles, levels, regions, tolerances |
//! | [`mod@deep`] | `.dsm` to deep OpenEXR |
//! | [`mod@flat`] | `.dsm` to a flat image with one value per pixel |
//! | [`mod@slice`] | the values of a filtered flat image |
//! | [`mod@picture`] | flat images as OpenEXR or PNG |
//! | [`mod@npz`] | `.dsm` to NumPy arrays |
//! | [`mod@level`] | the functions of a level, rectangle by rectangle |

pub mod args;
pub mod copy;
pub mod deep;
pub mod explicit;
pub mod flat;
pub mod from_exr;
pub mod level;
pub mod npz;
pub mod picture;
pub mod slice;

use std::path::Path;

use deepshadow::DsmFile;

use crate::inputs::recognise;
use crate::source::FileKind;
use args::{Args, Output};
use deepshadow_frame::{Failure, InFile, Result, names_file};

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that contradict each other, `Failed` for everything else, in one line that
/// names the file.
pub fn run() -> Result<()> {
    let (args, explicit) = Args::from_command_line()?;
    let output = Output::of(&args.output)?;
    let console = args.running.start("dsm-convert")?;
    let input = args.input.as_path();
    let kind = recognise(input)?;
    explicit.check(kind, output, &args)?;
    match (kind, output) {
        (FileKind::OpenExr, Output::Dsm) => from_exr::convert(&args, console),
        (FileKind::Dsm, output) => {
            let file = DsmFile::open_within(input, args.running.limits(1)).in_file(input)?;
            match output {
                Output::Dsm => copy::convert(&args, &file, console),
                Output::Exr if args.is_flat() => flat::convert(&args, file, output, console),
                Output::Exr => deep::convert(&args, &file, console),
                Output::Png => flat::convert(&args, file, output, console),
                Output::Npz => npz::convert(&args, &file, console),
            }
            .or_else(|e| name_input(e, input, &args.output))
        }
        (_, output) => Err(Failure::Usage(format!(
            "{}: an OpenEXR file can be converted to .dsm only, not to {output}",
            input.display()
        ))),
    }
}

/// Adds the input's name to a failure that names neither file.
fn name_input(failure: Failure, input: &Path, output: &Path) -> Result<()> {
    match failure {
        Failure::Failed(line) if !names_file(&line, output) => {
            Err(Failure::Failed(line)).in_file(input)
        }
        failure => Err(failure),
    }
}
