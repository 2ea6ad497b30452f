//! Upper bounds on the memory that a file may request.

/// Upper bounds on the sizes and counts of a file.
///
/// A file that exceeds one is a [`Limit`](crate::ErrorKind::Limit) error that names the field to
/// raise. Every size is also checked against the length of the file: stored bytes must lie in the
/// file, and a decoded size must be possible for its codec (zlib expands at most 1032 times, RLE at
/// most 64 times).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Parts in a file. Default 1024.
    pub max_parts: usize,
    /// Channels in a part. Default 1024.
    pub max_channels: usize,
    /// Attributes in all headers together. Default 65536.
    pub max_attributes: usize,
    /// Bytes of one attribute's value. Default 64 MiB.
    pub max_attribute_bytes: usize,
    /// Bytes of all headers together. Default 256 MiB.
    pub max_header_bytes: u64,
    /// Pixels in a data window. Default 2^30.
    pub max_pixels: u64,
    /// Samples in one block; values above 2^32 - 1 count as 2^32 - 1. Default 2^28.
    pub max_samples_per_block: u64,
    /// Bytes of one block, compressed or decoded, counts or samples. Default 1 GiB.
    pub max_block_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            max_parts: 1024,
            max_channels: 1024,
            max_attributes: 1 << 16,
            max_attribute_bytes: 64 << 20,
            max_header_bytes: 256 << 20,
            max_pixels: 1 << 30,
            max_samples_per_block: 1 << 28,
            max_block_bytes: 1 << 30,
        }
    }
}

impl Limits {
    /// Limit of samples in one block, so that offsets fit into 32 bits.
    pub(crate) fn samples(&self) -> u64 {
        self.max_samples_per_block.min(u32::MAX.into())
    }
}
