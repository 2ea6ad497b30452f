//! Test images, and helpers that write and read them.

use deepshadow_exr::*;
use exr::prelude::{AnyChannels, FlatSamples, Image, Layer, WritableImage};
use std::io::Cursor;

mod data;
pub use data::data;

/// All compressions of deep parts.
pub const COMPRESSIONS: [Compression; 4] = [
    Compression::None,
    Compression::Rle,
    Compression::Zips,
    Compression::Zstd,
];

/// A random number generator with the same output on every machine.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, n: u32) -> u32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        ((self.0 >> 33) % u64::from(n)) as u32
    }
}

pub fn rect(x: i32, y: i32, width: u32, height: u32) -> Rect {
    Rect {
        x,
        y,
        width,
        height,
    }
}

pub fn channels() -> Vec<Channel> {
    vec![
        Channel::new("A", SampleType::Half),
        Channel::new("Z", SampleType::Float),
        Channel::new("ZBack", SampleType::Half),
        Channel::new("id", SampleType::Uint),
    ]
}

/// A random image: pixels with no, one or many samples, and some empty rows.
pub fn image(window: Rect, channels: &[Channel], seed: u64) -> DeepBlock {
    let mut random = Random(seed);
    let mut out = DeepBlock::with_channels(window, channels);
    for y in 0..window.height {
        for _ in 0..window.width {
            let count = match (y % 4, random.below(8)) {
                (2, _) => 0,
                (_, 7) => 40,
                (_, n) => n.saturating_sub(3),
            };
            for i in 0..count {
                for c in &mut out.channels {
                    match c {
                        ChannelData::Half(v) => v.push(f16::from_f32(random.below(9) as f32 / 8.0)),
                        ChannelData::Float(v) => v.push(i as f32 + random.below(1000) as f32 / 7.0),
                        ChannelData::Uint(v) => v.push(random.below(u32::MAX)),
                    }
                }
            }
            out.push_pixel();
        }
    }
    out
}

/// Pictures by OpenEXR, one for each codec in scanlines and in tiles, and one with several parts.
pub fn flat_pictures() -> Vec<(String, Vec<u8>)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/seeds/deep_exr");
    let mut out = Vec::new();
    for file in std::fs::read_dir(folder).unwrap() {
        let path = file.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with("flat-") {
            out.push((name, std::fs::read(path).unwrap()));
        }
    }
    assert_eq!(out.len(), 23);
    out
}

/// A flat image of one layer, written by the `exr` crate.
pub fn flat_bytes(layer: Layer<AnyChannels<FlatSamples>>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .unwrap();
    bytes.into_inner()
}

/// Writes `image` in the blocks and the order of the part.
pub fn write_image<W: std::io::Write + std::io::Seek>(
    writer: &mut DeepWriter<W>,
    part: usize,
    image: &DeepBlock,
) {
    let description = writer.parts().nth(part).unwrap().clone();
    let mut blocks: Vec<Rect> = description.blocks().map(|(_, r)| r).collect();
    match description.line_order {
        LineOrder::Increasing => {}
        LineOrder::Decreasing => blocks.reverse(),
        LineOrder::Random => blocks.sort_by_key(|r| (r.x ^ r.y, r.x)),
    }
    for r in blocks {
        writer.write(part, &image.crop(r).unwrap()).unwrap();
    }
}

pub fn file_of(parts: &[Part], images: &[DeepBlock]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = DeepWriter::new(&mut bytes, parts.to_vec()).unwrap();
    for (i, image) in images.iter().enumerate() {
        write_image(&mut writer, i, image);
    }
    writer.finish().unwrap();
    bytes.into_inner()
}

/// Reads every block of a file; returns the first error, or the number of samples.
pub fn read_all(bytes: Vec<u8>, limits: Limits) -> Result<usize> {
    let reader = DeepReader::from_reader_with(Cursor::new(bytes), limits)?;
    read_everything(&reader)
}

/// Reads every block of every part and resolves its samples; returns the number of samples.
pub fn read_everything(reader: &DeepReader) -> Result<usize> {
    let mut samples = 0;
    let mut block = DeepBlock::default();
    for (index, part) in reader.parts().iter().enumerate() {
        let channels = samples::SampleChannels::of(part, None).ok();
        for (b, rect) in part.blocks() {
            reader.read_block_into(index, b, &mut block)?;
            assert_eq!(block.rect, rect);
            assert_eq!(block.offsets.len() as u64, rect.pixels() + 1);
            assert!(block.offsets.is_sorted());
            for c in &block.channels {
                assert_eq!(c.len(), block.sample_count());
            }
            samples += block.sample_count();
            if let Some(channels) = &channels {
                let mut repairs = Default::default();
                let mut out = Vec::new();
                for p in 0..rect.pixels() as usize {
                    channels.pixel(&block, p, Default::default(), &mut repairs, &mut out)?;
                    assert!(out.iter().all(|s| s.z.is_finite() && s.z_back >= s.z));
                }
            }
        }
    }
    Ok(samples)
}
