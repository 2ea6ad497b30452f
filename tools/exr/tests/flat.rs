//! Flat images, and parts with smaller levels.

use crate::common::*;
use deepshadow_exr::samples::{Policy, Repairs, SampleChannels};
use deepshadow_exr::*;
use exr::prelude::*;
use std::io::Cursor;

/// Depth and opacity of a pixel of a smooth flat image.
fn pixel(x: usize, y: usize) -> (f32, f32) {
    let z = if (x + y).is_multiple_of(7) {
        f32::INFINITY
    } else {
        10.0 + x as f32 + y as f32 / 4.0
    };
    (z, f32::from(f16::from_f32((x % 5) as f32 / 4.0)))
}

/// A flat image with a float Z and a half A, written by the `exr` crate.
fn flat_file(compression: exr::compression::Compression, blocks: Blocks) -> Vec<u8> {
    let size = (37, 41);
    let z = FlatSamples::F32((0..37 * 41).map(|i| pixel(i % 37, i / 37).0).collect());
    let a = (0..37 * 41).map(|i| exr::prelude::f16::from_f32(pixel(i % 37, i / 37).1));
    let channels = AnyChannels::sort(
        [
            AnyChannel::new("Z", z),
            AnyChannel::new("A", FlatSamples::F16(a.collect())),
        ]
        .into_iter()
        .collect(),
    );
    let encoding = Encoding {
        compression,
        blocks,
        line_order: exr::prelude::LineOrder::Increasing,
    };
    let mut attributes = LayerAttributes::named("flat");
    attributes.layer_position = Vec2(-4, 9);
    flat_bytes(Layer::new(size, attributes, encoding, channels))
}

#[test]
fn flat_pixels_have_one_sample_or_none_at_infinite_depth() {
    use exr::compression::Compression as C;
    for compression in [C::Uncompressed, C::RLE, C::ZIP1, C::ZIP16, C::PIZ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8))] {
            let bytes = flat_file(compression, blocks);
            let reader = DeepReader::from_reader(Cursor::new(bytes)).unwrap();
            let part = &reader.parts()[0];
            assert!(!part.deep);
            assert_eq!(part.data_window, rect(-4, 9, 37, 41));
            let block = reader.read_rect(0, part.data_window).unwrap();
            let channels = SampleChannels::of(part, None).unwrap();
            let (mut repairs, mut out) = (Repairs::default(), Vec::new());
            for p in 0..37 * 41 {
                channels
                    .pixel(&block, p, Policy::Strict, &mut repairs, &mut out)
                    .unwrap();
                let (z, a) = pixel(p % 37, p / 37);
                let expected = (z.is_finite() && a > 0.0).then_some((z, [a; 3]));
                let found = out.first().map(|s| (s.z, s.opacity));
                assert_eq!(found, expected, "pixel {p} with {compression:?}");
            }
        }
    }
}

#[test]
fn pictures_by_openexr_have_the_values_of_their_script_with_every_codec() {
    for (name, picture) in flat_pictures() {
        let reader = DeepReader::from_reader(Cursor::new(picture)).unwrap();
        for (index, part) in reader.parts().iter().enumerate() {
            let block = reader.read_rect(index, part.data_window).unwrap();
            let value = |channel, p| block.channels[part.channel(channel).unwrap()].get(p);
            for p in 0..part.data_window.pixels() as usize {
                let width = part.data_window.width as usize;
                let (x, y) = ((p % width) as f32, (p / width) as f32);
                assert_eq!(
                    value("Z", p),
                    (10.0 + x + y / 4.0).floor(),
                    "{name}, pixel {p}"
                );
                let opacity = if x + y > 9.0 { 1.0 } else { 0.5 };
                assert_eq!(value("A", p), opacity, "{name}, pixel {p}");
                let colours = [
                    ("R", x / 8.0 + y / 64.0),
                    ("G", 0.5 + 0.25 * (x / 3.0).sin() * (y / 5.0).cos()),
                    ("B", y / 32.0),
                ];
                for (channel, expected) in colours {
                    let found = value(channel, p);
                    assert!(
                        (found - expected).abs() < 0.05,
                        "{name}, pixel {p}: {channel} {found}"
                    );
                }
            }
        }
    }
}

#[test]
fn only_the_full_size_level_is_read() {
    let window = rect(0, 0, 20, 10);
    let image = image(window, &channels(), 8);
    let part = Part::deep_tiled(window, channels(), Tiles::new(8, 8));
    let one_level = file_of(&[part], std::slice::from_ref(&image));
    // Pretend that levels 10x5, 5x2, 2x1 and 1x1, of 2 + 1 + 1 + 1 tiles, follow the six tiles of
    // 20x10.
    let find = |name: &[u8]| {
        one_level
            .windows(name.len())
            .position(|w| w == name)
            .unwrap()
            + name.len()
    };
    let tiles = find(b"tiles\0tiledesc\0");
    let count = find(b"chunkCount\0int\0");
    // Skip the length, the value and the empty name that ends the header.
    let table = find(b"version\0int\0") + 9;
    let mut file = one_level[..table].to_vec();
    file[tiles + 4 + 8] = 1;
    file[count + 4] = 11;
    let mut offsets: Vec<u64> = one_level[table..table + 48]
        .chunks_exact(8)
        .map(|b| u64::from_le_bytes(b.try_into().unwrap()) + 40)
        .collect();
    offsets.extend([offsets[0]; 5]);
    file.extend(offsets.iter().flat_map(|o| o.to_le_bytes()));
    file.extend_from_slice(&one_level[table + 48..]);
    let reader = DeepReader::from_reader(Cursor::new(file)).unwrap();
    assert_eq!(
        reader.parts()[0].tiles.unwrap().levels,
        deepshadow_exr::LevelMode::Mipmap
    );
    assert_eq!(reader.parts()[0].block_count(), 6);
    assert_eq!(reader.read_rect(0, window).unwrap(), image);
}
