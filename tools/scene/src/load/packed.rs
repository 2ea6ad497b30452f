//! Unpacks gzip and zlib data up to a limit.

use std::io::Read;

use crate::error::{Error, ErrorKind, Result};
use flate2::read::{MultiGzDecoder, ZlibDecoder};

use super::fault;

/// Without an announced size, data may unpack to this multiple of its packed size,
const MAX_RATIO: u64 = 256;
/// or to this many bytes if that is more.
const MIN_LIMIT: u64 = 1 << 20;

/// Unpacks gzip data to at most 256 times its size, or 1 MiB if that is more.
///
/// # Errors
/// The data is not gzip, is damaged, ends early, or unpacks to more.
pub fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let limit = (bytes.len() as u64 * MAX_RATIO).max(MIN_LIMIT);
    let (out, more) = up_to(MultiGzDecoder::new(bytes), limit)?;
    if more {
        return fault(format!("{} bytes unpack to more than {limit}", bytes.len()));
    }
    Ok(out)
}

/// Unpacks the first `limit` bytes of gzip data, or all if there are fewer.
///
/// # Errors
/// The data is not gzip, is damaged, or ends early.
pub fn gzip_up_to(bytes: &[u8], limit: u64) -> Result<Vec<u8>> {
    up_to(MultiGzDecoder::new(bytes), limit).map(|(out, _)| out)
}

/// Unpacks the first `limit` bytes of zlib data, or all if there are fewer.
///
/// # Errors
/// The data is not zlib, is damaged, or ends early.
pub fn zlib_up_to(bytes: &[u8], limit: u64) -> Result<Vec<u8>> {
    up_to(ZlibDecoder::new(bytes), limit).map(|(out, _)| out)
}

/// Unpacks at most `limit` bytes, and returns whether there are more. The buffer grows with the
/// data, not with an announced size.
fn up_to(mut decoder: impl Read, limit: u64) -> Result<(Vec<u8>, bool)> {
    let mut out = Vec::new();
    let mut one = [0];
    (&mut decoder)
        .take(limit)
        .read_to_end(&mut out)
        .and_then(|_| decoder.read(&mut one))
        .map(|more| (out, more > 0))
        .map_err(|e| Error::new(ErrorKind::File, format!("cannot be unpacked: {e}")))
}
