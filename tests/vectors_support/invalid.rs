//! Files that every reader must refuse: valid files with changed bytes and correct CRCs.

use super::*;
use crate::resign::{block_references, resign};

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

    fn put(mut self, at: usize, bytes: &[u8]) -> Self {
        self.0[at..at + bytes.len()].copy_from_slice(bytes);
        self
    }

    /// Changes bytes at an offset that depends on the file.
    fn at(self, at: impl Fn(&Self) -> usize, bytes: &[u8]) -> Self {
        let at = at(&self);
        self.put(at, bytes)
    }

    /// Replaces `size` bytes of the directory or the footer with `new`, and updates the trailer.
    fn splice(mut self, at: usize, size: usize, new: &[u8]) -> Self {
        let (directory, footer, trailer) = (self.directory(), self.footer(), self.trailer());
        let grown = |v: usize| ((v + new.len() - size) as u64).to_le_bytes();
        let (length, footer_size) = (grown(self.0.len()), trailer - footer);
        if at <= directory {
            self = self.put(trailer + 8, &grown(directory));
        }
        if at <= footer && size == 0 && at != footer + 1 && at < footer + 1 && !new.is_empty() {
            self = self.put(trailer + 16, &grown(footer));
        } else {
            self = self.put(trailer + 24, &grown(footer_size));
        }
        self = self.put(trailer, &length);
        self.0.splice(at..at + size, new.iter().copied());
        self
    }

    /// Changes the footer, whose length may change, and updates the trailer.
    fn records(mut self, change: impl Fn(&mut Vec<u8>)) -> Self {
        let (start, trailer) = (self.footer(), self.trailer());
        let mut footer = self.0[start..trailer].to_vec();
        change(&mut footer);
        let size = footer.len() as u64;
        let mut tail = self.0[trailer..].to_vec();
        tail[..8].copy_from_slice(&(start as u64 + size + 64).to_le_bytes());
        tail[24..32].copy_from_slice(&size.to_le_bytes());
        self.0.truncate(start);
        self.0.extend(footer);
        self.0.extend(tail);
        self
    }

    /// The bytes of the file with correct CRCs.
    fn signed(mut self) -> Vec<u8> {
        resign(&mut self.0);
        self.0
    }
}

const LATTICE: Precision = Precision::Lattice(64);

/// A file of one map with one level; `f` yields the function of each pixel.
fn one(h: MapHeader, how: (Codec, u8), f: impl Fn(u32, u32) -> Visibility) -> Patch {
    let tiles = tiles_of(LevelShape::of(&h, 0), LATTICE, how, f);
    file_of(h, tiles)
}

fn file_of(h: MapHeader, tiles: Vec<RawTile>) -> Patch {
    let level = RawLevel {
        max_error: 0.25,
        tiles,
        directory: Codec::None,
    };
    Patch(RawFile::of(h, vec![level]).assemble())
}

/// A file of one pixel with these vertices: (depth, visibility) as f32 bits.
///
/// Its entry is consistent, so that readers decode the tile.
fn pixel_f32(vertices: &[(u32, u32)]) -> Patch {
    let mut bytes = Vec::new();
    put_u32(&mut bytes, &[0, vertices.len() as u32]);
    vertices.iter().for_each(|v| put_u32(&mut bytes, &[v.0]));
    vertices.iter().for_each(|v| put_u32(&mut bytes, &[v.1]));
    data_tile(1, 1, vertices.len(), 0, false, bytes)
}

fn put_u32(out: &mut Vec<u8>, values: &[u32]) {
    values
        .iter()
        .for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
}

/// A file of one tile with these decoded bytes, codec none and transform 0.
fn data_tile(
    w: u32,
    h: u32,
    vertices: usize,
    lattice: u16,
    coloured: bool,
    mut bytes: Vec<u8>,
) -> Patch {
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    raw_tile(
        w,
        h,
        vertices,
        lattice,
        coloured,
        (0, 0),
        bytes.len(),
        bytes,
    )
}

/// A file of one tile with these stored bytes.
#[allow(clippy::too_many_arguments, reason = "an entry has that many fields")]
fn raw_tile(
    w: u32,
    h: u32,
    vertices: usize,
    lattice: u16,
    coloured: bool,
    (codec, transform): (u8, u8),
    decoded: usize,
    bytes: Vec<u8>,
) -> Patch {
    let entry = Entry {
        kind: TileKind::Data,
        vertices: vertices as u32,
        depths: [1.0; 2],
        ends: [0.5; 2],
        lattice,
        coloured,
        ..Entry::default()
    };
    file_of(
        header("map", w, h, 3),
        vec![stored(entry, codec, transform, decoded, bytes)],
    )
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

/// A file of one pixel with these delta planes on the lattice 64.
fn delta(vertices: usize, bytes: Vec<u8>) -> Vec<u8> {
    raw_tile(1, 1, vertices, 64, false, (0, 1), bytes.len(), bytes).signed()
}

/// The first depth 1.0 in delta planes: the zigzag of its ordered integer less the prediction.
const ONE: u32 = 0x3F80_0000 << 1;

/// Names and bytes of all invalid files; a name begins with the broken rule or `unsupported`.
pub fn all() -> Vec<(String, Vec<u8>)> {
    let mut out: Vec<(String, Vec<u8>)> = Vec::new();
    let mut add = |name: &str, bytes: Vec<u8>| out.push((name.into(), bytes));
    let kinds = one(header("map", 24, 8, 1), (Codec::None, 0), |x, y| {
        match x / 8 {
            0 => Visibility::lit(),
            1 => mono(&[(7.5, 0.5)]),
            _ => valid::mixed_mono(x, y),
        }
    });
    let small = one(header("map", 3, 2, 1), (Codec::None, 0), valid::mixed_mono);
    let lz4 = one(header("map", 8, 8, 1), (Codec::Lz4, 1), valid::mixed_mono);
    let coloured = one(header("map", 3, 2, 3), (Codec::None, 0), valid::mixed_rgb);

    // Header.
    add("HEADER-MAGIC", small.clone().put(0, &[0x09]).signed());
    add("HEADER-MAGIC-line-ends", {
        let mut bytes = small.0.clone();
        bytes.remove(4);
        bytes
    });
    add("HEADER-SIZE", small.clone().put(10, &[128]).signed());
    add("HEADER-RESERVED", small.clone().put(59, &[1]).signed());
    add("HEADER-CRC", small.clone().put(30, &[1]).0);
    add("unsupported-version", small.clone().put(8, &[2]).signed());
    add(
        "unsupported-version-damaged",
        small.clone().put(8, &[2, 0, 77]).0,
    );

    // Trailer.
    add("FILE-SHORT", small.0[..100].to_vec());
    add("FILE-SHORT-empty", Vec::new());
    let t = small.trailer();
    add(
        "FILE-LENGTH",
        small.clone().put(t, &[small.0.len() as u8 ^ 8]).signed(),
    );
    add("FILE-LENGTH-longer", {
        let mut bytes = small.0.clone();
        bytes.splice(t..t, [0; 8]);
        bytes
    });
    add("DIRECTORY-RANGE", small.clone().put(t + 8, &[56]).signed());
    add(
        "DIRECTORY-RANGE-unaligned",
        small.clone().put(t + 8, &[65]).signed(),
    );
    add(
        "DIRECTORY-RANGE-behind-footer",
        small
            .clone()
            .put(t + 8, &(small.footer() as u64 + 8).to_le_bytes())
            .signed(),
    );
    add(
        "FOOTER-RANGE",
        small
            .clone()
            .put(t + 16, &(small.footer() as u64 + 8).to_le_bytes())
            .signed(),
    );
    add(
        "FOOTER-RANGE-huge",
        small
            .clone()
            .put(t + 24, &(u64::MAX - 7).to_le_bytes())
            .signed(),
    );
    add(
        "FOOTER-RANGE-overflow",
        small
            .clone()
            .put(t + 16, &(u64::MAX - 7).to_le_bytes())
            .signed(),
    );
    add(
        "FOOTER-RANGE-odd-size",
        small.clone().records(|f| f.truncate(f.len() - 4)).signed(),
    );
    add("FOOTER-RANGE-unaligned", {
        // The footer begins one byte later and is one byte shorter.
        let size = (t - small.footer()) as u64;
        let p = small
            .clone()
            .put(t + 16, &(small.footer() as u64 + 1).to_le_bytes());
        p.put(t + 24, &(size - 1).to_le_bytes()).signed()
    });
    add("FOOTER-CRC", {
        let mut bytes = small.clone().signed();
        bytes[t - 1] ^= 1;
        bytes
    });
    add("TRAILER-VERSION", small.clone().put(t + 36, &[2]).signed());
    add("TRAILER-RESERVED", small.clone().put(t + 51, &[1]).signed());
    add(
        "TRAILER-COMMIT",
        small.clone().put(t + 59, &[0x0D]).signed(),
    );
    add("TRAILER-COMMIT-cut-off", small.0[..t].to_vec());
    add(
        "TRAILER-CRC",
        small.clone().put(t + 60, &[small.0[t + 60] ^ 1]).0,
    );

    // Footer.
    let (f, m) = (small.footer(), small.map());
    let footer = |at: usize, bytes: &[u8]| small.clone().put(f + at, bytes).signed();
    let map = |at: usize, bytes: &[u8]| small.clone().put(m + at, bytes).signed();
    add("unsupported-feature", footer(0, &[1]));
    add("unsupported-feature-high", footer(7, &[0x80]));
    add("MAP-COUNT", footer(16, &[0]));
    add("MAP-COUNT-huge", footer(16, &[1, 0, 1]));
    add("GROUP-COUNT", footer(20, &[1, 0, 1]));
    add("ATTRIBUTE-COUNT", footer(24, &[1, 0, 1]));
    add("ATTRIBUTE-COUNT-of-map", map(48, &[255; 4]));
    add("FOOTER-RESERVED", footer(31, &[1]));
    add(
        "FOOTER-SHORT",
        small.clone().records(|f| f.truncate(f.len() - 24)).signed(),
    );
    add("FOOTER-SHORT-name", footer(32, &[200]));
    add(
        "FOOTER-SHORT-attribute",
        small
            .clone()
            .records(|f| attribute(f, "a", 0, u32::MAX, b""))
            .signed(),
    );
    add(
        "FOOTER-SHORT-directory",
        map(0, &[[0, 0, 16, 0], [0, 0, 16, 0]].concat()),
    );
    add(
        "FOOTER-SHORT-fixed-part",
        small.clone().records(|f| f.truncate(24)).signed(),
    );
    add("FOOTER-PADDING", small.clone().put(t - 1, &[1]).signed());
    add(
        "FOOTER-PADDING-too-long",
        small.clone().records(|f| f.extend([0; 8])).signed(),
    );

    // Map.
    add("MAP-NAME", footer(34, b"\n"));
    add("MAP-NAME-delete", footer(35, b"\x7f"));
    add("MAP-NAME-utf-8", footer(34, &[0xFF]));
    let renamed = |name: Vec<u8>| {
        let p = small.clone().records(|f| {
            let length = (name.len() as u16).to_le_bytes();
            f.truncate(f.len() - 7); // its padding
            f.splice(32..37, length.into_iter().chain(name.iter().copied()));
            f.resize(f.len().next_multiple_of(8), 0);
        });
        p.signed()
    };
    add("MAP-NAME-empty", renamed(vec![]));
    add("MAP-NAME-long", renamed(vec![b'n'; 256]));
    let mut two = RawFile::default();
    for name in ["aa", "ab"] {
        let h = header(name, 1, 1, 1);
        let level = RawLevel {
            max_error: 0.0,
            tiles: vec![(Entry::default(), vec![])],
            directory: Codec::None,
        };
        two.maps.push((h, vec![level]));
    }
    let group = |name: &str| Group::new(name, GroupRole::Faces, vec![MapId(0), MapId(1)]);
    two.groups = vec![group("ga"), group("gb")];
    two.attributes = vec![("ta".into(), "".into()), ("tb".into(), "".into())];
    let two = Patch(two.assemble());
    let find = |p: &Patch, text: &[u8]| p.0.windows(text.len()).rposition(|w| w == text).unwrap();
    let replace = |text: &[u8], at: usize, bytes: &[u8]| {
        two.clone().at(|p| find(p, text) + at, bytes).signed()
    };
    add("MAP-NAME-twice", replace(b"ab", 1, b"a"));
    add("MAP-SIZE", map(0, &[0]));
    add("MAP-SIZE-height", map(4, &[0]));
    add("MAP-SIZE-large", map(0, &((1u32 << 20) + 1).to_le_bytes()));
    add("MAP-CHANNELS", map(8, &[2]));
    add(
        "MAP-CHANNELS-coloured-tile",
        coloured.clone().at(|p| p.map() + 8, &[1]).signed(),
    );
    add("MAP-TILE", map(9, &[2]));
    add("MAP-TILE-large", map(9, &[9]));
    add("MAP-LEVELS", map(10, &[0]));
    add("MAP-LEVELS-many", map(10, &[4]));
    add("MAP-DEPTH", map(11, &[3]));
    add("MAP-INTERPRETATION", map(12, &[3]));
    add("MAP-CAMERA", map(13, &[4]));
    add("MAP-RESERVED", map(15, &[1]));
    for (name, unit) in [
        ("", -1.0),
        ("-infinite", f64::INFINITY),
        ("-nan", f64::NAN),
        ("-minus-zero", -0.0),
    ] {
        add(&format!("MAP-UNIT{name}"), map(16, &f64::to_le_bytes(unit)));
    }
    add("MAP-WINDOW", map(40, &(-1i32).to_le_bytes()));
    add("MAP-WINDOW-height", map(44, &(-1i32).to_le_bytes()));
    let mut seen = header("map", 3, 2, 1);
    seen.camera.ndc_from_world = Some([1.0; 16]);
    let seen = one(seen, (Codec::None, 0), valid::mixed_mono);
    add(
        "MAP-CAMERA-infinite",
        seen.clone()
            .at(|p| p.map() + 52 + 120, &f64::INFINITY.to_le_bytes())
            .signed(),
    );

    // Level and block.
    for (name, promise) in [
        ("", -0.5),
        ("-large", 1.5),
        ("-nan", f64::NAN),
        ("-minus-zero", -0.0),
    ] {
        add(
            &format!("LEVEL-ERROR{name}"),
            map(52, &f64::to_le_bytes(promise)),
        );
    }
    add("LEVEL-VERTICES", map(60, &[small.0[m + 60] + 1]));
    add("LEVEL-BYTES", map(68, &[small.0[m + 68] + 8]));
    let b = small.block(0);
    let block = |at: usize, bytes: &[u8]| small.clone().put(b + at, bytes).signed();
    let place = small.u64_at(b) as u64;
    add("BLOCK-RANGE", block(0, &(place + 8).to_le_bytes()));
    add("BLOCK-RANGE-in-tiles", block(0, &(place - 8).to_le_bytes()));
    add(
        "BLOCK-RANGE-unaligned",
        block(0, &(place + 1).to_le_bytes()),
    );
    add(
        "BLOCK-RANGE-overflow",
        block(0, &(u64::MAX - 7).to_le_bytes()),
    );
    add("BLOCK-RANGE-size", block(8, &[44]));
    add("BLOCK-RANGE-huge", block(8, &(u32::MAX - 7).to_le_bytes()));
    add("BLOCK-CRC", {
        let mut p = small.clone();
        p.0[small.directory() + 30] ^= 1;
        p.0
    });
    add("BLOCK-PADDING", block(17, &[8]));
    add("BLOCK-PADDING-not-zero", block(17, &[4])); // the last four bytes hold the lattice
    add("BLOCK-RESERVED", block(23, &[1]));
    for (name, codec, bytes) in [
        ("", 0u8, vec![0; 96]),
        ("-lz4", 1, vec![0xF0, 255, 255, 0]),
        ("-zstd", 2, b"\x28\xB5\x2F\xFD no more".to_vec()),
        (
            "-zstd-of-another-size",
            2,
            zstd::bulk::compress(&[0; 96], 3).unwrap(),
        ),
        ("-zstd-bomb", 2, zstd_stating(&[0; 48], 1 << 40)),
        (
            "-lz4-left-over",
            1,
            [lz4_flex::block::compress(&[0; 48]), vec![0; 8]].concat(),
        ),
    ] {
        let p = one(header("map", 3, 2, 1), (Codec::None, 0), valid::mixed_mono);
        let (at, reference) = (p.directory(), p.block(0));
        let (size, stored) = (bytes.len().next_multiple_of(8), bytes.len());
        let mut p = p
            .put(reference + 8, &(size as u32).to_le_bytes())
            .put(reference + 16, &[codec, (size - stored) as u8]);
        let (f, t) = (p.footer(), p.trailer());
        let mut new = bytes;
        new.resize(size, 0);
        p = p.put(t + 16, &((f + size - 48) as u64).to_le_bytes());
        p = p.put(t, &((t + 64 + size - 48) as u64).to_le_bytes());
        p.0.splice(at..at + 48, new);
        add(&format!("BLOCK-SIZE{name}"), p.signed());
    }
    add("unsupported-codec-of-block", block(16, &[3]));
    add("unsupported-codec-of-block-private", block(16, &[200]));
    add("BLOCK-COVER", small.clone().splice(f, 0, &[0; 8]).signed());
    let h = header("map", 9, 8, 1);
    let lit = |_, _| Visibility::lit();
    let levels = (0..2).map(|l| RawLevel {
        max_error: 0.0,
        tiles: tiles_of(LevelShape::of(&h, l), LATTICE, (Codec::None, 0), lit),
        directory: Codec::None,
    });
    let levels: Vec<RawLevel> = levels.collect();
    let both = Patch(RawFile::of(h, levels).assemble());
    let first = both.u64_at(both.block(0)) as u64;
    add(
        "BLOCK-COVER-overlap",
        both.clone()
            .at(|p| p.block(1), &first.to_le_bytes())
            .signed(),
    );

    // Groups and attributes.
    add("GROUP-NAME", replace(b"gb", 0, b"\t"));
    add("GROUP-NAME-twice", replace(b"gb", 1, b"a"));
    add("GROUP-ROLE", replace(b"ga", 2, &[0]));
    add("GROUP-ROLE-unknown", replace(b"ga", 2, &[3]));
    add("GROUP-MAPS", replace(b"ga", 7, &[2]));
    add("GROUP-MAPS-twice", replace(b"ga", 7, &[1]));
    add("GROUP-MAPS-none", replace(b"ga", 3, &[0]));
    add("GROUP-MAPS-huge", replace(b"ga", 3, &[255; 4]));
    add("ATTRIBUTE-NAME", replace(b"tb", 0, &[0]));
    add("ATTRIBUTE-NAME-twice", replace(b"tb", 1, b"a"));
    for (name, kind, value) in [
        ("", 0, &b"\xC0\xAF"[..]),
        ("-integers", 1, &[0; 7]),
        ("-no-integers", 1, &[]),
        ("-numbers", 2, &[0; 12]),
        ("-no-numbers", 2, &[]),
        ("-no-type", 3, &[]),
        ("-empty-type", 3, &[0, 0, 1]),
        ("-type-too-long", 3, &[9, 0, b't']),
        ("-type-control", 3, &[1, 0, 7]),
    ] {
        let p = small
            .clone()
            .records(|f| attribute(f, "a", kind, value.len() as u32, value));
        add(&format!("ATTRIBUTE-VALUE{name}"), p.signed());
    }

    // Entries of an empty tile, a constant tile and a data tile.
    let entry =
        |i: usize, at: usize, bytes: &[u8]| kinds.clone().at(|p| p.entry(i) + at, bytes).signed();
    add("TILE-KIND", entry(2, 40, &[3]));
    add("TILE-EMPTY", entry(0, 24, &1f32.to_le_bytes()));
    add("TILE-EMPTY-end", entry(0, 36, &0.5f32.to_le_bytes()));
    add("TILE-EMPTY-flags", entry(0, 46, &[2]));
    add(
        "TILE-EMPTY-minus-zero",
        entry(0, 28, &(-0.0f32).to_le_bytes()),
    );
    add("TILE-CONSTANT", entry(1, 16, &[63]));
    add("TILE-CONSTANT-depths", entry(1, 28, &8f32.to_le_bytes()));
    add(
        "TILE-CONSTANT-lit",
        entry(1, 32, &[1f32.to_le_bytes(), 1f32.to_le_bytes()].concat()),
    );
    add(
        "TILE-CONSTANT-minus-zero",
        entry(
            1,
            24,
            &[(-0f32).to_le_bytes(), (-0f32).to_le_bytes()].concat(),
        ),
    );
    add(
        "TILE-CONSTANT-nan",
        entry(
            1,
            24,
            &[f32::NAN.to_le_bytes(), f32::NAN.to_le_bytes()].concat(),
        ),
    );
    add("TILE-CONSTANT-coloured", entry(1, 46, &[1]));
    let start = kinds.u64_at(kinds.entry(2)) as u64;
    add("TILE-RANGE", entry(2, 0, &(start - 8).to_le_bytes()));
    add(
        "TILE-RANGE-unaligned",
        entry(2, 0, &(start + 1).to_le_bytes()),
    );
    add(
        "TILE-RANGE-in-directory",
        entry(2, 0, &(start + 8).to_le_bytes()),
    );
    add(
        "TILE-RANGE-overflow",
        entry(2, 0, &(u64::MAX - 7).to_le_bytes()),
    );
    add("TILE-RANGE-no-bytes", {
        let p = kinds.clone().at(|p| p.entry(2) + 8, &[0; 4]);
        p.at(|p| p.map() + 68, &[0; 8]).signed()
    });
    add("TILE-RANGE-size", entry(2, 8, &[1]));
    add("TILE-VERTICES", entry(2, 16, &[0; 4]));
    add("TILE-CRC", {
        let mut bytes = kinds.0.clone();
        bytes[start as usize + 5] ^= 4;
        bytes
    });
    add("TILE-DEPTHS", entry(2, 28, &1000f32.to_le_bytes()));
    add("TILE-DEPTHS-nan", entry(2, 24, &f32::NAN.to_le_bytes()));
    add("TILE-ENDS", entry(2, 32, &0.001f32.to_le_bytes()));
    add("TILE-ENDS-negative", entry(2, 32, &(-1f32).to_le_bytes()));
    add("TILE-PADDING", entry(2, 43, &[8]));
    add("TILE-FLAGS", entry(2, 46, &[2]));
    add("unsupported-transform", entry(2, 42, &[2]));
    add("unsupported-transform-private", entry(2, 42, &[255]));
    add("unsupported-codec-of-tile", entry(2, 41, &[3]));
    add("unsupported-codec-of-tile-private", entry(2, 41, &[128]));
    let of_lz4 = |at: usize, bytes: &[u8]| lz4.clone().at(|p| p.entry(0) + at, bytes).signed();
    add(
        "TILE-SIZE-limit",
        of_lz4(12, &((1u32 << 31) + 8).to_le_bytes()),
    );
    let early = lz4_flex::block::compress(&[3, 0, 0, 0, 0, 0, 0, 0]);
    add(
        "TILE-STREAM-lz4",
        raw_tile(1, 1, 3, 64, false, (1, 1), 8, early).signed(),
    );

    // Cover.
    // Entry `at` becomes empty after the file is built, so that no entry refers to its payload.
    let gap = |at: usize| {
        let mut tiles = tiles_of(
            LevelShape::of(&header("map", 16, 8, 1), 0),
            LATTICE,
            (Codec::None, 0),
            valid::mixed_mono,
        );
        if at > 0 {
            tiles.swap(0, 1);
        }
        let p = file_of(header("map", 16, 8, 1), tiles);
        let e = p.entry(at);
        let (vertices, size) = (
            p.0[e + 16],
            u32::from_le_bytes(p.0[e + 8..e + 12].try_into().unwrap()),
        );
        let mut empty = [0; 48];
        empty[32..36].copy_from_slice(&1f32.to_le_bytes());
        empty[36..40].copy_from_slice(&1f32.to_le_bytes());
        let m = p.map();
        let sum = |at: usize, less: u64| (p.u64_at(at) as u64 - less).to_le_bytes();
        let (v, s) = (sum(m + 60, vertices.into()), sum(m + 68, size.into()));
        p.put(e, &empty).put(m + 60, &v).put(m + 68, &s).signed()
    };
    add("TILE-COVER", gap(0));
    add("TILE-COVER-end", gap(1));
    let p = one(header("map", 16, 8, 1), (Codec::None, 0), |x, y| {
        valid::mixed_mono(x % 8, y)
    });
    let record = p.0[p.entry(0)..p.entry(1)].to_vec();
    add("TILE-COVER-overlap", p.at(|p| p.entry(1), &record).signed());

    // Decoded tiles: three pixels with zero, one and two vertices on the lattice 64.
    let plain = |table: [u32; 4], k: [u16; 3]| {
        let mut bytes = Vec::new();
        put_u32(&mut bytes, &table);
        put_u32(&mut bytes, &[1f32.to_bits(); 2]);
        put_u32(&mut bytes, &[2f32.to_bits()]);
        k.iter()
            .for_each(|k| bytes.extend_from_slice(&k.to_le_bytes()));
        bytes
    };
    let tile = |table, k| data_tile(3, 1, 3, 64, false, plain(table, k));
    add("TILE-TABLE", tile([1, 1, 1, 3], [32, 64, 32]).signed());
    add(
        "TILE-TABLE-falls",
        tile([0, 2, 1, 3], [32, 64, 32]).signed(),
    );
    add("TILE-TABLE-end", tile([0, 0, 1, 2], [32, 64, 32]).signed());
    add(
        "TILE-TABLE-huge",
        tile([0, 0, 1, u32::MAX], [32, 64, 32]).signed(),
    );
    add("TILE-LATTICE", tile([0, 0, 1, 3], [32, 65, 32]).signed());
    add(
        "TILE-SIZE",
        data_tile(
            3,
            1,
            3,
            64,
            false,
            [plain([0, 0, 1, 3], [32, 64, 32]), vec![0; 8]].concat(),
        )
        .signed(),
    );
    add(
        "TILE-SIZE-short",
        data_tile(
            3,
            1,
            3,
            64,
            false,
            plain([0, 0, 1, 3], [32, 64, 32])[..24].to_vec(),
        )
        .signed(),
    );
    add("TILE-PADDING-of-tile", {
        let mut bytes = plain([0, 0, 1, 3], [32, 64, 32]);
        bytes.push(7);
        data_tile(3, 1, 3, 64, false, bytes).signed()
    });
    add("TILE-PADDING-not-zero", {
        let p = lz4.clone();
        let e = p.entry(0);
        let (size, padding) = (p.u64_at(e + 8) & 0xFFFF_FFFF, p.0[e + 43]);
        assert!(
            padding < 7,
            "the last byte of the frame can count as padding"
        );
        p.put(e + 43, &[padding + 1])
            .at(|_| 64 + size - 1 - usize::from(padding), &[9])
            .signed()
    });
    // Coloured tiles: an empty pixel, a mono pixel of one vertex, a coloured pixel of two.
    let rgb_tile = |colour: [u32; 4], v: [u16; 7]| {
        let mut bytes = Vec::new();
        put_u32(&mut bytes, &[0, 0, 1, 3]);
        put_u32(&mut bytes, &colour);
        put_u32(
            &mut bytes,
            &[1f32.to_bits(), 1f32.to_bits(), 2f32.to_bits()],
        );
        v.iter()
            .for_each(|k| bytes.extend_from_slice(&k.to_le_bytes()));
        data_tile(3, 1, 3, 64, true, bytes)
    };
    add(
        "TILE-COLOUR",
        rgb_tile([0, 0, 0, 1], [32, 64, 32, 64, 0, 64, 0]).signed(),
    );
    add(
        "TILE-COLOUR-start",
        rgb_tile([1, 1, 1, 3], [32, 64, 32, 64, 0, 64, 0]).signed(),
    );
    add(
        "TILE-COLOUR-of-empty",
        rgb_tile([0, 1, 1, 3], [32, 64, 32, 64, 0, 64, 0]).signed(),
    );
    add(
        "TILE-COLOUR-falls",
        rgb_tile([0, 0, 1, 0], [32, 64, 32, 64, 0, 64, 0]).signed(),
    );
    add("TILE-FLAGS-no-colour", {
        let mut bytes = Vec::new();
        put_u32(
            &mut bytes,
            &[
                0,
                0,
                1,
                3,
                0,
                0,
                0,
                0,
                1f32.to_bits(),
                1f32.to_bits(),
                2f32.to_bits(),
            ],
        );
        [32u16, 64, 32]
            .iter()
            .for_each(|k| bytes.extend_from_slice(&k.to_le_bytes()));
        data_tile(3, 1, 3, 64, true, bytes).signed()
    });
    add(
        "COLOUR-EQUAL",
        rgb_tile([0, 0, 0, 2], [32, 64, 32, 64, 32, 64, 32]).signed(),
    );

    // Delta planes.
    let good = || planes(3, &[2], ONE, &[1], &[0, 16, 16]);
    add(
        "TILE-STREAM",
        delta(3, planes(3, &[2], ONE, &[0], &[0, 16, 16])),
    );
    add(
        "TILE-STREAM-unused-bits",
        delta(3, planes(3, &[6], ONE, &[1], &[0, 16, 16])),
    );
    add(
        "TILE-STREAM-left-over",
        delta(3, [good(), vec![0]].concat()),
    );
    add("TILE-STREAM-short", delta(3, good()[..18].to_vec()));
    add(
        "TILE-VERTICES-counts",
        delta(3, planes(4, &[2], ONE, &[1], &[0, 16, 16])),
    );
    add("TILE-VERTICES-wrap", {
        // Counts of 2^32 - 1 and 4, whose sum is 3 in 32 bits.
        let mut bytes = vec![255, 4, 255, 0, 255, 0, 255, 0];
        bytes.resize(20, 0);
        raw_tile(2, 1, 3, 64, false, (0, 1), bytes.len(), bytes).signed()
    });
    add("TILE-STREAM-colour-of-empty", {
        let mut bytes = vec![0, 1, 0, 0, 0, 0, 0, 0, 0b11];
        bytes.extend(ONE.to_le_bytes());
        bytes.extend([32, 0, 16, 0, 0, 0]);
        raw_tile(2, 1, 1, 64, true, (0, 1), bytes.len(), bytes).signed()
    });
    add(
        "TILE-LATTICE-wrap",
        delta(3, planes(3, &[2], ONE, &[1], &[0, 60, 5])),
    );
    add(
        "DEPTH-ORDER-wrap",
        delta(
            3,
            planes(3, &[0], ONE, &[0x3F00_0000, 0xC080_0000], &[0, 16, 16]),
        ),
    );
    add(
        "DEPTH-ZERO-delta-planes",
        delta(1, planes(1, &[], 1, &[], &[32])),
    );
    add(
        "DEPTH-FINITE-delta-planes",
        delta(1, planes(1, &[], 0x7F80_0000 << 1, &[], &[32])),
    );

    // Codecs.
    let coded = |codec: u8, stored: Vec<u8>| {
        let size = good().len();
        raw_tile(1, 1, 3, 64, false, (codec, 1), size, stored).signed()
    };
    let (packed, framed) = (
        lz4_flex::block::compress(&good()),
        zstd::bulk::compress(&good(), 3).unwrap(),
    );
    add(
        "TILE-CODEC",
        raw_tile(1, 1, 3, 64, false, (0, 1), good().len() + 1, good()).signed(),
    );
    add("TILE-CODEC-lz4", coded(1, vec![0xFF; 16]));
    add(
        "TILE-CODEC-lz4-short",
        coded(1, packed[..packed.len() - 3].to_vec()),
    );
    add(
        "TILE-CODEC-lz4-left-over",
        coded(1, [packed.clone(), vec![0x10, 1]].concat()),
    );
    add(
        "TILE-CODEC-zstd",
        coded(2, framed[..framed.len() - 2].to_vec()),
    );
    add(
        "TILE-CODEC-zstd-left-over",
        coded(2, [framed.clone(), vec![1]].concat()),
    );
    add(
        "TILE-CODEC-zstd-two-frames",
        coded(2, [framed.clone(), framed.clone()].concat()),
    );
    add(
        "TILE-CODEC-zstd-skippable-frame",
        coded(
            2,
            [&[0x50, 0x2A, 0x4D, 0x18, 1, 0, 0, 0, 7][..], &framed].concat(),
        ),
    );
    add(
        "TILE-CODEC-zstd-no-size",
        coded(2, zstd_without_size(&good())),
    );
    add(
        "TILE-CODEC-zstd-another-size",
        coded(2, zstd_stating(&good(), 1 << 20)),
    );
    add(
        "TILE-CODEC-zstd-dictionary",
        coded(2, zstd_with_dictionary(&good())),
    );
    add("TILE-CODEC-zstd-magic", coded(2, vec![0; 16]));

    // Laws.
    let one_ = 1f32.to_bits();
    let bits = |vertices: &[(f32, f32)]| {
        pixel_f32(
            &vertices
                .iter()
                .map(|v| (v.0.to_bits(), v.1.to_bits()))
                .collect::<Vec<_>>(),
        )
        .signed()
    };
    add("DEPTH-FINITE", bits(&[(1.0, 0.75), (f32::INFINITY, 0.5)]));
    add("DEPTH-FINITE-nan", bits(&[(f32::NAN, 0.75), (1.0, 0.5)]));
    add(
        "DEPTH-ZERO",
        pixel_f32(&[(0x8000_0000, 0x3F00_0000)]).signed(),
    );
    add(
        "DEPTH-ZERO-visibility",
        pixel_f32(&[(one_, 0x8000_0000)]).signed(),
    );
    add("DEPTH-ORDER", bits(&[(2.0, 0.75), (1.0, 0.5)]));
    add("DEPTH-FIRST", bits(&[(1.0, 0.75), (1.0, 0.5)]));
    add(
        "DEPTH-PAIR",
        bits(&[(0.5, 1.0), (1.0, 0.75), (1.0, 0.625), (1.0, 0.5)]),
    );
    add("VISIBILITY-RANGE", bits(&[(1.0, -0.5)]));
    add("VISIBILITY-RANGE-above", bits(&[(1.0, 1f32.next_up())]));
    add("VISIBILITY-RANGE-nan", bits(&[(1.0, f32::NAN)]));
    add("VISIBILITY-RISE", bits(&[(1.0, 0.5), (2.0, 0.75)]));
    add(
        "VISIBILITY-RISE-green",
        rgb_tile([0, 0, 0, 2], [32, 64, 32, 32, 33, 64, 0]).signed(),
    );
    add(
        "VERTEX-STEP",
        bits(&[(1.0, 1.0), (2.0, 0.75), (2.0, 0.75), (3.0, 0.5)]),
    );
    add(
        "VERTEX-REDUNDANT",
        bits(&[(1.0, 0.5), (2.0, 0.5), (3.0, 0.5), (4.0, 0.25)]),
    );
    add(
        "VERTEX-REDUNDANT-first",
        bits(&[(1.0, 1.0), (2.0, 1.0), (3.0, 0.5)]),
    );
    add("VERTEX-REDUNDANT-last", bits(&[(1.0, 0.5), (2.0, 0.5)]));
    add("VERTEX-REDUNDANT-alone", bits(&[(1.0, 1.0)]));
    out
}

/// Appends an attribute of the file to the footer and restores the padding.
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

/// A Zstandard frame of one raw block with this frame header.
fn zstd_frame(head: &[u8], content: &[u8]) -> Vec<u8> {
    let mut out = vec![0x28, 0xB5, 0x2F, 0xFD];
    out.extend_from_slice(head);
    out.extend_from_slice(&(1 | (content.len() as u32) << 3).to_le_bytes()[..3]); // last block, raw
    out.extend_from_slice(content);
    out
}

/// A frame whose header states this content size.
fn zstd_stating(content: &[u8], size: u64) -> Vec<u8> {
    // Single segment, 8 bytes of size.
    zstd_frame(&[&[0xE0][..], &size.to_le_bytes()].concat(), content)
}

fn zstd_without_size(content: &[u8]) -> Vec<u8> {
    // A window of 1 KiB, no size.
    zstd_frame(&[0, 0], content)
}

fn zstd_with_dictionary(content: &[u8]) -> Vec<u8> {
    // Single segment, dictionary 7, 1 byte of size.
    zstd_frame(&[0x21, 7, content.len() as u8], content)
}
