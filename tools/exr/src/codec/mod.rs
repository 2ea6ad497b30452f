//! Compresses and decompresses the bytes of one block.

mod dwa;
mod flat;
mod layout;
mod rle;
mod zip;
mod zst;

pub(crate) use flat::unpack_flat;
pub(crate) use layout::{Layout, Order};

use crate::error::{Error, Result};
use crate::header::Compression;
use crate::source::resize;
use std::cell::RefCell;

/// Reusable buffers of a thread.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) packed: Vec<u8>,
    a: Vec<u8>,
    b: Vec<u8>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch::default());
}

/// Buffers with a larger capacity are freed after use.
const MAX_KEPT_BYTES: usize = 32 << 20;

/// Calls `f` with this thread's buffers.
pub(crate) fn with_scratch<T>(f: impl FnOnce(&mut Scratch) -> T) -> T {
    // Take the buffers out for the call, so that a nested call gets buffers of its own.
    let mut scratch = SCRATCH.take();
    let result = f(&mut scratch);
    for buffer in [&mut scratch.packed, &mut scratch.a, &mut scratch.b] {
        if buffer.capacity() > MAX_KEPT_BYTES {
            *buffer = Vec::new();
        }
    }
    SCRATCH.set(scratch);
    result
}

/// Rejects impossible sizes before allocating: `packed` bytes must be able to yield `expected`.
pub(crate) fn check_sizes(compression: Compression, packed: usize, expected: u64) -> Result<()> {
    use Compression::*;
    let packed = packed as u64;
    let ratio = match compression {
        None => 1,
        Rle => rle::MAX_RATIO,
        Zips | Zip => zip::MAX_RATIO,
        Zstd => zst::MAX_RATIO,
        // Two bytes for zlib give 128 bytes of values, as two DCT coefficients or one run.
        Dwaa | Dwab => 64 * zip::MAX_RATIO,
        // A generous bound: the densest apply zlib to half of the bytes.
        _ => 8192,
    };
    // Writers store a block uncompressed if compression does not shrink it.
    if packed > expected || packed.saturating_mul(ratio) < expected {
        return Err(Error::corrupt(format!(
            "{packed} bytes cannot decode to {expected} with {compression:?}"
        )));
    }
    Ok(())
}

/// Decompresses a block of the shape `layout`; returns its bytes and their order.
pub(crate) fn unpack<'a>(
    compression: Compression,
    packed: &'a [u8],
    layout: &Layout<'_>,
    a: &'a mut Vec<u8>,
    b: &'a mut Vec<u8>,
) -> Result<(&'a [u8], Order)> {
    let expected = layout.bytes();
    if packed.len() == expected {
        return Ok((packed, Order::Packed));
    }
    check_sizes(compression, packed.len(), expected as u64)?;
    match compression {
        Compression::Zstd => {
            zst::decode(packed, layout, a, b)?;
            return Ok((b, Order::Sorted));
        }
        Compression::Rle => {
            resize(a, expected);
            rle::expand(packed, a).map_err(Error::corrupt)?;
        }
        _ => {
            resize(a, expected);
            zip::inflate(packed, a).map_err(Error::corrupt)?;
        }
    }
    resize(b, expected);
    zip::unfilter(a, b);
    Ok((b, Order::Packed))
}

/// Compresses `raw`, in [`Order::Packed`]; returns `raw` itself if that does not shrink it.
pub(crate) fn pack<'a>(
    compression: Compression,
    raw: &'a [u8],
    layout: &Layout<'_>,
    level: Option<i32>,
    a: &'a mut Vec<u8>,
    b: &'a mut Vec<u8>,
) -> &'a [u8] {
    debug_assert_eq!(raw.len(), layout.bytes());
    let shrunk = match compression {
        Compression::Rle => {
            zip::filter(raw, a);
            rle::shrink(a, b)
        }
        Compression::Zips => {
            zip::filter(raw, a);
            zip::deflate(a, level, b)
        }
        Compression::Zstd if layout.is_sorted() => zst::encode(raw, layout, level, a, b),
        Compression::Zstd => {
            let mut sorted = Vec::with_capacity(raw.len());
            layout.sort(raw, &mut sorted);
            zst::encode(&sorted, layout, level, a, b)
        }
        _ => false,
    };
    if shrunk { b } else { raw }
}

/// The three buffers of `scratch`: packed bytes, and `a` and `b` for [`unpack`] and [`pack`].
pub(crate) fn split(scratch: &mut Scratch) -> (&mut Vec<u8>, &mut Vec<u8>, &mut Vec<u8>) {
    (&mut scratch.packed, &mut scratch.a, &mut scratch.b)
}
