//! A decoded tile: the functions of its pixels, as lookups use them.

use byteorder::{ByteOrder, LittleEndian as LE};

use super::directory::{Entry, TileKind, pad, unpad};
use super::layout::{ALIGN, MAX_DECODED};
use super::{Codec, codec, laws, transform};
use crate::function::compress::Precision;
use crate::function::{Broken, Visibility};
use crate::{Error, Place, Result};

/// The visibility functions of one tile, in the types that the file stores.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tile {
    /// Pixels in a row.
    pub(super) width: u32,
    /// L of visibilities k / L, 0 for f32.
    pub(super) lattice: u16,
    /// First vertex of each pixel, and the number of vertices.
    pub(super) vertex: Vec<u32>,
    /// In coloured tiles, the same for vertices of coloured pixels; else empty.
    pub(super) colour: Vec<u32>,
    /// Depths.
    pub(super) z: Vec<f32>,
    /// Visibilities: first channel of all vertices, then the second and the third of coloured ones.
    pub(super) v: Values,
}

/// Visibilities as stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Values {
    /// k of k / L.
    Lattice(Vec<u16>),
    /// f32.
    F32(Vec<f32>),
}

impl Default for Values {
    fn default() -> Self {
        Values::F32(Vec::new())
    }
}

impl Values {
    pub(super) fn len(&self) -> usize {
        match self {
            Values::Lattice(k) => k.len(),
            Values::F32(v) => v.len(),
        }
    }
}

/// The f32 nearest to k / L.
#[inline]
pub(crate) fn lattice_value(k: u16, lattice: u16) -> f32 {
    f32::from(k) / f32::from(lattice)
}

/// The k with `lattice_value(k, lattice) == v`, if there is one.
#[inline]
pub(crate) fn lattice_index(v: f32, lattice: u16) -> Option<u16> {
    let k = (f64::from(v) * f64::from(lattice)).round() as u16;
    (lattice_value(k, lattice) == v).then_some(k)
}

impl Tile {
    /// A tile of `width` x `height` pixels that are all lit.
    ///
    /// # Panics
    /// If a side is zero.
    pub fn lit(width: u32, height: u32) -> Tile {
        assert!(width > 0 && height > 0, "a tile has pixels");
        Tile {
            width,
            vertex: vec![0; (width * height) as usize + 1],
            ..Tile::default()
        }
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.vertex.len() - 1
    }

    /// Number of vertices of all pixels.
    pub fn vertices(&self) -> usize {
        self.z.len()
    }

    /// Whether some pixels have three channels.
    pub fn is_coloured(&self) -> bool {
        !self.colour.is_empty()
    }

    /// How visibilities are stored.
    pub fn precision(&self) -> Precision {
        match self.lattice {
            0 => Precision::F32,
            lattice => Precision::Lattice(lattice),
        }
    }

    /// Bytes that the tile takes in memory, by capacity.
    pub fn bytes(&self) -> usize {
        let values = match &self.v {
            Values::Lattice(k) => 2 * k.capacity(),
            Values::F32(v) => 4 * v.capacity(),
        };
        4 * (self.vertex.capacity() + self.colour.capacity() + self.z.capacity()) + values
    }

    /// Number of vertices of pixel `i`, counted row by row.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn vertex_count(&self, i: usize) -> usize {
        (self.vertex[i + 1] - self.vertex[i]) as usize
    }

    /// The function of pixel `i`, counted row by row.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn function(&self, i: usize) -> Visibility {
        let mut out = Visibility::lit();
        self.read_function(i, &mut out);
        out
    }

    /// The function of pixel `i`, into memory that is used again.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn read_function(&self, i: usize, out: &mut Visibility) {
        let channels = self.channels(i);
        out.reset(channels);
        let range = self.vertex[i] as usize..self.vertex[i + 1] as usize;
        for (j, at) in range.enumerate() {
            let mut v = [0.0; 3];
            for (c, v) in v[..channels].iter_mut().enumerate() {
                *v = self.value(self.index(i, j, c));
            }
            out.push_unchecked(self.z[at], &v[..channels]);
        }
    }

    /// Channels of pixel `i`.
    pub(super) fn channels(&self, i: usize) -> usize {
        if self.is_coloured() && self.colour[i + 1] > self.colour[i] {
            3
        } else {
            1
        }
    }

    /// Where channel `c` of vertex `j` of pixel `i` stands among the visibilities.
    pub(super) fn index(&self, i: usize, j: usize, c: usize) -> usize {
        let coloured = self.colour.last().map_or(0, |&m| m as usize);
        match c {
            0 => self.vertex[i] as usize + j,
            c => self.z.len() + (c - 1) * coloured + self.colour[i] as usize + j,
        }
    }

    fn value(&self, at: usize) -> f32 {
        match &self.v {
            Values::Lattice(k) => lattice_value(k[at], self.lattice),
            Values::F32(v) => v[at],
        }
    }

    /// Least and greatest depth of a vertex; zeros if there is none.
    pub fn depth_range(&self) -> [f32; 2] {
        // Depths are sorted in each pixel.
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for ends in self.vertex.windows(2).filter(|w| w[0] < w[1]) {
            let (first, last) = (self.z[ends[0] as usize], self.z[ends[1] as usize - 1]);
            range = [range[0].min(first), range[1].max(last)];
        }
        if range[0] > range[1] {
            [0.0; 2]
        } else {
            range.map(|z| z + 0.0)
        }
    }

    /// Least and greatest visibility behind everything, of all pixels and channels.
    pub fn end_range(&self) -> [f32; 2] {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        let mut take = |v: f32| range = [range[0].min(v), range[1].max(v)];
        for i in 0..self.pixels() {
            match self.vertex_count(i) {
                0 => take(1.0),
                n if !self.is_coloured() => take(self.value(self.vertex[i] as usize + n - 1)),
                n => (0..self.channels(i)).for_each(|c| take(self.value(self.index(i, n - 1, c)))),
            }
        }
        range
    }

    /// The vertex that all pixels have alone and in common, if they do: depth and visibility.
    fn constant(&self) -> Option<(f32, f32)> {
        let one_each =
            self.z.len() == self.pixels() && self.vertex.windows(2).all(|w| w[1] - w[0] == 1);
        if !one_each || self.is_coloured() {
            return None;
        }
        let (z, v) = (self.z[0], self.value(0));
        let same =
            (1..self.pixels()).all(|i| self.z[i].to_bits() == z.to_bits() && self.value(i) == v);
        same.then_some((z, v))
    }

    /// Bytes of the decoded tile of section 7 with these counts.
    pub(super) fn decoded_size(
        pixels: u64,
        vertices: u64,
        coloured: Option<u64>,
        lattice: u16,
    ) -> u64 {
        let w = if lattice == 0 { 4 } else { 2 };
        let tables = 4 * (pixels + 1) * if coloured.is_some() { 2 } else { 1 };
        (tables + 4 * vertices + w * (vertices + 2 * coloured.unwrap_or(0)))
            .next_multiple_of(ALIGN as u64)
    }

    /// The directory entry of this tile, without offset, and its payload, empty unless the entry is of kind data.
    ///
    /// # Errors
    /// `Limit` for a tile of more than 2^31 bytes.
    pub fn encode(&self, codec: Codec) -> Result<(Entry, Vec<u8>)> {
        if self.z.is_empty() {
            return Ok((Entry::default(), Vec::new()));
        }
        if let Some((z, v)) = self.constant() {
            return Ok((Entry::constant(self.pixels() as u32, z, v), Vec::new()));
        }
        let coloured = self.colour.last().map(|&m| u64::from(m));
        let size = Tile::decoded_size(
            self.pixels() as u64,
            self.z.len() as u64,
            coloured,
            self.lattice,
        );
        if size + 4 * self.pixels() as u64 > u64::from(MAX_DECODED) {
            return Err(Error::limit(format!(
                "a tile of {size} bytes; use smaller tiles"
            )));
        }
        let plain = codec == Codec::None;
        let decoded = if plain {
            self.to_bytes(size as usize)
        } else {
            transform::encode(self)
        };
        let mut stored = Vec::new();
        codec.encode(&decoded, &mut stored)?;
        let padding = pad(&mut stored);
        let entry = Entry {
            kind: TileKind::Data,
            offset: 0,
            stored_size: u32::try_from(stored.len())
                .map_err(|_| Error::limit("a tile of more than 4 GiB"))?,
            decoded_size: decoded.len() as u32,
            vertices: self.z.len() as u32,
            crc: crc32fast::hash(&stored),
            depths: self.depth_range(),
            ends: self.end_range(),
            codec: codec.id(),
            transform: if plain {
                transform::NONE
            } else {
                transform::DELTA_PLANES
            },
            padding,
            lattice: self.lattice,
            coloured: self.is_coloured(),
        };
        Ok((entry, stored))
    }

    fn to_bytes(&self, size: usize) -> Vec<u8> {
        let mut out = vec![0; size];
        let mut rest = &mut out[..];
        let mut part = |n: usize| {
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(n);
            rest = tail;
            head
        };
        LE::write_u32_into(&self.vertex, part(4 * self.vertex.len()));
        LE::write_u32_into(&self.colour, part(4 * self.colour.len()));
        LE::write_f32_into(&self.z, part(4 * self.z.len()));
        match &self.v {
            Values::Lattice(k) => LE::write_u16_into(k, part(2 * k.len())),
            Values::F32(v) => LE::write_f32_into(v, part(4 * v.len())),
        }
        out
    }

    /// The tile of `extent` (width, height) pixels that `entry` describes, from its stored bytes, every rule checked.
    /// `limit` is the largest number of bytes that it may decode to.
    ///
    /// # Errors
    /// `Corrupt` by the rules of sections 6 to 9 and the laws, `Unsupported`, `Limit`.
    pub fn decode(entry: &Entry, stored: &[u8], extent: (u32, u32), limit: u64) -> Result<Tile> {
        match entry.kind {
            TileKind::Empty => return Ok(Tile::lit(extent.0, extent.1)),
            TileKind::Constant => return Ok(Tile::constant_of(entry, extent)),
            TileKind::Data => {}
        }
        if stored.len() != entry.stored_size as usize || crc32fast::hash(stored) != entry.crc {
            return Err(Error::corrupt(
                "TILE-CRC",
                "the bytes of the tile are damaged",
            ));
        }
        Self::decode_checked(entry, stored, extent, limit)
    }

    fn constant_of(entry: &Entry, (width, height): (u32, u32)) -> Tile {
        let pixels = width * height;
        let n = pixels as usize;
        Tile {
            width,
            vertex: (0..=pixels).collect(),
            z: vec![entry.depths[0]; n],
            v: Values::F32(vec![entry.ends[0]; n]),
            ..Tile::default()
        }
    }

    /// [`Tile::decode`] of stored bytes whose CRC has been seen to.
    pub(crate) fn decode_checked(
        entry: &Entry,
        stored: &[u8],
        extent: (u32, u32),
        limit: u64,
    ) -> Result<Tile> {
        let pixels = extent.0 * extent.1;
        let frame = unpad(stored, entry.padding)
            .ok_or_else(|| Error::corrupt("TILE-PADDING", "padding that is not zero"))?;
        let (p, n, decoded) = (
            u64::from(pixels),
            u64::from(entry.vertices),
            u64::from(entry.decoded_size),
        );
        // What the decoded planes take, and what they are made from.
        let most = Tile::decoded_size(p, n, entry.coloured.then_some(n), entry.lattice);
        if most.max(decoded) > limit {
            return Err(Error::limit(format!(
                "a tile of up to {} bytes, over the limit of {limit}",
                most.max(decoded)
            )));
        }
        // An honest size lies between that of no colour and that of colour everywhere: a forged one is refused unread.
        let (rule, (least, most)) = match entry.transform {
            transform::NONE => {
                let least = Tile::decoded_size(p, n, entry.coloured.then_some(0), entry.lattice);
                ("TILE-SIZE", (least, most))
            }
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
        let owned;
        let bytes = if entry.codec == codec::NONE {
            frame
        } else {
            owned = codec::decode(entry.codec, frame, decoded as usize)
                .map_err(|e| e.breaks("TILE-CODEC"))?;
            &owned
        };
        let tile = match entry.transform {
            transform::NONE => Tile::from_bytes(bytes, extent.0, pixels, entry)?,
            _ => transform::decode(bytes, extent.0, pixels, entry)?,
        };
        tile.check(entry)?;
        Ok(tile)
    }

    fn from_bytes(bytes: &[u8], width: u32, pixels: u32, entry: &Entry) -> Result<Tile> {
        let wrong_size = || {
            Error::corrupt(
                "TILE-SIZE",
                "the decoded tile has another size than its counts say",
            )
        };
        let mut rest = bytes;
        let mut part = |n: usize| -> Result<&[u8]> {
            let (head, tail) = rest.split_at_checked(n).ok_or_else(wrong_size)?;
            rest = tail;
            Ok(head)
        };
        let n = entry.vertices as usize;
        let table_bytes = 4 * (pixels as usize + 1);
        let mut vertex = vec![0; pixels as usize + 1];
        LE::read_u32_into(part(table_bytes)?, &mut vertex);
        check_table(&vertex, Some(entry.vertices), "TILE-TABLE")?;
        let mut colour = Vec::new();
        if entry.coloured {
            colour.resize(pixels as usize + 1, 0);
            LE::read_u32_into(part(table_bytes)?, &mut colour);
            check_table(&colour, None, "TILE-COLOUR")?;
            for (i, (v, c)) in vertex.windows(2).zip(colour.windows(2)).enumerate() {
                let grown = c[1] - c[0];
                if grown != 0 && grown != v[1] - v[0] {
                    let place = Place {
                        sample: Some(i),
                        ..Place::default()
                    };
                    return Err(
                        Error::corrupt("TILE-COLOUR", "a pixel is coloured in part").at(place)
                    );
                }
            }
        }
        let m = colour.last().map_or(0, |&m| m as usize);
        let mut z = vec![0.0; n];
        LE::read_f32_into(part(4 * n)?, &mut z);
        let v = if entry.lattice != 0 {
            let mut k = vec![0; n + 2 * m];
            LE::read_u16_into(part(2 * k.len())?, &mut k);
            Values::Lattice(k)
        } else {
            let mut v = vec![0.0; n + 2 * m];
            LE::read_f32_into(part(4 * v.len())?, &mut v);
            Values::F32(v)
        };
        if rest.len() >= ALIGN || !bytes.len().is_multiple_of(ALIGN) {
            return Err(wrong_size());
        }
        if rest.iter().any(|&b| b != 0) {
            return Err(Error::corrupt("TILE-PADDING", "padding that is not zero"));
        }
        Ok(Tile {
            width,
            lattice: entry.lattice,
            vertex,
            colour,
            z,
            v,
        })
    }

    /// The laws of the vertices, and what the entry says of them.
    fn check(&self, entry: &Entry) -> Result<()> {
        laws::check(self)?;
        if entry.coloured && *self.colour.last().unwrap_or(&0) == 0 {
            return Err(Error::corrupt(
                "TILE-FLAGS",
                "no pixel of a coloured tile is coloured",
            ));
        }
        let bits = |range: [f32; 2]| range.map(f32::to_bits);
        if bits(self.depth_range()) != bits(entry.depths) {
            let what = format!(
                "depths {:?} where the directory says {:?}",
                self.depth_range(),
                entry.depths
            );
            return Err(Error::corrupt("TILE-DEPTHS", what));
        }
        if bits(self.end_range()) != bits(entry.ends) {
            let what = format!(
                "ends {:?} where the directory says {:?}",
                self.end_range(),
                entry.ends
            );
            return Err(Error::corrupt("TILE-ENDS", what));
        }
        Ok(())
    }

    /// The first law that a pixel breaks, by the slow way that knows its place.
    pub(super) fn first_broken(&self) -> Option<(usize, Broken)> {
        let mut f = Visibility::lit();
        (0..self.pixels()).find_map(|i| {
            self.read_function(i, &mut f);
            laws::canonical(f.channels(), f.depths(), f.values())
                .err()
                .map(|broken| (i, broken))
        })
    }
}

/// Starts at 0, never falls, ends at `total`.
fn check_table(table: &[u32], total: Option<u32>, rule: &'static str) -> Result<()> {
    let last = table[table.len() - 1];
    if table[0] != 0 || table.windows(2).any(|w| w[0] > w[1]) || total.is_some_and(|n| n != last) {
        return Err(Error::corrupt(
            rule,
            format!("the table goes from {} to {last}, or falls", table[0]),
        ));
    }
    Ok(())
}
