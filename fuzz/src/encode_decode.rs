//! Encodes and decodes a tile of any functions.
//!
//! Both readers must return the functions for every codec. Encoding twice must give the same bytes.

use deepshadow::raw::directory::{Entry, TileKind};
use deepshadow::raw::{Precision, TileBuilder};
use deepshadow::{Codec, Tile, Visibility};

use super::bytes::Bytes;
use super::{curves, naive};

/// The codecs under test.
pub const ALL: [Codec; 3] = [Codec::None, Codec::Lz4, Codec::Zstd(1)];

/// Checks one input: a tile of up to 8 x 8 functions.
pub fn run(data: &[u8]) {
    let mut b = Bytes(data);
    let size = b.u8();
    let (width, height) = (1 + u32::from(size % 8), 1 + u32::from(b.u8() % 8));
    // One compressing codec per input: the codecs take most of the time.
    let packer = match size >> 3 & 1 {
        0 => Codec::Zstd(1),
        _ => Codec::Lz4,
    };
    let precision = match b.u8() % 4 {
        0 => Precision::F32,
        1 => Precision::Lattice(255),
        2 => Precision::Lattice(b.u16().max(1)),
        _ => Precision::Lattice(65535),
    };
    let all_same = b.u8() % 8 == 0;
    let mut functions: Vec<Visibility> = Vec::new();
    for i in 0..width * height {
        match functions.first() {
            Some(first) if all_same && i > 0 => functions.push(first.clone()),
            _ => functions.push(curves::function(
                &mut b,
                precision,
                if all_same { 1 } else { 12 },
            )),
        }
    }
    check(width, height, precision, &functions, &[Codec::None, packer]);
}

/// Builds a tile of these functions and checks it with each codec.
pub fn check(
    width: u32,
    height: u32,
    precision: Precision,
    functions: &[Visibility],
    codecs: &[Codec],
) {
    let mut builder = TileBuilder::new(width, precision);
    functions.iter().for_each(|f| builder.push(f));
    let tile = builder.finish();
    assert_eq!(tile.pixels(), functions.len());
    for (i, f) in functions.iter().enumerate() {
        assert_eq!(tile.function(i), f.function(), "built, pixel {i}");
        assert_eq!(tile.function(i).len(), f.len());
    }
    check_tile(&tile, (width, height), functions, codecs);
}

/// Encodes the tile with each codec and checks that both readers return `functions`.
pub fn check_tile(tile: &Tile, extent: (u32, u32), functions: &[Visibility], codecs: &[Codec]) {
    for &codec in codecs {
        let (mut entry, payload) = tile.encode(codec).expect("a small tile");
        assert_eq!(
            tile.encode(codec).expect("again"),
            (entry, payload.clone()),
            "{codec:?}: encoding twice gives different bytes"
        );
        if entry.kind == TileKind::Data {
            entry.offset = 64;
        }
        assert_eq!(payload.len() % 8, 0);
        let back = Tile::decode(&entry, &payload, extent, 1 << 30).expect("our own tile is legal");
        for (i, f) in functions.iter().enumerate() {
            assert_eq!(back.function(i), f.function(), "{codec:?}, pixel {i}");
        }
        let ends = functions.iter().flat_map(|f| f.end_rgb());
        let most = ends.clone().fold(0f32, f32::max);
        let least = ends.fold(1f32, f32::min);
        assert_eq!(entry.ends, [least, most]);
        assert_eq!(
            entry.vertices as usize,
            functions.iter().map(Visibility::len).sum::<usize>()
        );
        if entry.kind == TileKind::Data {
            assert_eq!(&back, tile);
            let read =
                naive::decode(&entry, &payload, extent).expect("the naive reader accepts the tile");
            assert_eq!(read, functions, "{codec:?}, naive reader");
        }
        check_entry(&entry, extent);
    }
}

/// Checks that an entry survives encoding and parsing.
fn check_entry(entry: &Entry, extent: (u32, u32)) {
    use deepshadow::raw::directory::{decode_block, encode_block};
    let (block, bytes) = encode_block(&[*entry], Codec::None).expect("one entry");
    let record = decode_block(&block, &bytes, 1).expect("our own entry is legal");
    let parsed =
        Entry::parse(&record, extent.0 * extent.1, 3, 1 << 40).expect("our own entry is legal");
    assert_eq!(&parsed, entry);
}
