//! Decodes the codecs that only flat images use, with the `exr` crate.

use super::dwa;
use crate::error::{Error, Result};
use crate::header::{Channel, Compression, Rect, SampleType};
use exr::math::RoundingMode;
use exr::meta::BlockDescription;
use exr::meta::attribute::{ChannelDescription, IntegerBounds, LevelMode, TileDescription};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// The decoded little-endian bytes of a block, row by row, channel by channel in each row.
///
/// The crate allocates by the size of the block, except for DWA, which `a` and `b` serve to check.
pub(crate) fn unpack_flat(
    compression: Compression,
    packed: &[u8],
    rect: Rect,
    channels: &[Channel],
    a: &mut Vec<u8>,
    b: &mut Vec<u8>,
) -> Result<Vec<u8>> {
    let method = match compression {
        Compression::Piz => exr::compression::Compression::PIZ,
        Compression::Pxr24 => exr::compression::Compression::PXR24,
        Compression::B44 => exr::compression::Compression::B44,
        Compression::B44a => exr::compression::Compression::B44A,
        Compression::Dwaa => exr::compression::Compression::DWAA(None),
        Compression::Dwab => exr::compression::Compression::DWAB(None),
        other => {
            return Err(Error::unsupported(format!(
                "a flat part with compression {other:?}"
            )));
        }
    };
    let bytes: usize = channels.iter().map(|c| c.sample_type.bytes()).sum();
    let expected = rect.pixels() * bytes as u64;
    if matches!(compression, Compression::Dwaa | Compression::Dwab) {
        dwa::check(packed, rect, channels.len(), expected, a, b)?;
    }
    let size = exr::math::Vec2(rect.width as usize, rect.height as usize);
    let list = channels
        .iter()
        .map(|c| {
            let kind = match c.sample_type {
                SampleType::Uint => exr::meta::attribute::SampleType::U32,
                SampleType::Half => exr::meta::attribute::SampleType::F16,
                SampleType::Float => exr::meta::attribute::SampleType::F32,
            };
            ChannelDescription::new(c.name.as_str(), kind, c.linear)
        })
        .collect();
    // The crate panics on some damaged blocks.
    let unpacked = catch_unwind(AssertUnwindSafe(|| {
        let tiles = TileDescription {
            tile_size: size,
            level_mode: LevelMode::Singular,
            rounding_mode: RoundingMode::Down,
        };
        let header = exr::meta::header::Header::new("block".into(), size, list).with_encoding(
            method,
            BlockDescription::Tiles(tiles),
            exr::meta::attribute::LineOrder::Increasing,
        );
        let section = IntegerBounds::from_dimensions(size);
        method.decompress_image_section_from_le(&header, packed.to_vec(), section, false)
    }));
    let mut unpacked = match unpacked {
        Ok(Ok(bytes)) => bytes,
        Ok(Err(e)) => return Err(Error::corrupt(format!("damaged {compression:?} data: {e}"))),
        Err(_) => {
            let message = format!("damaged {compression:?} data: the decoder panicked");
            return Err(Error::corrupt(message));
        }
    };
    if unpacked.len() as u64 != expected {
        return Err(Error::corrupt(format!(
            "{compression:?} data decodes to {} of {expected} bytes",
            unpacked.len()
        )));
    }
    if cfg!(target_endian = "big") {
        let mut at = 0;
        for _ in 0..rect.height {
            for c in channels {
                let n = c.sample_type.bytes();
                let row = &mut unpacked[at..at + n * rect.width as usize];
                row.chunks_exact_mut(n).for_each(<[u8]>::reverse);
                at += row.len();
            }
        }
    }
    Ok(unpacked)
}
