//! The tile directory: one entry per tile, in blocks of 1024.

use super::codec::{self, Codec};
use super::ensure;
use super::layout::*;
use super::record::{Number, Record};
use crate::names::{bytes, names};
use crate::{Error, Result};

/// How the functions of a tile are stored.
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
bytes!(TileKind, "TILE-KIND");

/// Flag of a tile that has pixels of three channels.
pub const FLAG_COLOURED: u16 = 1;

/// One entry of the tile directory, as in `spec/format.md`, section 6.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// How the functions of the tile are stored.
    pub kind: TileKind,
    /// Byte of the file at which the payload begins.
    pub offset: u64,
    /// Bytes of the payload in the file, padding included.
    pub stored_size: u32,
    /// Bytes that the codec decodes to.
    pub decoded_size: u32,
    /// Vertices of all pixels.
    pub vertices: u32,
    /// CRC-32 of the stored bytes.
    pub crc: u32,
    /// Least and greatest depth of a vertex. Decoding a tile of kind data checks them.
    pub depths: [f32; 2],
    /// Least and greatest visibility behind everything. Decoding a tile of kind data checks them.
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

    /// The fields that have the same form in memory and in the file.
    fn fields(&mut self, mut r: Record<'_>) {
        r.field(ENTRY_OFFSET, &mut self.offset);
        r.field(ENTRY_STORED, &mut self.stored_size);
        r.field(ENTRY_DECODED, &mut self.decoded_size);
        r.field(ENTRY_VERTICES, &mut self.vertices);
        r.field(ENTRY_CRC, &mut self.crc);
        r.field(ENTRY_Z_MIN, &mut self.depths);
        r.field(ENTRY_END_MIN, &mut self.ends);
        r.field(ENTRY_CODEC, &mut self.codec);
        r.field(ENTRY_TRANSFORM, &mut self.transform);
        r.field(ENTRY_PADDING, &mut self.padding);
        r.field(ENTRY_LATTICE, &mut self.lattice);
    }

    fn encode(mut self) -> [u8; ENTRY_SIZE] {
        let mut r = [0; ENTRY_SIZE];
        self.fields(Record::Write(&mut r));
        r[ENTRY_KIND] = self.kind.byte();
        (u16::from(self.coloured) * FLAG_COLOURED).write(&mut r[ENTRY_FLAGS..]);
        r
    }

    /// The entry in these 48 bytes.
    ///
    /// The tile has `pixels` pixels and belongs to a map of `channels`. The payloads of the file
    /// end at byte `directory`.
    ///
    /// # Errors
    /// `Corrupt` by the rules of section 6.
    pub fn parse(r: &[u8], pixels: u32, channels: usize, directory: u64) -> Result<Entry> {
        let flags = u16::read(&r[ENTRY_FLAGS..]);
        let mut entry = Entry {
            kind: TileKind::from_byte(r[ENTRY_KIND])?,
            coloured: flags & FLAG_COLOURED != 0,
            ..Entry::default()
        };
        entry.fields(Record::Read(r));
        match entry.kind {
            // An empty or constant tile has one form. Any other byte is wrong, -0 included.
            TileKind::Empty => ensure(
                *r == Entry::default().encode(),
                "TILE-EMPTY",
                || "an empty tile is not all empty",
            )?,
            TileKind::Constant => {
                let (z, v) = (entry.depths[0], entry.ends[0]);
                let is_negative_zero = |v: f32| v == 0.0 && v.is_sign_negative();
                let holds = z.is_finite()
                    && (0.0..1.0).contains(&v)
                    && ![z, v].into_iter().any(is_negative_zero)
                    && *r == Entry::constant(pixels, z, v).encode();
                ensure(
                    holds,
                    "TILE-CONSTANT",
                    || "a constant tile is not one vertex in every pixel",
                )?;
            }
            TileKind::Data => {
                ensure(flags & !FLAG_COLOURED == 0, "TILE-FLAGS", || {
                    format!("flags {flags:#x}")
                })?;
                entry.check_data(channels, directory)?;
            }
        }
        Ok(entry)
    }

    fn check_data(&self, channels: usize, directory: u64) -> Result<()> {
        let Entry {
            offset,
            stored_size: stored,
            decoded_size: decoded,
            padding,
            ..
        } = *self;
        ensure(
            !self.coloured || channels == 3,
            "MAP-CHANNELS",
            || "a coloured tile in a map of one channel",
        )?;
        check_padding(padding, stored, "TILE-PADDING")?;
        let end = offset.checked_add(u64::from(stored));
        let inside = offset >= HEADER_SIZE as u64 && end.is_some_and(|end| end <= directory);
        let holds = inside && is_aligned(offset, stored) && stored > 0;
        ensure(holds, "TILE-RANGE", || {
            format!("a payload of {stored} bytes at byte {offset}")
        })?;
        ensure(
            self.vertices > 0,
            "TILE-VERTICES",
            || "a data tile without vertices",
        )?;
        let size = || format!("a tile that decodes to {decoded} bytes");
        ensure(decoded <= MAX_DECODED, "TILE-SIZE", size)?;
        let is_exact = self.codec != codec::NONE || decoded == stored - u32::from(padding);
        ensure(is_exact, "TILE-CODEC", size)
    }
}

/// The position of a block of the directory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockRef {
    /// Byte offset in the file.
    pub offset: u64,
    /// Bytes in the file.
    pub stored_size: u32,
    /// CRC-32 of them.
    pub crc: u32,
    /// Codec id.
    pub codec: u8,
    /// Zero bytes at their end.
    pub padding: u8,
}

/// Checks the number of padding bytes at the end of `stored` bytes.
pub(super) fn check_padding(padding: u8, stored: u32, rule: &'static str) -> Result<()> {
    let holds = padding < ALIGN as u8 && u32::from(padding) <= stored;
    ensure(holds, rule, || format!("{padding} bytes of padding"))
}

/// Whether stored bytes start and end at multiples of [`ALIGN`].
pub(super) fn is_aligned(offset: u64, size: u32) -> bool {
    offset.is_multiple_of(ALIGN as u64) && size.is_multiple_of(ALIGN as u32)
}

/// The stored bytes of a block, padded, and a reference to it that lacks only its offset.
///
/// A codec other than none stores byte planes: the first bytes of all entries, then the second
/// bytes, and so on.
pub fn encode_block(entries: &[Entry], codec: Codec) -> Result<(BlockRef, Vec<u8>)> {
    let mut stored: Vec<u8> = entries.iter().flat_map(|e| e.encode()).collect();
    if codec != Codec::None {
        let records = std::mem::take(&mut stored);
        codec.encode(&transpose(&records, ENTRY_SIZE), &mut stored)?;
    }
    let block = BlockRef {
        offset: 0,
        padding: pad(&mut stored),
        stored_size: stored.len() as u32,
        crc: crc32fast::hash(&stored),
        codec: codec.id(),
    };
    Ok((block, stored))
}

/// The entry records of a block of `n` tiles, 48 bytes each, from its stored bytes; only one record
/// if all are equal.
///
/// # Errors
/// `Corrupt` by the rules of section 6, `Unsupported` for an unknown codec.
pub fn decode_block(block: &BlockRef, stored: &[u8], n: usize) -> Result<Vec<u8>> {
    ensure(
        crc32fast::hash(stored) == block.crc,
        "BLOCK-CRC",
        || "a block of the directory is damaged",
    )?;
    let frame = unpad(stored, block.padding, "BLOCK-PADDING")?;
    let records = |bytes: &[u8]| match block.codec {
        codec::NONE => bytes.to_vec(),
        // All bytes of each column are equal.
        _ if n > 0 && bytes.chunks(n).all(|column| column[1..] == column[..n - 1]) => {
            bytes.iter().copied().step_by(n).collect()
        }
        _ => transpose(bytes, n),
    };
    codec::with_decoded(block.codec, frame, n * ENTRY_SIZE, "BLOCK-SIZE", records)
}

/// The columns of a table of bytes whose rows have `width` bytes.
fn transpose(bytes: &[u8], width: usize) -> Vec<u8> {
    let rows = bytes.len() / width;
    let column = |c| (0..rows).map(move |row| bytes[row * width + c]);
    (0..width).flat_map(column).collect()
}

/// Pads `bytes` to a multiple of 8. Returns the number of bytes that it added.
pub(crate) fn pad(bytes: &mut Vec<u8>) -> u8 {
    let length = bytes.len();
    bytes.resize(length.next_multiple_of(ALIGN), 0);
    (bytes.len() - length) as u8
}

/// `stored` without its padding, which must be zero.
pub(crate) fn unpad<'a>(stored: &'a [u8], padding: u8, rule: &'static str) -> Result<&'a [u8]> {
    let end = stored.len().checked_sub(usize::from(padding));
    match end.map(|end| stored.split_at(end)) {
        Some((frame, zeros)) if zeros.iter().all(|&b| b == 0) => Ok(frame),
        _ => Err(Error::corrupt(rule, "padding that is not zero")),
    }
}
