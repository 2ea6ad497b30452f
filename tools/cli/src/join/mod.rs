//! `dsm-join`: joins several `.dsm` files into one.
//!
//! | module | contents |
//! |---|---|
//! | [`mod@args`] | the command line |
//! | [`mod@stitch`] | assembles maps from parts |
//! | [`mod@merge`] | multiplies maps of one camera |
//! | [`mod@collect`] | copies maps of any files |

pub mod args;
pub mod collect;
pub mod merge;
pub mod stitch;

use std::path::{Path, PathBuf};

use deepshadow::{Codec, Compressor, DsmFile, Encoding, Limits, Writer};
use deepshadow_frame::args::{Running, from_matches, matches};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, InFile, Result};

use crate::inputs::open_dsm;
use crate::runstats::Clock;
use args::{Args, How};

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that contradict each other; `Failed` for everything else, in one line that
/// names the file.
pub fn run() -> Result<()> {
    let args: Args = from_matches(&matches(Args::command(), std::env::args_os())?)?;
    let (output, common) = match &args.how {
        How::Stitch(a) => (&a.output, &a.common),
        How::Merge(a) => (&a.output, &a.common),
        How::Collect(a) => (&a.output, &a.common),
    };
    let is_dsm = |e: &std::ffi::OsStr| e.eq_ignore_ascii_case("dsm");
    if !output.extension().is_some_and(is_dsm) {
        let line = format!("{}: the output must be a .dsm file", output.display());
        return Err(Failure::Usage(line));
    }
    let console = common.running.start("dsm-join")?;
    let clock = Clock::default();
    match &args.how {
        How::Stitch(a) => stitch::stitch(a, console)?,
        How::Merge(a) => merge::merge(a, console)?,
        How::Collect(a) => collect::collect(a, console)?,
    }
    if common.runstats {
        clock.report(output, None, Output::standard())?;
    }
    Ok(())
}

/// The default encoding of levels and tiles.
fn usual() -> Encoding {
    Encoding::default()
        .compressor(Compressor::Minimal)
        .codec(Codec::Zstd(15))
}

/// Returns the memory that each of `files` files may cause. A tile of any file needs a share that
/// is large enough, so that many files get shares as if they were 16.
fn shares(running: &Running, files: usize) -> Limits {
    running.limits(files.min(16))
}

/// Opens the files. Errors use the name of each.
fn open(paths: &[PathBuf], running: &Running) -> Result<Vec<(String, DsmFile)>> {
    let limits = shares(running, paths.len());
    let open = |path: &PathBuf| Ok((path.display().to_string(), open_dsm(path, limits)?));
    paths.iter().map(open).collect()
}

/// Writes the output atomically, with a progress bar labelled `what`.
fn write(
    what: &'static str,
    output: &Path,
    console: Console,
    fill: impl FnOnce(&mut Writer) -> deepshadow::Result<()>,
) -> Result<()> {
    let mut writer = Writer::create(output).in_file(output)?;
    let mut bar = console.bar(what);
    writer.on_progress(move |done, total| {
        bar.set(done, total);
        true
    });
    name_output(fill(&mut writer), output)?;
    writer.finish().in_file(output)?;
    Ok(())
}

/// Adds the output's name to an error that does not name an input.
fn name_output<T>(result: deepshadow::Result<T>, output: &Path) -> Result<T> {
    match result {
        Err(e) if e.file().is_some() => Err(e.into()),
        result => result.in_file(output),
    }
}
