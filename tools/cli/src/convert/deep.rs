//! `.dsm` to deep OpenEXR.

use deepshadow::raw::DeepSample;
use deepshadow::raw::directory::TileKind;
use deepshadow::{FunctionRef, Limits};
use deepshadow_exr::{Channel, DeepBlock, DeepWriter, Part, Rect, SampleType, Tiles, f16};
use rayon::prelude::*;

use super::args::Args;
use super::level::{Level, in_parts};
use crate::inputs::find_map;
use crate::runstats::Clock;
use crate::source::header::{exr_attributes, windows};
use deepshadow_frame::args::Region;
use deepshadow_frame::console::Console;
use deepshadow_frame::output::{Output, begin};
use deepshadow_frame::{Failure, InFile, Result};

/// Converts one level of one map.
///
/// # Errors
/// `Usage` for numbers outside their domains; `Failed` for everything else.
pub fn convert(args: &Args, file: &deepshadow::DsmFile, console: Console) -> Result<()> {
    let clock = Clock::default();
    let tolerance = args.base.tolerance.unwrap_or(0.002);
    let compression = args.exr_compression()?;
    let map = find_map(file, args.map.as_deref())?;
    let level = Level::new(file, map.level(args.level.unwrap_or(0)))?;
    let shape = level.shape;
    let header = &file.map(map)?.header;
    let vertices = file.level(level.id)?.vertices;
    Limits::check_content(4 * level.pixels() + 16 * vertices, "an image")?;
    let (coloured, thick) = needs(&level)?;

    let alpha = if args.float {
        SampleType::Float
    } else {
        SampleType::Half
    };
    let mut names = vec!["A"];
    if coloured {
        names.extend(["AB", "AG", "AR"]);
    }
    let mut channels: Vec<Channel> = names.iter().map(|n| Channel::new(*n, alpha)).collect();
    channels.push(Channel::new("Z", SampleType::Float));
    if thick {
        channels.push(Channel::new("ZBack", SampleType::Float));
    }
    let (data, display) = windows(header, level.id.level, shape.width, shape.height);
    let mut part = match args.tiled {
        true => Part::deep_tiled(data, channels, Tiles::new(shape.tile_size, shape.tile_size)),
        false => Part::deep_scanline(data, channels),
    };
    part.display_window = display;
    part.compression = compression;
    part.name = Some(header.name.clone());
    let (attributes, lost) = exr_attributes(header);
    part.attributes = attributes;
    if !lost.is_empty() {
        let lost = lost.join(", ");
        console.detail(format_args!("attributes that OpenEXR cannot hold: {lost}"));
    }

    let output = args.output.as_path();
    let file_out = begin(output)?;
    let mut writer = DeepWriter::new(file_out, vec![part.clone()]).in_file(output)?;
    let mut bar = console.bar("converting");
    let mut samples = 0u64;
    let side = shape.tile_size;
    let at = |[x, y, width, height]: Region| Rect {
        x: data.x.wrapping_add_unsigned(x),
        y: data.y.wrapping_add_unsigned(y),
        width,
        height,
    };
    let limits = file.limits();
    for band in level.bands(level.all()) {
        let (rows, band) = band?;
        // The chunks of the image: tiles, or single scanlines.
        let areas: Vec<Region> = match args.tiled {
            true => {
                let height = rows.len() as u32;
                let columns = (0..shape.width).step_by(side as usize);
                let tile = |x| [x, rows.start, side.min(shape.width - x), height];
                columns.map(tile).collect()
            }
            false => rows.clone().map(|y| [0, y, shape.width, 1]).collect(),
        };
        let cost = |area: &Region| {
            let vertices = pixels_of(*area).map(|(x, y)| band.function(x, y).len() as u64);
            Ok(vertices.map(|n| 64 * (1 + n)).sum())
        };
        let check = |bytes| Ok(limits.check(2 * bytes, "a chunk of samples")?);
        for areas in in_parts(areas, limits.memory / 2, cost, check)? {
            let fit = |(x, y)| {
                let f = band.function(x, y);
                let fitted = match args.float {
                    true => f.deep_samples(tolerance, |opacity| opacity as f32),
                    false => f.deep_samples(tolerance, half),
                };
                fitted.map_err(|error| misfit(args, &error, (x, y)))
            };
            let blocks: Result<Vec<DeepBlock>> = areas
                .par_iter()
                .map(|&area| {
                    let fitted: Result<Vec<_>> = pixels_of(area).map(fit).collect();
                    Ok(block(&part, at(area), &fitted?))
                })
                .collect();
            for block in &blocks? {
                samples += block.sample_count() as u64;
                writer.write(0, block).in_file(output)?;
            }
        }
        bar.set(rows.end.into(), shape.height.into());
    }
    let file_out = writer.finish().in_file(output)?;
    file_out.commit().in_file(output)?;
    drop(bar);
    if args.runstats {
        let mut out = Output::standard();
        out.line(format_args!("vertices in     {vertices}"));
        out.line(format_args!("samples out     {samples}"));
        clock.report_file(output, out)?;
    }
    Ok(())
}

/// Returns whether any function of the level is coloured, and whether any has a ramp.
fn needs(level: &Level<'_>) -> Result<(bool, bool)> {
    let coloured = level.is_coloured()?;
    for batch in level.file.batches(level.id)? {
        let ramps: deepshadow::Result<Vec<bool>> = batch?
            .par_iter()
            .filter(|run| run.entry.kind == TileKind::Data)
            .map(|run| {
                let tile = level.file.tile(level.id, level.shape.tile_at(run.first))?;
                Ok(tile.functions().any(has_ramp))
            })
            .collect();
        if ramps?.contains(&true) {
            return Ok((coloured, true));
        }
    }
    Ok((coloured, false))
}

fn has_ramp(f: FunctionRef<'_>) -> bool {
    let z = f.depths();
    let falls = |i: usize| (0..f.channels()).any(|c| f.value(i, c) != f.value(i - 1, c));
    (1..z.len()).any(|i| z[i] > z[i - 1] && falls(i))
}

/// Returns the nearest half float below 1.
fn half(opacity: f64) -> f32 {
    const LARGEST: f16 = f16::from_bits(0x3bff);
    f16::from_f64(opacity).min(LARGEST).to_f32()
}

fn misfit(args: &Args, error: &deepshadow::Error, (x, y): (u32, u32)) -> Failure {
    let hint = match args.float {
        true => "use a larger --tolerance",
        false => "use --float or a larger --tolerance",
    };
    Failure::Failed(format!("pixel {x},{y}: {error}: {hint}"))
}

/// Returns the pixels of a rectangle, row by row.
fn pixels_of([x, y, width, height]: Region) -> impl Iterator<Item = (u32, u32)> {
    (y..y + height).flat_map(move |y| (x..x + width).map(move |x| (x, y)))
}

fn block(part: &Part, rect: Rect, pixels: &[Vec<DeepSample>]) -> DeepBlock {
    let mut block = DeepBlock::with_channels(rect, &part.channels);
    for samples in pixels {
        for s in samples {
            let [r, g, b] = s.opacity;
            for (channel, data) in part.channels.iter().zip(&mut block.channels) {
                data.push(match channel.name.as_str() {
                    "A" if r == g && r == b => r,
                    // For readers that read no other channel.
                    "A" => (r + g + b) / 3.0,
                    "AR" => r,
                    "AG" => g,
                    "AB" => b,
                    "Z" => s.depth,
                    _ => s.depth_back,
                });
            }
        }
        block.push_pixel();
    }
    block
}
