//! The tile directory: one entry per tile, in blocks of 1024.

use byteorder::{ByteOrder, LittleEndian as LE};

use super::codec::{self, Codec};
use super::footer::BlockRef;
use super::layout::*;
use crate::names::{bytes, names};
use crate::{Error, Result};

/// Where the functions of a tile are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum TileKind {
    /// No pixel has a vertex: lit everywhere.
    #[default]
    Empty = 0,
    /// Every pixel has the same single vertex, monochrome; no payload.
    Constant = 1,
    /// A payload holds the functions.
    Data = 2,
}

names!(TileKind, "tile kind" {
    Empty = "empty",
    Constant = "constant",
    Data = "data",
});
bytes!(TileKind);

/// Flag of a tile with pixels of three channels.
pub const FLAG_COLOURED: u16 = 1;

/// One entry of the tile directory, as in `spec/format.md`, section 6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// What the tile is.
    pub kind: TileKind,
    /// Where the payload begins in the file.
    pub offset: u64,
    /// Bytes of the payload in the file, padding included.
    pub stored_size: u32,
    /// Bytes that the codec yields.
    pub decoded_size: u32,
    /// Vertices of all pixels.
    pub vertices: u32,
    /// CRC-32 of the stored bytes.
    pub crc: u32,
    /// Least and greatest depth of a vertex.
    pub depths: [f32; 2],
    /// Least and greatest visibility behind everything.
    pub ends: [f32; 2],
    /// Codec id.
    pub codec: u8,
    /// Transform id.
    pub transform: u8,
    /// Zero bytes at the end of the stored bytes.
    pub padding: u8,
    /// L of visibilities k / L; 0 for f32.
    pub lattice: u16,
    /// Whether some pixels have three channels.
    pub coloured: bool,
}

impl Default for Entry {
    /// The entry of an empty tile.
    fn default() -> Self {
        Entry {
            kind: TileKind::Empty,
            offset: 0,
            stored_size: 0,
            decoded_size: 0,
            vertices: 0,
            crc: 0,
            depths: [0.0; 2],
            ends: [1.0; 2],
            codec: 0,
            transform: 0,
            padding: 0,
            lattice: 0,
            coloured: false,
        }
    }
}

impl Entry {
    /// The entry of a constant tile of `pixels` pixels, each with one vertex.
    pub fn constant(pixels: u32, z: f32, visibility: f32) -> Self {
        Entry {
            kind: TileKind::Constant,
            vertices: pixels,
            depths: [z; 2],
            ends: [visibility; 2],
            ..Entry::default()
        }
    }

    fn encode(&self, r: &mut [u8]) {
        LE::write_u64(&mut r[ENTRY_OFFSET..], self.offset);
        LE::write_u32(&mut r[ENTRY_STORED..], self.stored_size);
        LE::write_u32(&mut r[ENTRY_DECODED..], self.decoded_size);
        LE::write_u32(&mut r[ENTRY_VERTICES..], self.vertices);
        LE::write_u32(&mut r[ENTRY_CRC..], self.crc);
        LE::write_f32(&mut r[ENTRY_Z_MIN..], self.depths[0]);
        LE::write_f32(&mut r[ENTRY_Z_MAX..], self.depths[1]);
        LE::write_f32(&mut r[ENTRY_END_MIN..], self.ends[0]);
        LE::write_f32(&mut r[ENTRY_END_MAX..], self.ends[1]);
        r[ENTRY_KIND] = self.kind.byte();
        r[ENTRY_CODEC] = self.codec;
        r[ENTRY_TRANSFORM] = self.transform;
        r[ENTRY_PADDING] = self.padding;
        LE::write_u16(&mut r[ENTRY_LATTICE..], self.lattice);
        LE::write_u16(
            &mut r[ENTRY_FLAGS..],
            if self.coloured { FLAG_COLOURED } else { 0 },
        );
    }

    /// The entry in these 48 bytes, of a tile of `pixels` pixels in a map of `channels`, in a file whose payloads end at byte `directory`.
    ///
    /// # Errors
    /// `Corrupt` by the rules of section 6, `Unsupported` for a transform that is not known.
    pub fn parse(r: &[u8], pixels: u32, channels: usize, directory: u64) -> Result<Entry> {
        let flags = LE::read_u16(&r[ENTRY_FLAGS..]);
        let entry = Entry {
            kind: TileKind::from_byte(r[ENTRY_KIND])
                .ok_or_else(|| Error::corrupt("TILE-KIND", format!("kind {}", r[ENTRY_KIND])))?,
            offset: LE::read_u64(&r[ENTRY_OFFSET..]),
            stored_size: LE::read_u32(&r[ENTRY_STORED..]),
            decoded_size: LE::read_u32(&r[ENTRY_DECODED..]),
            vertices: LE::read_u32(&r[ENTRY_VERTICES..]),
            crc: LE::read_u32(&r[ENTRY_CRC..]),
            depths: [
                LE::read_f32(&r[ENTRY_Z_MIN..]),
                LE::read_f32(&r[ENTRY_Z_MAX..]),
            ],
            ends: [
                LE::read_f32(&r[ENTRY_END_MIN..]),
                LE::read_f32(&r[ENTRY_END_MAX..]),
            ],
            codec: r[ENTRY_CODEC],
            transform: r[ENTRY_TRANSFORM],
            padding: r[ENTRY_PADDING],
            lattice: LE::read_u16(&r[ENTRY_LATTICE..]),
            coloured: flags & FLAG_COLOURED != 0,
        };
        // Empty and constant tiles have one form each: whatever differs from it is wrong, -0 included.
        let is = |form: Entry| {
            let mut bytes = [0; ENTRY_SIZE];
            form.encode(&mut bytes);
            bytes == *r
        };
        match entry.kind {
            TileKind::Empty if !is(Entry::default()) => Err(Error::corrupt(
                "TILE-EMPTY",
                "an empty tile is not all empty",
            )),
            TileKind::Constant => {
                let (z, v) = (entry.depths[0], entry.ends[0]);
                let in_range = z.is_finite() && (0.0..1.0).contains(&v) && !v.is_sign_negative();
                if !in_range
                    || (z == 0.0 && z.is_sign_negative())
                    || !is(Entry::constant(pixels, z, v))
                {
                    return Err(Error::corrupt(
                        "TILE-CONSTANT",
                        "a constant tile is not one vertex in every pixel",
                    ));
                }
                Ok(entry)
            }
            TileKind::Data if flags & !FLAG_COLOURED != 0 => {
                Err(Error::corrupt("TILE-FLAGS", format!("flags {flags:#x}")))
            }
            TileKind::Data => entry.check_data(channels, directory).map(|()| entry),
            TileKind::Empty => Ok(entry),
        }
    }

    fn check_data(&self, channels: usize, directory: u64) -> Result<()> {
        if self.coloured && channels == 1 {
            return Err(Error::corrupt(
                "MAP-CHANNELS",
                "a coloured tile in a map of one channel",
            ));
        }
        if self.padding > 7 || u32::from(self.padding) > self.stored_size {
            return Err(Error::corrupt(
                "TILE-PADDING",
                format!("{} bytes of padding", self.padding),
            ));
        }
        let end = self.offset.checked_add(u64::from(self.stored_size));
        let inside = self.offset >= HEADER_SIZE as u64 && end.is_some_and(|end| end <= directory);
        if !inside
            || !self.offset.is_multiple_of(ALIGN as u64)
            || !self.stored_size.is_multiple_of(ALIGN as u32)
            || self.stored_size == 0
        {
            let what = format!(
                "a payload of {} bytes at byte {}",
                self.stored_size, self.offset
            );
            return Err(Error::corrupt("TILE-RANGE", what));
        }
        if self.vertices == 0 {
            return Err(Error::corrupt(
                "TILE-VERTICES",
                "a data tile without vertices",
            ));
        }
        let what = || format!("a tile that decodes to {} bytes", self.decoded_size);
        if self.decoded_size > MAX_DECODED {
            return Err(Error::corrupt("TILE-SIZE", what()));
        }
        let frame = self.stored_size - u32::from(self.padding);
        if self.codec == codec::NONE && self.decoded_size != frame {
            return Err(Error::corrupt("TILE-CODEC", what()));
        }
        let finite = self.depths.iter().all(|z| z.is_finite());
        if !finite || self.depths[0] > self.depths[1] {
            return Err(Error::corrupt(
                "TILE-DEPTHS",
                format!("depths {:?}", self.depths),
            ));
        }
        if !(0.0 <= self.ends[0] && self.ends[0] <= self.ends[1] && self.ends[1] <= 1.0) {
            return Err(Error::corrupt("TILE-ENDS", format!("ends {:?}", self.ends)));
        }
        Ok(())
    }
}

/// The stored bytes of a block, padded, and a reference to it that lacks only its offset.
pub fn encode_block(entries: &[Entry], codec: Codec) -> Result<(BlockRef, Vec<u8>)> {
    let mut raw = vec![0; entries.len() * ENTRY_SIZE];
    raw.chunks_exact_mut(ENTRY_SIZE)
        .zip(entries)
        .for_each(|(r, e)| e.encode(r));
    let mut stored = Vec::new();
    if codec == Codec::None {
        stored = raw;
    } else {
        let n = entries.len();
        let planes: Vec<u8> = (0..raw.len())
            .map(|i| raw[i % n * ENTRY_SIZE + i / n])
            .collect();
        codec.encode(&planes, &mut stored)?;
    }
    let padding = pad(&mut stored);
    let stored_size = stored.len() as u32;
    let crc = crc32fast::hash(&stored);
    Ok((
        BlockRef {
            offset: 0,
            stored_size,
            crc,
            codec: codec.id(),
            padding,
        },
        stored,
    ))
}

/// The entry records of a block of `n` tiles, 48 bytes each, from its stored bytes.
///
/// # Errors
/// `Corrupt` by the rules of section 6, `Unsupported` for a codec that is not known.
pub fn decode_block(block: &BlockRef, stored: &[u8], n: usize) -> Result<Vec<u8>> {
    if crc32fast::hash(stored) != block.crc {
        return Err(Error::corrupt(
            "BLOCK-CRC",
            "a block of the directory is damaged",
        ));
    }
    let frame = unpad(stored, block.padding)
        .ok_or_else(|| Error::corrupt("BLOCK-PADDING", "padding that is not zero"))?;
    let size = n * ENTRY_SIZE;
    let planes = codec::decode(block.codec, frame, size).map_err(|e| e.breaks("BLOCK-SIZE"))?;
    if planes.len() != size {
        return Err(Error::corrupt(
            "BLOCK-SIZE",
            format!("a block of {} bytes for {n} entries", planes.len()),
        ));
    }
    if block.codec == codec::NONE {
        return Ok(planes);
    }
    Ok((0..size)
        .map(|i| planes[i % ENTRY_SIZE * n + i / ENTRY_SIZE])
        .collect())
}

/// Pads `bytes` to a multiple of 8 and says by how much.
pub(crate) fn pad(bytes: &mut Vec<u8>) -> u8 {
    let length = bytes.len();
    bytes.resize(length.next_multiple_of(ALIGN), 0);
    (bytes.len() - length) as u8
}

/// `stored` without its padding; `None` if that is too long or not zero.
pub(crate) fn unpad(stored: &[u8], padding: u8) -> Option<&[u8]> {
    let (frame, zeros) = stored.split_at(stored.len().checked_sub(usize::from(padding))?);
    zeros.iter().all(|&b| b == 0).then_some(frame)
}
