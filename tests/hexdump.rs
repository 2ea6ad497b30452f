//! Compares `spec/hexdump.md` with the bytes, and the tables of `spec/format.md` with the layout.
//!
//! `BLESS=1` rewrites `spec/hexdump.md`.

use crate::vectors_support::{RawFile, RawLevel, header, mono, rgb, tiles_of};
use deepshadow::raw::layout::{BLOCK, ENTRY, FOOTER, Field, HEADER, LEVEL, MAP, TRAILER};
use deepshadow::raw::{LevelShape, Precision};
use deepshadow::*;

fn example() -> Vec<u8> {
    let h = header("light", 2, 2, 1);
    let tiles = tiles_of(
        LevelShape::of(&h, 0),
        Precision::Lattice(4),
        (Codec::None, 0),
        |x, y| match (x, y) {
            (1, 0) => mono(&[(2.0, 0.25)]),
            (0, 1) => mono(&[(1.0, 1.0), (3.0, 0.5)]),
            _ => Visibility::lit(),
        },
    );
    RawFile::of(
        h,
        vec![RawLevel {
            max_error: 0.125,
            tiles,
            directory: Codec::None,
        }],
    )
    .assemble()
}

/// The value of a field as text.
fn value(kind: &str, bytes: &[u8]) -> String {
    let number = |b: &[u8]| b.iter().rev().fold(0u64, |v, &b| v << 8 | u64::from(b));
    let many = |size: usize, f: &dyn Fn(&[u8]) -> String| {
        bytes.chunks(size).map(f).collect::<Vec<_>>().join(", ")
    };
    match kind.split('[').next().unwrap() {
        "u8" if kind.contains('[') && bytes.iter().all(|&b| b == 0) => "zero".into(),
        "u8" if kind.contains('[') => format!("`{}`", bytes.escape_ascii()),
        "f32" => many(4, &|b| f32::from_bits(number(b) as u32).to_string()),
        "f64" => many(8, &|b| f64::from_bits(number(b)).to_string()),
        "i32" => many(4, &|b| (number(b) as u32 as i32).to_string()),
        "u16" => many(2, &|b| number(b).to_string()),
        "u32" => many(4, &|b| number(b).to_string()),
        "u64" => many(8, &|b| number(b).to_string()),
        _ => number(bytes).to_string(),
    }
}

/// The page under construction, and how far it has described the bytes.
struct Page<'a> {
    bytes: &'a [u8],
    at: usize,
    out: String,
}

impl Page<'_> {
    fn title(&mut self, title: &str) {
        self.out +=
            &format!("\n## {title}\n\n| offset | bytes | field | value |\n|---|---|---|---|\n");
    }

    fn row(&mut self, size: usize, kind: &str, field: &str) {
        self.row_of(size, field, |bytes| match kind.contains("crc") {
            true => format!("0x{:08X}", u32::from_le_bytes(bytes.try_into().unwrap())),
            false => value(kind, bytes),
        });
    }

    /// A row for `count` values in `width` byte planes, shown by `show`. Returns the values.
    fn planes(
        &mut self,
        (count, width): (usize, usize),
        field: &str,
        show: impl Fn(&u32) -> String,
    ) -> Vec<u32> {
        let mut values = vec![0; count];
        self.row_of(count * width, field, |bytes| {
            for (i, &byte) in bytes.iter().enumerate() {
                values[i % count] |= u32::from(byte) << (8 * (i / count));
            }
            values.iter().map(show).collect::<Vec<_>>().join(", ")
        });
        values
    }

    fn row_of(&mut self, size: usize, field: &str, show: impl FnOnce(&[u8]) -> String) {
        let bytes = &self.bytes[self.at..self.at + size];
        let hex: Vec<String> = bytes.iter().map(|b| format!("{b:02X}")).collect();
        let (hex, shown) = (hex.join(" "), show(bytes));
        self.out += &format!("| {} | {hex} | {field} | {shown} |\n", self.at);
        self.at += size;
    }

    fn record(&mut self, fields: &[Field]) {
        for f in fields {
            let kind = if f.name.ends_with("crc") {
                "crc"
            } else {
                f.kind
            };
            self.row(f.size, kind, &format!("`{}`", f.name));
        }
    }
}

#[test]
fn the_annotated_dump_matches_the_bytes() {
    let bytes = example();
    assert!(bytes.len() < 450);
    DsmFile::from_bytes(bytes.clone())
        .unwrap()
        .verify(|_, _| true)
        .unwrap();
    let mut page = Page {
        bytes: &bytes,
        at: 0,
        out: String::new(),
    };
    page.out += &format!(
        "# A file, byte by byte\n\n\
        The file holds a map `light` of 2 x 2 pixels with one level, codec none, and visibilities\n\
        on the lattice 4. Pixel (1, 0) has a step at depth 2, behind which a quarter of the light\n\
        remains. In pixel (0, 1), visibility falls from 1 at depth 1 to 1/2 at depth 3. The other\n\
        two pixels are empty. The tables list all {} bytes of the file.\n\n\
        The test `tests/hexdump.rs` writes this page and fails if it differs from the bytes.\n\
        Section numbers are those of [format.md](format.md).\n",
        bytes.len()
    );
    page.title("Header (section 3)");
    page.record(HEADER);
    page.title("The tile (section 7)");
    page.row(
        20,
        "u32[5]",
        "vertex table: pixel 1 has vertex 0, pixel 2 has vertices 1 and 2",
    );
    page.row(12, "f32[3]", "depths: the step; both ends of the ramp");
    page.row(
        6,
        "u16[3]",
        "visibilities in fourths: a step to 1/4 (from the implicit 1); a ramp from 4/4 to 2/4",
    );
    page.row(2, "u8[2]", "padding to a multiple of 8");
    page.title("Directory: one block of one entry (section 6)");
    page.record(ENTRY);
    page.title("Footer (section 5)");
    page.record(FOOTER);
    page.row(2, "u16", "length of the map's name");
    page.row(5, "u8[5]", "the name");
    page.record(MAP);
    page.record(LEVEL);
    page.record(BLOCK);
    let trailer = bytes.len() - 64;
    page.row(trailer - page.at, "u8[]", "padding to a multiple of 8");
    page.title("Trailer (section 4)");
    page.record(TRAILER);
    assert_eq!(page.at, bytes.len());
    page.out += &delta_planes();
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("spec/hexdump.md");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, &page.out).unwrap();
    }
    assert!(
        std::fs::read_to_string(path).unwrap() == page.out,
        "spec/hexdump.md differs from the bytes: run this test with BLESS=1"
    );
}

/// The part of the page about transform 1: a tile, and how its first depths are predicted.
fn delta_planes() -> String {
    let function = |x: u32, y: u32| match (x, y) {
        (0, 0) => mono(&[(2.0, 0.25)]),
        (1, 0) => rgb(&[(2.0, [1.0, 1.0, 0.5]), (4.0, [0.5, 0.25, 0.5])]),
        (2, 0) => Visibility::lit(),
        (0, 1) => mono(&[(1.0, 1.0), (3.0, 0.5), (3.0, 0.25)]),
        (1, 1) => mono(&[(3.0, 0.5)]),
        _ => mono(&[(4.0, 0.0)]),
    };
    let (h, lattice) = (header("map", 3, 2, 3), Precision::Lattice(4));
    let tiles = tiles_of(LevelShape::of(&h, 0), lattice, (Codec::None, 1), function);
    let (entry, payload) = &tiles[0];
    let tile = Tile::decode(entry, payload, (3, 2), 1 << 20).unwrap();
    for i in 0..6 {
        let expected = function(i % 3, i / 3);
        assert_eq!(tile.function(i as usize), expected.function());
    }
    let mut page = Page {
        bytes: payload,
        at: 0,
        out: "\n# A tile as delta planes\n\n\
            Transform 1 (section 8) stores a tile of 3 x 2 pixels on the lattice 4 in 78 bytes,\n\
            and 2 bytes pad them. Vertices are (depth, visibility in fourths); the pixels:\n\n\
            | pixel | (0, y) | (1, y) | (2, y) |\n|---|---|---|---|\n\
            | y = 0 | (2, 1) | coloured: (2, 4 4 2) (4, 2 1 2) | empty |\n\
            | y = 1 | (1, 4) (3, 2) (3, 1), a step | (3, 2) | (4, 0) |\n"
            .to_owned(),
    };
    page.title("The parts (section 8)");
    page.out = page.out.replace("| offset |", "| byte |");
    let decimal = |v: &u32| v.to_string();
    let counts = page.planes((6, 4), "1. counts, in four byte planes", decimal);
    page.row_of(1, "2. colour bits: only pixel (1, 0) is coloured", |b| {
        format!("{:06b}, the first pixel last", b[0])
    });
    let what = "3. step bits of all vertices but the first of each pixel: \
        of (4, 2 1 2), (3, 2) and (3, 1)";
    page.row_of(1, what, |b| format!("{:03b}, the first vertex last", b[0]));
    let hex = |v: &u32| format!("0x{v:08X}");
    let firsts = page.planes((5, 4), "4. first depths, predicted: see below", hex);
    let gaps = page.planes(
        (2, 4),
        "5. gaps: from 2 to 4, from 1 to 3; none at the step",
        hex,
    );
    let first = page.planes((8, 2), "6. drops of the first channel, from 4 on", decimal);
    let what = "drops of the second channel of the coloured pixel: 4 to 4, 4 to 1";
    let second = page.planes((2, 2), what, decimal);
    let what = "drops of the third channel: 4 to 2, 2 to 2";
    let third = page.planes((2, 2), what, decimal);
    page.row(2, "u8[]", "padding to a multiple of 8");
    assert_eq!(page.at, payload.len());

    // The same numbers, straight from the text of section 8.
    assert_eq!(counts, [1, 2, 0, 3, 1, 1]);
    assert_eq!(first, [3, 0, 2, 0, 2, 1, 2, 4]);
    assert_eq!((second, third), (vec![0, 3], vec![2, 0]));
    let ordered = |z: f32| z.to_bits() ^ 0x8000_0000; // no depth is negative
    let far = |a: f32, b: f32| ordered(b) - ordered(a);
    assert_eq!(gaps, [far(2.0, 4.0), far(1.0, 3.0)]);
    let (o1, o2, o3, o4) = (ordered(1.0), ordered(2.0), ordered(3.0), ordered(4.0));
    page.out += "\nFirst depths, where W, N and NW are the neighbours that have vertices:\n\n\
        | pixel | depth | ordered integer o | prediction | d | stored |\n\
        |---|---|---|---|---|---|\n";
    let rows = [
        ("(0, 0)", 2, o2, 0x8000_0000, "no pixel before"),
        ("(1, 0)", 2, o2, o2, "W"),
        ("(0, 1)", 1, o1, o2, "N"),
        (
            "(1, 1)",
            3,
            o3,
            o1.wrapping_add(o2).wrapping_sub(o2),
            "W + N - NW",
        ),
        ("(2, 1)", 4, o4, o3, "W, as N is empty"),
    ];
    for ((pixel, z, o, prediction, why), stored) in rows.into_iter().zip(firsts) {
        let d = o.wrapping_sub(prediction) as i32;
        assert_eq!(((d << 1) ^ (d >> 31)) as u32, stored, "{pixel}");
        page.out += &format!(
            "| {pixel} | {z} | 0x{o:08X} | {why}: 0x{prediction:08X} | {d} | 0x{stored:08X} |\n"
        );
    }
    page.out
}

/// The rows of the table that follows the line `<!-- layout NAME -->` in the specification.
fn rows(spec: &str, name: &str) -> Vec<(usize, usize, String, String)> {
    let marker = format!("<!-- layout {name} -->");
    let start = spec
        .find(&marker)
        .unwrap_or_else(|| panic!("no table {name} in the specification"));
    spec[start..]
        .lines()
        .skip(1)
        .skip_while(|l| !l.starts_with('|'))
        .take_while(|l| l.starts_with('|'))
        .skip(2)
        .map(|line| {
            let cells: Vec<&str> = line
                .split('|')
                .map(|c| c.trim().trim_matches('`'))
                .collect();
            (
                cells[1].parse().unwrap(),
                cells[2].parse().unwrap(),
                cells[3].into(),
                cells[4].into(),
            )
        })
        .collect()
}

#[test]
fn the_tables_of_the_specification_match_the_layout() {
    let spec = include_str!("../spec/format.md");
    for (name, table) in [
        ("header", HEADER),
        ("trailer", TRAILER),
        ("footer", FOOTER),
        ("map", MAP),
        ("level", LEVEL),
        ("block", BLOCK),
        ("entry", ENTRY),
    ] {
        let ours: Vec<_> = table
            .iter()
            .map(|f| (f.offset, f.size, f.kind.to_string(), f.name.to_string()))
            .collect();
        assert_eq!(rows(spec, name), ours, "table {name}");
    }
}
