//! Writing block by block.

use crate::block::DeepBlock;
use crate::encode::{BlockEncoder, EncodedBlock};
use crate::error::{Error, Place, Result};
use crate::header::{LineOrder, Part};
use crate::parse::{FLAG_DEEP, FLAG_LONG_NAMES, FLAG_MULTIPART, MAGIC, VERSION};
use crate::write_header::{check_part, header_attributes};
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::NamedTempFile;

/// Writes deep parts, one block or band of lines after the other.
///
/// Holds the headers and 8 bytes per block. Lines come from the top (from the bottom for
/// [`LineOrder::Decreasing`]); tiles in any order for [`LineOrder::Random`], else row by row.
///
/// To pack on several threads, give each a [`DeepWriter::encoder`] and write what they return.
///
/// A file by path is written beside its final place and moved there by [`DeepWriter::finish`]: whatever
/// happens before, an older file of that name stays whole.
pub struct DeepWriter<W: Write + Seek = File> {
    out: Out<W>,
    parts: Vec<PartState>,
    level: Option<i32>,
    multipart: bool,
    /// Next byte to be written.
    position: u64,
    /// Where the first offset table begins.
    tables: u64,
}

enum Out<W: Write + Seek> {
    Plain(BufWriter<W>),
    Temporary(BufWriter<NamedTempFile>, PathBuf),
}

struct PartState {
    part: Arc<Part>,
    /// Where each block lies; 0 before it is written.
    offsets: Vec<u64>,
    /// Blocks written, and thus the next one where their order is fixed.
    written: usize,
    max_samples: u32,
    /// Where the value of `maxSamplesPerPixel` lies.
    max_samples_at: u64,
}

impl DeepWriter<File> {
    /// Creates a file at `path` once it is finished.
    ///
    /// # Errors
    /// `Io` if no file can be made in that folder, otherwise as for [`DeepWriter::new`].
    pub fn create(path: impl AsRef<Path>, parts: Vec<Part>) -> Result<Self> {
        let path = path.as_ref();
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".deepshadow-").suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // What the umask leaves of it, as for any new file.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let file = builder
            .tempfile_in(folder)
            .map_err(|e| Error::io(format!("cannot create a file in {}", folder.display()), e))?;
        let out = BufWriter::with_capacity(1 << 18, file);
        Self::start(Out::Temporary(out, path.to_owned()), parts)
    }
}

impl<W: Write + Seek> DeepWriter<W> {
    /// Writes to a stream, from its position 0.
    ///
    /// # Errors
    /// `Input` if there are no parts or one cannot be written as described: it is not deep, has no
    /// channels or two of one name, a compression that is not for deep data, smaller levels, an empty
    /// window, or no name of its own in a file of several; `Io` where writing fails.
    pub fn new(stream: W, parts: Vec<Part>) -> Result<Self> {
        Self::start(Out::Plain(BufWriter::with_capacity(1 << 18, stream)), parts)
    }

    fn start(out: Out<W>, parts: Vec<Part>) -> Result<Self> {
        let multipart = parts.len() > 1;
        if parts.is_empty() {
            return Err(Error::input("a file needs at least one part"));
        }
        for (index, part) in parts.iter().enumerate() {
            check_part(part, multipart).map_err(|e| {
                e.at(Place {
                    part: Some(index),
                    ..Place::default()
                })
            })?;
        }
        for (index, part) in parts.iter().enumerate() {
            if multipart && parts[..index].iter().any(|p| p.name == part.name) {
                return Err(Error::input(format!(
                    "two parts are called {:?}",
                    part.name.as_deref().unwrap_or_default()
                )));
            }
        }
        let mut writer = DeepWriter {
            out,
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

    /// Sets how hard ZIPS (0 to 9, default 4) and Zstandard (1 to 22, default 5) try.
    pub fn set_level(&mut self, level: i32) {
        self.level = Some(level);
    }

    /// The parts, with channels in the file's order.
    pub fn parts(&self) -> impl ExactSizeIterator<Item = &Part> {
        self.parts.iter().map(|p| &*p.part)
    }

    /// A packer for blocks of `part`.
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

    /// Packs and writes a block: a tile, or a band of whole lines.
    ///
    /// # Errors
    /// `Input` if it is not the next one, is none of the part's blocks, or contradicts itself; `Io`.
    pub fn write(&mut self, part: usize, block: &DeepBlock) -> Result<()> {
        let encoder = self.encoder(part)?;
        if encoder.part.tiles.is_some() || block.rect.height == 1 {
            return self.write_encoded(encoder.encode(block)?);
        }
        block.check(&encoder.part).map_err(|e| encoder.place(e))?;
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

    /// Writes a block that [`BlockEncoder::encode`] packed.
    ///
    /// # Errors
    /// `Input` if it is not the next one or was written before; `Io`.
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
            return Err(Error::input("a block is written twice").at(place));
        }
        if next != Some(encoded.block) {
            return Err(Error::input(format!(
                "blocks come in {:?} order, so block {} is next",
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

    /// Writes what is only known now, and puts the file in its place.
    ///
    /// # Errors
    /// `Input` if blocks are missing; `Io`. The file is then not put in its place.
    pub fn finish(mut self) -> Result<()> {
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
        let failed = |e| Error::io("cannot finish the file", e);
        match self.out {
            Out::Plain(mut out) => out.flush().map_err(failed),
            Out::Temporary(out, path) => {
                let file = out.into_inner().map_err(|e| failed(e.into_error()))?;
                file.as_file().sync_all().map_err(failed)?;
                file.persist(&path).map_err(|e| {
                    Error::io(
                        format!("cannot move the file to {}", path.display()),
                        e.error,
                    )
                })?;
                Ok(())
            }
        }
    }

    fn state(&self, part: usize) -> Result<&PartState> {
        let count = self.parts.len();
        self.parts
            .get(part)
            .ok_or_else(|| Error::input(format!("there is no part {part} of {count}")))
    }

    fn write_headers(&mut self, parts: Vec<Part>) -> Result<()> {
        let long = parts.iter().any(|p| {
            let names = p.channels.iter().map(|c| &c.name);
            let names = names.chain(p.attributes.iter().flat_map(|a| [&a.name, &a.type_name]));
            names.into_iter().any(|n| n.len() > 31)
        });
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
                // Checked in `check_part`.
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
        // In pieces: a part may have many blocks.
        for start in (0..blocks).step_by(1024) {
            self.put(&[0; 8 * 1024][..8 * (blocks - start).min(1024)])?;
        }
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let result = match &mut self.out {
            Out::Plain(out) => out.write_all(bytes),
            Out::Temporary(out, _) => out.write_all(bytes),
        };
        result.map_err(|e| Error::io("cannot write", e).at_byte(self.position))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn seek(&mut self, position: u64) -> Result<()> {
        let result = match &mut self.out {
            Out::Plain(out) => out.seek(SeekFrom::Start(position)),
            Out::Temporary(out, _) => out.seek(SeekFrom::Start(position)),
        };
        result.map_err(|e| Error::io("cannot seek", e).at_byte(position))?;
        self.position = position;
        Ok(())
    }
}
