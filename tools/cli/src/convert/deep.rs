//! `.dsm` to deep OpenEXR.

use deepshadow::{DeepSample, FunctionRef, TileId, Visibility};
use deepshadow_exr::{Channel, DeepBlock, DeepWriter, Part, Rect, SampleType, Tiles, f16};
use rayon::prelude::*;

use super::args::Args;
use super::level::Level;
use crate::inputs::find_map;
use crate::runstats::Clock;
use crate::source::header::{exr_attributes, windows};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, InFile, Result};

/// Converts one level of one map.
///
/// # Errors
/// `Usage` for numbers outside their domains; `Failed` for everything else.
pub fn convert(args: &Args, file: &deepshadow::DsmFile, console: Console) -> Result<()> {
    let clock = Clock::default();
    let tolerance = args.base.tolerance()?.unwrap_or(0.002);
    let compression = args.exr_compression()?;
    let map = find_map(file, args.map.as_deref())?;
    let level = Level::new(file, map.level(args.level.unwrap_or(0)))?;
    let shape = level.shape;
    let header = &file.map(map)?.header;
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
    let mut writer = DeepWriter::create(output, vec![part.clone()]).in_file(output)?;
    let mut bar = console.bar("converting");
    let (mut done, mut samples) = (0, 0u64);
    let side = shape.tile_size;
    for y in (0..shape.height).step_by(side as usize) {
        let height = side.min(shape.height - y);
        let rects = (0..shape.width).step_by(side as usize);
        let rects: Vec<_> = rects
            .map(|x| [x, y, side.min(shape.width - x), height])
            .collect();
        let fitted: Result<Vec<Vec<Vec<DeepSample>>>> = rects
            .par_iter()
            .map(|&[x, y, width, height]| {
                let functions = level.functions(x, y, width, height)?;
                let fit = |(i, f): (usize, &Visibility)| {
                    let f = f.function();
                    let fitted = match args.float {
                        true => f.deep_samples(tolerance, |opacity| opacity as f32),
                        false => f.deep_samples(tolerance, half),
                    };
                    fitted.map_err(|error| {
                        let (i, j) = (x + i as u32 % width, y + i as u32 / width);
                        misfit(args, &error, (i, j))
                    })
                };
                functions.iter().enumerate().map(fit).collect()
            })
            .collect();
        let fitted = fitted?;
        let at = |[x, y, width, height]: [u32; 4]| Rect {
            x: data.x.wrapping_add_unsigned(x),
            y: data.y.wrapping_add_unsigned(y),
            width,
            height,
        };
        let mut blocks = Vec::new();
        if args.tiled {
            for (rect, pixels) in rects.iter().zip(&fitted) {
                blocks.push(block(&part, at(*rect), pixels.iter()));
            }
        } else {
            // Scanlines cross all tiles.
            let pixels = (0..height as usize).flat_map(|j| {
                rects.iter().zip(&fitted).flat_map(move |(rect, pixels)| {
                    let width = rect[2] as usize;
                    &pixels[j * width..(j + 1) * width]
                })
            });
            blocks.push(block(&part, at([0, y, shape.width, height]), pixels));
        }
        for block in &blocks {
            samples += block.sample_count() as u64;
            writer.write(0, block).in_file(output)?;
        }
        done += u64::from(height);
        bar.set(done, shape.height.into());
    }
    writer.finish().in_file(output)?;
    drop(bar);
    if args.runstats {
        let vertices = file.level(level.id)?.vertices;
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
    for ty in 0..level.shape.tiles_y() {
        let ramps: deepshadow::Result<Vec<bool>> = (0..level.shape.tiles_x())
            .into_par_iter()
            .map(|tx| {
                let tile = level.file.tile(level.id, TileId::new(tx, ty))?;
                Ok((0..tile.pixels()).any(|i| has_ramp(tile.function(i))))
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

fn block<'a>(
    part: &Part,
    rect: Rect,
    pixels: impl Iterator<Item = &'a Vec<DeepSample>>,
) -> DeepBlock {
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
