//! What a file is, by its first bytes.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use deepshadow::{Error, Result};

/// What the first bytes of a file say that it is. `Display` gives a name with its article.
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
    /// Something else that has a name.
    Other(&'static str),
    /// Nothing at all.
    Empty,
    /// Nobody knows.
    Unknown,
}

const MAGICS: &[(&[u8], &str)] = &[
    (b"\x89PNG", "a PNG image"),
    (b"II*\0", "a TIFF image"),
    (b"MM\0*", "a TIFF image"),
    (b"II+\0", "a BigTIFF image"),
    (b"MM\0+", "a BigTIFF image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"#?RADIANCE", "a Radiance HDR image"),
    (b"\xde\x32\x04\0", "a deep texture (dtex) of PRMan"),
    (b"\0\x04\x32\xde", "a deep texture (dtex) of PRMan"),
    (b"MSD3", "a deep shadow map of 3Delight"),
    (b"3DSM", "a deep shadow map of 3Delight"),
    (b"fbtH", "a Houdini .rat image"),
    (b"Htbf", "a Houdini .rat image"),
    (b"PK\x03\x04", "a zip archive"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"\x1f\x8b", "a gzip archive"),
];

impl FileKind {
    /// The kind of the file at `path`.
    ///
    /// # Errors
    /// `Io` if it cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        let failed = |e| Error::io(format!("cannot open {}", path.display()), e);
        let mut head = Vec::new();
        let file = File::open(path).map_err(failed)?;
        file.take(64).read_to_end(&mut head).map_err(failed)?;
        Ok(Self::of_bytes(&head))
    }

    /// The kind of a file that begins with these bytes; ten are enough.
    pub fn of_bytes(head: &[u8]) -> Self {
        let dsm = &deepshadow::raw::layout::MAGIC;
        // Not all eight bytes, so that a file damaged by a transfer as text is still said to be damaged.
        if head.len() >= 4 && head[1..4] == dsm[1..4] {
            return FileKind::Dsm;
        }
        if head.starts_with(b"\x76\x2f\x31\x01") {
            return FileKind::OpenExr;
        }
        let known = MAGICS.iter().find(|(magic, _)| head.starts_with(magic));
        match known {
            Some((_, name)) => FileKind::Other(name),
            None if head.is_empty() => FileKind::Empty,
            None => FileKind::Unknown,
        }
    }
}

impl fmt::Display for FileKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FileKind::Dsm => "a deep shadow map (.dsm)",
            FileKind::OpenExr => "an OpenEXR file",
            FileKind::Other(name) => name,
            FileKind::Empty => "an empty file",
            FileKind::Unknown => "of an unknown kind",
        })
    }
}
