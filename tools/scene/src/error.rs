//! The error of this crate: its kind, its place and a message of one line.

use std::fmt;
use std::path::{Path, PathBuf};

/// Result of reading or building a scene.
pub type Result<T> = std::result::Result<T, Error>;

/// Who must act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The caller: a setting is out of range or contradicts another setting.
    Setting,
    /// The author of the scene: the scene is invalid.
    Scene,
    /// The owner of a file that the scene names: the file is damaged or of the wrong kind.
    File,
    /// The system: a file cannot be read or written.
    Io,
    /// The library refused the map; this is the library's own kind.
    Map(deepshadow::ErrorKind),
}

/// An error with its kind and place.
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

    /// An error in the value of a key, alone or together with other keys.
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

    /// The key in the scene file, or the setting of the same name, that has the wrong value.
    pub fn key(&self) -> Option<&'static str> {
        self.key
    }

    /// The file that contains the error.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The line in the scene file.
    pub fn line(&self) -> Option<usize> {
        self.line
    }

    /// The message without the place and the key.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// Prefixes the message with `what` and a colon.
    pub(crate) fn about(mut self, what: impl fmt::Display) -> Self {
        self.message = format!("{what}: {}", self.message);
        self
    }

    /// Moves the error of a key to the key `outer` that contains it. Other errors stay unchanged.
    pub(crate) fn within(mut self, outer: &'static str) -> Self {
        match self.key.replace(outer) {
            Some(key) => self.about(key),
            None => {
                self.key = None;
                self
            }
        }
    }

    /// Places an error in a line of the scene file, in a table of the given kind.
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

/// One line: file, line, key and message.
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

/// Adds the file to an error, unless the error already names one.
pub(crate) trait InFile<T> {
    /// Formats as `FILE: message`.
    fn in_file(self, path: &Path) -> Result<T>;
}

impl<T, E: Into<Error>> InFile<T> for std::result::Result<T, E> {
    fn in_file(self, path: &Path) -> Result<T> {
        self.map_err(|e| {
            let mut e: Error = e.into();
            let named = e.file.is_some() || deepshadow_frame::names_file(&e.message, path);
            if !named && e.kind != ErrorKind::Setting {
                e.file = Some(path.to_owned());
            }
            e
        })
    }
}
