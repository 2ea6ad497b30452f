//! The program `dsm-build`.

pub mod args;
mod report;

use std::path::Path;

use deepshadow::Encoding;
use deepshadow_frame::args::{from_matches, matches};
use deepshadow_frame::console::Console;
use deepshadow_frame::{Failure, Result};

use crate::build::build;
use crate::scene::{Scene, Shape};
use args::Args;

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for invalid or contradicting arguments, `Failed` for everything else, with one line.
pub fn run() -> Result<()> {
    let command = Args::command().after_help(demos());
    let args: Args = from_matches(&matches(command, std::env::args_os())?)?;
    if args
        .output
        .extension()
        .is_none_or(|e| !e.eq_ignore_ascii_case("dsm"))
    {
        let line = format!("{}: the output is a .dsm file", args.output.display());
        return Err(Failure::Usage(line));
    }
    let console = args.running.start("dsm-build")?;
    let started = std::time::Instant::now();
    let settings = args.settings()?;
    let scene = args.scene()?;
    let read = started.elapsed();
    say(&scene, console);
    let mut bar = console.bar("building");
    let report = build(&scene, &args.output, &settings, |done, total| {
        bar.set(done, total)
    })
    .map_err(args::usage)?;
    drop(bar);
    if args.runstats {
        report::print(
            &scene,
            &report,
            Path::new(&args.output),
            [read, started.elapsed()],
        )?;
    }
    Ok(())
}

/// Prints the settings of each light, and warns about valid settings that waste space.
fn say(scene: &Scene, console: Console) {
    let surfaces = scene
        .objects
        .iter()
        .any(|o| o.shadow && !matches!(o.shape, Shape::Volume(_)));
    for light in &scene.lights {
        let [width, height] = light.resolution;
        console.detail(format_args!(
            "light {:?}: {width} x {height} pixels of {} rays, within {}",
            light.name,
            light.samples,
            light.tolerance()
        ));
        let warning = light.tolerance.filter(|_| surfaces);
        if let Some(line) = warning.and_then(|t| Encoding::tolerance_warning(t, light.samples)) {
            console.note(format_args!("light {:?}: {line}", light.name));
        }
    }
}

/// The demos, for the help text.
fn demos() -> String {
    let lines = crate::demo::names().map(|(name, what)| format!("  demo:{name:<10} {what}\n"));
    format!("Demos:\n{}", lines.collect::<String>())
}
