//! Writes and reads the legal deep image that the bytes describe.
//!
//! Every value must be read back bit for bit.

use std::io::Cursor;

use deepshadow_exr::{
    Attribute, Channel, ChannelData, Compression, DeepBlock, DeepReader, DeepWriter, LineOrder,
    Part, Rect, SampleType, Tiles, f16,
};

use super::bytes::Bytes;

const NAMES: [&str; 6] = ["A", "R", "Z", "ZBack", "id", "smoke.A"];

/// A part and its samples, stored independently of blocks.
struct Image {
    part: Part,
    /// Number of samples of each pixel, row by row.
    counts: Vec<u32>,
    /// For each channel, the bits of all samples, pixel by pixel.
    bits: Vec<Vec<u32>>,
}

/// Checks one input: one image or two.
pub fn run(data: &[u8]) {
    let mut b = Bytes(data);
    let head = b.u8();
    let images: Vec<Image> = (0..1 + head % 4 / 3)
        .map(|i| image(&mut b, format!("part {i}")))
        .collect();
    check(&images, usize::from(b.u8()), i32::from(head >> 2) % 4);
}

fn image(b: &mut Bytes, name: String) -> Image {
    let (width, height) = match b.u8() {
        n @ 0..=199 => (1 + u32::from(n % 9), 1 + u32::from(n / 9 % 9)),
        n => (1 + u32::from(n - 200) * 4, 1),
    };
    let corner = |b: &mut Bytes| match b.u8() {
        0 => -(1 << 29),
        1 => 1 << 29,
        n => i32::from(n) - 60,
    };
    let window = Rect {
        x: corner(b),
        y: corner(b),
        width,
        height,
    };
    // One bit selects each name. If no bit is set, the channel is Z.
    let chosen = b.u8();
    let kinds = b.u16();
    let channels = NAMES.iter().enumerate().filter_map(|(i, name)| {
        let kind = match kinds >> (2 * i) & 3 {
            0 | 1 => SampleType::Float,
            2 => SampleType::Half,
            _ => SampleType::Uint,
        };
        (chosen >> i & 1 == 1 || chosen & 63 == 0 && i == 2).then(|| Channel::new(*name, kind))
    });
    let mut part = Part::deep_scanline(window, channels.collect());
    part.name = Some(name);
    part.attributes
        .push(Attribute::text("note", "any attribute"));
    part.display_window = Rect {
        x: corner(b),
        ..window
    };
    part.compression = [
        Compression::None,
        Compression::Rle,
        Compression::Zips,
        Compression::Zstd,
    ][usize::from(b.u8() % 4)];
    let order = b.u8();
    if order & 1 == 1 {
        part.tiles = Some(Tiles::new(
            1 + u32::from(b.u8() % 12),
            1 + u32::from(b.u8() % 12),
        ));
    }
    part.line_order = match order >> 1 & 3 {
        0 | 1 => LineOrder::Increasing,
        2 => LineOrder::Decreasing,
        _ if part.tiles.is_some() => LineOrder::Random,
        _ => LineOrder::Increasing,
    };
    let how = b.u8();
    let mut room = 2048u32;
    let counts: Vec<u32> = (0..width * height)
        .map(|_| {
            let n = match how % 4 {
                0 => u32::from(how / 4 % 4),
                1 => u32::from(b.u8() % 4),
                2 => u32::from(b.u8() == 1) * 300,
                _ => u32::from(b.u8() % 48),
            };
            let n = n.min(room);
            room -= n;
            n
        })
        .collect();
    let total: usize = counts.iter().map(|&n| n as usize).sum();
    let bits = (0..part.channels.len()).map(|_| values(b, total)).collect();
    Image { part, counts, bits }
}

/// Makes samples that pack well or badly: one value, runs, a ramp, the input's bytes or noise.
fn values(b: &mut Bytes, total: usize) -> Vec<u32> {
    let (how, mut at) = (b.u8(), b.u32());
    let step = u32::from(how >> 3);
    (0..total)
        .map(|i| {
            match how & 7 {
                0 => {}
                1 => at = at.wrapping_add(step),
                2 => at = at.wrapping_add(step << 19),
                3 if i % (step as usize + 1) == 0 => at = at.rotate_left(5) ^ 0x9e37,
                3 => {}
                4 => at = b.u32(),
                5 => at = u32::from(b.u8()) * 0x0101_0101,
                6 => at = if b.u8() & 1 == 0 { 0x7fc0_7e01 } else { at }, // NaN of either width
                _ => at = at.wrapping_mul(1_664_525).wrapping_add(1_013_904_223),
            }
            at
        })
        .collect()
}

impl Image {
    /// The pixels of `rect` as a block.
    fn block(&self, rect: Rect) -> DeepBlock {
        let window = self.part.data_window;
        let starts: Vec<u32> = self
            .counts
            .iter()
            .scan(0, |sum, &n| {
                *sum += n;
                Some(*sum - n)
            })
            .collect();
        let (mut offsets, mut picked) = (vec![0], Vec::new());
        for y in 0..rect.height {
            for x in 0..rect.width {
                let (dx, dy) = ((rect.x - window.x) as u32, (rect.y - window.y) as u32);
                let p = ((dy + y) * window.width + dx + x) as usize;
                picked.extend(starts[p]..starts[p] + self.counts[p]);
                offsets.push(picked.len() as u32);
            }
        }
        let channel = |(c, bits): (&Channel, &Vec<u32>)| {
            let bits = picked.iter().map(|&i| bits[i as usize]);
            match c.sample_type {
                SampleType::Half => {
                    ChannelData::Half(bits.map(|v| f16::from_bits(v as u16)).collect())
                }
                SampleType::Float => ChannelData::Float(bits.map(f32::from_bits).collect()),
                SampleType::Uint => ChannelData::Uint(bits.collect()),
            }
        };
        DeepBlock {
            rect,
            offsets,
            channels: self
                .part
                .channels
                .iter()
                .zip(&self.bits)
                .map(channel)
                .collect(),
        }
    }

    /// Rectangles in the order of writing: tiles, or bands of lines.
    ///
    /// `band` selects the height of the bands, and the first tile in random order.
    fn pieces(&self, band: usize) -> Vec<Rect> {
        let w = self.part.data_window;
        let (across, down) = match self.part.tiles {
            Some(t) => (t.width, t.height),
            None => (w.width, 1 + (band % 5) as u32),
        };
        let mut out = Vec::new();
        for top in (0..w.height).step_by(down as usize) {
            for left in (0..w.width).step_by(across as usize) {
                out.push(Rect {
                    x: w.x + left as i32,
                    y: w.y + top as i32,
                    width: across.min(w.width - left),
                    height: down.min(w.height - top),
                });
            }
        }
        match self.part.line_order {
            LineOrder::Increasing => {}
            LineOrder::Decreasing => out.reverse(),
            LineOrder::Random => {
                let turn = band % out.len();
                out.rotate_left(turn);
            }
        }
        out
    }
}

/// Writes images, reads them back and compares them: by blocks, whole and in part.
fn check(images: &[Image], band: usize, level: i32) {
    let mut bytes = Cursor::new(Vec::new());
    let parts = images.iter().map(|i| i.part.clone()).collect();
    let mut writer = DeepWriter::new(&mut bytes, parts).expect("legal parts");
    if level > 0 {
        writer.set_level(level);
    }
    for (p, image) in images.iter().enumerate() {
        for rect in image.pieces(band) {
            writer.write(p, &image.block(rect)).expect("a legal block");
        }
    }
    writer.finish().expect("every block was written");

    bytes.set_position(0);
    let reader = DeepReader::from_reader(bytes).expect("a legal file");
    assert_eq!(reader.parts().len(), images.len());
    for (p, image) in images.iter().enumerate() {
        let (part, given) = (&reader.parts()[p], &image.part);
        assert!(part.deep);
        assert_eq!(part.name, given.name);
        assert_eq!(part.data_window, given.data_window);
        assert_eq!(part.display_window, given.display_window);
        assert_eq!(part.channels, given.channels);
        assert_eq!(part.compression, given.compression);
        assert_eq!(part.line_order, given.line_order);
        assert_eq!(part.tiles, given.tiles);
        assert_eq!(part.attribute("note"), given.attribute("note"));
        let most = image.counts.iter().max().copied().unwrap_or(0);
        let said = part
            .attribute("maxSamplesPerPixel")
            .and_then(Attribute::as_int);
        assert_eq!(said, Some(most as i32));

        let mut seen = 0;
        for (b, rect) in part.blocks() {
            let block = reader.read_block(p, b).expect("a legal block");
            assert_same(&block, &image.block(rect));
            seen += rect.pixels();
        }
        assert_eq!(seen, given.data_window.pixels());
        let whole = reader
            .read_rect(p, given.data_window)
            .expect("the whole image");
        assert_same(&whole, &image.block(given.data_window));
        let w = given.data_window;
        let inner = Rect {
            x: w.x + w.width as i32 / 3,
            y: w.y + w.height as i32 / 2,
            width: w.width.div_ceil(2).min(w.width - w.width / 3),
            height: w.height - w.height / 2,
        };
        let some = reader.read_rect(p, inner).expect("a part of the image");
        assert_same(&some, &image.block(inner));
    }
}

/// Asserts that two blocks are equal bit for bit, including NaN.
fn assert_same(read: &DeepBlock, written: &DeepBlock) {
    assert_eq!(read.rect, written.rect);
    assert_eq!(read.offsets, written.offsets);
    assert_eq!(read.channels.len(), written.channels.len());
    for (a, b) in read.channels.iter().zip(&written.channels) {
        assert!(super::deep_exr::same(a, b), "{a:?} was {b:?}");
    }
}
