//! Builds conformance vectors part by part: they also hold things that the writer never writes.

pub mod attacks;
pub mod invalid;
pub mod text;
pub mod valid;

use deepshadow::raw::directory::{Entry, TileKind, encode_block};
use deepshadow::raw::footer::{Footer, LevelRecord, MapRecord};
use deepshadow::raw::header::{Trailer, encode_header};
use deepshadow::raw::{LevelShape, Precision, TileBuilder};
use deepshadow::*;

/// A tile and its stored bytes.
pub type RawTile = (Entry, Vec<u8>);

/// One level: its maximum error, its tiles row by row, and the codec of its directory.
pub struct RawLevel {
    pub max_error: f64,
    pub tiles: Vec<RawTile>,
    pub directory: Codec,
}

/// The contents of a file.
#[derive(Default)]
pub struct RawFile {
    pub optional_features: u64,
    pub maps: Vec<(MapHeader, Vec<RawLevel>)>,
    pub groups: Vec<Group>,
    pub attributes: Vec<(String, Attribute)>,
    /// Whether payloads are written from the last to the first.
    pub backwards: bool,
}

impl RawFile {
    /// A file of one map.
    pub fn of(header: MapHeader, levels: Vec<RawLevel>) -> Self {
        RawFile {
            maps: vec![(header, levels)],
            ..RawFile::default()
        }
    }

    /// The bytes of the file.
    pub fn assemble(mut self) -> Vec<u8> {
        let mut file = encode_header().to_vec();
        let mut tiles: Vec<&mut RawTile> = self
            .maps
            .iter_mut()
            .flat_map(|(_, levels)| levels)
            .flat_map(|l| &mut l.tiles)
            .filter(|t| t.0.kind == TileKind::Data)
            .collect();
        if self.backwards {
            tiles.reverse();
        }
        for (entry, payload) in tiles {
            entry.offset = file.len() as u64;
            file.extend_from_slice(payload);
        }
        let directory_offset = file.len() as u64;
        let mut footer = Footer {
            optional_features: self.optional_features,
            groups: self.groups,
            attributes: self.attributes,
            ..Footer::default()
        };
        for (header, levels) in self.maps {
            let mut records = Vec::new();
            for level in levels {
                let entries: Vec<Entry> = level.tiles.iter().map(|t| t.0).collect();
                let mut blocks = Vec::new();
                for entries in entries.chunks(1024) {
                    let (mut block, bytes) = encode_block(entries, level.directory).unwrap();
                    block.offset = file.len() as u64;
                    file.extend_from_slice(&bytes);
                    blocks.push(block);
                }
                records.push(LevelRecord {
                    max_error: level.max_error,
                    vertices: entries.iter().map(|e| u64::from(e.vertices)).sum(),
                    payload_bytes: entries.iter().map(|e| u64::from(e.stored_size)).sum(),
                    blocks,
                });
            }
            footer.maps.push(MapRecord {
                header,
                levels: records,
            });
        }
        attacks::sealed(file, &footer, directory_offset)
    }
}

/// A padded payload and its directory entry.
pub fn stored(
    mut entry: Entry,
    codec: u8,
    transform: u8,
    decoded: usize,
    mut payload: Vec<u8>,
) -> RawTile {
    let frame = payload.len();
    payload.resize(frame.next_multiple_of(8), 0);
    entry.codec = codec;
    entry.transform = transform;
    entry.decoded_size = decoded as u32;
    entry.padding = (payload.len() - frame) as u8;
    entry.stored_size = payload.len() as u32;
    entry.crc = crc32fast::hash(&payload);
    (entry, payload)
}

/// Encodes a tile with any codec and transform, including pairs that the writer does not use.
pub fn tile_by(tile: &Tile, codec: Codec, transform: u8) -> RawTile {
    let (entry, payload) = tile
        .encode(if transform == 0 {
            Codec::None
        } else {
            Codec::Lz4
        })
        .unwrap();
    if entry.kind != TileKind::Data {
        return (entry, payload);
    }
    let size = entry.decoded_size as usize;
    let frame = &payload[..payload.len() - usize::from(entry.padding)];
    let decoded = match transform {
        0 => frame.to_vec(),
        _ => lz4_flex::block::decompress(frame, size).unwrap(),
    };
    let (id, bytes) = match codec {
        Codec::None => (0, decoded),
        Codec::Lz4 => (1, lz4_flex::block::compress(&decoded)),
        Codec::Zstd(level) => (2, zstd::bulk::compress(&decoded, level).unwrap()),
        codec => panic!("vectors do not use codec {codec}"),
    };
    stored(entry, id, transform, size, bytes)
}

/// The tiles of a level, row by row; `function` yields the function of each pixel.
pub fn tiles_of(
    shape: LevelShape,
    precision: Precision,
    (codec, transform): (Codec, u8),
    function: impl Fn(u32, u32) -> Visibility,
) -> Vec<RawTile> {
    let mut out = Vec::new();
    for ty in 0..shape.tiles_y() {
        for tx in 0..shape.tiles_x() {
            let (w, h) = shape.tile_extent(TileId::new(tx, ty));
            let mut builder = TileBuilder::new(w, precision);
            for y in 0..h {
                for x in 0..w {
                    builder.push(&function(
                        tx * shape.tile_size + x,
                        ty * shape.tile_size + y,
                    ));
                }
            }
            out.push(tile_by(&builder.finish(), codec, transform));
        }
    }
    out
}

/// A monochrome function with these vertices (depth, visibility).
pub fn mono(vertices: &[(f32, f32)]) -> Visibility {
    Visibility::mono(vertices.iter().map(|&(z, v)| Vertex::new(z, v)).collect()).unwrap()
}

/// A coloured function with these vertices (depth, visibilities).
pub fn rgb(vertices: &[(f32, [f32; 3])]) -> Visibility {
    Visibility::rgb(vertices.iter().map(|&(z, v)| Vertex::new(z, v)).collect()).unwrap()
}

/// The header of a map with tiles of 8 x 8 pixels.
pub fn header(name: &str, width: u32, height: u32, channels: usize) -> MapHeader {
    MapHeader::new(name, width, height)
        .tile_size(8)
        .channels(channels)
}
