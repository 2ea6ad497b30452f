//! Samples and nothing else: what they are and how many must be said beside.

use std::str::FromStr;

use crate::error::{Error, Result};

use super::bytes::Endian;
use super::samples::{self, Kind};
use crate::geometry::Grid;

/// What the samples of a raw file are: x fastest, then y, with a spacing of one.
///
/// As text, `64x64x93:u16`: samples along x, y and z, and the type of each, `u8`, `i8`, `u16`, `i16`, `u32`, `i32`, `f32` or `f64`.
/// Its least byte comes first; with `be` behind, as in `u16be`, its greatest.
///
/// ```
/// use deepshadow_scene::load::RawShape;
/// let shape: RawShape = "64x64x93:u16be".parse()?;
/// assert_eq!(shape.size, [64, 64, 93]);
/// # Ok::<(), deepshadow_scene::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawShape {
    /// Samples along x, y and z.
    pub size: [u32; 3],
    /// What each is stored as.
    pub kind: Kind,
    /// Which of its bytes comes first.
    pub endian: Endian,
}

impl RawShape {
    /// From the two parts of its text, `64x64x93` and `u16be`.
    ///
    /// # Errors
    /// One that is not of this form.
    pub fn new(size: &str, kind: &str) -> Result<Self> {
        let mut parts = size.split('x').map(|n| n.trim().parse::<u32>().ok());
        let axes = [parts.next(), parts.next(), parts.next()].map(Option::flatten);
        let ([Some(x), Some(y), Some(z)], None) = (axes, parts.next()) else {
            return Err(Error::of_key(
                "shape",
                format!("the size {size:?} is not of the form 64x64x93"),
            ));
        };
        let little = kind.strip_suffix("le").map(|k| (k, Endian::Little));
        let (name, endian) = little
            .or(kind.strip_suffix("be").map(|k| (k, Endian::Big)))
            .unwrap_or((kind, Endian::Little));
        let Some(kind) = Kind::named(name) else {
            return Err(Error::of_key(
                "type",
                format!(
                    "the type {kind:?} is none of u8 i8 u16 i16 u32 i32 f32 f64, perhaps with le or be behind"
                ),
            ));
        };
        Ok(RawShape {
            size: [x, y, z],
            kind,
            endian,
        })
    }
}

impl FromStr for RawShape {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.split_once(':') {
            Some((size, kind)) => RawShape::new(size, kind),
            None => Err(Error::of_key(
                "shape",
                format!("the shape {text:?} is not of the form 64x64x93:u16"),
            )),
        }
    }
}

/// The grid in a raw file.
///
/// # Errors
/// The file is not exactly as long as the shape says, or a grid cannot have this shape or a value.
pub fn parse(bytes: &[u8], shape: RawShape) -> Result<Grid> {
    let size = shape.size.map(u64::from);
    let samples = samples::exactly(bytes, size, shape.kind, false)?;
    samples::plain(samples, size, [1.0; 3], (shape.kind, shape.endian), |v| v)
}
