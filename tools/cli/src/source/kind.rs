//! The kind of a file, by its first bytes.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use deepshadow::{Error, Result};

use deepshadow_frame::foreign::identify;

/// The kind of a file, by its first bytes. `Display` gives a name with its article.
///
/// ```
/// use deepshadow_cli::source::FileKind;
/// let kind = FileKind::of_bytes(b"\x76\x2f\x31\x01\x02\x00\x00\x00");
/// assert_eq!((kind, kind.to_string().as_str()), (FileKind::OpenExr, "an OpenEXR file"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FileKind {
    /// A deep shadow map of this project.
    Dsm,
    /// An OpenEXR file.
    OpenExr,
    /// Another known kind.
    Other(&'static str),
    /// An unknown kind.
    Unknown,
}

impl FileKind {
    /// Reads the kind of the file at `path`.
    ///
    /// # Errors
    /// `Io` if the file cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        let failed = |e| Error::io(format!("cannot open {}", path.display()), e);
        let mut head = Vec::new();
        let file = File::open(path).map_err(failed)?;
        file.take(4096).read_to_end(&mut head).map_err(failed)?;
        Ok(Self::of_bytes(&head))
    }

    /// Returns the kind of a file that begins with these bytes; 4096 are enough.
    pub fn of_bytes(head: &[u8]) -> Self {
        let dsm = &deepshadow::raw::layout::MAGIC;
        // Three of the eight bytes, so that opening a file damaged by a transfer as text says so.
        if head.len() >= 4 && head[1..4] == dsm[1..4] {
            return FileKind::Dsm;
        }
        if head.starts_with(b"\x76\x2f\x31\x01") {
            return FileKind::OpenExr;
        }
        identify(head).map_or(FileKind::Unknown, FileKind::Other)
    }
}

impl fmt::Display for FileKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FileKind::Dsm => "a deep shadow map (.dsm)",
            FileKind::OpenExr => "an OpenEXR file",
            FileKind::Other(name) => name,
            FileKind::Unknown => "of an unknown kind",
        })
    }
}
