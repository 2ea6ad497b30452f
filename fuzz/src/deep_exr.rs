//! Reads any bytes as a deep OpenEXR file, with small limits.
//!
//! Every image that is read must survive a rewrite bit for bit. Bytes that do not begin like a file
//! describe a legal image instead (see `deep_exr_legal`).

use std::io::Cursor;

use deepshadow_exr::{
    ChannelData, DeepBlock, DeepReader, DeepWriter, ErrorKind, Limits, LineOrder, Part, samples,
};

/// Bytes that a reader may allocate.
const MEMORY: u64 = 8 << 20;

/// Checks one input. It is a file if it begins with the first byte of the magic number.
pub fn run(data: &[u8]) {
    if data.first() != Some(&0x76) {
        return super::deep_exr_legal::run(data);
    }
    let file_fault = |kind: ErrorKind| {
        assert!(
            kind != ErrorKind::Input,
            "a fault of the file is reported as the caller's"
        )
    };
    let reader =
        match DeepReader::from_reader_with(Cursor::new(data.to_vec()), Limits { memory: MEMORY }) {
            Ok(reader) => reader,
            Err(e) => return file_fault(e.kind()),
        };
    let mut deep: Vec<(Part, Vec<DeepBlock>)> = Vec::new();
    for (p, part) in reader.parts().iter().enumerate() {
        let sample_channels = samples::SampleChannels::of(part, None).ok();
        let mut blocks = Vec::new();
        // One block of a large image suffices.
        let small = part.data_window.pixels() <= 1 << 12;
        let mut all_read = small;
        for (b, rect) in part.blocks().take(if small { usize::MAX } else { 1 }) {
            let block = match reader.read_block(p, b) {
                Ok(block) => block,
                Err(e) => {
                    file_fault(e.kind());
                    all_read = false;
                    continue;
                }
            };
            assert_eq!(block.rect, rect);
            assert_eq!(block.offsets.len() as u64, rect.pixels() + 1);
            assert!(block.offsets.is_sorted());
            assert_eq!(block.channels.len(), part.channels.len());
            assert!(
                block
                    .channels
                    .iter()
                    .all(|c| c.len() == block.sample_count())
            );
            if let Some(sample_channels) = &sample_channels {
                let (mut repairs, mut out) = (Default::default(), Vec::new());
                for pixel in 0..rect.pixels() as usize {
                    if sample_channels
                        .pixel(&block, pixel, Default::default(), &mut repairs, &mut out)
                        .is_ok()
                    {
                        assert!(out.iter().all(|s| s.z.is_finite() && s.z_back >= s.z));
                    }
                }
            }
            blocks.push(block);
        }
        if all_read && part.deep {
            deep.push((part.clone(), blocks));
        }
    }
    if !deep.is_empty() {
        rewrite(&deep);
    }
}

/// Writes parts whose blocks were read, reads them back and compares.
fn rewrite(deep: &[(Part, Vec<DeepBlock>)]) {
    let parts = deep
        .iter()
        .map(|(p, _)| Part {
            line_order: LineOrder::Increasing,
            ..p.clone()
        })
        .collect();
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = match DeepWriter::new(&mut bytes, parts) {
        Ok(writer) => writer,
        // The writer rejects some legal files, such as those with duplicate names or with other
        // compressions.
        Err(e) => {
            return assert!(
                e.kind() == ErrorKind::Input || e.kind() == ErrorKind::Unsupported,
                "{e}"
            );
        }
    };
    for (p, (_, blocks)) in deep.iter().enumerate() {
        let mut blocks: Vec<&DeepBlock> = blocks.iter().collect();
        blocks.sort_by_key(|b| (b.rect.y, b.rect.x));
        for block in blocks {
            writer.write(p, block).expect("a block that was read");
        }
    }
    writer.finish().expect("every block was written");
    let second =
        DeepReader::from_reader(Cursor::new(bytes.into_inner())).expect("our own file is legal");
    for (p, (part, blocks)) in deep.iter().enumerate() {
        assert_eq!(second.parts()[p].channels, part.channels);
        for block in blocks {
            let back = second
                .read_rect(p, block.rect)
                .expect("our own file is legal");
            assert_eq!(back.offsets, block.offsets);
            assert!(
                back.channels
                    .iter()
                    .zip(&block.channels)
                    .all(|(a, b)| same(a, b))
            );
        }
    }
}

/// Whether two channels are equal bit for bit, including NaN.
pub fn same(a: &ChannelData, b: &ChannelData) -> bool {
    match (a, b) {
        (ChannelData::Half(a), ChannelData::Half(b)) => a
            .iter()
            .map(|v| v.to_bits())
            .eq(b.iter().map(|v| v.to_bits())),
        (ChannelData::Float(a), ChannelData::Float(b)) => a
            .iter()
            .map(|v| v.to_bits())
            .eq(b.iter().map(|v| v.to_bits())),
        (a, b) => a == b,
    }
}
