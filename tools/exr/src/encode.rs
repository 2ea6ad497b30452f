//! Encodes the samples of a block to stored bytes.

use crate::block::DeepBlock;
use crate::codec::{self, Layout};
use crate::error::{Error, Result};
use crate::header::{Compression, Part, Rect};
use std::sync::Arc;

/// Compresses blocks of one part, on any thread.
#[derive(Clone, Debug)]
pub struct BlockEncoder {
    pub(crate) part: Arc<Part>,
    pub(crate) index: usize,
    pub(crate) multipart: bool,
    pub(crate) level: Option<i32>,
}

/// A compressed block for [`DeepWriter::write_encoded`](crate::DeepWriter::write_encoded).
#[derive(Clone, Debug)]
pub struct EncodedBlock {
    pub(crate) part: usize,
    pub(crate) block: usize,
    pub(crate) bytes: Vec<u8>,
    pub(crate) max_samples: u32,
}

impl BlockEncoder {
    /// The part of the blocks.
    pub fn part(&self) -> &Part {
        &self.part
    }

    /// Compresses a tile or one scanline.
    ///
    /// # Errors
    /// `Input` if the rectangle is not a block of the part, or the block contradicts itself.
    pub fn encode(&self, block: &DeepBlock) -> Result<EncodedBlock> {
        block.check(&self.part).map_err(|e| e.in_part(self.index))?;
        self.encode_checked(block, block.rect, 0)
    }

    /// Compresses row `row` of a block of several rows; the caller must check the block.
    pub(crate) fn encode_row(&self, block: &DeepBlock, row: u32) -> Result<EncodedBlock> {
        let rect = Rect {
            y: block.rect.y.wrapping_add(row as i32),
            height: 1,
            ..block.rect
        };
        self.encode_checked(block, rect, row as usize * block.rect.width as usize)
    }

    /// Compresses the pixels of `rect`, which start at pixel `first` of `block`.
    fn encode_checked(&self, block: &DeepBlock, rect: Rect, first: usize) -> Result<EncodedBlock> {
        let part = &*self.part;
        let found = part.blocks_in(rect).next();
        let Some((index, _)) = found.filter(|(_, r)| *r == rect) else {
            return Err(
                Error::input(format!("{rect:?} is not a block of the part")).in_part(self.index)
            );
        };
        let width = rect.width as usize;
        let pixels = first..first + width * rect.height as usize;
        let mut max_samples = 0;
        let mut counts = Vec::with_capacity(4 * pixels.len());
        let mut row_samples = Vec::with_capacity(rect.height as usize);
        for row in pixels.clone().step_by(width) {
            let offsets = &block.offsets[row..=row + width];
            for pair in offsets.windows(2) {
                max_samples = max_samples.max(pair[1] - pair[0]);
                counts.extend_from_slice(&(pair[1] - offsets[0]).to_le_bytes());
            }
            row_samples.push((offsets[width] - offsets[0]) as usize);
        }
        if row_samples.iter().any(|&n| n > i32::MAX as usize) {
            return Err(Error::input("a scanline has more than 2^31 samples").in_part(self.index));
        }
        let rows = vec![width; rect.height as usize];
        let counts_layout = Layout {
            row_samples: &rows,
            channel_bytes: &[4],
        };
        let channel_bytes = part.channel_bytes();
        let layout = Layout {
            row_samples: &row_samples,
            channel_bytes: &channel_bytes,
        };
        let mut raw = Vec::with_capacity(layout.bytes());
        for row in pixels.step_by(width) {
            let span = block.offsets[row] as usize..block.offsets[row + width] as usize;
            for channel in &block.channels {
                channel.write_le(span.clone(), &mut raw);
            }
        }

        let mut bytes = Vec::new();
        if self.multipart {
            bytes.extend_from_slice(&(self.index as i32).to_le_bytes());
        }
        match &part.tiles {
            Some(_) => {
                let columns = part.grid().0 as usize;
                for v in [index % columns, index / columns, 0, 0] {
                    bytes.extend_from_slice(&(v as i32).to_le_bytes());
                }
            }
            None => bytes.extend_from_slice(&rect.y.to_le_bytes()),
        }
        codec::with_scratch(|scratch| {
            let (_, a, b) = codec::split(scratch);
            let sizes_at = bytes.len();
            bytes.resize(sizes_at + 24, 0);
            let packed = codec::pack(part.compression, &counts, &counts_layout, self.level, a, b);
            let start = bytes.len();
            bytes.extend_from_slice(packed);
            if part.compression == Compression::None {
                // Readers expect uncompressed tables at full size, in edge tiles too.
                let (width, height) = part.block_size();
                bytes.resize(start + 4 * width as usize * height as usize, 0);
            }
            let counts_len = bytes.len() - start;
            let packed = codec::pack(part.compression, &raw, &layout, self.level, a, b);
            bytes.extend_from_slice(packed);
            for (i, size) in [counts_len, packed.len(), raw.len()]
                .into_iter()
                .enumerate()
            {
                let at = sizes_at + 8 * i;
                bytes[at..at + 8].copy_from_slice(&(size as u64).to_le_bytes());
            }
        });
        Ok(EncodedBlock {
            part: self.index,
            block: index,
            bytes,
            max_samples,
        })
    }
}
