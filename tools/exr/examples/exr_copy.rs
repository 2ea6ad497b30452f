//! Rewrites the deep parts of an OpenEXR file with another compression or tiling.
//!
//! `exr_copy IN OUT none|rle|zips|zstd [scanline | WIDTHxHEIGHT] [level]`

use std::fs::File;

use deepshadow_exr::{Compression, DeepReader, DeepWriter, LineOrder, Part, Rect, Tiles};

fn main() -> std::process::ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if !(3..=5).contains(&args.len()) {
        eprintln!("usage: exr_copy IN OUT none|rle|zips|zstd [scanline | WIDTHxHEIGHT] [level]");
        return 2.into();
    }
    match copy(&args) {
        Ok(()) => 0.into(),
        Err(e) => {
            eprintln!("{}: {e}", args[0]);
            1.into()
        }
    }
}

fn copy(args: &[String]) -> Result<(), Box<dyn std::error::Error>> {
    let reader = DeepReader::open(&args[0])?;
    let compression = match args[2].as_str() {
        "none" => Compression::None,
        "rle" => Compression::Rle,
        "zips" => Compression::Zips,
        "zstd" => Compression::Zstd,
        other => return Err(format!("deep parts do not allow compression {other}").into()),
    };
    let tiles = match args.get(3).map(|a| a.as_str()) {
        None | Some("scanline") => None,
        Some(size) => {
            let (w, h) = size.split_once('x').ok_or("tiles are WIDTHxHEIGHT")?;
            Some(Tiles::new(w.parse()?, h.parse()?))
        }
    };
    let deep: Vec<usize> = (0..reader.parts().len())
        .filter(|&i| reader.parts()[i].deep)
        .collect();
    let parts = deep
        .iter()
        .map(|&i| Part {
            compression,
            tiles,
            line_order: LineOrder::Increasing,
            ..reader.parts()[i].clone()
        })
        .collect();
    let mut writer = DeepWriter::new(File::create(&args[1])?, parts)?;
    if let Some(level) = args.get(4) {
        writer.set_level(level.parse()?);
    }
    for (out, &part) in deep.iter().enumerate() {
        let window = reader.parts()[part].data_window;
        // Copy one band of lines at a time: a row of tiles, or 64 scanlines.
        let height = tiles.map_or(64, |t| t.height);
        for top in (0..window.height).step_by(height as usize) {
            let band = Rect {
                y: window.y + top as i32,
                height: height.min(window.height - top),
                ..window
            };
            let block = reader.read_rect(part, band)?;
            let Some(t) = tiles else {
                writer.write(out, &block)?;
                continue;
            };
            for left in (0..window.width).step_by(t.width as usize) {
                let tile = Rect {
                    x: window.x + left as i32,
                    width: t.width.min(window.width - left),
                    ..band
                };
                let tile = block.crop(tile).ok_or("a tile lies outside its band")?;
                writer.write(out, &tile)?;
            }
        }
    }
    writer.finish()?;
    Ok(())
}
