//! Stored bytes to a tile, every rule checked.

use byteorder::{ByteOrder, LittleEndian as LE};

use super::{Counts, PADDING, Planes, Shared, Tile, ValuesMut, Words, planes_mut};
use crate::format::directory::{Entry, TileKind, unpad};
use crate::format::layout::ALIGN;
use crate::format::{codec, laws, transform};
use crate::{Error, Place, Result};

impl Tile {
    /// The tile of `extent` (width, height) pixels that `entry` describes, from its stored bytes, every rule checked.
    /// `limit` is the largest number of bytes that it may decode to.
    ///
    /// # Errors
    /// `Corrupt` by the rules of sections 6 to 9 and the laws, `Unsupported`, `Limit`.
    pub fn decode(entry: &Entry, stored: &[u8], extent: (u32, u32), limit: u64) -> Result<Tile> {
        Self::decode_into(entry, stored, extent, limit, Words::EMPTY)
    }

    /// [`Tile::decode`] into the memory of a tile that is no longer needed: what a cache does, without the system's
    /// cost of fresh pages.
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
        match entry.kind {
            TileKind::Empty => Ok(Tile::lit(extent.0, extent.1)),
            TileKind::Constant => Ok(Tile::constant_of(entry, extent)),
            TileKind::Data => {
                check_crc(entry, stored)?;
                Self::decode_checked(entry, stored, extent, limit, buffer)
            }
        }
    }

    fn constant_of(entry: &Entry, (width, height): (u32, u32)) -> Tile {
        let pixels = width * height;
        let counts = Counts {
            pixels: pixels as usize,
            vertices: pixels as usize,
            coloured: None,
            lattice: 0,
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

    /// [`Tile::decode_into`] of stored bytes whose CRC has been seen to.
    pub(crate) fn decode_checked(
        entry: &Entry,
        stored: &[u8],
        extent: (u32, u32),
        limit: u64,
        buffer: Words,
    ) -> Result<Tile> {
        let pixels = extent.0 * extent.1;
        check_sizes(entry, pixels, limit)?;
        let frame = unpadded(entry, stored)?;
        let tile =
            codec::with_decoded(
                entry.codec,
                frame,
                entry.decoded_size as usize,
                |bytes| match entry.transform {
                    transform::NONE => Tile::from_bytes(bytes, extent.0, pixels, entry, buffer),
                    _ => transform::decode(bytes, extent.0, pixels, entry, buffer),
                },
            )
            .map_err(|e| e.breaks("TILE-CODEC"))??;
        tile.check(entry)?;
        Ok(tile)
    }

    /// Whether the stored bytes of a tile are its decoded bytes.
    pub(crate) fn is_plain(entry: &Entry) -> bool {
        entry.kind == TileKind::Data
            && entry.codec == codec::NONE
            && entry.transform == transform::NONE
    }

    /// Bytes that the planes of a tile take; for coloured tiles of delta planes a little more than that. None if
    /// decoding it will be refused for what its entry says of sizes.
    pub(crate) fn planes_bytes(entry: &Entry, extent: (u32, u32), limit: u64) -> usize {
        if entry.kind != TileKind::Data || check_sizes(entry, extent.0 * extent.1, limit).is_err() {
            return 0;
        }
        let pixels = u64::from(extent.0) * u64::from(extent.1);
        let n = u64::from(entry.vertices);
        let w = if entry.lattice == 0 { 4 } else { 2 };
        let coloured = entry.coloured.then(|| {
            let (least, _) = match entry.transform {
                transform::NONE => (8 * (pixels + 1) + (4 + w) * n, 0),
                _ => transform::size_range(pixels, n, true, entry.lattice),
            };
            (u64::from(entry.decoded_size).saturating_sub(least) / (2 * w)).min(n)
        });
        let counts = Counts {
            pixels: pixels as usize,
            vertices: entry.vertices as usize,
            coloured: coloured.map(|m| m as usize),
            lattice: entry.lattice,
        };
        counts.bytes() as usize + PADDING
    }

    /// The tile whose stored bytes are its decoded bytes, looked up where they lie; `None` if its codec or this machine does
    /// not allow that. Every rule is checked, the CRC too.
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
        let Some(planes) = Planes::shared(stored, &counts) else {
            return Ok(None);
        };
        Self::of_planes(entry, extent, counts, planes).map(Some)
    }

    /// The tile whose stored bytes are its decoded bytes, from a buffer that holds them and then the
    /// padding, on a machine of the file's byte order.
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
        let planes = Planes::own(words, &counts);
        Self::of_planes(entry, extent, counts, planes)
    }

    fn of_planes(
        entry: &Entry,
        extent: (u32, u32),
        counts: Counts,
        planes: Planes,
    ) -> Result<Tile> {
        let tile = Tile {
            width: extent.0,
            counts,
            planes,
        };
        check_tables(
            entry,
            tile.planes().vertex_table,
            tile.planes().colour_table,
        )?;
        tile.check(entry)?;
        Ok(tile)
    }

    fn from_bytes(
        bytes: &[u8],
        width: u32,
        pixels: u32,
        entry: &Entry,
        mut buffer: Words,
    ) -> Result<Tile> {
        let counts = counts_of(entry, pixels, bytes)?;
        let planes = planes_mut(&mut buffer, &counts);
        let mut rest = bytes;
        let mut part = |n: usize| {
            let (head, tail) = rest.split_at(n);
            rest = tail;
            head
        };
        LE::read_u32_into(part(4 * planes.vertex.len()), planes.vertex);
        LE::read_u32_into(part(4 * planes.colour.len()), planes.colour);
        LE::read_f32_into(part(4 * planes.z.len()), planes.z);
        match planes.v {
            ValuesMut::Lattice(k) => LE::read_u16_into(part(2 * k.len()), k),
            ValuesMut::F32(v) => LE::read_f32_into(part(4 * v.len()), v),
        }
        let tile = Tile::new(width, buffer, counts);
        check_tables(
            entry,
            tile.planes().vertex_table,
            tile.planes().colour_table,
        )?;
        Ok(tile)
    }

    /// The laws of the vertices, and what the entry says of them.
    fn check(&self, entry: &Entry) -> Result<()> {
        let ranges = laws::check(self)?;
        if entry.coloured && self.counts.coloured == Some(0) {
            return Err(Error::corrupt(
                "TILE-FLAGS",
                "no pixel of a coloured tile is coloured",
            ));
        }
        let same = |rule, what, ours: [f32; 2], stated: [f32; 2]| {
            if ours.map(f32::to_bits) == stated.map(f32::to_bits) {
                return Ok(());
            }
            let what = format!("{what} {ours:?} where the directory says {stated:?}");
            Err(Error::corrupt(rule, what))
        };
        same("TILE-DEPTHS", "depths", ranges.depths, entry.depths)?;
        same("TILE-ENDS", "ends", ranges.ends, entry.ends)
    }
}

/// The counts of a tile whose stored bytes are its decoded bytes: CRC, sizes and padding checked, its tables not yet.
fn plain_counts(entry: &Entry, stored: &[u8], extent: (u32, u32), limit: u64) -> Result<Counts> {
    let pixels = extent.0 * extent.1;
    check_crc(entry, stored)?;
    check_sizes(entry, pixels, limit)?;
    let bytes = unpadded(entry, stored)?;
    counts_of(entry, pixels, bytes)
}

/// The counts of a tile whose decoded bytes these are: sizes and padding checked, its tables not yet.
fn counts_of(entry: &Entry, pixels: u32, bytes: &[u8]) -> Result<Counts> {
    // The number of coloured vertices is the last of the colour table.
    let at = 8 * (pixels as usize + 1) - 4;
    let coloured = entry
        .coloured
        .then(|| bytes.get(at..at + 4).map_or(u32::MAX, LE::read_u32) as usize);
    let counts = Counts {
        pixels: pixels as usize,
        vertices: entry.vertices as usize,
        coloured,
        lattice: entry.lattice,
    };
    if counts.bytes() != bytes.len() as u64 {
        return Err(wrong_size(entry, pixels, bytes));
    }
    if bytes[counts.unpadded()..].iter().any(|&b| b != 0) {
        return Err(Error::corrupt("TILE-PADDING", "padding that is not zero"));
    }
    Ok(counts)
}

fn check_crc(entry: &Entry, stored: &[u8]) -> Result<()> {
    if stored.len() != entry.stored_size as usize || crc32fast::hash(stored) != entry.crc {
        return Err(Error::corrupt(
            "TILE-CRC",
            "the bytes of the tile are damaged",
        ));
    }
    Ok(())
}

fn unpadded<'a>(entry: &Entry, stored: &'a [u8]) -> Result<&'a [u8]> {
    unpad(stored, entry.padding)
        .ok_or_else(|| Error::corrupt("TILE-PADDING", "padding that is not zero"))
}

/// Why the decoded tile has not the size that its counts give: a table that is broken is the cause, if there is one.
fn wrong_size(entry: &Entry, pixels: u32, bytes: &[u8]) -> Error {
    let mut tables = [vec![0; pixels as usize + 1], Vec::new()];
    if entry.coloured {
        tables[1] = tables[0].clone();
    }
    let mut rest = bytes;
    for table in &mut tables {
        let Some((head, tail)) = rest.split_at_checked(4 * table.len()) else {
            break;
        };
        LE::read_u32_into(head, table);
        rest = tail;
    }
    let size = Error::corrupt(
        "TILE-SIZE",
        "the decoded tile has another size than its counts say",
    );
    check_tables(entry, &tables[0], &tables[1])
        .err()
        .unwrap_or(size)
}

/// The tables of pixels and of coloured pixels, before anything is looked up through them.
fn check_tables(entry: &Entry, vertex: &[u32], colour: &[u32]) -> Result<()> {
    check_table(vertex, Some(entry.vertices), "TILE-TABLE")?;
    if !entry.coloured {
        return Ok(());
    }
    check_table(colour, None, "TILE-COLOUR")?;
    for (i, (v, c)) in vertex.windows(2).zip(colour.windows(2)).enumerate() {
        let grown = c[1] - c[0];
        if grown != 0 && grown != v[1] - v[0] {
            let place = Place {
                sample: Some(i),
                ..Place::default()
            };
            return Err(Error::corrupt("TILE-COLOUR", "a pixel is coloured in part").at(place));
        }
    }
    Ok(())
}

/// What the entry says of sizes, against `limit` and against itself, before anything is allocated.
fn check_sizes(entry: &Entry, pixels: u32, limit: u64) -> Result<()> {
    let (p, n, decoded) = (
        u64::from(pixels),
        u64::from(entry.vertices),
        u64::from(entry.decoded_size),
    );
    let size = |coloured: Option<u64>| {
        let counts = Counts {
            pixels: pixels as usize,
            vertices: entry.vertices as usize,
            coloured: coloured.map(|m| m as usize),
            lattice: entry.lattice,
        };
        counts.bytes()
    };
    // What the decoded planes take, and what they are made from.
    let most = size(entry.coloured.then_some(n));
    if most.max(decoded) > limit {
        return Err(Error::limit(format!(
            "a tile of up to {} bytes, over the limit of {limit}",
            most.max(decoded)
        )));
    }
    // An honest size lies between that of no colour and that of colour everywhere: a forged one is refused unread.
    let (rule, (least, most)) = match entry.transform {
        transform::NONE => ("TILE-SIZE", (size(entry.coloured.then_some(0)), most)),
        transform::DELTA_PLANES => (
            "TILE-STREAM",
            transform::size_range(p, n, entry.coloured, entry.lattice),
        ),
        id => return Err(Error::unsupported(format!("transform {id}"))),
    };
    if !(least..=most).contains(&decoded) {
        return Err(Error::corrupt(
            rule,
            format!("{decoded} bytes for {p} pixels and {n} vertices"),
        ));
    }
    Ok(())
}

/// Starts at 0, never falls, ends at `total`.
fn check_table(table: &[u32], total: Option<u32>, rule: &'static str) -> Result<()> {
    let last = table[table.len() - 1];
    let falls = table
        .iter()
        .zip(&table[1..])
        .map(|(a, b)| u32::from(a > b))
        .fold(0, |any, fall| any | fall);
    if table[0] != 0 || falls != 0 || total.is_some_and(|n| n != last) {
        return Err(Error::corrupt(
            rule,
            format!("the table goes from {} to {last}, or falls", table[0]),
        ));
    }
    Ok(())
}

const _: () = assert!(ALIGN == 8, "buffers are words");
