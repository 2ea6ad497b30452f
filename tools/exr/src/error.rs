//! The error type of this crate: a message, who must act, and where it happened.

use std::fmt;

/// Result with the [`Error`] of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Who must act on an [`Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The system: a read or a write failed. A retry may help.
    Io,
    /// The file: its bytes contradict the format or each other, or it is unfinished.
    Corrupt,
    /// An upgrade: the file is sound, but needs a feature that this crate lacks.
    Unsupported,
    /// A policy: the file exceeds one of the [`Limits`](crate::Limits).
    Limit,
    /// The caller: an argument is outside its domain.
    Input,
}

/// Where an error happened; unknown coordinates are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Index of the part in the file.
    pub part: Option<usize>,
    /// Index of the block in its part.
    pub block: Option<usize>,
    /// Pixel, in the coordinates of the data window.
    pub pixel: Option<(i32, i32)>,
    /// Index of the sample in its pixel.
    pub sample: Option<usize>,
    /// Byte offset in the file.
    pub byte: Option<u64>,
}

impl Place {
    /// This place, with missing coordinates taken from `outer`.
    fn or(self, outer: Place) -> Place {
        Place {
            part: self.part.or(outer.part),
            block: self.block.or(outer.block),
            pixel: self.pixel.or(outer.pixel),
            sample: self.sample.or(outer.sample),
            byte: self.byte.or(outer.byte),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut sep = "";
        let mut field = |f: &mut fmt::Formatter<'_>, name: &str, value: Option<String>| {
            if let Some(value) = value {
                write!(f, "{sep}{name} {value}")?;
                sep = ", ";
            }
            Ok(())
        };
        field(f, "part", self.part.map(|v| v.to_string()))?;
        field(f, "block", self.block.map(|v| v.to_string()))?;
        field(f, "pixel", self.pixel.map(|(x, y)| format!("{x},{y}")))?;
        field(f, "sample", self.sample.map(|v| v.to_string()))?;
        field(f, "byte", self.byte.map(|v| v.to_string()))
    }
}

/// An error with its kind and place; its message is one line.
///
/// ```
/// use deepshadow_exr::{DeepReader, ErrorKind};
/// let e = DeepReader::from_reader(std::io::Cursor::new(b"not an EXR".to_vec())).unwrap_err();
/// assert_eq!(e.kind(), ErrorKind::Corrupt);
/// assert_eq!(e.to_string(), "corrupt OpenEXR file: no OpenEXR magic number (byte 0)");
/// ```
pub struct Error(Box<Inner>);

struct Inner {
    kind: ErrorKind,
    message: String,
    place: Place,
    source: Option<std::io::Error>,
}

impl Error {
    fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        Error(Box::new(Inner {
            kind,
            message: message.into(),
            place: Place::default(),
            source: None,
        }))
    }

    /// An error of kind [`Corrupt`](ErrorKind::Corrupt).
    pub fn corrupt(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Corrupt, message)
    }

    /// An error of kind [`Unsupported`](ErrorKind::Unsupported).
    pub fn unsupported(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Unsupported, message)
    }

    /// An error of kind [`Limit`](ErrorKind::Limit).
    pub fn limit(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Limit, message)
    }

    /// An error of kind [`Input`](ErrorKind::Input).
    pub fn input(message: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, message)
    }

    /// An error of kind [`Io`](ErrorKind::Io): `message`, then the text of `source`.
    pub fn io(message: impl Into<String>, source: std::io::Error) -> Self {
        let mut e = Self::new(ErrorKind::Io, message);
        e.0.source = Some(source);
        e
    }

    /// Adds the coordinates of `place` that the error lacks.
    pub fn at(mut self, place: Place) -> Self {
        self.0.place = self.0.place.or(place);
        self
    }

    /// Adds the index of a part, unless the error has one.
    pub(crate) fn in_part(self, part: usize) -> Self {
        self.at(Place {
            part: Some(part),
            ..Place::default()
        })
    }

    /// Adds the byte offset `byte`, unless the error has one.
    pub(crate) fn at_byte(self, byte: u64) -> Self {
        self.at(Place {
            byte: Some(byte),
            ..Place::default()
        })
    }

    /// Who must act.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// Where it happened.
    pub fn place(&self) -> Place {
        self.0.place
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let inner = &self.0;
        f.write_str(match inner.kind {
            ErrorKind::Corrupt => "corrupt OpenEXR file: ",
            ErrorKind::Unsupported => "unsupported OpenEXR file: ",
            ErrorKind::Limit => "limit exceeded: ",
            ErrorKind::Io | ErrorKind::Input => "",
        })?;
        f.write_str(&inner.message)?;
        if let Some(source) = &inner.source {
            write!(f, ": {source}")?;
        }
        if inner.place != Place::default() {
            write!(f, " ({})", inner.place)?;
        }
        Ok(())
    }
}

impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}: {self}", self.0.kind)
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source.as_ref().map(|e| e as _)
    }
}
