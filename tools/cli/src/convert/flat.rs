//! `.dsm` to a flat image: visibility at a depth, opacity behind everything, or the number of vertices.

use std::io::{Cursor, Write};

use deepshadow::{AtomicFile, DsmFile, Visibility};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes,
    Vec2, WritableImage,
};
use rayon::prelude::*;

use super::args::{Args, Output};
use super::level::{Level, find_map};
use super::stats::Clock;
use crate::progress::Bar;
use crate::source::header::{exr_attributes, windows};
use crate::{Failure, InFile, Result};

/// The most numbers that an image may hold; it is written in one piece.
const MOST: u64 = 1 << 29;

/// A flat image of floats, pixel by pixel, one channel or three.
struct Picture {
    width: u32,
    height: u32,
    channels: usize,
    values: Vec<f32>,
}

/// Converts one level of one map.
///
/// # Errors
/// `Failed`, also for images beyond 2^29 numbers.
pub fn convert(args: &Args, file: &DsmFile, output: Output) -> Result<()> {
    let clock = Clock::default();
    if args.depth.is_some_and(f32::is_nan) {
        return Err(Failure::Usage("--depth nan is no depth".into()));
    }
    let map = find_map(file, args.map.as_deref())?;
    let level = Level::new(file, map, args.level.unwrap_or(0))?;
    let mut picture = picture(args, &level)?;
    let path = args.output.as_path();
    let bytes = match output {
        Output::Png => png(args, &mut picture)?,
        _ => open_exr(&level, picture)?,
    };
    let write = || {
        let mut file = AtomicFile::create(path)?;
        file.write_all(&bytes)?;
        file.commit()
    };
    write().in_file(path)?;
    if args.runstats {
        clock.report_file(path)?;
    }
    Ok(())
}

fn picture(args: &Args, level: &Level<'_>) -> Result<Picture> {
    let (width, height) = (level.shape.width, level.shape.height);
    let channels = if !args.count && level.is_coloured()? {
        3
    } else {
        1
    };
    let numbers = u64::from(width) * u64::from(height) * channels as u64;
    if numbers > MOST {
        return Err(Failure::Failed(format!(
            "a flat image of {numbers} numbers, over the limit of {MOST}: cut it by --region, or take a higher --level"
        )));
    }
    let value = |f: &Visibility| match args.depth {
        Some(z) => f.at_rgb(z),
        None if args.opacity => f.end().map(|v| 1.0 - v),
        None => [f.len() as f32; 3],
    };
    let mut bar = Bar::new("evaluating");
    let mut values = Vec::with_capacity(numbers as usize);
    for y in (0..height).step_by(level.shape.tile_size as usize) {
        let rows = level.shape.tile_size.min(height - y);
        let functions = level.functions(0, y, width, rows)?;
        let found: Vec<[f32; 3]> = functions.par_iter().map(value).collect();
        values.extend(found.iter().flat_map(|v| &v[..channels]));
        bar.set(u64::from(y + rows), height.into());
    }
    Ok(Picture {
        width,
        height,
        channels,
        values,
    })
}

fn open_exr(level: &Level<'_>, picture: Picture) -> Result<Vec<u8>> {
    let header = &level.file.maps()[level.map].header;
    let (data, display) = windows(header, level.level as u32, picture.width, picture.height);
    let names: &[&str] = match picture.channels {
        1 => &["Y"],
        _ => &["R", "G", "B"],
    };
    let channel = |(c, name): (usize, &&str)| {
        let values = picture.values.iter().skip(c).step_by(picture.channels);
        AnyChannel::new(*name, FlatSamples::F32(values.copied().collect()))
    };
    let channels = AnyChannels::sort(names.iter().enumerate().map(channel).collect());
    let mut attributes = LayerAttributes {
        layer_position: Vec2(data.x, data.y),
        ..LayerAttributes::default()
    };
    for a in exr_attributes(header).0 {
        let Some(m) = a.as_m44f() else { continue };
        match a.name.as_str() {
            "worldToCamera" => attributes.world_to_camera = Some(m),
            "worldToNDC" => attributes.world_to_normalized_device = Some(m),
            _ => {}
        }
    }
    let size = (picture.width as usize, picture.height as usize);
    let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels);
    let mut image = Image::from_layer(layer);
    image.attributes.display_window = IntegerBounds::new(
        Vec2(display.x, display.y),
        Vec2(display.width as usize, display.height as usize),
    );
    let mut bytes = Cursor::new(Vec::new());
    let written = image.write().non_parallel().to_buffered(&mut bytes);
    written.map_err(|e| Failure::Failed(format!("cannot make the image: {e}")))?;
    Ok(bytes.into_inner())
}

/// 16 bits, linear: white is 1, or the largest count.
fn png(args: &Args, picture: &mut Picture) -> Result<Vec<u8>> {
    let white = match args.count {
        true => picture.values.iter().fold(1.0, |m: f32, &v| m.max(v)),
        false => 1.0,
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, picture.width, picture.height);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_color(match picture.channels {
        1 => png::ColorType::Grayscale,
        _ => png::ColorType::Rgb,
    });
    encoder.set_source_gamma(png::ScaledFloat::new(1.0));
    let failed = |e: png::EncodingError| Failure::Failed(format!("cannot make the image: {e}"));
    let meaning = match args.count {
        true => format!("number of vertices, white is {white}"),
        false => "linear, white is 1".into(),
    };
    encoder
        .add_text_chunk("Description".into(), meaning.clone())
        .map_err(failed)?;
    if args.count || args.verbose {
        println!("{}: {meaning}", args.output.display());
    }
    let mut writer = encoder.write_header().map_err(failed)?;
    let scaled = |v: &f32| (f64::from(*v) / f64::from(white) * 65535.0).round() as u16;
    // PNG is the one format here that stores its numbers with the high byte first.
    let data: Vec<u8> = picture
        .values
        .iter()
        .map(scaled)
        .flat_map(|v| [(v >> 8) as u8, v as u8])
        .collect();
    writer.write_image_data(&data).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}
