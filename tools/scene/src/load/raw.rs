//! Raw files: only samples. Their size and type are given separately.

use std::str::FromStr;

use crate::error::{Error, Result};

use super::bytes::Endian;
use super::samples::{self, Kind};
use crate::geometry::Grid;

/// Size and type of the samples in a raw file. Samples are stored with x fastest, then y, and have
/// a spacing of one.
///
/// As text, `64x64x93:u16`: number of samples along x, y and z, and the type of each: `u8`, `i8`,
/// `u16`, `i16`, `u32`, `i32`, `f32` or `f64`. Samples are little-endian; the suffix `be`, as in
/// `u16be`, means big-endian.
///
/// ```
/// use deepshadow_scene::load::RawShape;
/// let shape: RawShape = "64x64x93:u16be".parse()?;
/// assert_eq!(shape.size, [64, 64, 93]);
/// # Ok::<(), deepshadow_scene::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawShape {
    /// Number of samples along x, y and z.
    pub size: [u32; 3],
    /// Type of a sample.
    pub kind: Kind,
    /// Byte order of a sample.
    pub endian: Endian,
}

impl RawShape {
    /// Parses the two parts of the text, such as `64x64x93` and `u16be`.
    ///
    /// # Errors
    /// A part that does not have this form.
    pub fn new(size: &str, kind: &str) -> Result<Self> {
        let mut parts = size.split('x').map(|n| n.trim().parse::<u32>().ok());
        let axes = [parts.next(), parts.next(), parts.next()].map(Option::flatten);
        let ([Some(x), Some(y), Some(z)], None) = (axes, parts.next()) else {
            return Err(Error::of_key(
                "shape",
                format!("{size:?} is not of the form WxHxD, such as 64x64x93"),
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
                    "the type {kind:?} is not one of u8 i8 u16 i16 u32 i32 f32 f64, \
                     optionally with the suffix le or be"
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
/// The file's length does not match the shape, or the shape or a sample is invalid for a grid.
pub fn parse(bytes: &[u8], shape: RawShape) -> Result<Grid> {
    let size = shape.size.map(u64::from);
    let samples = samples::exactly(bytes, size, shape.kind, false)?;
    samples::plain(samples, size, [1.0; 3], (shape.kind, shape.endian), |v| v)
}
