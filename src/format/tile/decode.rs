//! Stored bytes to a tile. Checks every rule.

use byteorder::{ByteOrder, LittleEndian as LE};

use super::{Counts, PADDING, Planes, Shared, Tile, ValuesMut, Words, planes_mut};
use crate::error::Place;
use crate::format::directory::{Entry, TileKind, unpad};
use crate::format::layout::ALIGN;
use crate::format::wide::wide;
use crate::format::{codec, ensure, laws, transform};
use crate::{Error, Limits, Result};

impl Tile {
    /// The tile of `extent` (width, height) pixels that `entry` describes, from its stored bytes.
    ///
    /// Checks every rule. `limit` is the largest number of bytes that the tile may decode to.
    ///
    /// # Errors
    /// `Corrupt` by the rules of sections 6 to 9 and the laws, `Unsupported`, `Limit`.
    pub fn decode(entry: &Entry, stored: &[u8], extent: (u32, u32), limit: u64) -> Result<Tile> {
        Self::decode_into(entry, stored, extent, limit, Words::EMPTY)
    }

    /// [`Tile::decode`] into the memory of `old`, as a cache does: avoids the cost of fresh pages.
    ///
    /// # Errors
    /// As [`Tile::decode`].
    pub fn decode_reusing(
        entry: &Entry,
        stored: &[u8],
        extent: (u32, u32),
        limit: u64,
        old: Tile,
    ) -> Result<Tile> {
        Self::decode_into(entry, stored, extent, limit, old.into_buffer())
    }

    /// [`Tile::decode`] into `buffer`.
    pub(crate) fn decode_into(
        entry: &Entry,
        stored: &[u8],
        extent: (u32, u32),
        limit: u64,
        buffer: Words,
    ) -> Result<Tile> {
        if entry.kind == TileKind::Data {
            check_crc(entry, stored)?;
        }
        Self::decode_checked(entry, stored, extent, limit, buffer)
    }

    /// [`Tile::decode_into`] of stored bytes whose CRC the caller has checked.
    pub(crate) fn decode_checked(
        entry: &Entry,
        stored: &[u8],
        extent: (u32, u32),
        limit: u64,
        buffer: Words,
    ) -> Result<Tile> {
        let (width, pixels) = (extent.0, extent.0 * extent.1);
        match entry.kind {
            TileKind::Empty => return Ok(Tile::lit(extent.0, extent.1)),
            TileKind::Constant => return Ok(Tile::constant_of(entry, width, pixels)),
            TileKind::Data => check_sizes(entry, pixels, limit)?,
        };
        let frame = unpad(stored, entry.padding, "TILE-PADDING")?;
        let size = entry.decoded_size as usize;
        let decode = |bytes: &[u8]| match entry.transform {
            transform::NONE => Tile::from_bytes(bytes, width, pixels, entry, buffer),
            _ => wide(
                #[inline(always)]
                || transform::decode(bytes, width, pixels, entry, buffer),
            ),
        };
        codec::with_decoded(entry.codec, frame, size, "TILE-CODEC", decode)??.checked(entry)
    }

    fn constant_of(entry: &Entry, width: u32, pixels: u32) -> Tile {
        let counts = Counts {
            pixels: pixels as usize,
            vertices: pixels as usize,
            ..Counts::default()
        };
        let mut words = Words::EMPTY;
        let planes = planes_mut(&mut words, &counts);
        planes.vertex.iter_mut().zip(0..).for_each(|(v, i)| *v = i);
        planes.z.fill(entry.depths[0]);
        if let ValuesMut::F32(v) = planes.v {
            v.fill(entry.ends[0]);
        }
        Tile::new(width, words, counts)
    }

    /// Whether the stored bytes of a tile are its decoded bytes.
    pub(crate) fn is_plain(entry: &Entry) -> bool {
        entry.kind == TileKind::Data
            && entry.codec == codec::NONE
            && entry.transform == transform::NONE
    }

    /// Bytes that the planes of a tile take, and its padding.
    ///
    /// For coloured tiles of delta planes, an upper bound. 0 for a tile without planes, and if
    /// decoding will refuse the sizes that the entry states.
    pub(crate) fn planes_bytes(entry: &Entry, extent: (u32, u32), limit: u64) -> usize {
        let pixels = extent.0 * extent.1;
        let is_sound = || check_sizes(entry, pixels, limit).unwrap_or(false);
        if entry.kind != TileKind::Data || !is_sound() {
            return 0;
        }
        let (p, n) = (u64::from(pixels), u64::from(entry.vertices));
        let w = if entry.lattice == 0 { 4 } else { 2 };
        let coloured = entry.coloured.then(|| {
            let (least, _) = match entry.transform {
                transform::NONE => (8 * (p + 1) + (4 + w) * n, 0),
                _ => transform::size_range(p, n, true, entry.lattice),
            };
            (u64::from(entry.decoded_size).saturating_sub(least) / (2 * w)).min(n)
        });
        Counts::of(entry, pixels, coloured).bytes() as usize + PADDING
    }

    /// The tile of a plain entry, looked up where its stored bytes lie. Checks every rule, the CRC
    /// too. `None` if the entry is not plain, or if this machine cannot read the bytes there.
    ///
    /// # Errors
    /// As [`Tile::decode`].
    pub(crate) fn in_place(
        entry: &Entry,
        stored: Shared,
        extent: (u32, u32),
        limit: u64,
    ) -> Result<Option<Tile>> {
        if !Tile::is_plain(entry) {
            return Ok(None);
        }
        let counts = plain_counts(entry, (*stored).as_ref(), extent, limit)?;
        let tile = Planes::shared(stored, &counts).map(|planes| Tile {
            width: extent.0,
            counts,
            planes,
        });
        tile.map(|tile| tile.checked(entry)).transpose()
    }

    /// The tile of a plain entry, from a buffer that holds its stored bytes and then [`PADDING`].
    /// The machine must have the byte order of the file.
    ///
    /// # Errors
    /// As [`Tile::decode`].
    pub(crate) fn adopt(
        entry: &Entry,
        words: Words,
        extent: (u32, u32),
        limit: u64,
    ) -> Result<Tile> {
        debug_assert!(Tile::is_plain(entry) && cfg!(target_endian = "little"));
        let stored = words.len() - PADDING / 8;
        let counts = plain_counts(entry, bytemuck::cast_slice(&words[..stored]), extent, limit)?;
        Tile::new(extent.0, words, counts).checked(entry)
    }

    fn from_bytes(
        bytes: &[u8],
        width: u32,
        pixels: u32,
        entry: &Entry,
        mut buffer: Words,
    ) -> Result<Tile> {
        let counts = counts_of(entry, pixels, bytes)?;
        planes_mut(&mut buffer, &counts);
        bytemuck::cast_slice_mut(&mut buffer)[..bytes.len()].copy_from_slice(bytes);
        planes_mut(&mut buffer, &counts).convert_byte_order();
        Ok(Tile::new(width, buffer, counts))
    }

    /// The tile, if its tables, the laws of its vertices and the ranges of the entry hold.
    fn checked(self, entry: &Entry) -> Result<Tile> {
        if entry.transform == transform::NONE {
            let planes = self.planes();
            check_tables(entry, planes.vertex_table, planes.colour_table)?;
        }
        let (depths, ends) = laws::check(&self)?;
        let is_coloured = self.counts.coloured != Some(0);
        ensure(
            is_coloured || !entry.coloured,
            "TILE-FLAGS",
            || "no pixel of a coloured tile is coloured",
        )?;
        let same = |rule, what, ours: [f32; 2], stated: [f32; 2]| {
            let is_same = ours.map(f32::to_bits) == stated.map(f32::to_bits);
            ensure(is_same, rule, || {
                format!("{what} {ours:?} where the directory says {stated:?}")
            })
        };
        same("TILE-DEPTHS", "depths", depths, entry.depths)?;
        same("TILE-ENDS", "ends", ends, entry.ends)?;
        Ok(self)
    }
}

impl Counts {
    /// The counts of a tile with `coloured` vertices of coloured pixels.
    fn of(entry: &Entry, pixels: u32, coloured: Option<u64>) -> Counts {
        Counts {
            pixels: pixels as usize,
            vertices: entry.vertices as usize,
            coloured: coloured.map(|m| m as usize),
            lattice: entry.lattice,
        }
    }
}

/// The counts of a plain tile from its stored bytes. Checks CRC, sizes and padding, not the tables.
fn plain_counts(entry: &Entry, stored: &[u8], extent: (u32, u32), limit: u64) -> Result<Counts> {
    let pixels = extent.0 * extent.1;
    check_crc(entry, stored)?;
    check_sizes(entry, pixels, limit)?;
    counts_of(entry, pixels, unpad(stored, entry.padding, "TILE-PADDING")?)
}

/// The counts of a tile from its decoded bytes. Checks sizes and padding, not the tables.
fn counts_of(entry: &Entry, pixels: u32, bytes: &[u8]) -> Result<Counts> {
    // The number of coloured vertices is the last of the colour table.
    let at = 8 * (pixels as usize + 1) - 4;
    let last = || bytes.get(at..at + 4).map_or(u32::MAX, LE::read_u32);
    let counts = Counts::of(entry, pixels, entry.coloured.then(|| last().into()));
    if counts.bytes() != bytes.len() as u64 {
        return Err(wrong_size(entry, pixels, bytes));
    }
    let is_zero = bytes[counts.unpadded()..].iter().all(|&b| b == 0);
    ensure(is_zero, "TILE-PADDING", || "padding that is not zero")?;
    Ok(counts)
}

fn check_crc(entry: &Entry, stored: &[u8]) -> Result<()> {
    let holds = stored.len() == entry.stored_size as usize && crc32fast::hash(stored) == entry.crc;
    ensure(holds, "TILE-CRC", || "the bytes of the tile are damaged")
}

/// The error of a decoded tile whose size differs from its counts. A broken table is the cause, if
/// there is one.
fn wrong_size(entry: &Entry, pixels: u32, bytes: &[u8]) -> Error {
    let n = pixels as usize + 1;
    let words = bytes.chunks_exact(4).map(LE::read_u32);
    let mut tables: Vec<u32> = words.take(2 * n).collect();
    tables.resize(2 * n, 0);
    let broken = check_tables(entry, &tables[..n], &tables[n..]).err();
    broken.unwrap_or_else(|| {
        Error::corrupt(
            "TILE-SIZE",
            "the decoded tile has another size than its counts say",
        )
    })
}

/// Checks the tables of pixels and of coloured pixels, which give the ranges of vertices.
fn check_tables(entry: &Entry, vertex: &[u32], colour: &[u32]) -> Result<()> {
    check_table(vertex, Some(entry.vertices), "TILE-TABLE")?;
    if !entry.coloured {
        return Ok(());
    }
    check_table(colour, None, "TILE-COLOUR")?;
    for (i, (v, c)) in vertex.windows(2).zip(colour.windows(2)).enumerate() {
        let grown = c[1] - c[0];
        ensure(
            grown == 0 || grown == v[1] - v[0],
            "TILE-COLOUR",
            || "a pixel is coloured in part",
        )
        .map_err(|e| e.at(Place::sample(i)))?;
    }
    Ok(())
}

/// The most bytes that decoding a tile takes at once: its planes, the bytes that they are made
/// from, the stored bytes, and the gaps between depths of delta planes.
pub(crate) fn decoding_bytes(entry: &Entry, pixels: u32) -> u64 {
    let n = u64::from(entry.vertices);
    let planes = Counts::of(entry, pixels, entry.coloured.then_some(n)).bytes();
    planes + u64::from(entry.decoded_size) + u64::from(entry.stored_size) + 4 * n
}

/// Checks the sizes that the entry states, before anything is allocated: against one another, and
/// against `limit`. `false` if delta planes are too short for `vertices`: they name the rule.
fn check_sizes(entry: &Entry, pixels: u32, limit: u64) -> Result<bool> {
    let (p, n) = (u64::from(pixels), u64::from(entry.vertices));
    let decoded = u64::from(entry.decoded_size);
    let size = |coloured: u64| {
        let coloured = entry.coloured.then_some(coloured);
        Counts::of(entry, pixels, coloured).bytes()
    };
    // The least size has no coloured vertex, the largest has only coloured ones.
    let (rule, (least, most)) = match entry.transform {
        transform::NONE => ("TILE-SIZE", (size(0), size(n))),
        transform::DELTA_PLANES => (
            "TILE-STREAM",
            transform::size_range(p, n, entry.coloured, entry.lattice),
        ),
        id => return Err(Error::unsupported(format!("transform {id}"))),
    };
    let is_short = decoded < least && entry.transform == transform::DELTA_PLANES;
    ensure(is_short || (least..=most).contains(&decoded), rule, || {
        format!("{decoded} bytes for {p} pixels and {n} vertices")
    })?;
    let bytes = match is_short {
        true => decoded + u64::from(entry.stored_size),
        false => decoding_bytes(entry, pixels),
    };
    Limits::default().memory(limit).check(bytes, "a tile")?;
    Ok(!is_short)
}

/// Checks that a table starts at 0, never falls, and ends at `total`.
fn check_table(table: &[u32], total: Option<u32>, rule: &'static str) -> Result<()> {
    let (first, last) = (table[0], table[table.len() - 1]);
    let pairs = table.iter().zip(&table[1..]);
    let falls = pairs.fold(0, |any, (a, b)| any | u32::from(a > b));
    let holds = first == 0 && falls == 0 && total.is_none_or(|n| n == last);
    ensure(holds, rule, || {
        format!("the table goes from {first} to {last}, or falls")
    })
}

const _: () = assert!(ALIGN == 8, "buffers are words");
