//! Stored bytes that do not decode.

use super::*;

pub fn add(add: &mut Add<'_>) {
    // Sixteen pixels with the vertex (1, 32/64). The last bytes of their delta planes are zeros.
    let mut bytes = [&[1; 16][..], &[0; 48]].concat();
    let first = ONE
        .to_le_bytes()
        .map(|byte| [&[byte][..], &[0; 15]].concat());
    bytes.extend(first.concat());
    bytes.extend([[32; 16], [0; 16]].concat());
    let entry = data(16, 64, [1.0; 2], [0.5; 2]);
    let tile =
        |codec: u8, stored: Vec<u8>| coded((4, 4), entry, (codec, 1), bytes.len(), stored).signed();
    let all = bytes.len();
    add("TILE-CODEC", tile(0, bytes[..all - 1].to_vec()));
    add("TILE-CODEC-more", tile(0, [&bytes[..], &[0]].concat()));
    for (name, codec, frame) in broken(&bytes) {
        add(&format!("TILE-CODEC-{name}"), tile(codec, frame));
    }
}

/// Stored bytes that break the rules of a codec: a name, the codec, and the bytes.
///
/// A lenient decoder yields `content`, or `content` without zeros at its end, or more after it. At
/// least 16 zeros end the content.
pub fn broken(content: &[u8]) -> Vec<(&'static str, u8, Vec<u8>)> {
    let n = content.len();
    assert!(content[n - 16..].iter().all(|&byte| byte == 0));
    // The content until `left` bytes are left, a match of `length` zeros, and the rest.
    let ending = |left: usize, offset: u16, length: usize| {
        let rest = &content[n - left + length..];
        [
            sequence(&content[..n - left], Some((offset, length))),
            literals(rest),
        ]
        .concat()
    };
    let frame = zstd_frame(&stating(n as u32), content);
    let header = |head: &[u8]| zstd_frame(head, content);
    let size = (n as u32).to_le_bytes();
    vec![
        ("lz4", 1, ending(16, u16::MAX, 4)),
        ("lz4-offset-zero", 1, ending(16, 0, 4)),
        ("lz4-few-literals", 1, ending(12, 1, 8)),
        ("lz4-late-match", 1, ending(11, 1, 6)),
        ("lz4-no-literals", 1, ending(12, 1, 12)),
        (
            "lz4-ends-in-match",
            1,
            sequence(&content[..n - 12], Some((1, 12))),
        ),
        ("lz4-short", 1, {
            let block = literals(content);
            block[..block.len() - 3].to_vec()
        }),
        (
            "lz4-left-over",
            1,
            [sequence(content, Some((1, 4))), literals(&[0; 8])].concat(),
        ),
        ("zstd", 2, {
            let mut frame = frame.clone();
            let block = 4 + stating(0).len();
            frame[block] &= !1; // not the last block
            [frame, vec![1]].concat() // the first of three bytes of another block
        }),
        ("zstd-left-over", 2, [&frame[..], &[1]].concat()),
        ("zstd-two-frames", 2, [&frame[..], &frame].concat()),
        (
            "zstd-skippable-frame",
            2,
            [&[0x50, 0x2A, 0x4D, 0x18, 1, 0, 0, 0, 7][..], &frame].concat(),
        ),
        ("zstd-magic", 2, [&[0x27], &frame[1..]].concat()),
        // A window of 1 KiB, and no size.
        ("zstd-no-size", 2, header(&[0, 0])),
        ("zstd-another-size", 2, header(&stating(1 << 20))),
        (
            "zstd-bomb",
            2,
            header(&[&[0xE0][..], &(1u64 << 40).to_le_bytes()].concat()),
        ),
        (
            "zstd-short-content",
            2,
            zstd_frame(&stating(n as u32), &content[..n - 1]),
        ),
        // Single segment, dictionary 7.
        (
            "zstd-dictionary",
            2,
            header(&[&[0xA1, 7][..], &size].concat()),
        ),
        // A window of 144 MiB.
        (
            "zstd-window",
            2,
            header(&[&[0x80, 0x89][..], &size].concat()),
        ),
        // A checksum that is wrong.
        (
            "zstd-checksum",
            2,
            [header(&[&[0xA4][..], &size].concat()), vec![0; 4]].concat(),
        ),
    ]
}

/// An LZ4 sequence: literals and a match (offset, length), or only the last literals.
fn sequence(literals: &[u8], matched: Option<(u16, usize)>) -> Vec<u8> {
    let length = matched.map_or(0, |m| m.1 - 4);
    let more = |out: &mut Vec<u8>, n: usize| {
        if let Some(mut n) = n.checked_sub(15) {
            while n >= 255 {
                out.push(255);
                n -= 255;
            }
            out.push(n as u8);
        }
    };
    let mut out = vec![(literals.len().min(15) << 4 | length.min(15)) as u8];
    more(&mut out, literals.len());
    out.extend_from_slice(literals);
    if let Some((offset, _)) = matched {
        out.extend(offset.to_le_bytes());
        more(&mut out, length);
    }
    out
}

/// An LZ4 block that is all literals.
pub fn literals(content: &[u8]) -> Vec<u8> {
    sequence(content, None)
}

/// The frame header of a single segment whose size has four bytes.
fn stating(size: u32) -> Vec<u8> {
    [&[0xA0][..], &size.to_le_bytes()].concat()
}

/// A Zstandard frame of one raw block with this frame header.
pub fn zstd_frame(head: &[u8], content: &[u8]) -> Vec<u8> {
    let block = 1 | (content.len() as u32) << 3; // the last one, raw
    let magic = [0x28, 0xB5, 0x2F, 0xFD];
    [&magic, head, &block.to_le_bytes()[..3], content].concat()
}
