//! Measures the speed of reading and writing a deep OpenEXR file on one thread.
//!
//! `exr_speed FILE [scanline | WIDTHxHEIGHT] [repeats]` writes the first deep part to memory with
//! every compression, reads it back, and asserts that the values are equal. It prints MB of samples
//! per second.

use deepshadow_exr::{Compression, DeepBlock, DeepReader, DeepWriter, LineOrder, Part, Tiles};
use std::io::Cursor;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let reader = DeepReader::open(
        args.first()
            .ok_or("usage: exr_speed FILE [tiling] [repeats]")?,
    )?;
    let repeats: u32 = args.get(2).map_or(Ok(5), |r| r.parse())?;
    let index = reader
        .parts()
        .iter()
        .position(|p| p.deep)
        .ok_or("no deep part")?;
    let mut part = Part {
        name: None,
        line_order: LineOrder::Increasing,
        tiles: None,
        ..reader.parts()[index].clone()
    };
    if let Some((w, h)) = args.get(1).and_then(|t| t.split_once('x')) {
        part.tiles = Some(Tiles::new(w.parse()?, h.parse()?));
    }
    let image = reader.read_rect(index, part.data_window)?;
    let payload = image.sample_count() * part.sample_bytes() + 4 * image.offsets.len();
    println!("{:.1} MB of samples and counts", payload as f64 / 1e6);
    println!("compression   file MB  write MB/s   read MB/s  (best of {repeats})");
    for compression in [
        Compression::None,
        Compression::Rle,
        Compression::Zips,
        Compression::Zstd,
    ] {
        part.compression = compression;
        let blocks: Option<Vec<DeepBlock>> = part.blocks().map(|(_, r)| image.crop(r)).collect();
        let blocks = blocks.ok_or("a block lies outside the image")?;
        let (mut write, mut read) = (f64::MAX, f64::MAX);
        let mut bytes = Vec::new();
        for _ in 0..repeats {
            let mut out = Cursor::new(std::mem::take(&mut bytes));
            let start = Instant::now();
            let mut writer = DeepWriter::new(&mut out, vec![part.clone()])?;
            for block in &blocks {
                writer.write(0, block)?;
            }
            writer.finish()?;
            write = write.min(start.elapsed().as_secs_f64());
            bytes = out.into_inner();
        }
        for _ in 0..repeats {
            let copy = DeepReader::from_reader(Cursor::new(bytes.clone()))?;
            let mut block = DeepBlock::default();
            let start = Instant::now();
            for i in 0..blocks.len() {
                copy.read_block_into(0, i, &mut block)?;
                std::hint::black_box(&block);
            }
            read = read.min(start.elapsed().as_secs_f64());
            for (i, expected) in blocks.iter().enumerate() {
                assert_eq!(
                    &copy.read_block(0, i)?,
                    expected,
                    "block {i} with {compression:?}"
                );
            }
        }
        let rate = |seconds: f64| payload as f64 / 1e6 / seconds;
        println!(
            "{:<11} {:>9.2} {:>11.0} {:>11.0}",
            format!("{compression:?}"),
            bytes.len() as f64 / 1e6,
            rate(write),
            rate(read)
        );
    }
    Ok(())
}
