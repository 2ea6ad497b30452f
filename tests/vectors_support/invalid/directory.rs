//! Directory blocks, and entries whose payload is sound.

use super::*;

pub fn add(add: &mut Add<'_>) {
    blocks(add);
    entries(add);
    ranges(add);
    cover(add);
}

fn blocks(add: &mut Add<'_>) {
    let small = small();
    let b = small.block(0);
    let block = |at: usize, bytes: &[u8]| small.clone().put(b + at, bytes).signed();
    let crc = [small.0[b + 12] ^ 1];
    add("BLOCK-CRC", small.clone().put(b + 12, &crc).sign_footer());
    add("BLOCK-RESERVED", block(23, &[1]));
    add("unsupported-codec-of-block", block(16, &[3]));
    add("unsupported-codec-of-block-private", block(16, &[200]));

    let entry = small.0[small.directory()..small.footer()].to_vec();
    let padded = small.clone().block_of(0, &entry, &[0; 8]);
    add("BLOCK-PADDING", padded.signed());
    let frame = codecs::literals(&entry);
    let padded = small.clone().block_of(1, &frame, &[0, 0, 0, 0, 0, 1]);
    add("BLOCK-PADDING-not-zero", padded.signed());
    let size = small
        .clone()
        .block_of(0, &[&entry[..], &[0; 48]].concat(), &[]);
    add("BLOCK-SIZE", size.signed());
    // The last bytes of an empty entry are zeros.
    let lit = lit();
    let empty = lit.0[lit.directory()..lit.footer()].to_vec();
    let size = lit.clone().block_of(0, &empty[..40], &[]);
    add("BLOCK-SIZE-short", size.signed());
    // Three empty entries in byte planes.
    let three = one(header("map", 24, 8, 1), |_, _| Visibility::lit());
    let planes: Vec<u8> = empty.iter().flat_map(|&byte| [byte; 3]).collect();
    for (name, codec, frame) in codecs::broken(&planes) {
        let padding = frame.len().next_multiple_of(8) - frame.len();
        let p = three.clone().block_of(codec, &frame, &vec![0; padding]);
        add(&format!("BLOCK-SIZE-{name}"), p.signed());
    }

    // Two blocks of 52 bytes: together they cover the directory.
    let two = levels_of(
        header("map", 2, 1, 1),
        [
            vec![(Entry::default(), vec![])],
            vec![(Entry::default(), vec![])],
        ],
    );
    let frame = codecs::literals(&empty);
    let p = two.blocks(&[&empty[..], &[0; 4], &frame, &[0; 2]].concat());
    let (start, [b, c]) = (p.directory() as u64, [0, 1].map(|i| p.block(i)));
    let p = p.put(b + 8, &[52]).put(b + 16, &[0, 4]);
    let p = p
        .put(c, &(start + 52).to_le_bytes())
        .put(c + 8, &[52])
        .put(c + 16, &[1, 2]);
    add("BLOCK-RANGE-unaligned", p.signed());
    // The block is the value of an attribute, and the directory is empty.
    let record = &lit.0[lit.footer()..lit.trailer() - 7];
    let mut footer = [record, &[0; 7]].concat();
    attribute(&mut footer, "position", 200, 48, &empty);
    let outside = bare(footer);
    let at = (outside.find(&empty) as u64).to_le_bytes();
    add("BLOCK-RANGE", outside.at(|p| p.block(0), &at).signed());
    let end = (lit.footer() as u64).to_le_bytes();
    let inside = lit.clone().at(|p| p.trailer() + 8, &end);
    add("BLOCK-RANGE-in-tiles", inside.signed());
    let far = (u64::MAX - 7).to_le_bytes();
    add("BLOCK-RANGE-overflow", block(0, &far));
    add("BLOCK-RANGE-huge", block(8, &(u32::MAX - 7).to_le_bytes()));
}

fn entries(add: &mut Add<'_>) {
    let kinds = kinds();
    let patched = |i: usize, at: usize, bytes: &[u8]| kinds.clone().at(|p| p.entry(i) + at, bytes);
    let entry = |i: usize, at: usize, bytes: &[u8]| patched(i, at, bytes).signed();
    let floats = |i: usize, at: usize, values: &[f32]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        entry(i, at, &bytes)
    };
    add("TILE-KIND", entry(2, 40, &[3]));
    add("TILE-EMPTY", floats(0, 24, &[1.0]));
    add("TILE-EMPTY-end", floats(0, 36, &[0.5]));
    add("TILE-EMPTY-flags", entry(0, 46, &[2]));
    add("TILE-EMPTY-minus-zero", floats(0, 28, &[-0.0]));
    let vertices = kinds.map() + 60;
    let fewer = patched(1, 16, &[63]).plus(vertices, -1);
    add("TILE-CONSTANT", fewer.signed());
    add("TILE-CONSTANT-depths", floats(1, 28, &[8.0]));
    add("TILE-CONSTANT-lit", floats(1, 32, &[1.0; 2]));
    add("TILE-CONSTANT-minus-zero", floats(1, 24, &[-0.0; 2]));
    add("TILE-CONSTANT-nan", floats(1, 24, &[f32::NAN; 2]));
    add("TILE-CONSTANT-coloured", entry(1, 46, &[1]));
    let e = kinds.entry(2);
    let crc = [kinds.0[e + 20] ^ 1];
    let damaged = kinds.clone().put(e + 20, &crc).sign_block();
    add("TILE-CRC", damaged.sign_footer());
    add("TILE-FLAGS", entry(2, 46, &[2]));
    add("unsupported-transform", entry(2, 42, &[2]));
    add("unsupported-transform-private", entry(2, 42, &[255]));
    add("unsupported-codec-of-tile", entry(2, 41, &[3]));
    add("unsupported-codec-of-tile-private", entry(2, 41, &[128]));
    let coloured = one(header("map", 3, 2, 3), valid::mixed_rgb);
    add(
        "MAP-CHANNELS-coloured-tile",
        coloured.at(|p| p.map() + 8, &[1]).signed(),
    );

    // Ranges. The tile has vertices at 0, and ends at 0 and at 1.
    let tile = one(header("map", 2, 1, 1), |x, _| match x {
        0 => mono(&[(0.0, 0.75), (1.0, 0.5), (2.0, 0.0)]),
        _ => Visibility::lit(),
    });
    let range = |at: usize, value: f32| {
        let e = tile.entry(0);
        tile.clone().put(e + at, &value.to_le_bytes()).signed()
    };
    add("TILE-DEPTHS", range(28, 1000.0));
    add("TILE-DEPTHS-narrow", range(28, 2f32.next_down()));
    add("TILE-DEPTHS-minus-zero", range(24, -0.0));
    add("TILE-DEPTHS-nan", range(24, f32::NAN));
    add("TILE-DEPTHS-infinite", range(28, f32::INFINITY));
    add("TILE-ENDS", range(32, 0.001));
    add("TILE-ENDS-wide", range(36, 1f32.next_up()));
    add("TILE-ENDS-minus-zero", range(32, -0.0));
    add("TILE-ENDS-negative", range(32, -1.0));
    add("TILE-ENDS-nan", range(36, f32::NAN));
}

fn ranges(add: &mut Add<'_>) {
    // Two payloads of 12 bytes, one after another.
    let half = |z: u32| {
        let depth = f32::from_bits(z);
        let entry = data(1, 64, [depth; 2], [0.5; 2]);
        let bytes = planes(1, &[], z << 1, &[], &[32]);
        let (mut entry, mut bytes) = stored(entry, 0, 1, bytes.len(), bytes);
        bytes.truncate(12);
        (entry.stored_size, entry.padding) = (12, 2);
        (entry, bytes)
    };
    let mut two = RawFile::default();
    for (name, z) in [("one", 1f32), ("two", 2f32)] {
        let level = RawLevel {
            max_error: 0.0,
            tiles: vec![half(z.to_bits())],
            directory: Codec::None,
        };
        two.maps.push((header(name, 1, 1, 1), vec![level]));
    }
    add("TILE-RANGE-unaligned", Patch(two.assemble()).signed());
    // The payload is the value of an attribute, and there are no bytes of tiles.
    let (entry, bytes) = good();
    let (entry, payload) = stored(entry, 0, 1, bytes.len(), bytes);
    let level = RawLevel {
        max_error: 0.0,
        tiles: vec![(entry, vec![])],
        directory: Codec::None,
    };
    let mut outside = RawFile::of(header("map", 1, 1, 1), vec![level]);
    let value = Attribute::Unknown {
        kind: 200,
        bytes: payload.clone(),
    };
    outside.attributes = vec![("position".into(), value)];
    let p = Patch(outside.assemble());
    let at = (p.find(&payload) as u64).to_le_bytes();
    add("TILE-RANGE", p.at(|p| p.entry(0), &at).signed());

    let kinds = kinds();
    let entry = |at: usize, bytes: &[u8]| kinds.clone().at(|p| p.entry(2) + at, bytes);
    add(
        "TILE-RANGE-overflow",
        entry(0, &(u64::MAX - 7).to_le_bytes()).signed(),
    );
    let none = entry(8, &[0; 4]).at(|p| p.map() + 68, &[0; 8]);
    add("TILE-RANGE-no-bytes", none.signed());
    let start = kinds.u64_at(kinds.entry(2)) as u64 - 8;
    add(
        "TILE-RANGE-in-header",
        entry(0, &start.to_le_bytes()).signed(),
    );
}

fn cover(add: &mut Add<'_>) {
    let small = small();
    let footer = small.footer();
    let gap = small.clone().insert(footer, &[0; 8]);
    add("BLOCK-COVER", gap.signed());
    let empty = || vec![(Entry::default(), vec![])];
    let both = levels_of(header("map", 2, 1, 1), [empty(), empty()]);
    let first = (both.u64_at(both.block(0)) as u64).to_le_bytes();
    let overlap = both.at(|p| p.block(1), &first);
    add("BLOCK-COVER-overlap", overlap.signed());

    // Tile `at` becomes empty after the file is built, so that no entry refers to its payload.
    let two = one(header("map", 16, 8, 1), |x, y| valid::mixed_mono(x % 8, y));
    let gap = |at: usize| {
        let (e, m) = (two.entry(at), two.map());
        let field = |at: usize| i64::from(two.0[e + at]) + (i64::from(two.0[e + at + 1]) << 8);
        let mut empty = [0; 48];
        empty[32..40].copy_from_slice(&[1f32.to_le_bytes(); 2].concat());
        let p = two.clone().plus(m + 60, -field(16)).plus(m + 68, -field(8));
        p.put(e, &empty).signed()
    };
    add("TILE-COVER", gap(0));
    add("TILE-COVER-end", gap(1));
    let record = two.0[two.entry(0)..two.entry(1)].to_vec();
    let overlap = two.clone().at(|p| p.entry(1), &record);
    add("TILE-COVER-overlap", overlap.signed());
}
