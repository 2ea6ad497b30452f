//! Files that every reader must refuse: valid files of which one thing was changed.
//!
//! All other fields are exact, CRCs, sums and ranges included, so that a file breaks no rule but
//! the one in its name. `spec/vectors/README.md` lists the exceptions; `spec/check.py` checks that
//! it lists all of them.

mod codecs;
mod directory;
mod file;
mod footer;
mod laws;
mod tiles;

pub use codecs::zstd_frame;

use super::*;
use crate::resign::{block_references, resign};

/// Names and bytes of all invalid files; a name begins with the broken rule or `unsupported`.
pub fn all() -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    let mut add = |name: &str, bytes: Vec<u8>| out.push((name.to_owned(), bytes));
    file::add(&mut add);
    footer::add(&mut add);
    directory::add(&mut add);
    tiles::add(&mut add);
    codecs::add(&mut add);
    laws::add(&mut add);
    out
}

/// Takes the name and the bytes of a file.
type Add<'a> = dyn FnMut(&str, Vec<u8>) + 'a;

/// A file whose bytes are being changed.
#[derive(Clone)]
struct Patch(Vec<u8>);

impl Patch {
    fn u64_at(&self, at: usize) -> usize {
        u64::from_le_bytes(self.0[at..at + 8].try_into().unwrap()) as usize
    }

    fn trailer(&self) -> usize {
        self.0.len() - 64
    }

    fn footer(&self) -> usize {
        self.u64_at(self.trailer() + 16)
    }

    fn directory(&self) -> usize {
        self.u64_at(self.trailer() + 8)
    }

    /// The offset of the first map's record, after its name.
    fn map(&self) -> usize {
        let name = self.footer() + 32;
        name + 2 + usize::from(u16::from_le_bytes([self.0[name], self.0[name + 1]]))
    }

    /// The offset of a block reference.
    fn block(&self, i: usize) -> usize {
        let f = self.footer();
        f + block_references(&self.0[f..self.trailer()])[i]
    }

    fn entry(&self, i: usize) -> usize {
        self.directory() + 48 * i
    }

    /// The offset of the last occurrence of `bytes`.
    fn find(&self, bytes: &[u8]) -> usize {
        let mut windows = self.0.windows(bytes.len());
        windows.rposition(|w| w == bytes).expect("these bytes")
    }

    fn put(mut self, at: usize, bytes: &[u8]) -> Self {
        self.0[at..at + bytes.len()].copy_from_slice(bytes);
        self
    }

    /// Changes bytes at an offset that depends on the file.
    fn at(self, at: impl Fn(&Self) -> usize, bytes: &[u8]) -> Self {
        let at = at(&self);
        self.put(at, bytes)
    }

    /// Adds to a `u64` of the file.
    fn plus(self, at: usize, more: i64) -> Self {
        let value = (self.u64_at(at) as i64 + more) as u64;
        self.put(at, &value.to_le_bytes())
    }

    /// Inserts bytes at the start of the footer, or after the footer.
    fn insert(mut self, at: usize, bytes: &[u8]) -> Self {
        let more = bytes.len() as i64;
        if at == self.footer() {
            let trailer = self.trailer();
            self = self.plus(trailer + 16, more);
        }
        let trailer = self.trailer();
        self = self.plus(trailer, more);
        self.0.splice(at..at, bytes.iter().copied());
        self
    }

    /// Replaces the whole directory.
    fn blocks(mut self, bytes: &[u8]) -> Self {
        let (from, to, trailer) = (self.directory(), self.footer(), self.trailer());
        let more = bytes.len() as i64 - (to - from) as i64;
        self = self.plus(trailer, more).plus(trailer + 16, more);
        self.0.splice(from..to, bytes.iter().copied());
        self
    }

    /// Replaces the only directory block by one with these stored bytes.
    fn block_of(self, codec: u8, frame: &[u8], padding: &[u8]) -> Self {
        let stored = [frame, padding].concat();
        let p = self.blocks(&stored);
        let b = p.block(0);
        p.put(b + 8, &(stored.len() as u32).to_le_bytes())
            .put(b + 16, &[codec, padding.len() as u8])
    }

    /// Changes the footer, whose length may change, and updates the trailer.
    fn records(mut self, change: impl Fn(&mut Vec<u8>)) -> Self {
        let (start, trailer) = (self.footer(), self.trailer());
        let mut footer = self.0[start..trailer].to_vec();
        change(&mut footer);
        let more = footer.len() as i64 - (trailer - start) as i64;
        self = self.plus(trailer, more).plus(trailer + 24, more);
        self.0.splice(start..trailer, footer);
        self
    }

    /// The bytes of the file with correct CRCs.
    fn signed(mut self) -> Vec<u8> {
        resign(&mut self.0);
        self.0
    }

    /// Makes the CRC of a block correct, but not those of its tiles.
    fn sign_block(self) -> Self {
        let (from, to, b) = (self.directory(), self.footer(), self.block(0));
        let crc = crc32fast::hash(&self.0[from..to]).to_le_bytes();
        self.put(b + 12, &crc)
    }

    /// The bytes of the file, of which only the CRCs of footer and trailer were corrected.
    fn sign_footer(self) -> Vec<u8> {
        let (from, to) = (self.footer(), self.trailer());
        let crc = crc32fast::hash(&self.0[from..to]).to_le_bytes();
        self.put(to + 32, &crc).sign_trailer()
    }

    /// The bytes of the file, of which only the CRC of the trailer was corrected.
    fn sign_trailer(self) -> Vec<u8> {
        let trailer = self.trailer();
        let crc = crc32fast::hash(&self.0[trailer..trailer + 60]).to_le_bytes();
        self.put(trailer + 60, &crc).0
    }
}

const LATTICE: Precision = Precision::Lattice(64);

/// A file of one map with one level; `f` yields the function of each pixel.
fn one(h: MapHeader, f: impl Fn(u32, u32) -> Visibility) -> Patch {
    let tiles = tiles_of(LevelShape::of(&h, 0), LATTICE, (Codec::None, 0), f);
    file_of(h, tiles)
}

fn file_of(h: MapHeader, tiles: Vec<RawTile>) -> Patch {
    levels_of(h, [tiles])
}

fn levels_of(h: MapHeader, levels: impl IntoIterator<Item = Vec<RawTile>>) -> Patch {
    let level = |tiles| RawLevel {
        max_error: 0.25,
        tiles,
        directory: Codec::None,
    };
    let levels = levels.into_iter().map(level).collect();
    Patch(RawFile::of(h, levels).assemble())
}

/// A map of 3 x 2 pixels and one data tile, whose payload is plain.
fn small() -> Patch {
    one(header("map", 3, 2, 1), valid::mixed_mono)
}

/// A map of one lit pixel.
fn lit() -> Patch {
    one(header("map", 1, 1, 1), |_, _| Visibility::lit())
}

/// A map of three tiles: an empty one, a constant one and one with data.
fn kinds() -> Patch {
    one(header("map", 24, 8, 1), |x, y| match x / 8 {
        0 => Visibility::lit(),
        1 => mono(&[(7.5, 0.5)]),
        _ => valid::mixed_mono(x, y),
    })
}

/// A file without tiles and directory whose footer is this one.
fn bare(mut footer: Vec<u8>) -> Patch {
    footer.resize(footer.len().next_multiple_of(8), 0);
    let trailer = Trailer {
        file_length: 128 + footer.len() as u64,
        directory_offset: 64,
        footer_offset: 64,
        footer_size: footer.len() as u64,
        footer_crc: 0,
    };
    Patch([&encode_header()[..], &footer, &trailer.encode()].concat())
}

/// An entry of kind data with these ranges.
fn data(vertices: u32, lattice: u16, depths: [f32; 2], ends: [f32; 2]) -> Entry {
    Entry {
        kind: TileKind::Data,
        vertices,
        depths,
        ends,
        lattice,
        ..Entry::default()
    }
}

/// A file of one tile with these stored bytes, which are padded.
fn coded(
    extent: (u32, u32),
    entry: Entry,
    (codec, transform): (u8, u8),
    decoded: usize,
    bytes: Vec<u8>,
) -> Patch {
    let tile = stored(entry, codec, transform, decoded, bytes);
    file_of(header("map", extent.0, extent.1, 3), vec![tile])
}

/// A file of one tile with these decoded bytes, codec none and transform 0.
fn plain(extent: (u32, u32), entry: Entry, mut bytes: Vec<u8>) -> Patch {
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    coded(extent, entry, (0, 0), bytes.len(), bytes)
}

fn put_u32(out: &mut Vec<u8>, values: &[u32]) {
    values
        .iter()
        .for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
}

fn put_u16(out: &mut Vec<u8>, values: &[u16]) {
    values
        .iter()
        .for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
}

/// Delta planes of one monochrome pixel: vertex count, steps, first depth, gaps and drops.
fn planes(count: u32, steps: &[u8], first: u32, gaps: &[u32], drops: &[u16]) -> Vec<u8> {
    let mut bytes = count.to_le_bytes().to_vec();
    bytes.extend_from_slice(steps);
    bytes.extend_from_slice(&first.to_le_bytes());
    (0..4).for_each(|p| bytes.extend(gaps.iter().map(|g| g.to_le_bytes()[p])));
    (0..2).for_each(|p| bytes.extend(drops.iter().map(|d| d.to_le_bytes()[p])));
    bytes
}

/// The first depth 1.0 in delta planes: the zigzag of its ordered integer less the prediction.
const ONE: u32 = 0x3F80_0000 << 1;

/// Lawful delta planes of one pixel on the lattice 64, and their entry: (1, 64/64), and a step from
/// 48/64 to 32/64 one float behind it.
fn good() -> (Entry, Vec<u8>) {
    let entry = data(3, 64, [1.0, 1f32.next_up()], [0.5; 2]);
    (entry, planes(3, &[2], ONE, &[1], &[0, 16, 16]))
}

/// A file of one pixel with these delta planes.
fn delta(entry: Entry, bytes: Vec<u8>) -> Vec<u8> {
    coded((1, 1), entry, (0, 1), bytes.len(), bytes).signed()
}

/// Appends an attribute of the file to the footer of [`small`] and restores the padding.
fn attribute(footer: &mut Vec<u8>, name: &str, kind: u8, length: u32, value: &[u8]) {
    footer.truncate(footer.len() - 7); // its padding
    footer[24] += 1;
    footer.extend((name.len() as u16).to_le_bytes());
    footer.extend(name.as_bytes());
    footer.push(kind);
    footer.extend(length.to_le_bytes());
    footer.extend(value);
    footer.resize(footer.len().next_multiple_of(8), 0);
}
