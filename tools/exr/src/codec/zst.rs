//! Zstandard in the container of OpenEXR 3.5.
//!
//! A block is a header of 24 bytes and a Zstandard frame. The header holds `zstd-exr`, the format
//! (u32), flags (u32) and the length of the frame (u64). The frame holds up to two segments, the
//! two-byte channels of all rows and the four-byte channels ([`Order::Sorted`](super::Order)). A
//! segment is its length (u64) and its byte planes: all first bytes, all second bytes, and so on.
//! A block that compression does not shrink is stored in packed order, without the header.
//!
//! OpenEXR 3.5 and this crate write format 1 for deep parts. For flat parts, OpenEXR writes format
//! 2 with flag 1: each value is the difference to the previous one in the same row and channel, as
//! a wrapping integer.

use super::layout::{Layout, Order};
use crate::error::{Error, Result};
use crate::source::resize;
use std::cell::RefCell;
use zstd::bulk::{Compressor, Decompressor};

const MAGIC: &[u8; 8] = b"zstd-exr";
const HEADER: usize = 24;
/// Largest expansion of Zstandard: a block of four bytes decodes to 128 KiB.
pub(crate) const MAX_RATIO: u64 = 32_768;
/// Default compression level of OpenEXR.
const DEFAULT_LEVEL: i32 = 5;

thread_local! {
    static DECODE: RefCell<Option<Decompressor<'static>>> = const { RefCell::new(None) };
    static ENCODE: RefCell<Option<(i32, Compressor<'static>)>> = const { RefCell::new(None) };
}

/// Length and element size of each non-empty segment.
fn segments(layout: &Layout<'_>) -> impl Iterator<Item = (usize, usize)> {
    let two = layout.two_bytes();
    let four = layout.bytes() - two;
    [(two, 2), (four, 4)]
        .into_iter()
        .filter(|&(len, _)| len > 0)
}

/// Replaces the contents of `out` with the block's bytes in [`Order::Sorted`].
pub(crate) fn decode(
    packed: &[u8],
    layout: &Layout<'_>,
    scratch: &mut Vec<u8>,
    out: &mut Vec<u8>,
) -> Result<()> {
    let corrupt = |message: String| Err(Error::corrupt(message));
    let header = packed
        .split_at_checked(HEADER)
        .filter(|(h, _)| h.starts_with(MAGIC));
    let Some((header, frame)) = header else {
        return corrupt("the block is neither uncompressed nor Zstandard data".into());
    };
    let field = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| header[at + i]));
    let (format, flags) = (field(8), field(12));
    let differences = match (format, flags) {
        (1, 0) | (2, 0) => false,
        (2, 1) => true,
        _ => {
            return Err(Error::unsupported(format!(
                "Zstandard data of format {format} with flags {flags}"
            )));
        }
    };
    let stated = u64::from(field(16)) | u64::from(field(20)) << 32;
    if stated != frame.len() as u64 {
        return corrupt(format!(
            "a Zstandard frame has {} bytes, but its header states {stated}",
            frame.len()
        ));
    }
    let inner = layout.bytes() + 8 * segments(layout).count();
    match zstd::zstd_safe::get_frame_content_size(frame) {
        Ok(Some(size)) if size != inner as u64 => {
            return corrupt(format!("Zstandard data of {size} bytes instead of {inner}"));
        }
        Ok(_) => {}
        Err(_) => return corrupt("the block has no Zstandard frame".into()),
    }
    resize(scratch, inner);
    let size = DECODE.with_borrow_mut(|slot| {
        let decode = match slot {
            Some(decode) => decode,
            None => slot
                .insert(Decompressor::new().map_err(|e| Error::io("cannot set up Zstandard", e))?),
        };
        decode
            .decompress_to_buffer(frame, &mut scratch[..])
            .map_err(|e| Error::corrupt(format!("damaged Zstandard data: {e}")))
    })?;
    if size != inner {
        return corrupt(format!("Zstandard data ends after {size} of {inner} bytes"));
    }
    resize(out, layout.bytes());
    let mut rest = &scratch[..];
    let mut target = &mut out[..];
    for (len, element) in segments(layout) {
        let (prefix, after) = rest.split_at(8);
        if prefix != (len as u64).to_le_bytes() {
            return corrupt("a Zstandard segment has the wrong length".into());
        }
        let (planes, after) = after.split_at(len);
        let (piece, tail) = std::mem::take(&mut target).split_at_mut(len);
        if element == 2 {
            from_byte_planes::<2>(planes, piece);
        } else {
            from_byte_planes::<4>(planes, piece);
        }
        rest = after;
        target = tail;
    }
    if differences {
        layout.for_each_row(Order::Sorted, |_, channel, span| {
            if layout.channel_bytes[channel] == 2 {
                let add = |a, b: &[u8; 2]| u16::from_le_bytes(*b).wrapping_add(a);
                prefix_sums(&mut out[span], add, u16::to_le_bytes);
            } else {
                let add = |a, b: &[u8; 4]| u32::from_le_bytes(*b).wrapping_add(a);
                prefix_sums(&mut out[span], add, u32::to_le_bytes);
            }
        });
    }
    Ok(())
}

/// Replaces the contents of `out` with the encoded `sorted`; false if that does not shrink it.
pub(crate) fn encode(
    sorted: &[u8],
    layout: &Layout<'_>,
    level: Option<i32>,
    scratch: &mut Vec<u8>,
    out: &mut Vec<u8>,
) -> bool {
    scratch.clear();
    let mut rest = sorted;
    for (len, element) in segments(layout) {
        let (piece, tail) = rest.split_at(len);
        scratch.extend_from_slice(&(len as u64).to_le_bytes());
        if element == 2 {
            append_byte_planes::<2>(piece, scratch);
        } else {
            append_byte_planes::<4>(piece, scratch);
        }
        rest = tail;
    }
    out.clear();
    let level = level.unwrap_or(DEFAULT_LEVEL).clamp(1, 22);
    out.resize(HEADER + zstd::zstd_safe::compress_bound(scratch.len()), 0);
    let size = ENCODE.with_borrow_mut(|slot| {
        if slot.as_ref().is_none_or(|(l, _)| *l != level) {
            *slot = Compressor::new(level).ok().map(|c| (level, c));
        }
        let (_, encode) = slot.as_mut()?;
        encode.compress_to_buffer(scratch, &mut out[HEADER..]).ok()
    });
    let Some(size) = size.filter(|size| HEADER + size < sorted.len()) else {
        return false;
    };
    out.truncate(HEADER + size);
    out[..8].copy_from_slice(MAGIC);
    out[8..12].copy_from_slice(&1_u32.to_le_bytes());
    out[12..16].copy_from_slice(&0_u32.to_le_bytes());
    out[16..24].copy_from_slice(&(size as u64).to_le_bytes());
    true
}

/// Replaces every value with the wrapping sum of the values up to it.
fn prefix_sums<const N: usize, T: Copy + Default>(
    bytes: &mut [u8],
    add: impl Fn(T, &[u8; N]) -> T,
    to_bytes: impl Fn(T) -> [u8; N],
) {
    let mut sum = T::default();
    for value in bytes.as_chunks_mut::<N>().0 {
        sum = add(sum, value);
        *value = to_bytes(sum);
    }
}

/// Converts byte planes to values.
fn from_byte_planes<const N: usize>(planes: &[u8], values: &mut [u8]) {
    let n = planes.len() / N;
    let plane: [&[u8]; N] = std::array::from_fn(|k| &planes[k * n..(k + 1) * n]);
    for (i, value) in values.chunks_exact_mut(N).enumerate() {
        for k in 0..N {
            value[k] = plane[k][i];
        }
    }
}

/// Appends the byte planes of `values` to `planes`.
fn append_byte_planes<const N: usize>(values: &[u8], planes: &mut Vec<u8>) {
    for k in 0..N {
        planes.extend(values.chunks_exact(N).map(|value| value[k]));
    }
}
