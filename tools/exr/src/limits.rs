//! Upper bound on the memory that a file may request.

use crate::error::{Error, Result};
use crate::header::{Compression, Part, Rect};

/// Upper bound on the memory that one file can cause.
///
/// The reader checks every size against the bytes that are stored, and adds up what it is about to
/// allocate. A file that needs more than the limit is a [`Limit`](crate::ErrorKind::Limit) error
/// before the allocation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes that a reader keeps, plus those that decoding needs for a moment. Default 4 GiB.
    ///
    /// A reader keeps its headers, which count 64 times because a short attribute takes more memory
    /// than bytes in the file, and 8 bytes per block. One block or rectangle is decoded at a time,
    /// with its stored bytes and the working memory of its codec; threads that decode at the same
    /// time need as much each. A thread keeps up to 96 MiB of working memory for its next block.
    pub memory: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { memory: 4 << 30 }
    }
}

/// Memory for headers, as a multiple of their size: an attribute of 7 bytes takes at most 312.
pub(crate) const PER_HEADER_BYTE: u64 = 64;

impl Limits {
    /// Fails if `subject` reaches the limit.
    pub(crate) fn check(&self, subject: &str, bytes: u64) -> Result<()> {
        if bytes >= self.memory {
            return Err(Error::limit(format!(
                "{subject} can take {bytes} bytes of memory, but Limits::memory is {}",
                self.memory
            )));
        }
        Ok(())
    }
}

/// Upper bound of the memory that decoding a block takes, from its `stored` and `decoded` bytes.
pub(crate) fn block_memory(part: &Part, rect: Rect, stored: u64, decoded: u64) -> u64 {
    use Compression::{B44, B44a, Dwaa, Dwab, Piz, Pxr24};
    let pixels = rect.pixels();
    let channels = part.channels.len() as u64;
    let times = |factor: u64, bytes: u64| bytes.saturating_mul(factor);
    // The `exr` crate copies the stored bytes, and grows some buffers in steps.
    let codec = match part.compression {
        Piz | B44 | B44a => stored.saturating_add(times(2, decoded)),
        Pxr24 => stored.saturating_add(times(5, decoded)),
        Dwaa | Dwab => {
            let blocks = dct_blocks(rect);
            let coefficients = times(400 * channels + 800, blocks);
            stored
                .saturating_add(times(13, decoded))
                .saturating_add(coefficients)
        }
        _ => 0,
    };
    // Two scratch buffers and the values; counts, offsets and lengths of rows; tables of codecs.
    [
        codec,
        stored,
        times(3, decoded),
        times(28, pixels),
        512 * channels,
        4 << 20,
    ]
    .into_iter()
    .fold(0, u64::saturating_add)
}

/// Number of DCT blocks of a channel.
pub(crate) fn dct_blocks(rect: Rect) -> u64 {
    u64::from(rect.width.div_ceil(8)) * u64::from(rect.height.div_ceil(8))
}
