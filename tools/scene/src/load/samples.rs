//! Samples of volumes: their types and encodings, and their conversion to a grid.

use std::borrow::Cow;

use crate::error::Result;
use glam::Vec3;

use super::bytes::{Cursor, Endian};
use super::{fault, packed, text};
use crate::geometry::Grid;

/// Type of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "they are named like the types")]
pub enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Kind {
    /// Size of a sample in bytes.
    pub fn bytes(self) -> u64 {
        match self {
            Kind::U8 | Kind::I8 => 1,
            Kind::U16 | Kind::I16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::F64 => 8,
        }
    }

    /// The type with the given Rust name.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "u8" => Kind::U8,
            "i8" => Kind::I8,
            "u16" => Kind::U16,
            "i16" => Kind::I16,
            "u32" => Kind::U32,
            "i32" => Kind::I32,
            "f32" => Kind::F32,
            "f64" => Kind::F64,
            _ => return None,
        })
    }

    /// The name of the Rust type.
    pub fn name(self) -> &'static str {
        match self {
            Kind::U8 => "u8",
            Kind::I8 => "i8",
            Kind::U16 => "u16",
            Kind::I16 => "i16",
            Kind::U32 => "u32",
            Kind::I32 => "i32",
            Kind::F32 => "f32",
            Kind::F64 => "f64",
        }
    }

    /// Converts all samples to the nearest f32.
    fn values(self, bytes: &[u8], endian: Endian) -> Vec<f32> {
        fn each<const N: usize>(b: &[u8], endian: Endian, f: impl Fn([u8; N]) -> f32) -> Vec<f32> {
            let number = |chunk: &[u8]| {
                let mut array = [0; N];
                array.copy_from_slice(chunk);
                if endian == Endian::Big {
                    array.reverse();
                }
                f(array)
            };
            b.chunks_exact(N).map(number).collect()
        }
        match self {
            Kind::U8 => each(bytes, endian, |b: [u8; 1]| f32::from(b[0])),
            Kind::I8 => each(bytes, endian, |b| f32::from(i8::from_le_bytes(b))),
            Kind::U16 => each(bytes, endian, |b| f32::from(u16::from_le_bytes(b))),
            Kind::I16 => each(bytes, endian, |b| f32::from(i16::from_le_bytes(b))),
            Kind::U32 => each(bytes, endian, |b| u32::from_le_bytes(b) as f32),
            Kind::I32 => each(bytes, endian, |b| i32::from_le_bytes(b) as f32),
            Kind::F32 => each(bytes, endian, f32::from_le_bytes),
            Kind::F64 => each(bytes, endian, |b| f64::from_le_bytes(b) as f32),
        }
    }
}

/// Encoding of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Plain binary.
    Plain,
    /// Compressed with gzip.
    Gzip,
    /// Compressed with zlib.
    Zlib,
    /// Text: numbers between white space.
    Text,
}

/// Place of the samples.
#[derive(Clone, Debug, PartialEq)]
pub enum Data<'a> {
    /// After the header, in the same file.
    Here(&'a [u8]),
    /// In another file; the path is relative to the header's folder.
    In(String),
}

/// The header of a volume file.
#[derive(Clone, Debug, PartialEq)]
pub struct Header<'a> {
    /// Number of samples along x, y and z.
    pub size: [u64; 3],
    /// Distance between samples.
    pub spacing: [f64; 3],
    /// Type of a sample.
    pub kind: Kind,
    /// Byte order of a sample.
    pub endian: Endian,
    /// Encoding of the samples.
    pub encoding: Encoding,
    /// Number of lines to skip before the samples.
    pub skip_lines: u64,
    /// Then, number of unpacked bytes to skip. `None` means that the samples are the last bytes of
    /// the file; they must be plain.
    pub skip_bytes: Option<u64>,
    /// Place of the samples.
    pub data: Data<'a>,
}

impl Header<'_> {
    /// Reads the grid from the bytes with its samples.
    ///
    /// # Errors
    /// A size, spacing or sample that is invalid for a grid; too few bytes; or bytes that cannot be
    /// unpacked.
    pub fn grid(&self, bytes: &[u8]) -> Result<Grid> {
        let count = count(self.size)?;
        if self.skip_bytes.is_none() && self.encoding != Encoding::Plain {
            return fault("only samples that are stored plainly can be the last bytes of a file");
        }
        let mut bytes = bytes;
        for n in 0..self.skip_lines {
            let Some(end) = bytes.iter().position(|&b| b == b'\n') else {
                return fault(format!(
                    "{} lines are to be left out, and there are {n}",
                    self.skip_lines
                ));
            };
            bytes = &bytes[end + 1..];
        }
        if self.encoding == Encoding::Text {
            let skip = usize::try_from(self.skip_bytes.unwrap_or(0)).unwrap_or(usize::MAX);
            let values = numbers(bytes.get(skip..).unwrap_or_default(), count)?;
            return grid(self.size, self.spacing, values);
        }
        let need = count.saturating_mul(self.kind.bytes());
        let limit = need.saturating_add(self.skip_bytes.unwrap_or(0));
        let bytes = match self.encoding {
            Encoding::Gzip => Cow::Owned(packed::gzip_up_to(bytes, limit)?),
            Encoding::Zlib => Cow::Owned(packed::zlib_up_to(bytes, limit)?),
            Encoding::Plain | Encoding::Text => Cow::Borrowed(bytes),
        };
        let skip = match self.skip_bytes {
            Some(skip) => skip,
            None => (bytes.len() as u64).saturating_sub(need),
        };
        let mut cursor = Cursor::new(&bytes, self.endian);
        cursor.take(skip, "bytes to leave out")?;
        let samples = exactly(cursor.rest(), self.size, self.kind, true)?;
        grid(
            self.size,
            self.spacing,
            self.kind.values(samples, self.endian),
        )
    }
}

/// Number of samples.
///
/// # Errors
/// An axis with fewer than two samples or more than 2^32 - 1, or 2^40 samples or more in all.
pub fn count(size: [u64; 3]) -> Result<u64> {
    let product = size
        .iter()
        .try_fold(1u64, |n, &s| n.checked_mul(s))
        .filter(|&n| n < 1 << 40 && size.iter().all(|&s| s <= u64::from(u32::MAX)));
    let [x, y, z] = size;
    match product {
        _ if size.iter().any(|&s| s < 2) => fault(format!(
            "a volume of {x} x {y} x {z} samples: there must be two at least along each axis"
        )),
        Some(n) => Ok(n),
        None => fault(format!("a volume of {x} x {y} x {z} samples is too large")),
    }
}

/// Returns the bytes of the samples. There must be enough, and no others unless `more` is set.
pub(super) fn exactly(bytes: &[u8], size: [u64; 3], kind: Kind, more: bool) -> Result<&[u8]> {
    let need = count(size)?.saturating_mul(kind.bytes());
    let have = bytes.len() as u64;
    if have < need || (have > need && !more) {
        let [x, y, z] = size;
        let name = kind.name();
        return fault(format!(
            "{x} x {y} x {z} samples of {name} take {need} bytes, and there are {have}"
        ));
    }
    Ok(&bytes[..need as usize])
}

/// Reads plain binary samples, and applies `change` to each.
///
/// # Errors
/// As [`Header::grid`].
pub(super) fn plain(
    bytes: &[u8],
    size: [u64; 3],
    spacing: [f64; 3],
    (kind, endian): (Kind, Endian),
    change: impl Fn(f32) -> f32,
) -> Result<Grid> {
    let mut values = kind.values(bytes, endian);
    values.iter_mut().for_each(|v| *v = change(*v));
    grid(size, spacing, values)
}

/// Parses numbers between white space or commas.
fn numbers(bytes: &[u8], count: u64) -> Result<Vec<f32>> {
    // Each number takes a digit and a space; the last may lack its space.
    if (bytes.len() as u64).div_ceil(2) < count {
        return fault(format!(
            "{count} samples as text do not fit into {} bytes",
            bytes.len()
        ));
    }
    let mut words = text::Words::new(bytes);
    let mut values = Vec::with_capacity(count as usize);
    for _ in 0..count {
        values.push(words.number("a sample")?);
    }
    Ok(values)
}

/// Makes a grid at the origin, and checks its invariants.
fn grid(size: [u64; 3], spacing: [f64; 3], values: Vec<f32>) -> Result<Grid> {
    let step = Vec3::from_array(spacing.map(|s| s as f32));
    if !(step.is_finite() && step.cmpgt(Vec3::ZERO).all()) {
        let [x, y, z] = spacing;
        return fault(format!(
            "spacing of {x} x {y} x {z}: finite numbers above 0 are expected"
        ));
    }
    if let Some(i) = values.iter().position(|v| !v.is_finite()) {
        let (i, [nx, ny, _]) = (i as u64, size);
        return fault(format!(
            "the sample at {}, {}, {} is {}, which is not a finite number",
            i % nx,
            i / nx % ny,
            i / nx / ny,
            values[i as usize]
        ));
    }
    let grid = Grid {
        size: size.map(|n| n as u32),
        origin: Vec3::ZERO,
        spacing: step,
        values,
    };
    if !grid.last().is_finite() {
        return fault("the extent of the volume overflows f32");
    }
    Ok(grid)
}
