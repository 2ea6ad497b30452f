//! `.dsm` to a flat image: visibility at a depth, opacity behind all vertices, or the number of
//! vertices.

use deepshadow::{DsmFile, FunctionRef};
use rayon::prelude::*;

use super::args::{Args, Output};
use super::level::Level;
use super::picture::Picture;
use super::slice::Slice;
use crate::inputs::find_map;
use crate::runstats::Clock;
use deepshadow_frame::Result;
use deepshadow_frame::args::Region;
use deepshadow_frame::console::Console;
use deepshadow_frame::output;
use deepshadow_frame::stream::is_standard_output;

/// Converts one level of one map.
///
/// # Errors
/// `Failed`, also for images of more than 2^29 numbers.
pub fn convert(args: &Args, file: DsmFile, output: Output, console: Console) -> Result<()> {
    let clock = Clock::default();
    let map = find_map(&file, args.map.as_deref())?;
    let header = file.map(map)?.header.clone();
    let path = args.output.as_path();
    let begun = output::begin(path)?;
    let level = Level::new(&file, map.level(args.level.unwrap_or(0)))?;
    let (number, region) = (level.id.level, level.region(args.region)?);
    let picture = match (args.depth, args.width) {
        (Some(depth), Some(width)) => {
            let slice = Slice {
                depth,
                width,
                filter: args.filter.unwrap_or_default(),
                region,
            };
            slice.picture(file, map, console)?
        }
        _ => pixels(args, &level, region, console)?,
    };
    if output != Output::Png {
        output::finish(begun, path, &picture.exr(&header, number, region)?)?;
    } else {
        let (white, meaning) = scale(args, &picture);
        output::finish(begun, path, &picture.png(white, &meaning)?)?;
        let line = format!("{}: {meaning}", args.target.display());
        if args.count && !is_standard_output(&args.target) {
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

/// Evaluates every function of a rectangle of a level.
fn pixels(
    args: &Args,
    level: &Level<'_>,
    [x, top, width, height]: Region,
    console: Console,
) -> Result<Picture> {
    let coloured = !args.count && level.is_coloured()?;
    let mut picture = Picture::new(width, height, coloured, level.file.limits())?;
    let value = |f: FunctionRef<'_>| match args.depth {
        Some(z) => f.visibility_rgb(z).map(|v| v as f32),
        None if args.opacity => f.end_rgb().map(|v| 1.0 - v as f32),
        None => [f.len() as f32; 3],
    };
    let mut bar = console.bar("evaluating");
    for band in level.bands([x, top, width, height]) {
        let (rows, band) = band?;
        for y in rows.clone() {
            let pixels = (x..x + width).into_par_iter();
            let found: Vec<_> = pixels.map(|x| value(band.function(x, y))).collect();
            picture.extend(found);
        }
        bar.set((rows.end - top).into(), height.into());
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
