//! Why a scene cannot be read or built: the kind, the place and one line.

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of reading or building a scene.
pub type Result<T> = std::result::Result<T, Error>;

/// Who must act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The caller: a setting is out of range, or contradicts another one.
    Setting,
    /// The author of the scene: it says something that makes no sense.
    Scene,
    /// The owner of a file that the scene names: the file is damaged or of the wrong kind.
    File,
    /// The system: a file cannot be read or written.
    Io,
    /// The library refused the map, for a reason of its own.
    Map(deepshadow::ErrorKind),
}

/// An error with its kind and its place.
///
/// ```
/// use deepshadow_scene::load::RawShape;
/// use deepshadow_scene::ErrorKind;
/// let error = "64x64x93:u17".parse::<RawShape>().unwrap_err();
/// assert_eq!((error.kind(), error.key()), (ErrorKind::Setting, Some("type")));
/// ```
#[derive(Clone, Debug)]
pub struct Error {
    kind: ErrorKind,
    key: Option<&'static str>,
    file: Option<PathBuf>,
    line: Option<usize>,
    message: String,
}

impl Error {
    /// An error without a place.
    pub(crate) fn new(kind: ErrorKind, message: impl Into<String>) -> Self {
        Error {
            kind,
            key: None,
            file: None,
            line: None,
            message: message.into(),
        }
    }

    /// The value of a key makes no sense, or not together with others.
    pub(crate) fn of_key(key: &'static str, message: impl Into<String>) -> Self {
        Error {
            key: Some(key),
            ..Error::new(ErrorKind::Setting, message)
        }
    }

    /// Who must act.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// The key of a scene file, or the setting of the same name, whose value is wrong.
    pub fn key(&self) -> Option<&'static str> {
        self.key
    }

    /// The file in which the error lies.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The line of a scene file.
    pub fn line(&self) -> Option<usize> {
        self.line
    }

    /// What is wrong, without the place and the key.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// Makes the message begin with `what`.
    pub(crate) fn about(mut self, what: impl fmt::Display) -> Self {
        self.message = format!("{what}: {}", self.message);
        self
    }

    /// Moves an error of a key into the key that holds it; leaves every other error alone.
    pub(crate) fn within(mut self, outer: &'static str) -> Self {
        match self.key.replace(outer) {
            Some(key) => self.about(key),
            None => {
                self.key = None;
                self
            }
        }
    }

    /// Places an error in the scene file that is being read: in this line, in a table of this kind.
    pub(crate) fn at_line(self, file: &Path, line: usize, table: &str) -> Self {
        Error {
            kind: ErrorKind::Scene,
            file: Some(file.to_owned()),
            line: Some(line),
            message: match self.key {
                Some(key) => format!("{table}: {key}: {}", self.message),
                None => self.message,
            },
            ..self
        }
    }
}

/// One line: the file, the line, the key, and what is wrong.
impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            match self.line {
                Some(line) => write!(f, "{}:{line}: ", file.display())?,
                None => write!(f, "{}: ", file.display())?,
            }
        }
        if let Some(key) = self.key.filter(|_| self.line.is_none()) {
            write!(f, "{key}: ")?;
        }
        f.write_str(&self.message.replace('\n', " "))
    }
}

impl std::error::Error for Error {}

impl From<std::io::Error> for Error {
    fn from(e: std::io::Error) -> Self {
        Error::new(ErrorKind::Io, e.to_string())
    }
}

impl From<deepshadow::Error> for Error {
    fn from(e: deepshadow::Error) -> Self {
        Error::new(ErrorKind::Map(e.kind()), e.to_string())
    }
}

/// Names the file in which an error lies, unless the error names one already.
pub(crate) trait InFile<T> {
    /// `FILE: what went wrong`.
    fn in_file(self, path: &Path) -> Result<T>;
}

impl<T, E: Into<Error>> InFile<T> for std::result::Result<T, E> {
    fn in_file(self, path: &Path) -> Result<T> {
        self.map_err(|e| {
            let mut e: Error = e.into();
            let named = e.file.is_some() || e.message.contains(&*path.to_string_lossy());
            if !named && e.kind != ErrorKind::Setting {
                e.file = Some(path.to_owned());
            }
            e
        })
    }
}
