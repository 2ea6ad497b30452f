//! The most memory that a file may make the reader allocate.

/// The most bytes that a reader allocates for one file.
///
/// A file that needs more fails with an error of kind `Limit`, before the allocation.
///
/// ```
/// let limits = deepshadow::Limits::default().tile_bytes(64 << 20); // no tile larger than 64 MiB
/// assert_eq!(limits.tile_bytes, 64 << 20);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Bytes of the footer: names, attributes, and 24 bytes per 1024 tiles. Default 256 MiB.
    pub footer_bytes: u64,
    /// Bytes of one tile, decoded. Default 1 GiB.
    pub tile_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            footer_bytes: 256 << 20,
            tile_bytes: 1 << 30,
        }
    }
}

impl Limits {
    /// Sets the most bytes of one decoded tile.
    pub fn tile_bytes(mut self, bytes: u64) -> Self {
        self.tile_bytes = bytes;
        self
    }
}
