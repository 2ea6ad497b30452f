//! One budget for everything that a file may ask us to allocate.

/// What a reader is willing to allocate for one file. A file that wants more is refused with an error of
/// kind `Limit`, before anything is allocated.
///
/// ```
/// let mut limits = deepshadow::Limits::default();
/// limits.tile_bytes = 64 << 20; // no tile larger than 64 MiB
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
