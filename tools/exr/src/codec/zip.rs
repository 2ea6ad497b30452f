//! zlib, and the byte filter that zlib and RLE share.

use flate2::{Compress, Compression, Decompress, FlushCompress, FlushDecompress, Status};
use std::cell::RefCell;

thread_local! {
    static INFLATE: RefCell<Decompress> = RefCell::new(Decompress::new(true));
    static DEFLATE: RefCell<Option<(u32, Compress)>> = const { RefCell::new(None) };
}

/// Largest expansion of zlib.
pub(crate) const MAX_RATIO: u64 = 1032;

/// Default compression level of OpenEXR.
const DEFAULT_LEVEL: u32 = 4;

/// Decodes a zlib stream to exactly `out.len()` bytes.
pub(crate) fn inflate(packed: &[u8], out: &mut [u8]) -> Result<(), String> {
    INFLATE.with_borrow_mut(|inflate| {
        inflate.reset(true);
        let status = inflate
            .decompress(packed, out, FlushDecompress::Finish)
            .map_err(|e| format!("damaged zlib data: {e}"))?;
        if status != Status::StreamEnd {
            return Err(format!("zlib data does not end after {} bytes", out.len()));
        }
        if inflate.total_out() != out.len() as u64 {
            return Err(format!(
                "zlib data ends after {} of {} bytes",
                inflate.total_out(),
                out.len()
            ));
        }
        Ok(())
    })
}

/// Replaces the contents of `out` with `raw` as a zlib stream.
///
/// Returns false, with unspecified contents of `out`, if that does not shrink it.
pub(crate) fn deflate(raw: &[u8], level: Option<i32>, out: &mut Vec<u8>) -> bool {
    let level = level.map_or(DEFAULT_LEVEL, |l| l.clamp(0, 9) as u32);
    DEFLATE.with_borrow_mut(|slot| {
        if slot.as_ref().is_none_or(|(l, _)| *l != level) {
            *slot = Some((level, Compress::new(Compression::new(level), true)));
        }
        let Some((_, deflate)) = slot else {
            return false;
        };
        deflate.reset();
        out.clear();
        out.resize(raw.len(), 0);
        match deflate.compress(raw, out, FlushCompress::Finish) {
            Ok(Status::StreamEnd) if deflate.total_out() < raw.len() as u64 => {
                out.truncate(deflate.total_out() as usize);
                true
            }
            _ => false,
        }
    })
}

/// Inverts [`filter`]: sums the differences and interleaves the two halves.
///
/// Sums both halves in one loop; the second half starts from the sum of the first.
pub(crate) fn unfilter(filtered: &[u8], out: &mut [u8]) {
    assert_eq!(filtered.len(), out.len());
    let half = filtered.len().div_ceil(2);
    let (even, odd) = filtered.split_at(half);
    let sum = even.iter().fold(0_u8, |a, &b| a.wrapping_add(b));
    // Differences are stored plus 128; the first byte is stored unchanged.
    let mut a = 128_u8;
    let mut b = sum.wrapping_sub(if half.is_multiple_of(2) { 128 } else { 0 });
    let mut pairs = out.chunks_exact_mut(2);
    for ((pair, &x), &y) in (&mut pairs).zip(even).zip(odd) {
        a = a.wrapping_add(x).wrapping_sub(128);
        b = b.wrapping_add(y).wrapping_sub(128);
        pair[0] = a;
        pair[1] = b;
    }
    if let ([last], Some(&x)) = (pairs.into_remainder(), even.last()) {
        *last = a.wrapping_add(x).wrapping_sub(128);
    }
}

/// Replaces the contents of `out` with the filtered `raw`: even bytes, then odd bytes, as
/// differences plus 128.
pub(crate) fn filter(raw: &[u8], out: &mut Vec<u8>) {
    out.clear();
    out.resize(raw.len(), 0);
    let half = raw.len().div_ceil(2);
    let (even, odd) = out.split_at_mut(half);
    let mut a = 128_u8;
    let mut b = match half {
        0 => return,
        _ => raw[2 * (half - 1)],
    };
    let mut pairs = raw.chunks_exact(2);
    for ((pair, x), y) in (&mut pairs).zip(even.iter_mut()).zip(odd) {
        *x = pair[0].wrapping_sub(a).wrapping_add(128);
        *y = pair[1].wrapping_sub(b).wrapping_add(128);
        a = pair[0];
        b = pair[1];
    }
    if let ([last], Some(x)) = (pairs.remainder(), even.last_mut()) {
        *x = last.wrapping_sub(a).wrapping_add(128);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filter as OpenEXR documents it, in two passes: split into halves, then differences.
    fn slow_filter(raw: &[u8]) -> Vec<u8> {
        let mut t: Vec<u8> = raw.iter().copied().step_by(2).collect();
        t.extend(raw.iter().copied().skip(1).step_by(2));
        (0..t.len())
            .map(|i| match i {
                0 => t[0],
                _ => t[i].wrapping_sub(t[i - 1]).wrapping_add(128),
            })
            .collect()
    }

    #[test]
    fn the_filter_equals_the_two_pass_filter_and_is_inverted() {
        for len in [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 255, 256, 1001] {
            let raw: Vec<u8> = (0..len).map(|i: u32| (i * i * 7 + 3) as u8).collect();
            let mut filtered = Vec::new();
            filter(&raw, &mut filtered);
            assert_eq!(filtered, slow_filter(&raw), "{len} bytes");
            let mut back = vec![0; raw.len()];
            unfilter(&filtered, &mut back);
            assert_eq!(back, raw, "{len} bytes");
        }
    }
}
