//! `dsm-convert`: deep images to deep shadow maps, and back.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@args`] | the command line |
//! | [`mod@given`] | which options go with which formats |
//! | [`mod@from_exr`] | deep and flat OpenEXR to `.dsm` |
//! | [`mod@copy`] | `.dsm` to `.dsm`: other codecs, tiles, levels, regions, tolerances |
//! | [`mod@join`] | several `.dsm` to one: parts stitched, things merged |
//! | [`mod@deep`] | `.dsm` to deep OpenEXR |
//! | [`mod@fit`] | one visibility function as samples of a deep image |
//! | [`mod@flat`] | `.dsm` to a flat image of one number per pixel |
//! | [`mod@slice`] | the values of a filtered one |
//! | [`mod@picture`] | the image itself, as OpenEXR or PNG |
//! | [`mod@npz`] | `.dsm` to NumPy arrays |
//! | [`mod@level`] | the functions of a level, band by band |
//! | [`mod@stats`] | what `--runstats` says |

pub mod args;
pub mod copy;
pub mod deep;
pub mod flat;
pub mod from_exr;
pub mod given;
pub mod join;
pub mod level;
pub mod npz;
pub mod picture;
pub mod slice;
pub mod stats;

use std::path::Path;

use deepshadow::DsmFile;

use crate::source::FileKind;
use args::{Args, Output};
use deepshadow_frame::{Failure, InFile, Result};

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that make no sense together, `Failed` for everything else, with one line that names the file.
pub fn run() -> Result<()> {
    let (mut args, given) = Args::from_command_line();
    let inputs = args.take_inputs();
    let output = Output::of(&args.output)?;
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build_global()
            .map_err(|e| Failure::Failed(format!("cannot start {threads} threads: {e}")))?;
    }
    if args.stitch || args.merge {
        given.check_join(&args)?;
        return join::convert(&args, &inputs, output);
    }
    let input = args.input.as_path();
    let kind = recognise(input)?;
    given.check(kind, output, &args)?;
    match (kind, output) {
        (FileKind::OpenExr, Output::Dsm) => from_exr::convert(&args),
        (FileKind::Dsm, output) => {
            let file = DsmFile::open(input).in_file(input)?;
            match output {
                Output::Dsm => copy::convert(&args, &file),
                Output::Exr if args.is_flat() => flat::convert(&args, file, output),
                Output::Exr => deep::convert(&args, &file),
                Output::Png => flat::convert(&args, file, output),
                Output::Npz => npz::convert(&args, &file),
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

/// Opens a file that must be a `.dsm` one.
fn open_dsm(path: &Path) -> Result<DsmFile> {
    match recognise(path)? {
        FileKind::Dsm => DsmFile::open(path).in_file(path),
        kind => {
            let line = format!("not a .dsm file of deepshadow, but {kind}");
            Err(Failure::Failed(line)).in_file(path)
        }
    }
}

/// What the input is: its content says so, and an extension that says something else is an error.
fn recognise(path: &Path) -> Result<FileKind> {
    if path.is_dir() {
        return Err(Failure::Failed("it is a folder".into())).in_file(path);
    }
    let kind = FileKind::of(path).in_file(path)?;
    let said = path.extension().map(|e| e.to_ascii_lowercase());
    let expected = match said.as_ref().and_then(|e| e.to_str()) {
        Some("exr") => Some((FileKind::OpenExr, "an OpenEXR file")),
        Some("dsm") => Some((FileKind::Dsm, "a .dsm file of deepshadow")),
        _ => None,
    };
    match (kind, expected) {
        (kind, Some((expected, name))) if kind != expected => {
            Err(Failure::Failed(format!("not {name}, but {kind}"))).in_file(path)
        }
        (FileKind::OpenExr | FileKind::Dsm, _) => Ok(kind),
        (kind, _) => {
            let line = format!("neither an OpenEXR nor a .dsm file, but {kind}");
            Err(Failure::Failed(line)).in_file(path)
        }
    }
}
