//! Small files that ask for much memory or much work. All CRCs and sums are right.

use deepshadow::raw::directory::{Entry, encode_block};
use deepshadow::raw::footer::{Footer, LevelRecord, MapRecord};
use deepshadow::raw::header::{Trailer, encode_header};
use deepshadow::raw::{LevelShape, Precision, TileBuilder};
use deepshadow::*;

/// A directory entry and the payload of its tile.
type Stored = (Entry, Vec<u8>);

/// A file of maps of one level each. All tiles of a map are the same and share their payload.
fn uniform(maps: Vec<(MapHeader, Stored)>, groups: Vec<Group>) -> Vec<u8> {
    let mut file = encode_header().to_vec();
    let mut footer = Footer {
        groups,
        ..Footer::default()
    };
    let mut entries = Vec::new();
    for (header, (mut entry, payload)) in maps {
        if !payload.is_empty() {
            entry.offset = file.len() as u64;
        }
        file.extend_from_slice(&payload);
        entries.push((header, entry));
    }
    let directory_offset = file.len() as u64;
    for (header, entry) in entries {
        let tiles = LevelShape::of(&header, 0).tiles();
        let block = |n: u64| encode_block(&vec![entry; n as usize], Codec::Zstd(3)).unwrap();
        let (full, rest) = (block(tiles.min(1024)), block(tiles % 1024));
        let mut blocks = Vec::new();
        for first in (0..tiles).step_by(1024) {
            let is_full = tiles - first >= 1024;
            let (mut block, bytes) = if is_full { &full } else { &rest }.clone();
            block.offset = file.len() as u64;
            file.extend_from_slice(&bytes);
            blocks.push(block);
        }
        let level = LevelRecord {
            max_error: 0.0,
            vertices: tiles * u64::from(entry.vertices),
            payload_bytes: tiles * u64::from(entry.stored_size),
            blocks,
        };
        let levels = vec![level];
        footer.maps.push(MapRecord { header, levels });
    }
    sealed(file, &footer, directory_offset)
}

/// Appends the footer and the trailer to the tiles and the directory of a file.
pub fn sealed(mut file: Vec<u8>, footer: &Footer, directory_offset: u64) -> Vec<u8> {
    let footer_offset = file.len() as u64;
    let bytes = footer.encode().unwrap();
    file.extend_from_slice(&bytes);
    let trailer = Trailer {
        file_length: file.len() as u64 + 64,
        directory_offset,
        footer_offset,
        footer_size: bytes.len() as u64,
        footer_crc: crc32fast::hash(&bytes),
    };
    file.extend_from_slice(&trailer.encode());
    file
}

fn map(width: u32, height: u32, tile_size: u32) -> MapHeader {
    MapHeader::new("map", width, height)
        .tile_size(tile_size)
        .channels(1)
}

/// The function that falls `n` times by `drop`, at the depths 0, 1, 2 and so on.
fn stairs(n: u32, drop: f32) -> Visibility {
    let value = |i: u32| 1.0 - i as f32 * drop;
    let mut vertices = vec![Vertex::new(0.0, value(1))];
    for i in 1..n {
        let z = i as f32;
        vertices.extend([Vertex::new(z, value(i)), Vertex::new(z, value(i + 1))]);
    }
    Visibility::mono(vertices).unwrap()
}

/// One function that falls in `steps` steps, in a map of one pixel.
pub fn huge_function(steps: u32) -> Vec<u8> {
    let mut builder = TileBuilder::new(1, Precision::F32);
    builder.push(&stairs(steps, 2f32.powi(-24)));
    let tile = builder.finish().encode(Codec::Zstd(3)).unwrap();
    uniform(vec![(map(1, 1, 8), tile)], Vec::new())
}

/// `maps` maps of one empty tile each, in one group.
pub fn many_maps(maps: u32) -> Vec<u8> {
    let one = |m: u32| {
        let mut header = map(1, 1, 8);
        header.name = format!("map {m}");
        (header, (Entry::default(), Vec::new()))
    };
    let group = Group::new("all", GroupRole::Clusters, (0..maps).map(MapId).collect());
    uniform((0..maps).map(one).collect(), vec![group])
}

/// A row of `tiles` tiles that share one payload, each of 256 x 256 pixels with 16 steps.
pub fn shared_row(tiles: u32) -> Vec<u8> {
    let mut builder = TileBuilder::new(256, Precision::Lattice(64));
    let function = stairs(16, 1.0 / 64.0);
    (0..256 * 256).for_each(|_| builder.push(&function));
    let tile = builder.finish().encode(Codec::Zstd(3)).unwrap();
    uniform(vec![(map(256 * tiles, 256, 256), tile)], Vec::new())
}

/// A map of `width` x `height` pixels of constant tiles.
pub fn constant(width: u32, height: u32) -> Vec<u8> {
    let entry = Entry::constant(256 * 256, 1.0, 0.5);
    uniform(
        vec![(map(width, height, 256), (entry, Vec::new()))],
        Vec::new(),
    )
}

/// A square map of `tiles` x `tiles` empty tiles.
pub fn empty(tiles: u32) -> Vec<u8> {
    let tile = (Entry::default(), Vec::new());
    uniform(vec![(map(8 * tiles, 8 * tiles, 8), tile)], Vec::new())
}

/// A row of `tiles` broken tiles of 8 x 8 pixels.
pub fn broken(tiles: u32) -> Vec<u8> {
    let mut builder = TileBuilder::new(8, Precision::Lattice(4));
    let wall = |z: f32| Visibility::mono(vec![Vertex::new(z, 0.5)]).unwrap();
    (0..64u8).for_each(|i| builder.push(&wall(i.into())));
    let (mut entry, payload) = builder.finish().encode(Codec::Lz4).unwrap();
    entry.crc ^= 1;
    uniform(vec![(map(8 * tiles, 8, 8), (entry, payload))], Vec::new())
}
