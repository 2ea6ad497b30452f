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

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use deepshadow::{Compressor, DsmFile, Encoding, Limits, ReadAt, Writer};
use deepshadow_frame::args::{Running, from_matches, matches};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::stream::{Destination, open_dsm};
use deepshadow_frame::{InFile, Result, storage};

use crate::runstats::Clock;
use args::{Args, How};

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that contradict each other; `Failed` for everything else, in one line that
/// names the file.
pub fn run() -> Result<()> {
    let args: Args = from_matches(&matches(Args::command(), std::env::args_os())?)?;
    let mut args = args;
    let (output, common) = match &mut args.how {
        How::Stitch(a) => (&mut a.output, &a.common),
        How::Merge(a) => (&mut a.output, &a.common),
        How::Collect(a) => (&mut a.output, &a.common),
    };
    let (runstats, running) = (common.runstats, common.running);
    let destination = Destination::of_dsm(output, runstats)?;
    *output = destination.path().to_owned();
    let console = running.start("dsm-join")?;
    let clock = Clock::default();
    let made = match &args.how {
        How::Stitch(a) => stitch::stitch(a, console),
        How::Merge(a) => merge::merge(a, console),
        How::Collect(a) => collect::collect(a, console),
    };
    if runstats && made.is_ok() {
        clock.report(destination.path(), None, Output::standard())?;
    }
    destination.deliver(made)
}

/// The default encoding of levels and tiles.
fn usual() -> Encoding {
    storage::usual(Compressor::Minimal)
}

/// Returns the memory that each of `files` files may cause. A tile of any file needs a share that
/// is large enough, so that many files get shares as if they were 16.
fn shares(running: &Running, files: usize) -> Limits {
    running.limits(files.min(16))
}

/// Most files that stay open: many systems allow a process 1024, and threads need some.
const OPEN_FILES: usize = 256;

/// Opens the files. Errors use the name of each. Of many files, each is opened again for every
/// read, so that their number has no limit.
fn open(paths: &[PathBuf], running: &Running) -> Result<Vec<(String, DsmFile)>> {
    let limits = shares(running, paths.len());
    let open = |path: &PathBuf| {
        let is_regular = path.is_file();
        let file = match paths.len() > OPEN_FILES && is_regular {
            true => Reopened::open(path, limits).in_file(path)?,
            false => open_dsm(path, limits)?,
        };
        Ok((path.display().to_string(), file))
    };
    paths.iter().map(open).collect()
}

/// A file that is opened for each read.
struct Reopened {
    path: PathBuf,
    length: u64,
}

impl Reopened {
    /// Checks the file at `path`, and opens it without keeping it open.
    fn open(path: &Path, limits: Limits) -> Result<DsmFile> {
        // The error for a file of another kind names that kind.
        let length = open_dsm(path, limits)?.length();
        let path = path.to_owned();
        let source = Arc::new(Reopened { path, length });
        Ok(DsmFile::from_source(source, limits)?)
    }
}

impl ReadAt for Reopened {
    fn length(&self) -> u64 {
        self.length
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        let mut file = File::open(&self.path)?;
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(buffer)
    }
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
