//! The error type of the crate: its kind, the broken rule and the place.

use std::fmt;
use std::sync::Arc;

use crate::map::{LevelId, MapId, Pixel};

/// Result of the fallible functions of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// The kind of an [`Error`], which says who must act.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The system: a read or a write failed. Trying again may help.
    Io,
    /// The file: its bytes break a rule of the specification. Trying again does not help.
    Corrupt,
    /// An upgrade: the file is valid, but needs a feature that this build lacks.
    Unsupported,
    /// A policy: the operation would exceed a limit, set by the caller or the default.
    Limit,
    /// The caller: an argument is outside its domain.
    Input,
    /// The caller's progress callback asked to stop.
    Cancelled,
}

/// An error with its kind, the rule of the specification that the file breaks, and the place.
///
/// The text is one complete line:
///
/// ```
/// use deepshadow::raw::Place;
/// use deepshadow::{Error, MapId};
/// let e = Error::corrupt("TILE-RANGE", "offset 12 lies in the header")
///     .at(Place::byte(8412))
///     .at(Place::tile(17))
///     .at(MapId(0).level(1));
/// assert_eq!(
///     e.to_string(),
///     "file breaks rule TILE-RANGE: offset 12 lies in the header \
///      (map 0, level 1, tile 17, byte 8412)"
/// );
/// ```
#[derive(Clone)]
pub struct Error(Box<Inner>);

#[derive(Clone)]
struct Inner {
    kind: ErrorKind,
    rule: Option<&'static str>,
    what: String,
    place: Place,
    file: Option<String>,
    source: Option<Arc<std::io::Error>>,
}

/// The place of an error: the coordinates that are known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Place {
    /// The map.
    pub map: Option<MapId>,
    /// Mip level, 0 being the base.
    pub level: Option<u32>,
    /// Index of the tile in its level, `ty * tiles_x + tx`.
    pub tile: Option<u64>,
    /// Pixel, in the coordinates of its level.
    pub pixel: Option<Pixel>,
    /// Index of the sample or vertex in its pixel.
    pub sample: Option<usize>,
    /// Byte offset in the file.
    pub byte: Option<u64>,
}

impl Place {
    /// A tile, by its index in its level.
    pub fn tile(index: u64) -> Self {
        Place {
            tile: Some(index),
            ..Place::default()
        }
    }

    /// A sample or vertex, by its index in its pixel.
    pub fn sample(index: usize) -> Self {
        Place {
            sample: Some(index),
            ..Place::default()
        }
    }

    /// A byte, by its offset in the file.
    pub fn byte(offset: u64) -> Self {
        Place {
            byte: Some(offset),
            ..Place::default()
        }
    }

    /// This place; coordinates that it lacks come from `outer`.
    fn or(self, outer: Place) -> Place {
        Place {
            map: self.map.or(outer.map),
            level: self.level.or(outer.level),
            tile: self.tile.or(outer.tile),
            pixel: self.pixel.or(outer.pixel),
            sample: self.sample.or(outer.sample),
            byte: self.byte.or(outer.byte),
        }
    }
}

impl From<MapId> for Place {
    fn from(map: MapId) -> Self {
        Place {
            map: Some(map),
            ..Place::default()
        }
    }
}

impl From<LevelId> for Place {
    fn from(id: LevelId) -> Self {
        Place {
            level: Some(id.level),
            ..id.map.into()
        }
    }
}

impl From<Pixel> for Place {
    fn from(pixel: Pixel) -> Self {
        Place {
            pixel: Some(pixel),
            ..Place::default()
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [
            ("map", self.map.map(|v| v.to_string())),
            ("level", self.level.map(|v| v.to_string())),
            ("tile", self.tile.map(|v| v.to_string())),
            ("pixel", self.pixel.map(|v| v.to_string())),
            ("sample", self.sample.map(|v| v.to_string())),
            ("byte", self.byte.map(|v| v.to_string())),
        ];
        let known = parts
            .iter()
            .filter_map(|(name, v)| Some((name, v.as_ref()?)));
        for (i, (name, value)) in known.enumerate() {
            write!(f, "{}{name} {value}", if i > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

impl Error {
    fn new(kind: ErrorKind, rule: Option<&'static str>, what: impl Into<String>) -> Self {
        Error(Box::new(Inner {
            kind,
            rule,
            what: what.into(),
            place: Place::default(),
            file: None,
            source: None,
        }))
    }

    /// The file breaks `rule` of the specification.
    pub fn corrupt(rule: &'static str, what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Corrupt, Some(rule), what)
    }

    /// The same error in what the caller gave, not in a file.
    pub(crate) fn of_caller(self) -> Self {
        match self.0.rule {
            Some(rule) => Error::input(format!("{} ({rule})", self.0.what)),
            None => Error::input(self.to_string()),
        }
    }

    /// The file needs a feature that this build lacks.
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Unsupported, None, what)
    }

    /// The operation would exceed a limit.
    pub fn limit(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Limit, None, what)
    }

    /// An argument is outside its domain.
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, None, what)
    }

    /// The caller asked to stop.
    pub fn cancelled() -> Self {
        Self::new(ErrorKind::Cancelled, None, "cancelled by the caller")
    }

    /// Reading or writing failed while doing `what`.
    pub fn io(what: impl Into<String>, source: std::io::Error) -> Self {
        let mut e = Self::new(ErrorKind::Io, None, what);
        e.0.source = Some(Arc::new(source));
        e
    }

    /// Adds the coordinates of `place` that the error does not have yet.
    pub fn at(mut self, place: impl Into<Place>) -> Self {
        self.0.place = self.0.place.or(place.into());
        self
    }

    /// Adds the name of the file, unless the error has one already.
    ///
    /// ```
    /// let e = deepshadow::Error::input("no such level").in_file("hair.dsm");
    /// assert_eq!(e.to_string(), "hair.dsm: no such level");
    /// assert_eq!(e.file(), Some("hair.dsm"));
    /// ```
    pub fn in_file(mut self, name: &str) -> Self {
        self.0.file.get_or_insert_with(|| name.to_owned());
        self
    }

    /// The kind, which says who must act.
    pub fn kind(&self) -> ErrorKind {
        self.0.kind
    }

    /// Id of the rule in `spec/` that the file breaks; [`ErrorKind::Corrupt`] only.
    pub fn rule(&self) -> Option<&'static str> {
        self.0.rule
    }

    /// Name of the file, where an operation takes several ([`Error::in_file`]).
    pub fn file(&self) -> Option<&str> {
        self.0.file.as_deref()
    }

    /// The place.
    pub fn place(&self) -> Place {
        self.0.place
    }
}

impl From<std::io::Error> for Error {
    fn from(source: std::io::Error) -> Self {
        Error::io("input or output failed", source)
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner {
            kind,
            rule,
            what,
            place,
            file,
            source,
        } = &*self.0;
        if let Some(file) = file {
            write!(f, "{file}: ")?;
        }
        match (kind, rule) {
            (_, Some(rule)) => write!(f, "file breaks rule {rule}: {what}")?,
            (ErrorKind::Unsupported, _) => write!(f, "unsupported: {what}")?,
            (ErrorKind::Limit, _) => write!(f, "limit exceeded: {what}")?,
            _ => write!(f, "{what}")?,
        }
        if let Some(source) = source {
            write!(f, ": {source}")?;
        }
        if *place != Place::default() {
            write!(f, " ({place})")?;
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
        self.0.source.as_ref().map(|e| &**e as _)
    }
}
