//! Sizes, tables and streams of data tiles.

use super::*;

pub fn add(add: &mut Add<'_>) {
    plain_tiles(add);
    coloured_tiles(add);
    delta_planes(add);
    // A data tile without vertices, and numbers of vertices that no tile can have.
    let none = data(0, 0, [0.0; 2], [1.0; 2]);
    add("TILE-VERTICES", plain((1, 1), none, vec![0; 8]).signed());
    let absurd = |vertices: u32| Entry {
        vertices,
        ..good().0
    };
    add("TILE-VERTICES-counts", delta(absurd(4), good().1));
    add(
        "TILE-VERTICES-absurd",
        delta(absurd(4_000_000_000), good().1),
    );
    let mut bytes = Vec::new();
    put_u32(&mut bytes, &[0, 4_000_000_000]);
    bytes.resize(64, 0);
    let p = plain((1, 1), absurd(4_000_000_000), bytes);
    add("TILE-SIZE-vertices", p.signed());
    let size = coded((1, 1), good().0, (1, 1), (1 << 31) + 8, good().1);
    add("TILE-SIZE-limit", size.signed());
    // Padding. The payload has 19 bytes, and then zeros.
    let padded = |padding: &[u8]| {
        let (entry, bytes) = good();
        let all = [&bytes[..], padding].concat();
        let (mut entry, all) = stored(entry, 0, 1, bytes.len(), all);
        entry.padding = padding.len() as u8;
        file_of(header("map", 1, 1, 3), vec![(entry, all)]).signed()
    };
    add("TILE-PADDING", padded(&[0; 13]));
    add("TILE-PADDING-not-zero", padded(&[0, 0, 0, 0, 9]));
}

/// Three pixels on the lattice 64 with these tables, three depths and visibilities.
fn three(table: [u32; 4], colour: &[u32], depths: [f32; 3], k: &[u16]) -> Vec<u8> {
    let mut bytes = Vec::new();
    put_u32(&mut bytes, &table);
    put_u32(&mut bytes, colour);
    put_u32(&mut bytes, &depths.map(f32::to_bits));
    put_u16(&mut bytes, k);
    bytes
}

fn plain_tiles(add: &mut Add<'_>) {
    let tile = |table, z: [f32; 3], k: [u16; 3], end: f32| {
        let most = z[0].max(z[1]).max(z[2]);
        let entry = data(3, 64, [1.0, most], [end, 1.0]);
        plain((3, 1), entry, three(table, &[], z, &k)).signed()
    };
    // Pixels without a vertex, with one, and with two, unless the table says otherwise.
    let (z, k) = ([1.0, 1.0, 2.0], [32, 64, 32]);
    add("TILE-TABLE", tile([1, 1, 1, 3], [1.5, 1.0, 2.0], k, 0.5));
    let falls = tile([0, 2, 1, 3], [1.0, 2.0, 3.0], [64, 32, 16], 0.25);
    add("TILE-TABLE-falls", falls);
    add("TILE-TABLE-end", tile([0, 0, 1, 2], [1.0; 3], [32; 3], 0.5));
    add("TILE-TABLE-huge", tile([0, 0, 1, u32::MAX], z, k, 0.5));
    add("TILE-LATTICE", tile([0, 0, 1, 3], z, [32, 65, 32], 0.5));
    let entry = data(3, 64, [1.0, 2.0], [0.5, 1.0]);
    let bytes = || three([0, 0, 1, 3], &[], z, &k);
    let more = [bytes(), vec![0; 14]].concat(); // 6 of padding, 8 too many
    add("TILE-SIZE", plain((3, 1), entry, more).signed());
    let mut padded = bytes();
    padded.push(7);
    add(
        "TILE-PADDING-of-tile",
        plain((3, 1), entry, padded).signed(),
    );
    // The visibility 0 of the only vertex is missing.
    let entry = data(1, 0, [1.0; 2], [0.0; 2]);
    let mut bytes = Vec::new();
    put_u32(&mut bytes, &[0, 1, 1f32.to_bits()]);
    let short = coded((1, 1), entry, (0, 0), bytes.len(), bytes);
    add("TILE-SIZE-short", short.signed());
}

fn coloured_tiles(add: &mut Add<'_>) {
    let tile = |table, colour: [u32; 4], k: &[u16], ends: [f32; 2]| {
        let entry = Entry {
            coloured: true,
            ..data(3, 64, [1.0, 2.0], ends)
        };
        let bytes = three(table, &colour, [1.0, 1.0, 2.0], k);
        plain((3, 1), entry, bytes).signed()
    };
    // An empty pixel, a monochrome one of one vertex, a coloured one of two.
    let table = [0, 0, 1, 3];
    let partly = tile(table, [0, 0, 0, 1], &[32, 64, 32, 32, 16], [0.25, 1.0]);
    add("TILE-COLOUR", partly);
    let k = [32, 64, 32, 64, 64, 0, 64, 64, 32];
    add(
        "TILE-COLOUR-start",
        tile(table, [1, 1, 1, 3], &k, [0.0, 1.0]),
    );
    let empty = tile(table, [0, 1, 1, 3], &k, [0.0, 1.0]);
    add("TILE-COLOUR-of-empty", empty);
    // The second pixel is empty, and the table falls there.
    let k = [32, 64, 32, 48, 0, 16, 16];
    let falls = tile([0, 1, 1, 3], [0, 1, 0, 2], &k, [0.0, 1.0]);
    add("TILE-COLOUR-falls", falls);
    let none = tile(table, [0; 4], &[32, 64, 32], [0.5, 1.0]);
    add("TILE-FLAGS-no-colour", none);
    let colour = [0, 0, 0, 2];
    let equal = tile(table, colour, &[32, 64, 32, 64, 32, 64, 32], [0.5, 1.0]);
    add("COLOUR-EQUAL", equal);
    let green = tile(table, colour, &[32, 64, 32, 32, 33, 64, 0], [0.0, 1.0]);
    add("VISIBILITY-RISE-green", green);
}

fn delta_planes(add: &mut Add<'_>) {
    let (entry, bytes) = good();
    let drops = [0, 16, 16];
    // The step is a gap of 0, not a step bit.
    let gap = planes(3, &[0], ONE, &[1, 0], &drops);
    add("TILE-STREAM", delta(entry, gap));
    let unused = planes(3, &[6], ONE, &[1], &drops);
    add("TILE-STREAM-unused-bits", delta(entry, unused));
    add(
        "TILE-STREAM-left-over",
        delta(entry, [&bytes[..], &[0]].concat()),
    );
    let short = bytes[..bytes.len() - 1].to_vec(); // without a zero
    add("TILE-STREAM-short", delta(entry, short.clone()));
    let packed = codecs::literals(&short);
    let short = coded((1, 1), entry, (1, 1), short.len(), packed);
    add("TILE-STREAM-lz4", short.signed());
    add("TILE-STREAM-colour-of-empty", {
        // An empty pixel, and one with the vertex (1, (32/64, 48/64, 64/64)).
        let mut bytes = vec![0, 1, 0, 0, 0, 0, 0, 0, 0b11];
        bytes.extend(ONE.to_le_bytes());
        bytes.extend([32, 0, 16, 0, 0, 0]);
        let entry = Entry {
            coloured: true,
            ..data(1, 64, [1.0; 2], [0.5, 1.0])
        };
        coded((2, 1), entry, (0, 1), bytes.len(), bytes).signed()
    });
    add("TILE-VERTICES-wrap", {
        // Counts of 2^32 - 1 and 4, whose sum is 3 in 32 bits.
        let mut bytes = vec![255, 4, 255, 0, 255, 0, 255, 0];
        bytes.resize(20, 0);
        coded((2, 1), entry, (0, 1), bytes.len(), bytes).signed()
    });
    // Sums that wrap around.
    let single = |depth: f32, end: f32| data(1, 64, [depth; 2], [end; 2]);
    let drop = planes(1, &[], ONE, &[], &[65]);
    let above = single(1.0, 65535.0 / 64.0);
    add("TILE-LATTICE-wrap", delta(above, drop));
    let depths = [0.5, f32::from_bits(0x7E80_0000)];
    let gaps = [0x3F00_0000, 0xC080_0000];
    let wrapped = planes(3, &[0], ONE, &gaps, &drops);
    let entry = data(3, 64, depths, [0.5; 2]);
    add("DEPTH-ORDER-wrap", delta(entry, wrapped));
    let zero = planes(1, &[], 1, &[], &[32]);
    add("DEPTH-ZERO-delta-planes", delta(single(-0.0, 0.5), zero));
    let far = planes(1, &[], 0x7F80_0000 << 1, &[], &[32]);
    let infinite = single(f32::INFINITY, 0.5);
    add("DEPTH-FINITE-delta-planes", delta(infinite, far));
}
