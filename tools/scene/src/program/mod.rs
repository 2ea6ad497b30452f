//! The program `dsm-build`.

pub mod args;
mod report;

use std::path::Path;

use deepshadow::Encoding;
use deepshadow_frame::Result;
use deepshadow_frame::args::{from_matches, matches};
use deepshadow_frame::console::Console;
use deepshadow_frame::stream::Destination;

use crate::build::build;
use crate::scene::{Light, Scene, Shape};
use args::Args;

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for invalid or contradicting arguments, `Failed` for everything else, with one line.
pub fn run() -> Result<()> {
    let command = Args::command().after_help(demos());
    let args: Args = from_matches(&matches(command, std::env::args_os())?)?;
    let destination = Destination::of_dsm(&args.output, args.runstats)?;
    let console = args.running.start("dsm-build")?;
    let made = write(&args, destination.path(), console);
    destination.deliver(made)
}

/// Builds the file at `path`.
fn write(args: &Args, path: &Path, console: Console) -> Result<()> {
    let started = std::time::Instant::now();
    let settings = args.settings()?;
    let scene = args.scene()?;
    let read = started.elapsed();
    say(&scene, console);
    let mut bar = console.bar("building");
    let report =
        build(&scene, path, &settings, |done, total| bar.set(done, total)).map_err(args::usage)?;
    drop(bar);
    for (light, why) in &report.lit {
        console.note(format_args!(
            "light {light:?}: its map is lit everywhere: {why}"
        ));
    }
    if args.runstats {
        report::print(&scene, &report, path, [read, started.elapsed()])?;
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
        if let Some(line) = coarse_depths(scene, light) {
            console.note(format_args!("light {:?}: {line}", light.name));
        }
    }
}

/// Warns about a light so far away that the 32-bit floats of its depths cannot tell the parts of
/// the objects apart.
fn coarse_depths(scene: &Scene, light: &Light) -> Option<String> {
    let view = light.views(scene).ok()?.into_iter().next()?;
    let (near, far) = scene.extent(|p| view.eye.axes(p)).ok()?;
    let size = (far - near).max_element();
    let depth = near.z.abs().max(far.z.abs()) as f32;
    let step = f64::from(depth.next_up()) - f64::from(depth);
    (size > 0.0 && size < 1000.0 * step).then(|| {
        format!(
            "depths near {depth:e} are stored in steps of {step:.3e}, too coarse for objects of \
             size {size:.3e}: move the light nearer to them"
        )
    })
}

/// The demos, for the help text.
fn demos() -> String {
    let lines = crate::demo::names().map(|(name, what)| format!("  demo:{name:<10} {what}\n"));
    format!("Demos:\n{}", lines.collect::<String>())
}
