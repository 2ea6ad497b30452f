//! Compares the fast tile reader with the naive one, on any directory entry and any bytes.
//!
//! Both must accept the same tiles and return the same functions.

use deepshadow::raw::directory::{Entry, TileKind};
use deepshadow::{ErrorKind, Tile, Visibility};

use super::bytes::Bytes;
use super::{encode_decode, naive};

/// Largest decoded size of a tile in bytes.
const LIMIT: u64 = 1 << 18;

/// Checks one input: 5 bytes of settings, 48 bytes of the entry, then the bytes of the tile.
pub fn run(data: &[u8]) {
    let mut b = Bytes(data);
    let extent = (1 + u32::from(b.u8() % 16), 1 + u32::from(b.u8() % 16));
    let (how, transform, settings) = (b.u8(), b.u8(), b.u8());
    let mut record = [0; 48];
    let given = b.take(48);
    record[..given.len()].copy_from_slice(given);
    if settings & 1 == 0 {
        record[40] = 2;
    }
    let pixels = extent.0 * extent.1;
    let decoded_size = u32::from_le_bytes([record[12], record[13], record[14], record[15]]);
    let padding = record[43] % 8;
    let Ok(mut entry) = parse(record, pixels) else {
        return;
    };
    if entry.kind != TileKind::Data {
        let tile = Tile::decode(&entry, &[], extent, LIMIT)
            .expect("empty and constant tiles always decode");
        let functions: Vec<Visibility> = tile.functions().map(|f| f.to_visibility()).collect();
        encode_decode::check_tile(&tile, extent, &functions, &encode_decode::ALL);
        return;
    }
    let raw = b.0;
    let mut stored = match how % 8 {
        3 => lz4_flex::block::compress(raw),
        4 => zstd::bulk::compress(raw, 1).expect("memory"),
        _ => raw.to_vec(),
    };
    entry.codec = [0, 1, 2, 1, 2, 0, 0, entry.codec][usize::from(how % 8)];
    entry.transform = if transform < 254 {
        transform % 2
    } else {
        transform
    };
    let honest = matches!(how % 8, 0 | 3..=6);
    entry.decoded_size = if honest {
        raw.len() as u32
    } else {
        decoded_size
    };
    entry.padding = match settings & 4 {
        0 => (stored.len().next_multiple_of(8) - stored.len()) as u8,
        _ => padding,
    };
    stored.resize(stored.len().next_multiple_of(8), 0);
    entry.stored_size = stored.len() as u32;
    if usize::from(entry.padding) > stored.len() {
        return; // the entry itself is rejected
    }
    entry.crc = crc32fast::hash(&stored);
    let expected = (entry.decoded_size as u64 <= LIMIT && entry.vertices as u64 <= LIMIT)
        .then(|| naive::decode(&entry, &stored, extent))
        .flatten();
    if let (Some(functions), true) = (&expected, settings & 2 == 0) {
        (entry.depths, entry.ends) = naive::ranges(functions);
        entry.depths = entry.depths.map(|z| z + 0.0);
    }
    let ranges_fit = expected.as_ref().is_some_and(|f| {
        let (depths, ends) = naive::ranges(f);
        let bits = |r: [f32; 2]| r.map(|v| (v + 0.0).to_bits());
        bits(depths) == entry.depths.map(f32::to_bits) && bits(ends) == entry.ends.map(f32::to_bits)
    });
    match Tile::decode(&entry, &stored, extent, LIMIT) {
        Ok(tile) => {
            let functions =
                expected.expect("the naive reader rejects a tile that the fast one accepts");
            assert!(
                ranges_fit,
                "accepted ranges that differ from those of the functions"
            );
            for (i, f) in functions.iter().enumerate() {
                assert_eq!(tile.function(i), f.function(), "pixel {i}");
            }
            assert_eq!(tile.vertices(), entry.vertices as usize);
            // A canonical tile is encoded again bit for bit. An entry of kind data may hold a tile
            // that the encoder writes as a constant.
            let (again, _) = tile.encode(deepshadow::Codec::None).expect("a small tile");
            if again.kind == TileKind::Data {
                encode_decode::check_tile(&tile, extent, &functions, &encode_decode::ALL);
            }
        }
        Err(e) if e.kind() == ErrorKind::Limit => {}
        Err(e) => {
            assert!(
                matches!(e.kind(), ErrorKind::Corrupt | ErrorKind::Unsupported),
                "{e}"
            );
            assert!(
                expected.is_none() || !ranges_fit,
                "rejected a tile that the naive reader accepts: {e}"
            );
        }
    }
}

/// Parses an entry.
///
/// First makes fields that are not under test valid, so that the checks of section 6 pass.
fn parse(mut record: [u8; 48], pixels: u32) -> Result<Entry, ()> {
    if record[40] == 2 {
        record[..8].copy_from_slice(&64u64.to_le_bytes());
        record[8..12].copy_from_slice(&8u32.to_le_bytes());
        record[12..16].copy_from_slice(&8u32.to_le_bytes());
        record[43] = 0;
        (record[46], record[47]) = (record[46] & 1, 0);
        if record[16..20] == [0; 4] {
            record[16] = 1;
        }
    }
    Entry::parse(&record, pixels, 3, 1 << 40).map_err(|_| ())
}
