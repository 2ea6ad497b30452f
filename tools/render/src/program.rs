//! The program `dsm-render`.

use deepshadow_frame::args::parse;
use deepshadow_frame::output::{Output, begin};
use deepshadow_frame::progress::Bar;
use deepshadow_frame::stream::{Destination, is_standard_output};
use deepshadow_frame::{Failure, Result};
use deepshadow_scene::scene::file;

use crate::args::Args;
use crate::compare::compare;
use crate::image::Format;
use crate::render::{Report, render};

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for invalid combinations of arguments, `Failed` for everything else, in one line.
pub fn run() -> Result<()> {
    let args: Args = parse()?;
    let console = args.running.start("dsm-render")?;
    if args.compare {
        return compared(&args);
    }
    // Check the command line before reading any file.
    args.settings(0)?;
    Format::of(&args.second)?;
    if args.runstats && is_standard_output(&args.second) {
        let line = "--runstats: standard output takes the picture; write to a file instead";
        return Err(Failure::Usage(line.into()));
    }
    let scene = file::read(&args.first)?;
    let destination = Destination::of(&args.second)?;
    let begun = begin(destination.path())?;
    let settings = args.settings(scene.seed)?;
    let lights = scene.lights.iter().map(|l| l.name.as_str());
    console.detail(format_args!(
        "{} objects, lights {}, {} rays in each pixel",
        scene.objects.len(),
        lights.collect::<Vec<_>>().join(", "),
        settings.spp
    ));
    let mut bar: Option<(&str, Bar)> = None;
    let (image, report) = render(&scene, &settings, |what, done, all| {
        if bar.as_ref().is_none_or(|(now, _)| *now != what) {
            bar = None;
        }
        let (_, bar) = bar.get_or_insert_with(|| (what, console.bar(what)));
        bar.set(done, all);
    })?;
    drop(bar);
    report.notes.iter().for_each(|line| console.note(line));
    destination.deliver(image.finish(begun, &args.second))?;
    if args.runstats {
        return print(&report);
    }
    Ok(())
}

fn compared(args: &Args) -> Result<()> {
    let given = [
        ("shadows", args.shadows.is_some()),
        ("reference", args.reference.is_some()),
        ("pcf", args.pcf.is_some()),
        ("no-shadows", args.no_shadows),
        ("crop", args.crop.is_some()),
        ("resolution", args.resolution.is_some()),
        ("shadow-only", args.shadow_only),
    ];
    if let Some((name, _)) = given.iter().find(|(_, given)| *given) {
        return Err(Failure::Usage(format!(
            "--{name}: is for rendering, and --compare for existing pictures"
        )));
    }
    let pictures = [&args.first, &args.second].into_iter();
    for path in pictures.chain(&args.difference) {
        Format::of(path)?;
    }
    let found = compare(&args.first, &args.second, args.difference.as_deref())?;
    let mut out = Output::standard();
    out.line(found);
    out.flush()
}

fn print(report: &Report) -> Result<()> {
    let seconds = |d: std::time::Duration| format!("{:.2} s", d.as_secs_f64());
    let work = &report.work;
    let rays = seconds(report.threads.saturating_sub(work.looking_up));
    let lookups = seconds(work.looking_up);
    let each = work.looking_up.as_nanos() as f64 / work.lookups.max(1) as f64;
    let mebibytes = report.bytes as f64 / f64::from(1 << 20);
    let mut out = Output::standard();
    for (what, value) in [
        ("preparing", seconds(report.preparing)),
        ("rendering", seconds(report.rendering)),
        (
            "camera rays",
            format!("{} in {rays} of all threads", work.rays),
        ),
        (
            "shadow lookups",
            format!(
                "{} in {lookups} of all threads, {each:.0} ns each (with two clock reads)",
                work.lookups
            ),
        ),
        ("memory of shadows", format!("{mebibytes:.1} MiB")),
    ] {
        out.line(format!("{what:<17}  {value}"));
    }
    if let Some(cache) = &report.cache {
        out.line(cache);
    }
    out.flush()
}
