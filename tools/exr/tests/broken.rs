//! Damaged files cause errors: no panic, no hang, no allocation beyond the limits.

use crate::common::*;
use deepshadow_exr::ErrorKind::{Corrupt, Limit};
use deepshadow_exr::*;
use std::io::Cursor;

/// Small files with every compression, with scanlines and tiles, with one part and with two.
fn small_files() -> Vec<Vec<u8>> {
    let window = rect(-1, 2, 5, 3);
    let image = image(window, &channels(), 4);
    let mut files = Vec::new();
    for compression in COMPRESSIONS {
        let mut part = Part::deep_scanline(window, channels());
        part.compression = compression;
        let mut tiled = part.clone();
        tiled.tiles = Some(Tiles::new(4, 2));
        files.push(file_of(&[part.clone()], std::slice::from_ref(&image)));
        files.push(file_of(&[tiled.clone()], std::slice::from_ref(&image)));
        part.name = Some("a".into());
        tiled.name = Some("b".into());
        files.push(file_of(&[part, tiled], &[image.clone(), image.clone()]));
    }
    files
}

/// Limits that keep every block small.
fn small_limits() -> Limits {
    Limits { memory: 1 << 23 }
}

#[test]
fn a_file_truncated_anywhere_is_an_error() {
    for file in small_files() {
        for len in 0..file.len() {
            let e = read_all(file[..len].to_vec(), small_limits()).unwrap_err();
            assert!(!e.to_string().contains('\n'));
            assert_eq!(e.kind(), ErrorKind::Corrupt, "truncated to {len}: {e}");
        }
        read_all(file, small_limits()).unwrap();
    }
}

#[test]
fn a_file_with_any_byte_changed_is_read_or_refused() {
    for file in small_files() {
        for at in 0..file.len() {
            for change in [0x01, 0x80, 0xff] {
                let mut broken = file.clone();
                broken[at] ^= change;
                if let Err(e) = read_all(broken, small_limits()) {
                    assert!(!e.to_string().contains('\n'), "{e}");
                    assert_ne!(e.kind(), ErrorKind::Io, "byte {at}: {e}");
                }
            }
        }
    }
}

#[test]
fn files_with_random_bytes_are_read_or_refused() {
    let mut random = Random(77);
    for file in small_files() {
        for _ in 0..200 {
            let mut broken = file.clone();
            for _ in 0..1 + random.below(8) {
                let at = random.below(broken.len() as u32) as usize;
                broken[at] = random.below(256) as u8;
            }
            let _ = read_all(broken, small_limits());
        }
    }
}

/// An uncompressed scanline of two pixels with one sample each, and the offset of its chunk.
fn two_pixel_file() -> (Vec<u8>, usize) {
    let window = rect(0, 0, 2, 1);
    let mut part = Part::deep_scanline(window, vec![Channel::new("Z", SampleType::Float)]);
    part.compression = Compression::None;
    let block = DeepBlock {
        rect: window,
        offsets: vec![0, 1, 2],
        channels: vec![ChannelData::Float(vec![1.0, 2.0])],
    };
    let file = file_of(&[part], &[block]);
    let chunk = file.len() - (4 + 24 + 8 + 8);
    (file, chunk)
}

#[test]
fn forged_counts_and_sizes_are_refused() {
    let (file, chunk) = two_pixel_file();
    let table = chunk - 8;
    let huge = u64::MAX.to_le_bytes();
    for (at, bytes, kind, text) in [
        (table, &[0; 8][..], Corrupt, "unfinished: 1 of 1 blocks"),
        (table, &huge, Corrupt, "lies outside the blocks"),
        (table, &[1, 0, 0, 0], Corrupt, "lies outside the blocks"),
        (chunk, &[1], Corrupt, "belongs to another block"),
        (chunk + 4, &huge, Corrupt, "the file has only 16 left"),
        (chunk + 12, &huge, Corrupt, "the file has only 16 left"),
        (
            chunk + 20,
            &huge,
            Limit,
            "the block can take 18446744073709551615 bytes of memory",
        ),
        (
            chunk + 20,
            &[9],
            Corrupt,
            "states a decoded size of 9 bytes, but its counts need 8",
        ),
        (
            chunk + 4,
            &[7],
            Corrupt,
            "7 bytes cannot decode to 8 with None",
        ),
        (
            chunk + 12,
            &[7],
            Corrupt,
            "7 bytes cannot decode to 8 with None",
        ),
        (
            chunk + 28,
            &[9],
            Corrupt,
            "sample counts decrease along a row",
        ),
        (
            chunk + 32,
            &[255; 4],
            Corrupt,
            "but its counts need 17179869180",
        ),
        (chunk + 32, &[0, 1], Corrupt, "but its counts need 1024"),
    ] {
        let mut forged = file.clone();
        forged[at..at + bytes.len()].copy_from_slice(bytes);
        let e = read_all(forged, Limits::default()).unwrap_err();
        assert_eq!(e.kind(), kind, "{e}");
        assert!(e.to_string().contains(text), "{e}");
    }
}

#[test]
fn a_tile_larger_than_the_image_is_clipped_to_the_image() {
    let window = rect(0, 0, 3, 2);
    let image = image(window, &channels(), 6);
    for compression in [Compression::None, Compression::Zips] {
        let mut part = Part::deep_tiled(window, channels(), Tiles::new(64, 64));
        part.compression = compression;
        let mut file = file_of(&[part], std::slice::from_ref(&image));
        let name = b"tiles\0tiledesc\0";
        let at = file.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
        for side in [at, at + 4] {
            file[side..side + 4].copy_from_slice(&i32::MAX.to_le_bytes());
        }
        assert!(read_all(file.clone(), small_limits()).is_ok());
        file[at + 3] = 0x80;
        let e = read_all(file, small_limits()).unwrap_err();
        assert_eq!(e.kind(), Corrupt, "{e}");
    }
}

#[test]
fn zstandard_differences_are_summed_and_a_later_format_is_unsupported() {
    let window = rect(0, 0, 64, 1);
    let channels = vec![
        Channel::new("h", SampleType::Half),
        Channel::new("u", SampleType::Uint),
    ];
    let mut part = Part::deep_scanline(window, channels);
    part.compression = Compression::Zstd;
    let half = |bits: u16| f16::from_bits(bits);
    let block = DeepBlock {
        rect: window,
        offsets: (0..=64).collect(),
        channels: vec![
            ChannelData::Half(vec![half(0x8000 | 3); 64]),
            ChannelData::Uint(vec![u32::MAX; 64]),
        ],
    };
    let mut file = file_of(&[part], &[block]);
    // The frame of the samples, not that of the counts.
    let magic = file.windows(8).rposition(|w| w == b"zstd-exr").unwrap();
    file[magic + 8] = 2;
    file[magic + 12] = 1;
    let reader = DeepReader::from_reader(Cursor::new(file.clone())).unwrap();
    let summed = reader.read_block(0, 0).unwrap();
    let sums = (1..=64_u16).map(|i| half(i.wrapping_mul(0x8003)));
    assert_eq!(summed.channels[0], ChannelData::Half(sums.collect()));
    let sums = (1..=64_u32).map(|i| 0_u32.wrapping_sub(i));
    assert_eq!(summed.channels[1], ChannelData::Uint(sums.collect()));
    file[magic + 8] = 3;
    let e = read_all(file, small_limits()).unwrap_err();
    assert_eq!(e.kind(), ErrorKind::Unsupported, "{e}");
}

#[test]
fn parts_and_blocks_that_do_not_exist_are_input_errors() {
    let reader = DeepReader::from_reader(Cursor::new(two_pixel_file().0)).unwrap();
    for (part, block) in [(0, 1), (1, 0), (usize::MAX, usize::MAX)] {
        assert_eq!(
            reader.read_block(part, block).unwrap_err().kind(),
            ErrorKind::Input
        );
    }
    assert_eq!(
        DeepReader::open("/nowhere/at/all.exr").unwrap_err().kind(),
        ErrorKind::Io
    );
    assert!(DeepReader::open(env!("CARGO_MANIFEST_DIR")).is_err());
}
