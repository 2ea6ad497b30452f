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

use std::path::{Path, PathBuf};

use crate::source::DeepSource;
use args::{Args, Output};
use deepshadow_frame::console::Console;
use deepshadow_frame::foreign::FileKind;
use deepshadow_frame::stream::{Destination, Input, is_standard_input, is_standard_output};
use deepshadow_frame::{Failure, InFile, Result, names_file};
use explicit::ExplicitOptions;

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that contradict each other, `Failed` for everything else, in one line that
/// names the file.
pub fn run() -> Result<()> {
    let (args, explicit) = Args::from_command_line()?;
    let jobs = jobs(&args)?;
    let console = args.running.start("dsm-convert")?;
    let mut failed = 0;
    for job in &jobs {
        if job.args.skip_existing && job.args.output.exists() {
            console.detail(format_args!(
                "{}: exists, skipped",
                job.args.output.display()
            ));
            continue;
        }
        match convert(job, &explicit, console) {
            Err(Failure::Failed(line)) if jobs.len() > 1 => {
                console.error(line);
                failed += 1;
            }
            result => result?,
        }
    }
    match failed {
        0 => Ok(()),
        n => Err(Failure::Failed(format!(
            "{n} of {} files failed",
            jobs.len()
        ))),
    }
}

fn convert(job: &Job, explicit: &ExplicitOptions, console: Console) -> Result<()> {
    let destination = Destination::of(&job.args.output)?;
    let args = Args {
        output: destination.path().to_owned(),
        ..job.args.clone()
    };
    destination.deliver(convert_input(&args, job.kind, explicit, console))
}

fn convert_input(
    args: &Args,
    output: Output,
    explicit: &ExplicitOptions,
    console: Console,
) -> Result<()> {
    let input = args.input.as_path();
    let mut opened = Input::open(input).in_file(input)?;
    let kind = opened.kind().in_file(input)?;
    check_extension(input, kind)?;
    explicit.check(kind, output, args)?;
    let file = match (kind, output) {
        (FileKind::OpenExr, Output::Exr) if !args.is_flat() => {
            return Err(Failure::Usage(format!(
                "{}: a deep image to .exr needs --depth Z, --opacity or --count",
                input.display()
            )));
        }
        (FileKind::OpenExr, _) => {
            let source = DeepSource::of(input, opened, &args.source_options())?;
            if output == Output::Dsm {
                return from_exr::convert(args, &source, console);
            }
            from_exr::temporary(args, &source, console)?
        }
        _ => opened.dsm(args.running.limits(1)).in_file(input)?,
    };
    match output {
        Output::Dsm => copy::convert(args, &file, console),
        Output::Exr if !args.is_flat() => deep::convert(args, &file, console),
        Output::Npz => npz::convert(args, &file, console),
        output => flat::convert(args, file, output, console),
    }
    .or_else(|e| name_input(e, input, &args.output))
}

/// Refuses an input whose extension is that of another kind, and one of no kind that is read.
fn check_extension(path: &Path, kind: FileKind) -> Result<()> {
    let extension = path.extension().map(|e| e.to_ascii_lowercase());
    let expected = match extension.as_ref().and_then(|e| e.to_str()) {
        Some("exr") => Some((FileKind::OpenExr, "an OpenEXR file")),
        Some("dsm") => Some((FileKind::Dsm, "a .dsm file")),
        _ => None,
    };
    let line = match (kind, expected) {
        (kind, Some((expected, name))) if kind != expected => format!("not {name}, but {kind}"),
        (FileKind::OpenExr | FileKind::Dsm, _) => return Ok(()),
        (kind, _) => format!("neither an OpenEXR nor a .dsm file, but {kind}"),
    };
    Err(Failure::Failed(line)).in_file(path)
}

/// The conversion of one input.
struct Job {
    /// The arguments, with the input and the output.
    args: Args,
    /// Kind of the output.
    kind: Output,
}

/// Returns the conversions that the arguments ask for. Creates the folder `OUTDIR/`.
///
/// # Errors
/// `Usage` for several inputs without a folder, for inputs whose outputs have the same name, and
/// for an unknown kind of output.
fn jobs(args: &Args) -> Result<Vec<Job>> {
    let target = args.target.as_path();
    let is_new_folder = target.as_os_str().as_encoded_bytes().ends_with(b"/");
    let is_folder = is_new_folder || target.is_dir();
    let job = |input: &Path, output: PathBuf, kind| Job {
        args: Args {
            input: input.to_owned(),
            output,
            ..args.clone()
        },
        kind,
    };
    if let ([input], false) = (args.inputs.as_slice(), is_folder) {
        let kind = args.to.map_or_else(|| Output::of(target), Ok)?;
        if args.runstats && is_standard_output(target) {
            let line = "--runstats: standard output takes the file; write to a file instead";
            return Err(Failure::Usage(line.into()));
        }
        return Ok(vec![job(input, target.to_owned(), kind)]);
    }
    if !is_folder {
        return Err(Failure::Usage(format!(
            "{}: several inputs need a folder as output; end its name with /",
            target.display()
        )));
    }
    let kind = args.to.unwrap_or(Output::Dsm);
    let mut jobs: Vec<Job> = Vec::new();
    for input in &args.inputs {
        let name = input.file_stem().filter(|_| !is_standard_input(input));
        let name = name.ok_or_else(|| {
            let line = format!("{}: has no name for a file in a folder", input.display());
            Failure::Usage(line)
        })?;
        let mut file = name.to_owned();
        file.push(kind.to_string());
        let output = target.join(file);
        if let Some(other) = jobs.iter().find(|j| j.args.output == output) {
            return Err(Failure::Usage(format!(
                "{} and {} would both become {}",
                other.args.input.display(),
                input.display(),
                output.display()
            )));
        }
        jobs.push(job(input, output, kind));
    }
    if is_new_folder && !target.is_dir() {
        std::fs::create_dir(target).in_file(target)?;
    }
    Ok(jobs)
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
