//! The writer: writes a file block by block.

use crate::block::DeepBlock;
use crate::encode::{BlockEncoder, EncodedBlock};
use crate::error::{Error, Place, Result};
use crate::header::{LineOrder, Part};
use crate::parse::{FLAG_DEEP, FLAG_LONG_NAMES, FLAG_MULTIPART, MAGIC, VERSION};
use crate::write_header::{check_part, header_attributes};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::sync::Arc;

/// Writes deep parts block by block.
///
/// Keeps the headers and 8 bytes per block in memory. Write scanlines from the top, or from the
/// bottom for [`LineOrder::Decreasing`]. Write tiles row by row, or in any order for
/// [`LineOrder::Random`].
///
/// To compress on several threads, give each thread a [`DeepWriter::encoder`] and pass the encoded
/// blocks to [`DeepWriter::write_encoded`].
///
/// The file is complete only after [`DeepWriter::finish`], which returns the stream.
pub struct DeepWriter<W: Write + Seek> {
    output: BufWriter<W>,
    parts: Vec<PartState>,
    level: Option<i32>,
    multipart: bool,
    /// Byte offset of the next write.
    position: u64,
    /// Byte offset of the first offset table.
    tables: u64,
}

struct PartState {
    part: Arc<Part>,
    /// Byte offset of each block; 0 until it is written.
    offsets: Vec<u64>,
    /// Number of blocks written; determines the next block if the order is fixed.
    written: usize,
    max_samples: u32,
    /// Byte offset of the value of `maxSamplesPerPixel`.
    max_samples_at: u64,
}

impl<W: Write + Seek> DeepWriter<W> {
    /// Writes to a stream, starting at position 0.
    ///
    /// # Errors
    /// `Io` if writing fails. `Input` if there are no parts, or if a part is not deep, has no
    /// channels or two with the same name, has a compression that deep parts do not allow, has
    /// smaller levels, has an empty window, or has no unique name in a file with several parts.
    pub fn new(stream: W, parts: Vec<Part>) -> Result<Self> {
        let multipart = parts.len() > 1;
        if parts.is_empty() {
            return Err(Error::input("a file needs at least one part"));
        }
        for (index, part) in parts.iter().enumerate() {
            check_part(part, multipart).map_err(|e| e.in_part(index))?;
        }
        for (index, part) in parts.iter().enumerate() {
            if multipart && parts[..index].iter().any(|p| p.name == part.name) {
                return Err(Error::input(format!(
                    "two parts have the name {:?}",
                    part.name.as_deref().unwrap_or_default()
                )));
            }
        }
        let mut writer = DeepWriter {
            output: BufWriter::with_capacity(1 << 18, stream),
            parts: Vec::new(),
            level: None,
            multipart,
            position: 0,
            tables: 0,
        };
        writer.seek(0)?;
        writer.write_headers(parts)?;
        Ok(writer)
    }

    /// Sets the compression level of ZIPS (0 to 9, default 4) and Zstandard (1 to 22, default 5).
    pub fn set_level(&mut self, level: i32) {
        self.level = Some(level);
    }

    /// The parts.
    pub fn parts(&self) -> impl ExactSizeIterator<Item = &Part> {
        self.parts.iter().map(|p| &*p.part)
    }

    /// An encoder for blocks of `part`.
    ///
    /// # Errors
    /// `Input` if there is no such part.
    pub fn encoder(&self, part: usize) -> Result<BlockEncoder> {
        let state = self.state(part)?;
        Ok(BlockEncoder {
            part: state.part.clone(),
            index: part,
            multipart: self.multipart,
            level: self.level,
        })
    }

    /// Compresses and writes a tile or one or more whole scanlines.
    ///
    /// # Errors
    /// `Input` if the block is not the next one, is not a block of the part, or contradicts itself;
    /// `Io` if writing fails.
    pub fn write(&mut self, part: usize, block: &DeepBlock) -> Result<()> {
        let encoder = self.encoder(part)?;
        if encoder.part.tiles.is_some() || block.rect.height == 1 {
            return self.write_encoded(encoder.encode(block)?);
        }
        block.check(&encoder.part).map_err(|e| e.in_part(part))?;
        let height = block.rect.height;
        for i in 0..height {
            let row = match encoder.part.line_order {
                LineOrder::Decreasing => height - 1 - i,
                _ => i,
            };
            let encoded = encoder.encode_row(block, row)?;
            self.write_encoded(encoded)?;
        }
        Ok(())
    }

    /// Writes a block from [`BlockEncoder::encode`].
    ///
    /// # Errors
    /// `Input` if the block is not the next one or was written before; `Io` if writing fails.
    pub fn write_encoded(&mut self, encoded: EncodedBlock) -> Result<()> {
        let place = Place {
            part: Some(encoded.part),
            block: Some(encoded.block),
            ..Place::default()
        };
        let state = self.state(encoded.part)?;
        let next = match state.part.line_order {
            LineOrder::Increasing => Some(state.written),
            LineOrder::Decreasing => state.offsets.len().checked_sub(1 + state.written),
            LineOrder::Random => Some(encoded.block),
        };
        if state.offsets.get(encoded.block).is_none_or(|&o| o != 0) {
            return Err(Error::input("the block was already written").at(place));
        }
        if next != Some(encoded.block) {
            return Err(Error::input(format!(
                "the order is {:?}, so the next block is {}",
                state.part.line_order,
                next.unwrap_or_default()
            ))
            .at(place));
        }
        let position = self.position;
        self.put(&encoded.bytes)?;
        let state = &mut self.parts[encoded.part];
        state.offsets[encoded.block] = position;
        state.written += 1;
        state.max_samples = state.max_samples.max(encoded.max_samples);
        Ok(())
    }

    /// Completes the offset tables, and returns the stream.
    ///
    /// # Errors
    /// `Input` if blocks are missing; `Io` if writing fails.
    pub fn finish(mut self) -> Result<W> {
        for (index, state) in self.parts.iter().enumerate() {
            if let Some(block) = state.offsets.iter().position(|&o| o == 0) {
                let missing = state.offsets.len() - state.written;
                return Err(Error::input(format!(
                    "{missing} of {} blocks were not written",
                    state.offsets.len()
                ))
                .at(Place {
                    part: Some(index),
                    block: Some(block),
                    ..Place::default()
                }));
            }
        }
        for part in std::mem::take(&mut self.parts) {
            self.seek(part.max_samples_at)?;
            let max = i32::try_from(part.max_samples).unwrap_or(i32::MAX);
            self.put(&max.to_le_bytes())?;
            self.seek(self.tables)?;
            let table: Vec<u8> = part.offsets.iter().flat_map(|o| o.to_le_bytes()).collect();
            self.put(&table)?;
            self.tables = self.position;
        }
        let stream = self.output.into_inner();
        stream.map_err(|e| Error::io("cannot finish the file", e.into_error()))
    }

    fn state(&self, part: usize) -> Result<&PartState> {
        let count = self.parts.len();
        self.parts
            .get(part)
            .ok_or_else(|| Error::input(format!("there is no part {part} of {count}")))
    }

    fn write_headers(&mut self, parts: Vec<Part>) -> Result<()> {
        let long = parts.iter().any(|p| p.header_names().any(|n| n.len() > 31));
        let flags = FLAG_DEEP
            | if long { FLAG_LONG_NAMES } else { 0 }
            | if self.multipart { FLAG_MULTIPART } else { 0 };
        self.put(&MAGIC.to_le_bytes())?;
        self.put(&(VERSION | flags).to_le_bytes())?;
        for part in parts {
            let mut max_samples_at = 0;
            for a in header_attributes(&part) {
                let mut bytes = Vec::new();
                for name in [&a.name, &a.type_name] {
                    bytes.extend_from_slice(name.as_bytes());
                    bytes.push(0);
                }
                // `check_part` has checked that the length fits.
                bytes.extend_from_slice(&(a.value.len() as i32).to_le_bytes());
                if a.name == "maxSamplesPerPixel" {
                    max_samples_at = self.position + bytes.len() as u64;
                }
                bytes.extend_from_slice(&a.value);
                self.put(&bytes)?;
            }
            self.put(&[0])?;
            self.parts.push(PartState {
                offsets: vec![0; part.block_count()],
                part: Arc::new(part),
                written: 0,
                max_samples: 0,
                max_samples_at,
            });
        }
        if self.multipart {
            self.put(&[0])?;
        }
        self.tables = self.position;
        let blocks: usize = self.parts.iter().map(|p| p.offsets.len()).sum();
        // Written in pieces, because a part may have many blocks.
        for start in (0..blocks).step_by(1024) {
            self.put(&[0; 8 * 1024][..8 * (blocks - start).min(1024)])?;
        }
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let result = self.output.write_all(bytes);
        result.map_err(|e| Error::io("cannot write", e).at_byte(self.position))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn seek(&mut self, position: u64) -> Result<()> {
        let result = self.output.seek(SeekFrom::Start(position));
        result.map_err(|e| Error::io("cannot seek", e).at_byte(position))?;
        self.position = position;
        Ok(())
    }
}
