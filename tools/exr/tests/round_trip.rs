//! The reader returns the values that the writer wrote.

use crate::common::*;
use deepshadow_exr::*;
use std::io::Cursor;

fn assert_read_back(bytes: Vec<u8>, part: usize, image: &DeepBlock) {
    let reader = DeepReader::from_reader(Cursor::new(bytes)).unwrap();
    let window = reader.parts()[part].data_window;
    assert_eq!(&reader.read_rect(part, window).unwrap(), image);
}

#[test]
fn every_compression_and_tiling_preserves_the_samples() {
    let window = rect(-7, -3, 37, 21);
    let image = image(window, &channels(), 1);
    for compression in COMPRESSIONS {
        for tiles in [
            None,
            Some((16, 8)),
            Some((64, 64)),
            Some((1, 1)),
            Some((37, 21)),
        ] {
            for line_order in [
                LineOrder::Increasing,
                LineOrder::Decreasing,
                LineOrder::Random,
            ] {
                if tiles.is_none() && line_order == LineOrder::Random {
                    continue;
                }
                let mut part = Part::deep_scanline(window, channels());
                part.compression = compression;
                part.tiles = tiles.map(|(w, h)| Tiles::new(w, h));
                part.line_order = line_order;
                part.display_window = rect(0, 0, 20, 20);
                let bytes = file_of(&[part], std::slice::from_ref(&image));
                assert_read_back(bytes, 0, &image);
            }
        }
    }
}

#[test]
fn every_combination_of_types_preserves_the_samples() {
    use SampleType::{Float, Half, Uint};
    let window = rect(3, 4, 19, 9);
    for types in [
        &[Half][..],
        &[Float],
        &[Uint],
        &[Float, Half],
        &[Half, Half, Uint, Half],
    ] {
        let names = ["A", "B", "C", "D"];
        let channels: Vec<Channel> = names
            .iter()
            .zip(types)
            .map(|(n, &t)| Channel::new(*n, t))
            .collect();
        let image = image(window, &channels, 2);
        for compression in COMPRESSIONS {
            for tiles in [None, Some(Tiles::new(8, 4))] {
                let mut part = Part::deep_scanline(window, channels.clone());
                part.compression = compression;
                part.tiles = tiles;
                assert_read_back(file_of(&[part], std::slice::from_ref(&image)), 0, &image);
            }
        }
    }
}

#[test]
fn special_values_keep_their_bits() {
    let window = rect(0, 0, 1, 1);
    let channels = vec![
        Channel::new("h", SampleType::Half),
        Channel::new("z", SampleType::Float),
    ];
    for compression in COMPRESSIONS {
        let mut part = Part::deep_scanline(window, channels.clone());
        part.compression = compression;
        let halves = [0x0001, 0x8000, 0x7c00, 0xfc00, 0x7e01, 0x3c00].map(f16::from_bits);
        let floats = [
            1,
            0x8000_0000,
            0x7f80_0000,
            0xff80_0000,
            0x7fc0_0001,
            0x3f80_0000,
        ]
        .map(f32::from_bits);
        let block = DeepBlock {
            rect: window,
            offsets: vec![0, 6],
            channels: vec![
                ChannelData::Half(halves.to_vec()),
                ChannelData::Float(floats.to_vec()),
            ],
        };
        let reader = DeepReader::from_reader(Cursor::new(file_of(&[part], &[block]))).unwrap();
        let back = reader.read_block(0, 0).unwrap();
        match &back.channels[..] {
            [ChannelData::Half(h), ChannelData::Float(z)] => {
                assert_eq!(
                    h.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
                    halves.map(f16::to_bits)
                );
                assert_eq!(
                    z.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
                    floats.map(f32::to_bits)
                );
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn an_image_without_samples_is_read_back_empty() {
    let window = rect(0, -2, 5, 3);
    for compression in COMPRESSIONS {
        for tiles in [None, Some(Tiles::new(2, 2))] {
            let mut part = Part::deep_scanline(window, channels());
            part.compression = compression;
            part.tiles = tiles;
            let mut image = DeepBlock::with_channels(window, &channels());
            (0..window.pixels()).for_each(|_| image.push_pixel());
            assert_read_back(file_of(&[part], std::slice::from_ref(&image)), 0, &image);
        }
    }
}

#[test]
fn parts_of_several_kinds_share_a_file() {
    let windows = [
        rect(0, 0, 10, 10),
        rect(-5, -5, 33, 7),
        rect(100, 200, 3, 30),
    ];
    let mut parts: Vec<Part> = windows.map(|w| Part::deep_scanline(w, channels())).into();
    for (part, name) in
        parts
            .iter_mut()
            .zip(["left", "right", "a name of more than thirty-one bytes"])
    {
        part.name = Some(name.into());
        part.attributes.push(Attribute::text(
            "a custom attribute, also with a long name",
            name,
        ));
    }
    parts[1].tiles = Some(Tiles::new(8, 4));
    parts[1].compression = Compression::Zstd;
    parts[2].compression = Compression::None;
    parts[2].line_order = LineOrder::Decreasing;
    let images: Vec<DeepBlock> = (0..3)
        .map(|i| image(windows[i], &channels(), i as u64))
        .collect();
    let bytes = file_of(&parts, &images);
    for (i, image) in images.iter().enumerate() {
        assert_read_back(bytes.clone(), i, image);
    }
    let reader = DeepReader::from_reader(Cursor::new(bytes)).unwrap();
    assert_eq!(reader.parts()[2].name, parts[2].name);
    assert_eq!(reader.parts()[1].tiles, parts[1].tiles);
}

#[test]
fn attributes_are_preserved_and_computed_attributes_are_right() {
    let window = rect(2, 3, 11, 6);
    let mut part = Part::deep_scanline(window, channels());
    part.display_window = rect(0, 0, 640, 480);
    let matrix = std::array::from_fn(|i| i as f32 - 0.5);
    part.attributes = vec![
        Attribute::m44f("worldToCamera", matrix),
        Attribute::new("strange", "neverHeardOf", vec![0, 255, 3]),
        Attribute::float("screenWindowWidth", 2.0),
        Attribute::int("chunkCount", 99),
    ];
    let image = image(window, &channels(), 5);
    let bytes = file_of(&[part], std::slice::from_ref(&image));
    let reader = DeepReader::from_reader(Cursor::new(bytes)).unwrap();
    let back = &reader.parts()[0];
    assert_eq!(back.display_window, rect(0, 0, 640, 480));
    assert_eq!(
        back.attribute("worldToCamera").unwrap().as_m44f(),
        Some(matrix)
    );
    assert_eq!(back.attribute("strange").unwrap().value, [0, 255, 3]);
    assert_eq!(
        back.attribute("screenWindowWidth").unwrap().as_float(),
        Some(2.0)
    );
    assert_eq!(
        back.attribute("pixelAspectRatio").unwrap().as_float(),
        Some(1.0)
    );
    assert_eq!(back.attribute("chunkCount").unwrap().as_int(), Some(6));
    assert_eq!(
        back.attribute("maxSamplesPerPixel").unwrap().as_int(),
        Some(40)
    );
    assert_eq!(
        back.attribute("type").unwrap().as_text(),
        Some("deepscanline")
    );
    assert!(back.attributes.is_sorted_by(|a, b| a.name < b.name));
}

#[test]
fn any_rectangle_can_be_read() {
    let window = rect(-7, -3, 37, 21);
    let image = image(window, &channels(), 9);
    for tiles in [None, Some(Tiles::new(16, 8))] {
        let mut part = Part::deep_scanline(window, channels());
        part.tiles = tiles;
        let bytes = file_of(&[part], std::slice::from_ref(&image));
        let reader = DeepReader::from_reader(Cursor::new(bytes)).unwrap();
        for r in [
            rect(-7, -3, 1, 1),
            rect(8, 4, 2, 2),
            rect(-6, -2, 35, 19),
            rect(29, 17, 1, 1),
        ] {
            assert_eq!(reader.read_rect(0, r).unwrap(), image.crop(r).unwrap());
        }
        for r in [rect(-8, 0, 2, 2), rect(0, 0, 0, 4), rect(0, 17, 1, 2)] {
            assert_eq!(reader.read_rect(0, r).unwrap_err().kind(), ErrorKind::Input);
        }
    }
}

#[test]
fn several_threads_read_one_file_and_encode_another() {
    let window = rect(0, 0, 64, 64);
    let image = image(window, &channels(), 11);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let part = Part::deep_tiled(window, channels(), Tiles::new(16, 16));
    let file = std::fs::File::create(&path).unwrap();
    let mut writer = DeepWriter::new(file, vec![part.clone()]).unwrap();
    let encoder = writer.encoder(0).unwrap();
    let blocks: Vec<Rect> = part.blocks().map(|(_, r)| r).collect();
    let packed = std::thread::scope(|s| {
        let halves = [0, 1].map(|half| {
            let (blocks, encoder, image) = (&blocks, &encoder, &image);
            s.spawn(move || {
                let mine = blocks.iter().skip(half).step_by(2);
                mine.map(|&r| encoder.encode(&image.crop(r).unwrap()).unwrap())
                    .collect::<Vec<_>>()
            })
        });
        halves.map(|thread| thread.join().unwrap()).concat()
    });
    packed
        .into_iter()
        .rev()
        .for_each(|p| writer.write_encoded(p).unwrap());
    writer.finish().unwrap();
    let reader = DeepReader::open(&path).unwrap();
    std::thread::scope(|s| {
        for thread in 0..4 {
            let (reader, blocks, image) = (&reader, &blocks, &image);
            s.spawn(move || {
                for i in (thread..blocks.len()).step_by(4) {
                    let expected = image.crop(blocks[i]).unwrap();
                    assert_eq!(reader.read_block(0, i).unwrap(), expected);
                }
            });
        }
    });
}

#[test]
fn a_file_without_all_its_blocks_cannot_be_finished() {
    let window = rect(0, 0, 4, 2);
    let image = image(window, &channels(), 3);
    let part = Part::deep_scanline(window, channels());
    let start = || DeepWriter::new(Cursor::new(Vec::new()), vec![part.clone()]).unwrap();
    assert_eq!(
        start().finish().unwrap_err().to_string(),
        "2 of 2 blocks were not written (part 0, block 0)"
    );
    let mut writer = start();
    writer.write(0, &image).unwrap(); // both lines at once
    let reader = DeepReader::from_reader(writer.finish().unwrap()).unwrap();
    assert_eq!(reader.read_rect(0, window).unwrap(), image);
}

#[test]
fn blocks_of_another_part_or_order_are_refused() {
    let window = rect(0, 0, 4, 2);
    let image = image(window, &channels(), 3);
    let mut bytes = Cursor::new(Vec::new());
    let part = Part::deep_scanline(window, channels());
    let mut writer = DeepWriter::new(&mut bytes, vec![part.clone()]).unwrap();
    let line = |y| image.crop(rect(0, y, 4, 1)).unwrap();
    let text = |r: Result<()>| r.unwrap_err().to_string();
    assert_eq!(
        text(writer.write(0, &line(1))),
        "the order is Increasing, so the next block is 0 (part 0, block 1)"
    );
    writer.write(0, &line(0)).unwrap();
    assert_eq!(
        text(writer.write(0, &line(0))),
        "the block was already written (part 0, block 0)"
    );
    assert!(
        writer
            .write(0, &image.crop(rect(0, 1, 3, 1)).unwrap())
            .is_err()
    );
    assert!(writer.write(1, &line(1)).is_err());
    let mut bad = line(1);
    bad.channels.swap(0, 1);
    assert!(writer.write(0, &bad).is_err());
    let mut bad = line(1);
    bad.offsets.pop();
    assert!(writer.write(0, &bad).is_err());
    for change in [
        (|p: &mut Part| p.channels.clear()) as fn(&mut Part),
        |p| p.channels.reverse(),
        |p| p.compression = Compression::Zip,
        |p| p.data_window.width = 0,
        |p| p.data_window.x = i32::MAX,
        |p| p.deep = false,
        |p| p.line_order = LineOrder::Random,
        |p| p.tiles = Some(Tiles::new(0, 1)),
        |p| p.tiles = Some(Tiles::new(1 << 30, 1 << 30)),
        |p| p.attributes.push(Attribute::text("", "")),
    ] {
        let mut part = part.clone();
        change(&mut part);
        let e = DeepWriter::new(Cursor::new(Vec::new()), vec![part])
            .err()
            .unwrap();
        assert_eq!(e.kind(), ErrorKind::Input);
    }
}
