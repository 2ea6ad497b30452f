//! The memory that a file causes stays within the limit, whatever its bytes are.

use crate::common::*;
use crate::heap::peak_of;
use deepshadow_exr::*;
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer, LayerAttributes};
use std::io::Cursor;

/// Pictures with every codec, flat and deep.
fn pictures() -> Vec<(String, Vec<u8>)> {
    let mut out = flat_pictures();
    let image = image(rect(0, 0, 6, 5), &channels(), 9);
    for compression in COMPRESSIONS {
        let mut part = Part::deep_tiled(image.rect, channels(), Tiles::new(4, 4));
        part.compression = compression;
        let file = file_of(&[part], std::slice::from_ref(&image));
        out.push((format!("deep-{compression:?}"), file));
    }
    out
}

/// Reads a file on a thread without working memory, and asserts that its memory is bounded.
fn read_within(bytes: &[u8], memory: u64) -> Result<usize> {
    let file = Cursor::new(bytes.to_vec());
    let (result, peak) = peak_of(|| {
        let reader = DeepReader::from_reader_with(file, Limits { memory })?;
        read_everything(&reader)
    });
    assert!(
        peak as u64 <= memory,
        "{peak} bytes for a limit of {memory}: {result:?}"
    );
    result
}

/// Runs `test` for each picture on a new thread: no earlier block left working memory behind.
fn for_each_picture(test: impl Fn(&str, &[u8]) + Sync) {
    let pictures = pictures();
    std::thread::scope(|scope| {
        for (name, picture) in &pictures {
            let test = &test;
            scope.spawn(move || test(name, picture));
        }
    });
}

#[test]
fn any_changed_byte_of_any_codec_keeps_the_limit() {
    for_each_picture(|name, picture| {
        let memory = 1 << 23;
        assert!(read_within(picture, memory).unwrap_or_else(|e| panic!("{name}: {e}")) > 0);
        let mut refused = 0;
        for at in 0..picture.len() {
            let old = picture[at];
            for new in [0, 0xff, old.wrapping_add(1), old.wrapping_sub(1)] {
                let mut changed = picture.to_vec();
                changed[at] = new;
                if let Err(e) = read_within(&changed, memory) {
                    let text = e.to_string();
                    assert!(
                        !text.contains('\n') && !text.contains("panicked"),
                        "{name}: {e}"
                    );
                    assert_ne!(e.kind(), ErrorKind::Io, "{name}, byte {at}: {e}");
                    refused += 1;
                }
            }
        }
        assert!(refused > 100, "{name}: only {refused} changes were noticed");
    });
}

#[test]
fn a_rectangle_takes_no_more_than_the_smallest_limit_that_admits_it() {
    for_each_picture(|name, picture| {
        let (mut low, mut high) = (0, 1 << 23);
        while high - low > 1 {
            let memory = low + (high - low) / 2;
            let file = Cursor::new(picture.to_vec());
            let (result, peak) = peak_of(|| {
                let reader = DeepReader::from_reader_with(file, Limits { memory })?;
                reader.read_rect(0, reader.parts()[0].data_window)
            });
            assert!(peak as u64 <= memory, "{name}: {peak} of {memory} bytes");
            match result {
                Ok(_) => high = memory,
                Err(e) => {
                    assert_eq!(e.kind(), ErrorKind::Limit, "{name}: {e}");
                    low = memory;
                }
            }
        }
        assert!(high < 1 << 23, "{name}");
    });
}

/// A picture of 1024 x 256 pixels with three channels of `values`, written by the `exr` crate.
fn large_picture(compression: exr::compression::Compression, values: FlatSamples) -> Vec<u8> {
    let channel = |name| AnyChannel::new(name, values.clone());
    let channels = AnyChannels::sort(["A", "B", "R"].into_iter().map(channel).collect());
    let encoding = Encoding {
        compression,
        ..Encoding::UNCOMPRESSED
    };
    let attributes = LayerAttributes::default();
    flat_bytes(Layer::new((1024, 256), attributes, encoding, channels))
}

#[test]
fn large_blocks_stay_below_the_memory_that_their_sizes_let_expect() {
    use exr::compression::Compression as C;
    let lossy = [C::PXR24, C::B44, C::B44A, C::DWAA(None), C::DWAB(None)];
    for compression in [C::RLE, C::ZIP1, C::ZIP16, C::PIZ].into_iter().chain(lossy) {
        let mut random = Random(3);
        let mut noise = || {
            (0..1024 * 256)
                .map(|_| random.below(1000) as f32 / 1000.0)
                .collect()
        };
        let halves = |v: Vec<f32>| FlatSamples::F16(v.iter().map(|&v| f16::from_f32(v)).collect());
        let black = || vec![0.0; 1024 * 256];
        let pictures = [
            FlatSamples::F32(black()),
            FlatSamples::F32(noise()),
            halves(black()),
            halves(noise()),
        ];
        for (which, values) in pictures.into_iter().enumerate() {
            let file = large_picture(compression, values);
            let read = move |memory| {
                let file = Cursor::new(file.clone());
                peak_of(|| {
                    let reader = DeepReader::from_reader_with(file, Limits { memory })?;
                    reader.read_block(0, 0)
                })
            };
            let run = move || {
                // The error states the memory that the block can take.
                let text = read(1 << 20).0.unwrap_err().to_string();
                let words: Vec<&str> = text.split(' ').collect();
                let can_take = words.iter().position(|w| *w == "take").unwrap();
                let memory = words[can_take + 1].parse::<u64>().unwrap() + 1;
                let (block, peak) = read(memory);
                let block = block.unwrap();
                assert!(
                    peak as u64 <= memory,
                    "{compression}: {peak} of {memory} bytes"
                );
                assert!(which % 2 == 1 || (0..1024).all(|i| block.channels[2].get(i) == 0.0));
            };
            std::thread::spawn(run).join().unwrap();
        }
    }
}

#[test]
fn forged_counts_of_a_dwa_block_are_refused() {
    for (name, picture) in pictures() {
        if !name.contains("dwa") {
            continue;
        }
        // The version, 2, then counters that are less than 2^24.
        let is_block = |b: &[u8]| {
            let counters = b.as_chunks::<8>().0;
            counters[0] == [2, 0, 0, 0, 0, 0, 0, 0]
                && counters[1..].iter().all(|c| c[3..] == [0; 5])
        };
        let block = picture.windows(88).position(is_block).unwrap();
        for counter in 1..11 {
            for value in [
                1 << 16,
                1 << 32,
                i64::MAX as u64 / 2,
                i64::MAX as u64,
                u64::MAX,
            ] {
                let mut forged = picture.clone();
                forged[block + 8 * counter..][..8].copy_from_slice(&u64::to_le_bytes(value));
                let e = read_within(&forged, 1 << 23).unwrap_err();
                assert_eq!(
                    e.kind(),
                    ErrorKind::Corrupt,
                    "{name}, counter {counter}: {e}"
                );
                assert!(
                    !e.to_string().contains("panicked"),
                    "{name}, counter {counter}: {e}"
                );
            }
        }
        // More rules than OpenEXR writes.
        let mut forged = picture.clone();
        forged[block + 89] = 0x40;
        assert!(
            read_within(&forged, 1 << 23)
                .unwrap_err()
                .to_string()
                .contains("bytes of rules")
        );
    }
}
