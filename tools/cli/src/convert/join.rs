//! Several `.dsm` files to one: parts of maps stitched, maps of one camera merged. The work is the library's.

use std::path::{Path, PathBuf};

use deepshadow::{DsmFile, Encoding, MapId, Merge, Mips, Stitch, Writer};

use super::args::{Args, Output, check_tolerance};
use super::from_exr::{lattice, precision};
use super::level::find_map;
use super::open_dsm;
use super::stats::Clock;
use deepshadow_frame::progress::Bar;
use deepshadow_frame::{Failure, InFile, Result};

/// Joins the files.
///
/// # Errors
/// `Usage` for options that do not go together; `Failed` for everything else.
pub fn convert(args: &Args, inputs: &[PathBuf], output: Output) -> Result<()> {
    if output != Output::Dsm {
        let line = format!("--stitch and --merge make .dsm files, not {output}");
        return Err(Failure::Usage(line));
    }
    if args.merge && inputs.len() < 2 {
        return Err(Failure::Usage("--merge needs two inputs or more".into()));
    }
    let clock = Clock::default();
    let encoding = Encoding::default()
        .compressor(args.compressor())
        .codec(args.codec()?)
        .mip_tolerance(check_tolerance("mip-tolerance", args.mip_tolerance)?)
        .mips(if args.nomipmap {
            Mips::None
        } else {
            Mips::Full
        });
    let tolerance = check_tolerance("tolerance", args.tolerance)?;
    let mut files = Vec::with_capacity(inputs.len());
    for path in inputs {
        files.push((path.display().to_string(), open_dsm(path)?));
    }
    if args.stitch {
        stitch(args, files, &encoding)?;
    } else {
        merge(args, files, tolerance, encoding)?;
    }
    if args.runstats {
        clock.report(&args.output, None)?;
    }
    Ok(())
}

fn stitch(args: &Args, files: Vec<(String, DsmFile)>, encoding: &Encoding) -> Result<()> {
    let output = args.output.as_path();
    let stitch = said(Stitch::new(files), output)?;
    say(stitch.notes());
    for (map, header) in stitch.headers().enumerate() {
        let (w, h, lit) = (
            header.width,
            header.height,
            stitch.lit_pixels(MapId(map as u32)),
        );
        if lit > 0 {
            eprintln!(
                "dsm-convert: {}: {lit} of the {w} x {h} pixels of map {:?} are in no part and are lit",
                output.display(),
                header.name
            );
        }
        if args.verbose {
            let given = stitch.source_error(MapId(map as u32));
            eprintln!(
                "{:?}: {w} x {h} pixels, the base within {given}",
                header.name
            );
        }
    }
    write("stitching", output, |writer| stitch.write(writer, encoding))
}

fn merge(
    args: &Args,
    files: Vec<(String, DsmFile)>,
    tolerance: Option<f64>,
    encoding: Encoding,
) -> Result<()> {
    let output = args.output.as_path();
    let merge = match &args.map {
        Some(map) => {
            let found = files
                .iter()
                .map(|(name, file)| find_map(file, Some(map)).in_file(Path::new(name)));
            let maps = found.collect::<Result<_>>()?;
            Merge::of_maps(files, maps)
        }
        None => Merge::new(files),
    };
    let mut merge = said(merge, output)?;
    if args.name.is_some() && merge.headers().len() > 1 {
        let line = "--name needs --map: there are several maps";
        return Err(Failure::Failed(line.into()));
    }
    for header in merge.headers_mut() {
        args.describe(header)?;
    }
    say(merge.notes());
    let mut encodings = Vec::new();
    for map in 0..merge.headers().len() {
        let given = merge.source_error(MapId(map as u32));
        let tolerance = tolerance.unwrap_or_else(|| merge.default_tolerance(MapId(map as u32)));
        let left = tolerance.min(encoding.mip_tolerance.unwrap_or(1.0)) - given;
        let name = &merge.headers()[map].name;
        if left <= 0.0 && (given > 0.0 || left < 0.0) {
            return Err(Failure::Failed(format!(
                "the promises for map {name:?} add up to {given}: --tolerance and --mip-tolerance must be above that"
            )))
            .in_file(output);
        }
        if args.verbose {
            eprintln!("{name:?}: the promises add up to {given}, the result is within {tolerance}");
        }
        encodings.push(
            encoding
                .clone()
                .tolerance(tolerance)
                .precision(precision(args, left)?.or(Some(lattice(left)))),
        );
    }
    write("merging", output, |writer| merge.write(writer, &encodings))
}

/// Writes a file that appears whole or not at all.
fn write(
    what: &'static str,
    output: &Path,
    fill: impl FnOnce(&mut Writer) -> deepshadow::Result<()>,
) -> Result<()> {
    let mut writer = Writer::create(output).in_file(output)?;
    let mut bar = Bar::new(what);
    writer.on_progress(move |p| {
        bar.set(p.done, p.total);
        true
    });
    said(fill(&mut writer), output)?;
    writer.finish().in_file(output)?;
    Ok(())
}

/// An error of an input names it already; others are the output's.
fn said<T>(result: deepshadow::Result<T>, output: &Path) -> Result<T> {
    match result {
        Err(e) if e.file().is_some() => Err(e.into()),
        result => result.in_file(output),
    }
}

fn say(notes: &[String]) {
    notes.iter().for_each(|n| eprintln!("dsm-convert: {n}"));
}
