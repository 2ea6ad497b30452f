//! Decodes the stored bytes of a block to samples.

use crate::block::{ChannelData, DeepBlock};
use crate::codec::{self, Layout, Order};
use crate::error::{Error, Place, Result};
use crate::header::{Compression, Part, Rect, SampleType};

/// Decodes one block; its methods use the buffers `a` and `b` as scratch memory.
pub(crate) struct Decoder<'a> {
    pub(crate) part: &'a Part,
    pub(crate) rect: Rect,
}

impl Decoder<'_> {
    /// Decodes the table of sample counts, cumulative in each row, to offsets.
    pub(crate) fn counts(
        &self,
        packed: &[u8],
        a: &mut Vec<u8>,
        b: &mut Vec<u8>,
        offsets: &mut Vec<u32>,
    ) -> Result<()> {
        let (part, rect) = (self.part, self.rect);
        let width = rect.width as usize;
        let expected = 4 * rect.pixels();
        let (block_width, block_height) = part.block_size();
        let full = (4 * u64::from(block_width)).saturating_mul(block_height.into());
        // Edge tiles store an uncompressed table at full size: the counts, then padding.
        let plain = part.compression == Compression::None || packed.len() as u64 == full;
        let packed = match packed.get(..expected as usize) {
            Some(counts) if plain && packed.len() as u64 <= full => counts,
            _ => packed,
        };
        codec::check_sizes(part.compression, packed.len(), expected)?;
        let rows = vec![width; rect.height as usize];
        let layout = Layout {
            row_samples: &rows,
            channel_bytes: &[4],
        };
        let (bytes, _) = codec::unpack(part.compression, packed, &layout, a, b)?;
        offsets.clear();
        offsets.reserve_exact(width * rows.len() + 1);
        offsets.push(0);
        let mut total = 0_u64;
        for (y, row) in bytes.chunks_exact(4 * width).enumerate() {
            let mut last = 0;
            for (x, count) in row.chunks_exact(4).enumerate() {
                let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]);
                if count < last {
                    return Err(
                        Error::corrupt("sample counts decrease along a row").at(Place {
                            pixel: Some((rect.x + x as i32, rect.y + y as i32)),
                            ..Place::default()
                        }),
                    );
                }
                last = count;
                // Wraps only in rows that are refused below.
                offsets.push((total as u32).wrapping_add(count));
            }
            total += u64::from(last);
            if total > u32::MAX.into() {
                return Err(Error::limit(format!(
                    "a block has {total} samples, more than 2^32 - 1"
                )));
            }
        }
        Ok(())
    }

    /// Decodes the samples of a deep block; `out` already has its offsets.
    pub(crate) fn deep(
        &self,
        packed: &[u8],
        unpacked: u64,
        a: &mut Vec<u8>,
        b: &mut Vec<u8>,
        out: &mut DeepBlock,
    ) -> Result<()> {
        let (part, rect) = (self.part, self.rect);
        let samples = out.sample_count() as u64;
        let bytes = samples * part.sample_bytes() as u64;
        if unpacked != bytes {
            return Err(Error::corrupt(format!(
                "the block states a decoded size of {unpacked} bytes, but its counts need {bytes}"
            )));
        }
        let width = rect.width as usize;
        let rows: Vec<usize> = (0..rect.height as usize)
            .map(|y| (out.offsets[(y + 1) * width] - out.offsets[y * width]) as usize)
            .collect();
        let widths = part.channel_bytes();
        let layout = Layout {
            row_samples: &rows,
            channel_bytes: &widths,
        };
        let (bytes, order) = if samples == 0 {
            (&[][..], Order::Packed)
        } else {
            codec::unpack(part.compression, packed, &layout, a, b)?
        };
        split_channels(part, bytes, &layout, order, out);
        Ok(())
    }

    /// Decodes a flat block, with one sample per pixel.
    pub(crate) fn flat(
        &self,
        packed: &[u8],
        a: &mut Vec<u8>,
        b: &mut Vec<u8>,
        out: &mut DeepBlock,
    ) -> Result<()> {
        let (part, rect) = (self.part, self.rect);
        if let Some(c) = part.channels.iter().find(|c| c.sampling != (1, 1)) {
            return Err(Error::unsupported(format!(
                "channel {:?} is subsampled",
                c.name
            )));
        }
        let expected = rect.pixels() * part.sample_bytes() as u64;
        codec::check_sizes(part.compression, packed.len(), expected)?;
        let rows = vec![rect.width as usize; rect.height as usize];
        let widths = part.channel_bytes();
        let layout = Layout {
            row_samples: &rows,
            channel_bytes: &widths,
        };
        use Compression::{None, Rle, Zip, Zips, Zstd};
        let native = matches!(part.compression, None | Rle | Zip | Zips | Zstd);
        let unpacked;
        let (bytes, order) = if native || packed.len() == layout.bytes() {
            codec::unpack(part.compression, packed, &layout, a, b)?
        } else {
            unpacked = codec::unpack_flat(part.compression, packed, rect, &part.channels, a, b)?;
            (&unpacked[..], Order::Packed)
        };
        let pixels = u32::try_from(rect.pixels())
            .map_err(|_| Error::limit("a block has 2^32 pixels or more"))?;
        out.offsets.clear();
        out.offsets.reserve_exact(rect.pixels() as usize + 1);
        out.offsets.extend(0..=pixels);
        split_channels(part, bytes, &layout, order, out);
        Ok(())
    }
}

/// Splits the bytes of a block into its channels.
fn split_channels(
    part: &Part,
    bytes: &[u8],
    layout: &Layout<'_>,
    order: Order,
    out: &mut DeepBlock,
) {
    let samples = layout.row_samples.iter().sum();
    let empty = || ChannelData::new(SampleType::Half);
    out.channels.resize_with(part.channels.len(), empty);
    for (data, channel) in out.channels.iter_mut().zip(&part.channels) {
        data.reset(channel.sample_type, samples);
    }
    layout.for_each_row(order, |_, channel, span| {
        out.channels[channel].extend_le(&bytes[span]);
    });
}
