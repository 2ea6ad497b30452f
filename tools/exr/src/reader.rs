//! The reader: opens a file and decodes its blocks on demand.

use crate::block::DeepBlock;
use crate::codec;
use crate::decode::Decoder;
use crate::error::{Error, Place, Result};
use crate::header::{Part, Rect};
use crate::limits::{Limits, PER_HEADER_BYTE, block_memory};
use crate::parse;
use crate::source::Source;
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

/// An open OpenEXR file that decodes blocks on demand.
///
/// Keeps the headers and 8 bytes per block in memory, never pixels. All methods take `&self`:
/// several threads can read and decode different blocks at once. Files opened by path are read
/// without a lock; streams are locked for each read.
pub struct DeepReader {
    source: Source,
    limits: Limits,
    parts: Vec<Part>,
    /// Byte offsets of each part's blocks.
    offsets: Vec<Vec<u64>>,
    multipart: bool,
    /// Memory that the reader keeps.
    kept: u64,
}

impl std::fmt::Debug for DeepReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DeepReader")
            .field("parts", &self.parts)
            .finish_non_exhaustive()
    }
}

/// The sizes in the header of a chunk.
struct ChunkSizes {
    /// First byte after the chunk's header.
    start: u64,
    counts: u64,
    data: u64,
    unpacked: u64,
}

impl DeepReader {
    /// Opens a file with the default [`Limits`].
    ///
    /// # Errors
    /// As for [`DeepReader::open_with`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_with(path, Limits::default())
    }

    /// Opens a file.
    ///
    /// # Errors
    /// `Io` if the file cannot be read; `Corrupt` if it is not an OpenEXR file, contradicts itself
    /// or is unfinished; `Unsupported` if the type or the compression of a part is unknown; `Limit`
    /// if its headers and tables of blocks exceed `limits`.
    pub fn open_with(path: impl AsRef<Path>, limits: Limits) -> Result<Self> {
        let path = path.as_ref();
        let file = File::open(path)
            .map_err(|e| Error::io(format!("cannot open {}", path.display()), e))?;
        Self::from_source(Source::file(file)?, limits)
    }

    /// Reads from an open file with the default [`Limits`].
    ///
    /// # Errors
    /// As for [`DeepReader::open_with`].
    pub fn from_file(file: File) -> Result<Self> {
        Self::from_source(Source::file(file)?, Limits::default())
    }

    /// Reads from a stream with the default [`Limits`].
    ///
    /// # Errors
    /// As for [`DeepReader::open_with`].
    pub fn from_reader(stream: impl Read + Seek + Send + 'static) -> Result<Self> {
        Self::from_reader_with(stream, Limits::default())
    }

    /// Reads from a stream that contains the file and nothing else.
    ///
    /// # Errors
    /// As for [`DeepReader::open_with`].
    pub fn from_reader_with(
        stream: impl Read + Seek + Send + 'static,
        limits: Limits,
    ) -> Result<Self> {
        Self::from_source(Source::stream(stream)?, limits)
    }

    fn from_source(source: Source, limits: Limits) -> Result<Self> {
        let headers = parse::read_headers(&source, &limits)?;
        let mut offsets = Vec::new();
        let mut at = headers.end;
        // Check that all tables fit into the file before reading one.
        let tables: u64 = headers
            .chunk_counts
            .iter()
            .try_fold(0_u64, |sum, &n| sum.checked_add(n.checked_mul(8)?))
            .filter(|&bytes| bytes <= source.len() - headers.end)
            .ok_or_else(|| {
                Error::corrupt(format!(
                    "the tables of block offsets exceed the file's {} bytes",
                    source.len()
                ))
                .at_byte(headers.end)
            })?;
        let kept = (PER_HEADER_BYTE * headers.end).saturating_add(tables);
        limits.check("the headers and tables of block offsets", kept)?;
        let first = headers.end + tables;
        for (index, (part, &count)) in headers.parts.iter().zip(&headers.chunk_counts).enumerate() {
            let table =
                read_table(&source, at, part.block_count(), first).map_err(|e| e.in_part(index))?;
            offsets.push(table);
            at += 8 * count;
        }
        Ok(DeepReader {
            source,
            limits,
            parts: headers.parts,
            offsets,
            multipart: headers.multipart,
            kept,
        })
    }

    /// The parts, as their headers describe them.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Index of the first deep part with a `Z` in any layer, or else of the first such flat part.
    pub fn first_depth_part(&self) -> Option<usize> {
        let with_z = |deep: bool| {
            self.parts.iter().position(|p| {
                let is_z = |name: &str| name == "Z" || name.ends_with(".Z");
                p.deep == deep && p.channels.iter().any(|c| is_z(&c.name))
            })
        };
        with_z(true).or_else(|| with_z(false))
    }

    /// Reads one block; every pixel of a flat part has one sample.
    ///
    /// # Errors
    /// `Input` if there is no such block; `Io`, `Corrupt`, `Unsupported` or `Limit` if the block
    /// cannot be read or decoded.
    pub fn read_block(&self, part: usize, block: usize) -> Result<DeepBlock> {
        let mut out = DeepBlock::default();
        self.read_block_into(part, block, &mut out)?;
        Ok(out)
    }

    /// [`DeepReader::read_block`] that reuses the memory of `out`.
    ///
    /// # Errors
    /// As for [`DeepReader::read_block`]; `out` is then empty.
    pub fn read_block_into(&self, part: usize, block: usize, out: &mut DeepBlock) -> Result<()> {
        self.read_within(part, block, 0, out)
    }

    /// [`DeepReader::read_block_into`] for a caller that holds `held` bytes.
    fn read_within(&self, part: usize, block: usize, held: u64, out: &mut DeepBlock) -> Result<()> {
        let result = self.decode_block(part, block, held, out);
        if result.is_err() {
            *out = DeepBlock::default();
        }
        result.map_err(|e| {
            e.at(Place {
                part: Some(part),
                block: Some(block),
                byte: self.offsets.get(part).and_then(|o| o.get(block)).copied(),
                ..Place::default()
            })
        })
    }

    /// Reads all pixels of `rect`.
    ///
    /// Decodes every block that intersects `rect`, so rectangles of whole blocks cost least.
    ///
    /// # Errors
    /// `Input` if `rect` is empty or not inside the data window; otherwise as for
    /// [`DeepReader::read_block`]. The limit applies to the whole rectangle.
    pub fn read_rect(&self, part: usize, rect: Rect) -> Result<DeepBlock> {
        let description = self.part(part)?;
        if rect.pixels() == 0 || !description.data_window.contains_rect(&rect) {
            return Err(Error::input(format!(
                "{rect:?} is empty or not inside the data window"
            )));
        }
        let mut held = rect.pixels().saturating_mul(4);
        let needed = self.kept.saturating_add(held);
        self.limits.check("the rectangle", needed)?;
        let mut out = DeepBlock::with_channels(rect, &description.channels);
        out.offsets.reserve_exact(rect.pixels() as usize);
        let (mut row, mut samples) = (Vec::<DeepBlock>::new(), 0);
        for (index, block_rect) in description.blocks_in(rect) {
            let mut block = DeepBlock::default();
            self.read_within(part, index, held, &mut block)?;
            let values = block.sample_count() as u64 * description.sample_bytes() as u64;
            let offsets = 4 * block_rect.pixels() + 64 * description.channels.len() as u64;
            // The rectangle grows in steps while the blocks of a row are in memory.
            held = held.saturating_add(4 * (values + offsets + 256));
            samples += block.sample_count();
            if u32::try_from(samples).is_err() {
                return Err(Error::limit("the rectangle has 2^32 samples or more"));
            }
            row.push(block);
            if block_rect.x_end() < rect.x_end() {
                continue;
            }
            // The row of blocks is complete: append its lines.
            let Some(lines) = block_rect.intersection(&rect) else {
                continue;
            };
            for y in 0..lines.height {
                for block in &row {
                    let Some(common) = block.rect.intersection(&rect) else {
                        continue;
                    };
                    let dy = (common.y - block.rect.y) as usize + y as usize;
                    let dx = (common.x - block.rect.x) as usize;
                    let first = dy * block.rect.width as usize + dx;
                    out.append_row(block, first, common.width as usize);
                }
            }
            row.clear();
        }
        Ok(out)
    }

    fn part(&self, part: usize) -> Result<&Part> {
        self.parts
            .get(part)
            .ok_or_else(|| Error::input(format!("there is no part {part} of {}", self.parts.len())))
    }

    fn decode_block(
        &self,
        part_index: usize,
        block: usize,
        held: u64,
        out: &mut DeepBlock,
    ) -> Result<()> {
        let part = self.part(part_index)?;
        let rect = part.block_rect(block);
        let (Some(rect), Some(&offset)) = (rect, self.offsets[part_index].get(block)) else {
            return Err(Error::input(format!(
                "there is no block {block} of {}",
                part.block_count()
            )));
        };
        let sizes = self.read_chunk_header(part_index, part, rect, offset)?;
        // Check all sizes before allocating.
        let stored = sizes.counts.saturating_add(sizes.data);
        let decoded = if part.deep {
            sizes.unpacked
        } else {
            rect.pixels().saturating_mul(part.sample_bytes() as u64)
        };
        let needed = block_memory(part, rect, stored, decoded)
            .saturating_add(self.kept)
            .saturating_add(held);
        self.limits.check("the block", needed)?;
        codec::with_scratch(|scratch| {
            let (packed, a, b) = codec::split(scratch);
            self.source.read_vec(packed, sizes.start, stored)?;
            // The cast is lossless: all stored bytes are in memory.
            let (counts, data) = packed.split_at(sizes.counts as usize);
            out.rect = rect;
            let decoder = Decoder { part, rect };
            if part.deep {
                decoder.counts(counts, a, b, &mut out.offsets)?;
                decoder.deep(data, decoded, a, b, out)
            } else {
                decoder.flat(data, a, b, out)
            }
        })
    }

    /// Reads a chunk's header and checks that it is that of the block with pixels `rect`.
    fn read_chunk_header(
        &self,
        part_index: usize,
        part: &Part,
        rect: Rect,
        offset: u64,
    ) -> Result<ChunkSizes> {
        let mut expected = Vec::new();
        if self.multipart {
            expected.push(part_index as i32);
        }
        match &part.tiles {
            Some(_) => {
                let (width, height) = part.block_size();
                let w = &part.data_window;
                let column = (i64::from(rect.x) - i64::from(w.x)) / i64::from(width);
                let row = (i64::from(rect.y) - i64::from(w.y)) / i64::from(height);
                expected.extend([column as i32, row as i32, 0, 0]);
            }
            None => expected.push(rect.y),
        }
        let len = 4 * expected.len() + if part.deep { 24 } else { 4 };
        let mut bytes = Vec::with_capacity(len);
        self.source.read_vec(&mut bytes, offset, len as u64)?;
        let (coordinates, sizes) = bytes.split_at(4 * expected.len());
        if coordinates
            .chunks_exact(4)
            .zip(&expected)
            .any(|(b, p)| b != p.to_le_bytes())
        {
            return Err(Error::corrupt(
                "the header of this chunk belongs to another block",
            ));
        }
        let u64_at = |at: usize| {
            let byte = |i: usize| u64::from(sizes[at + i]) << (8 * i);
            (0..8).map(byte).sum::<u64>()
        };
        let start = offset + len as u64;
        let left = self.source.len() - start;
        let (counts, data, unpacked) = if part.deep {
            (u64_at(0), u64_at(8), u64_at(16))
        } else {
            let size = [0, 1, 2, 3].map(|i| sizes[i]);
            // A negative size becomes a large one and is refused below.
            (0, u64::from(u32::from_le_bytes(size)), 0)
        };
        if counts.checked_add(data).is_none_or(|sum| sum > left) {
            return Err(Error::corrupt(format!(
                "the block has {counts} + {data} bytes, but the file has only {left} left"
            )));
        }
        Ok(ChunkSizes {
            start,
            counts,
            data,
            unpacked,
        })
    }
}

/// Reads the first `count` entries of an offset table and checks their range.
fn read_table(source: &Source, at: u64, count: usize, first: u64) -> Result<Vec<u64>> {
    let (mut table, mut piece) = (Vec::with_capacity(count), Vec::new());
    while table.len() < count {
        let bytes = 8 * (count - table.len()).min(4096) as u64;
        source.read_vec(&mut piece, at + 8 * table.len() as u64, bytes)?;
        let offsets = piece.as_chunks().0.iter();
        table.extend(offsets.map(|&b| u64::from_le_bytes(b)));
    }
    let missing = table.iter().filter(|&&offset| offset == 0).count();
    if missing > 0 {
        return Err(Error::corrupt(format!(
            "the file is unfinished: {missing} of {count} blocks are missing"
        ))
        .at_byte(at));
    }
    if let Some(block) = table
        .iter()
        .position(|&offset| offset < first || offset >= source.len())
    {
        return Err(Error::corrupt(format!(
            "the offset {} lies outside the blocks, which are from byte {first} to {}",
            table[block],
            source.len()
        ))
        .at(Place {
            block: Some(block),
            byte: Some(at + 8 * block as u64),
            ..Place::default()
        }));
    }
    Ok(table)
}
