//! Encodes a tile: its directory entry and its stored bytes.

use super::{Tile, Words, planes_mut};
use crate::format::directory::{Entry, TileKind, pad};
use crate::format::layout::MAX_DECODED;
use crate::format::{Codec, transform};
use crate::{Error, Result};

impl Tile {
    /// The directory entry of this tile, without its offset, and the payload. The payload is empty
    /// unless the entry is of kind data.
    ///
    /// # Errors
    /// `Limit` for a tile of more than 2^31 bytes.
    pub fn encode(&self, codec: Codec) -> Result<(Entry, Vec<u8>)> {
        if self.vertices() == 0 {
            return Ok((Entry::default(), Vec::new()));
        }
        if let Some((z, v)) = self.constant() {
            return Ok((Entry::constant(self.pixels() as u32, z, v), Vec::new()));
        }
        let size = self.counts.bytes();
        if size + 4 * self.pixels() as u64 > u64::from(MAX_DECODED) {
            return Err(Error::limit(format!(
                "a tile of {size} bytes; use smaller tiles"
            )));
        }
        let (words, bytes);
        let (transform, decoded) = match codec {
            Codec::None => {
                words = self.words_of_file();
                let all = bytemuck::cast_slice(&words);
                (transform::NONE, &all[..size as usize])
            }
            _ => {
                bytes = transform::encode(self);
                (transform::DELTA_PLANES, &bytes[..])
            }
        };
        let mut stored = Vec::new();
        codec.encode(decoded, &mut stored)?;
        let padding = pad(&mut stored);
        let entry = Entry {
            kind: TileKind::Data,
            offset: 0,
            stored_size: u32::try_from(stored.len())
                .map_err(|_| Error::limit("a tile of more than 4 GiB"))?,
            decoded_size: decoded.len() as u32,
            vertices: self.vertices() as u32,
            crc: crc32fast::hash(&stored),
            depths: self.depth_range(),
            ends: self.end_range(),
            codec: codec.id(),
            transform,
            padding,
            lattice: self.lattice(),
            coloured: self.is_coloured(),
        };
        Ok((entry, stored))
    }

    /// Depth and visibility of the vertex of every pixel, if each has one and all are the same.
    fn constant(&self) -> Option<(f32, f32)> {
        if self.vertices() != self.pixels() || self.is_coloured() {
            return None;
        }
        let vertex = |i| {
            let f = self.function(i);
            let bits = f.depths().first()?.to_bits();
            (f.len() == 1).then(|| (bits, f.end() as f32))
        };
        let (bits, v) = vertex(0)?;
        let same = (1..self.pixels()).all(|i| vertex(i) == Some((bits, v)));
        same.then_some((f32::from_bits(bits), v))
    }

    /// The planes in the byte order of the file, with zeros after them.
    fn words_of_file(&self) -> Words {
        let mut words = self.clone().into_buffer();
        planes_mut(&mut words, &self.counts).convert_byte_order();
        words
    }
}
