//! Reproduces the figures of Lokovic and Veach with our own scenes.
//!
//! Writes `docs/figures.md` with its pictures, plots and numbers.
//! `cargo run --release -p deepshadow-figures` takes some minutes. `--quick` makes small, noisy
//! pictures, to check that everything runs.

mod growth;
mod hair;
mod page;
mod plain;
mod shots;
mod width;

use std::path::PathBuf;

use clap::Parser;
use deepshadow_frame::Result;

use page::Page;
use shots::Studio;

/// Reproduces the figures of Lokovic and Veach in docs/figures.md and docs/figures/.
#[derive(Debug, Parser)]
#[command(name = "deepshadow-figures", version)]
struct Args {
    /// Output folder for figures.md and figures/
    #[arg(default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs"))]
    folder: PathBuf,
    /// Makes small, noisy pictures in a minute or two
    #[arg(long)]
    quick: bool,
}

fn main() -> std::process::ExitCode {
    deepshadow_frame::exit("deepshadow-figures", run(&Args::parse()))
}

fn run(args: &Args) -> Result<()> {
    let mut page = Page::new(&args.folder)?;
    let studio = Studio::new(args.quick)?;
    hair::with_and_without(&studio, &mut page)?;
    hair::magnified(&studio, &mut page)?;
    growth::tables(&studio, &mut page)?;
    width::table(&studio, &mut page)?;
    shots::clouds(&studio, &mut page)?;
    shots::motion(&studio, &mut page)?;
    shots::colour(&studio, &mut page)?;
    shots::blur(&studio, &mut page)?;
    page.write()
}
