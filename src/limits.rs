//! One budget for everything that a file may ask us to allocate.

/// What a reader is willing to allocate for one file. A file that wants more is refused with an error of
/// kind `Limit`, before anything is allocated.
///
/// ```
/// let limits = deepshadow::Limits::default().tile_bytes(64 << 20); // no tile larger than 64 MiB
/// assert_eq!(limits.tile_bytes, 64 << 20);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Bytes of the footer: names, attributes, 24 bytes per 1024 tiles. Default 256 MiB.
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
    /// Sets the bytes that the footer may take.
    pub fn footer_bytes(mut self, bytes: u64) -> Self {
        self.footer_bytes = bytes;
        self
    }

    /// Sets the bytes that one decoded tile may take.
    pub fn tile_bytes(mut self, bytes: u64) -> Self {
        self.tile_bytes = bytes;
        self
    }
}
