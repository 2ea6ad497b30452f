//! Deep and flat OpenEXR to `.dsm`.

use deepshadow::{Codec, Curve, DsmFile, Encoding, Mips, Pixels, Ray, TileId, Writer};
use rayon::prelude::*;

use super::args::Args;
use crate::runstats::{Clock, Vertices};
use crate::source::DeepSource;
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::storage::small_lattice;
use deepshadow_frame::{InFile, Result};

/// Columns of the image that one read covers.
const COLUMNS: u32 = 4096;

/// Tiles of functions in memory at once, before compression.
const TILES: usize = 64;

/// Converts the image.
///
/// # Errors
/// `Usage` for options that contradict each other; `Failed` for everything else.
pub fn convert(args: &Args, source: &DeepSource, console: Console) -> Result<()> {
    let clock = Clock::default();
    let encoding = encoding(args)?;
    let output = args.output.as_path();
    let writer = Writer::create(output).in_file(output)?;
    let vertices = write(args, source, writer, &encoding, console)?;
    if args.runstats {
        let tally = source.tally();
        let mut out = Output::standard();
        out.line(format_args!(
            "samples in      {} ({:.2} a pixel)",
            tally.samples,
            tally.samples as f64 / tally.pixels.max(1) as f64
        ));
        clock.report(output, Some(&vertices), out)?;
    }
    Ok(())
}

/// Converts the image to a map in an unnamed temporary file, for another conversion.
///
/// # Errors
/// As [`convert`].
pub fn temporary(args: &Args, source: &DeepSource, console: Console) -> Result<DsmFile> {
    let file = tempfile::tempfile()?;
    let writer = Writer::new(file.try_clone()?)?;
    let encoding = Encoding::new(args.base.tolerance.unwrap_or(0.001)).codec(Codec::Lz4);
    let needs_levels = args.width.is_some() || args.level.is_some();
    let mips = if needs_levels {
        encoding.mips
    } else {
        Mips::None
    };
    write(args, source, writer, &encoding.mips(mips), console)?;
    Ok(DsmFile::from_file(file, args.running.limits(1))?)
}

/// Compresses the image into `writer`, and finishes it.
fn write(
    args: &Args,
    source: &DeepSource,
    mut writer: Writer,
    encoding: &Encoding,
    console: Console,
) -> Result<Vertices> {
    let output = args.output.as_path();
    let mut header = source.header().clone();
    args.describe(&mut header);
    let tile = header.tile_size;
    let (width, height) = (header.width, header.height);
    let part = source.part();
    let names = part.channels.iter().map(|c| c.name.as_str());
    console.detail(format_args!(
        "{}: {} {}, {width} x {height} pixels, channels {}",
        args.input.display(),
        if part.deep { "deep" } else { "flat" },
        if part.tiles.is_some() {
            "tiles"
        } else {
            "lines"
        },
        names.collect::<Vec<_>>().join(" "),
    ));

    let mut bar = console.bar("converting");
    writer.on_progress(move |done, total| {
        bar.set(done, total);
        true
    });
    let map = writer.add_map(header, encoding.clone()).in_file(output)?;
    // The error of chords is a small part of the tolerance.
    let finest = encoding
        .mip_tolerance
        .unwrap_or(1.0)
        .min(encoding.tolerance);
    let chord = finest.max(Encoding::MIN_TOLERANCE) / 64.0;
    let mut vertices = Vertices::default();
    // A whole number of tiles, and of the image's own blocks if possible.
    let band = source.block_rows().clamp(tile, 256).next_multiple_of(tile);
    for y in (0..height).step_by(band as usize) {
        let rows = band.min(height - y);
        for x in (0..width).step_by(COLUMNS as usize) {
            let columns = COLUMNS.min(width - x);
            let rays = source.rays(x, y, columns, rows)?;
            let tops = (y..y + rows).step_by(tile as usize);
            let corners = tops.flat_map(|ty| {
                let lefts = (x..x + columns).step_by(tile as usize);
                lefts.map(move |tx| (tx, ty))
            });
            for corners in corners.collect::<Vec<_>>().chunks(TILES) {
                let made: Vec<((TileId, Pixels), Vertices)> = corners
                    .par_iter()
                    .map(|&(left, top)| {
                        let right = (left + tile).min(x + columns);
                        let bottom = (top + tile).min(y + rows);
                        let pixels = (top..bottom).flat_map(|j| (left..right).map(move |i| (i, j)));
                        let rays = pixels.map(|(i, j)| &rays[((j - y) * columns + i - x) as usize]);
                        flatten(rays, chord, encoding.tolerance, (left / tile, top / tile))
                    })
                    .collect();
                let mut tiles = Vec::with_capacity(made.len());
                for (input, counted) in made {
                    vertices.add(&counted);
                    tiles.push(input);
                }
                writer.tiles(map, tiles).in_file(output)?;
            }
        }
    }
    writer.finish().in_file(output)?;

    let tally = source.tally();
    let input = args.input.display();
    if tally.repairs.total() > 0 {
        console.note(format_args!("{input}: {}", tally.repairs));
    }
    if tally.limited > 0 {
        let limited = tally.limited;
        console.note(format_args!(
            "{input}: --opacitylimit made {limited} pixels opaque"
        ));
    }
    if vertices.count == 0 {
        console.note(format_args!(
            "{input}: no pixel has a sample with opacity; the map is lit everywhere"
        ));
    }
    Ok(vertices)
}

fn flatten<'a>(
    rays: impl Iterator<Item = &'a Ray>,
    chord: f64,
    tolerance: f64,
    (tx, ty): (u32, u32),
) -> ((TileId, Pixels), Vertices) {
    let mut vertices = Vertices::default();
    let curves = rays.map(|ray| {
        let mut curve = Curve::lit(1);
        ray.flatten(chord, &mut curve);
        vertices.count_curve(&curve, tolerance);
        curve
    });
    let pixels = Pixels::Curves(curves.collect());
    ((TileId::new(tx, ty), pixels), vertices)
}

/// Returns the encoding of the map.
///
/// # Errors
/// `Usage` for options that contradict each other.
pub fn encoding(args: &Args) -> Result<Encoding> {
    let tolerance = args.base.tolerance.unwrap_or(0.01);
    let encoding = args.encoding()?;
    let finest = tolerance.min(encoding.mip_tolerance.unwrap_or(1.0));
    let precision = match args.lattice.precision(finest)? {
        None if encoding.mip_tolerance.is_none() => Some(small_lattice(tolerance)),
        given => given,
    };
    Ok(encoding.tolerance(tolerance).precision(precision))
}
