//! Packing and unpacking the bytes of one block.

mod flat;
mod layout;
mod rle;
mod zip;
mod zst;

pub(crate) use flat::unpack_flat;
pub(crate) use layout::{Layout, Order};

use crate::error::{Error, Result};
use crate::header::Compression;
use std::cell::RefCell;

/// Buffers that outlive a block.
#[derive(Default)]
pub(crate) struct Scratch {
    pub(crate) packed: Vec<u8>,
    a: Vec<u8>,
    b: Vec<u8>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch::default());
}

/// Larger buffers are given back after use.
const KEEP: usize = 32 << 20;

/// Calls `f` with this thread's buffers.
pub(crate) fn with_scratch<T>(f: impl FnOnce(&mut Scratch) -> T) -> T {
    // Taken out for the call, so that a call from within gets buffers of its own.
    let mut scratch = SCRATCH.take();
    let result = f(&mut scratch);
    for buffer in [&mut scratch.packed, &mut scratch.a, &mut scratch.b] {
        if buffer.capacity() > KEEP {
            *buffer = Vec::new();
        }
    }
    SCRATCH.set(scratch);
    result
}

/// Fails where `packed` bytes cannot be a block of `expected` bytes, before anything that large is made.
pub(crate) fn check_sizes(compression: Compression, packed: usize, expected: u64) -> Result<()> {
    use Compression::*;
    let packed = packed as u64;
    let ratio = match compression {
        None => 1,
        Rle => rle::MAX_RATIO,
        Zips | Zip => zip::MAX_RATIO,
        Zstd => zst::MAX_RATIO,
        // Of the others, the densest put zlib around half of the bytes; none comes near this.
        _ => 8192,
    };
    // What does not shrink is stored plain.
    if packed > expected || packed.saturating_mul(ratio) < expected {
        return Err(Error::corrupt(format!(
            "{packed} bytes cannot unpack to {expected} with {compression:?}"
        )));
    }
    Ok(())
}

/// The bytes of a block of the shape `layout`, and their order.
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
            a.resize(expected, 0);
            rle::expand(packed, a).map_err(Error::corrupt)?;
        }
        _ => {
            a.resize(expected, 0);
            zip::inflate(packed, a).map_err(Error::corrupt)?;
        }
    }
    b.resize(expected, 0);
    zip::unfilter(a, b);
    Ok((b, Order::Packed))
}

/// The packed form of `raw`, which is in [`Order::Packed`]; `raw` itself where packing does not shrink it.
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

/// The parts of a [`Scratch`] that [`unpack`] and [`pack`] need, apart from the packed bytes.
pub(crate) fn split(scratch: &mut Scratch) -> (&mut Vec<u8>, &mut Vec<u8>, &mut Vec<u8>) {
    (&mut scratch.packed, &mut scratch.a, &mut scratch.b)
}
