//! `dsm-build`: the program.

pub mod args;
mod report;

use std::path::Path;

use clap::{CommandFactory, FromArgMatches};
use deepshadow::tolerance_warning;
use deepshadow_frame::progress::Bar;
use deepshadow_frame::{Failure, Result};

use crate::build::build;
use crate::scene::{Scene, Shape};
use args::Args;

/// Runs the program with the arguments of the process.
///
/// # Errors
/// `Usage` for arguments that make no sense together, `Failed` for everything else, with one line.
pub fn run() -> Result<()> {
    let args = match Args::from_arg_matches(&Args::command().after_help(demos()).get_matches()) {
        Ok(args) => args,
        Err(e) => e.exit(),
    };
    if args
        .output
        .extension()
        .is_none_or(|e| !e.eq_ignore_ascii_case("dsm"))
    {
        let line = format!("{}: the output is a .dsm file", args.output.display());
        return Err(Failure::Usage(line));
    }
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build_global()
            .map_err(|e| Failure::Failed(format!("cannot start {threads} threads: {e}")))?;
    }
    let started = std::time::Instant::now();
    let settings = args.settings()?;
    let scene = args.scene()?;
    let read = started.elapsed();
    warn(&scene);
    let mut bar = Bar::new("building");
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

/// Says on standard error what is legal and yet not what anybody wants.
fn warn(scene: &Scene) {
    let surfaces = scene
        .objects
        .iter()
        .any(|o| o.shadow && !matches!(o.shape, Shape::Volume(_)));
    if !surfaces {
        return;
    }
    for light in &scene.lights {
        if let Some(line) = light
            .tolerance
            .and_then(|t| tolerance_warning(t, light.samples))
        {
            eprintln!("dsm-build: light {:?}: {line}", light.name);
        }
    }
}

/// The demos, for the help.
fn demos() -> String {
    let lines = crate::demo::names().map(|(name, what)| format!("  demo:{name:<10} {what}\n"));
    format!("Demos:\n{}", lines.collect::<String>())
}
