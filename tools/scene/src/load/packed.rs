//! What gzip and zlib packed, unpacked up to a limit.

use std::io::Read;

use crate::error::{Error, ErrorKind, Result};
use flate2::read::{MultiGzDecoder, ZlibDecoder};

use super::fault;

/// A file whose length nothing announces may unpack to so many times its size,
const MOST_TIMES: u64 = 256;
/// or to so many bytes.
const ALWAYS: u64 = 1 << 20;

/// All that is packed with gzip: up to 256 times its size, or a mebibyte.
///
/// # Errors
/// It is not gzip, is damaged, ends early, or unpacks to more.
pub fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let limit = (bytes.len() as u64 * MOST_TIMES).max(ALWAYS);
    let (out, more) = up_to(MultiGzDecoder::new(bytes), limit)?;
    if more {
        return fault(format!("{} bytes unpack to more than {limit}", bytes.len()));
    }
    Ok(out)
}

/// The first `limit` bytes of what is packed with gzip, or all where there are fewer.
///
/// # Errors
/// It is not gzip, is damaged, or ends early.
pub fn gzip_up_to(bytes: &[u8], limit: u64) -> Result<Vec<u8>> {
    up_to(MultiGzDecoder::new(bytes), limit).map(|(out, _)| out)
}

/// The first `limit` bytes of what is packed with zlib, or all where there are fewer.
///
/// # Errors
/// It is not zlib, is damaged, or ends early.
pub fn zlib_up_to(bytes: &[u8], limit: u64) -> Result<Vec<u8>> {
    up_to(ZlibDecoder::new(bytes), limit).map(|(out, _)| out)
}

/// Up to `limit` bytes, and whether there are more. The buffer grows with what comes, not with what is announced.
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
