//! The most memory that a file may cause.

use crate::{Error, Result};

/// One budget for all memory that a file causes: its footer, the blocks of its directory that are
/// kept, its tiles while they are decoded, and the bands that a walk over the whole file holds.
///
/// An operation that needs more fails with an error of kind `Limit`, before the allocation.
///
/// ```
/// let limits = deepshadow::Limits::default().memory(64 << 20);
/// assert_eq!(limits.memory, 64 << 20);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Limits {
    /// Bytes. Default 1 GiB.
    pub memory: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits { memory: 1 << 30 }
    }
}

impl Limits {
    /// The most bytes of content, unpacked, that one pass hashes or exports: 1 TiB. A file of a few
    /// kilobytes may hold a million times as much.
    pub const CONTENT: u64 = 1 << 40;

    /// Sets the budget in bytes.
    pub fn memory(mut self, bytes: u64) -> Self {
        self.memory = bytes;
        self
    }

    /// Checks the bytes of a footer. A short attribute takes 20 times as many once it is parsed.
    pub(crate) fn check_footer(self, bytes: u64) -> Result<()> {
        within(bytes, self.memory / 32, "a footer", "a 32nd of the memory")
    }

    /// Number of blocks of the directory, 48 KiB each, that a file keeps.
    pub(crate) fn blocks(self) -> usize {
        (self.memory / 16 / (48 << 10)).max(1) as usize
    }

    /// Checks that an operation that takes `bytes` of memory for `what` is within the budget.
    ///
    /// # Errors
    /// `Limit`.
    pub fn check(self, bytes: u64, what: &str) -> Result<()> {
        within(bytes, self.memory, what, "memory")
    }

    /// Checks that a pass over `bytes` of unpacked content is within [`Limits::CONTENT`].
    ///
    /// # Errors
    /// `Limit`.
    pub fn check_content(bytes: u64, what: &str) -> Result<()> {
        within(bytes, Self::CONTENT, what, "content")
    }
}

fn within(bytes: u64, most: u64, what: &str, of: &str) -> Result<()> {
    if bytes <= most {
        return Ok(());
    }
    let line = format!("{what} of {bytes} bytes, over the {most} bytes for {of}");
    Err(Error::limit(line))
}
