//! `.dsm` to a flat image: visibility at a depth, opacity behind all vertices, or the number of
//! vertices.

use deepshadow::{DsmFile, FunctionRef};
use rayon::prelude::*;

use super::args::{Args, Output};
use super::level::Level;
use super::picture::Picture;
use super::slice;
use crate::inputs::find_map;
use crate::runstats::Clock;
use deepshadow_frame::console::Console;
use deepshadow_frame::output;
use deepshadow_frame::{Failure, Result};

/// Converts one level of one map.
///
/// # Errors
/// `Usage` for numbers outside their domains; `Failed` for everything else, including images of
/// more than 2^29 numbers.
pub fn convert(args: &Args, file: DsmFile, output: Output, console: Console) -> Result<()> {
    let clock = Clock::default();
    if args.depth.is_some_and(f32::is_nan) {
        return Err(Failure::Usage(
            "--depth nan: the depth must be a number or inf".into(),
        ));
    }
    let map = find_map(&file, args.map.as_deref())?;
    let level = args.level.unwrap_or(0);
    let header = file.map(map)?.header.clone();
    let path = args.output.as_path();
    let begun = output::begin(path)?;
    let picture = match (args.depth, args.width) {
        (Some(depth), Some(width)) => {
            let filter = args.filter.unwrap_or_default();
            slice::picture(file, map, depth, width, filter, console)?
        }
        _ => pixels(args, &Level::new(&file, map.level(level))?, console)?,
    };
    if output != Output::Png {
        output::finish(begun, path, &picture.exr(&header, level)?)?;
    } else {
        let (white, meaning) = scale(args, &picture);
        output::finish(begun, path, &picture.png(white, &meaning)?)?;
        let line = format!("{}: {meaning}", path.display());
        if args.count {
            let mut out = output::Output::standard();
            out.line(line);
            out.flush()?;
        } else {
            console.detail(line);
        }
    }
    if args.runstats {
        clock.report_file(path, output::Output::standard())?;
    }
    Ok(())
}

/// Evaluates every function of a level.
fn pixels(args: &Args, level: &Level<'_>, console: Console) -> Result<Picture> {
    let (width, height) = (level.shape.width, level.shape.height);
    let coloured = !args.count && level.is_coloured()?;
    let mut picture = Picture::new(width, height, coloured, level.file.limits())?;
    let value = |f: FunctionRef<'_>| match args.depth {
        Some(z) => f.visibility_rgb(z).map(|v| v as f32),
        None if args.opacity => f.end_rgb().map(|v| 1.0 - v as f32),
        None => [f.len() as f32; 3],
    };
    let mut bar = console.bar("evaluating");
    for band in level.bands() {
        let (rows, band) = band?;
        for y in rows.clone() {
            let pixels = (0..width).into_par_iter();
            let found: Vec<_> = pixels.map(|x| value(band.function(x, y))).collect();
            picture.extend(found);
        }
        bar.set(rows.end.into(), height.into());
    }
    Ok(picture)
}

/// Returns the value that is white in a PNG, and the meaning of its values.
fn scale(args: &Args, picture: &Picture) -> (f32, String) {
    if !args.count {
        return (1.0, "linear, white is 1".into());
    }
    let white = picture.largest();
    (white, format!("number of vertices, white is {white}"))
}
