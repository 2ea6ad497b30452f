//! The one error type: what went wrong, who must act, and where.

use std::fmt;

/// Result of everything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// Who must act on an [`Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The system: a read or a write failed. Trying again may help.
    Io,
    /// The file: its bytes contradict the format or each other, or it was never finished.
    Corrupt,
    /// An upgrade: the file is sound, but asks for what this crate cannot do.
    Unsupported,
    /// A policy: reading on would exceed one of the [`Limits`](crate::Limits).
    Limit,
    /// The caller: an argument is outside its domain.
    Input,
}

/// Where an error happened: as many coordinates as are known.
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
    /// This place, with the coordinates that it lacks taken from `outer`.
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

/// An error with its kind and place; its text is complete in one line.
///
/// ```
/// use deepshadow_exr::{DeepReader, ErrorKind};
/// let e = DeepReader::from_reader(std::io::Cursor::new(b"not an EXR".to_vec())).unwrap_err();
/// assert_eq!(e.kind(), ErrorKind::Corrupt);
/// assert_eq!(e.to_string(), "corrupt OpenEXR file: it does not begin with OpenEXR's magic number (byte 0)");
/// ```
pub struct Error(Box<Inner>);

struct Inner {
    kind: ErrorKind,
    what: String,
    place: Place,
    source: Option<std::io::Error>,
}

impl Error {
    fn new(kind: ErrorKind, what: impl Into<String>) -> Self {
        Error(Box::new(Inner {
            kind,
            what: what.into(),
            place: Place::default(),
            source: None,
        }))
    }

    /// The file contradicts the format or itself.
    pub fn corrupt(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Corrupt, what)
    }

    /// The file asks for something that this crate does not have.
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Unsupported, what)
    }

    /// Reading on would exceed a limit.
    pub fn limit(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Limit, what)
    }

    /// An argument is outside its domain.
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, what)
    }

    /// Reading or writing failed while doing `what`.
    pub fn io(what: impl Into<String>, source: std::io::Error) -> Self {
        let mut e = Self::new(ErrorKind::Io, what);
        e.0.source = Some(source);
        e
    }

    /// The same error, with the coordinates that it lacks taken from `place`.
    pub fn at(mut self, place: Place) -> Self {
        self.0.place = self.0.place.or(place);
        self
    }

    /// The same error, at a byte of the file if it has none yet.
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
            ErrorKind::Limit => "over a limit: ",
            ErrorKind::Io | ErrorKind::Input => "",
        })?;
        f.write_str(&inner.what)?;
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
