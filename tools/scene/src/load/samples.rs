//! Samples of volumes: their types, their number, and the grid they make.

use std::borrow::Cow;

use crate::error::Result;
use glam::Vec3;

use super::bytes::{Cursor, Endian};
use super::{fault, packed, text};
use crate::geometry::Grid;

/// What a sample is stored as.
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
    /// Bytes of a sample.
    pub fn bytes(self) -> u64 {
        match self {
            Kind::U8 | Kind::I8 => 1,
            Kind::U16 | Kind::I16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::F64 => 8,
        }
    }

    /// By the name of the Rust type.
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

    /// All samples of these bytes, the nearest f32 of each.
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

/// How samples are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As they are.
    Plain,
    /// With gzip.
    Gzip,
    /// With zlib.
    Zlib,
    /// As text, numbers between white space.
    Text,
}

/// Where the samples are.
#[derive(Clone, Debug, PartialEq)]
pub enum Data<'a> {
    /// Behind the header.
    Here(&'a [u8]),
    /// In another file, named as from the header's folder.
    In(String),
}

/// What headers of volumes say.
#[derive(Clone, Debug, PartialEq)]
pub struct Header<'a> {
    /// Samples along x, y and z.
    pub size: [u64; 3],
    /// From one sample to the next.
    pub spacing: [f64; 3],
    /// What a sample is.
    pub kind: Kind,
    /// Which of its bytes comes first.
    pub endian: Endian,
    /// How samples are packed.
    pub encoding: Encoding,
    /// Lines to leave out before the samples.
    pub skip_lines: u64,
    /// Then bytes to leave out, of what is unpacked; none: the samples are the last bytes, which must be plain.
    pub skip_bytes: Option<u64>,
    /// Where the samples are.
    pub data: Data<'a>,
}

impl Header<'_> {
    /// The grid, from the bytes that hold its samples.
    ///
    /// # Errors
    /// Sizes, spacing or values that a grid cannot have, and bytes that are too few, or cannot be unpacked.
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

/// How many samples there are.
///
/// # Errors
/// An axis with less than two, which is no grid, or more than 32 bits count; more than 2^40 in all.
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
        None => fault(format!(
            "a volume of {x} x {y} x {z} samples is beyond all memory"
        )),
    }
}

/// The bytes of the samples, of which there must be enough, and, unless `more` may follow, not too many.
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

/// Samples that are stored plainly.
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

/// Numbers between white space or commas.
fn numbers(bytes: &[u8], count: u64) -> Result<Vec<f32>> {
    // A digit and a space for each, but for the last.
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

/// A grid at the origin, its laws checked.
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
        return fault("a volume that reaches beyond all numbers");
    }
    Ok(grid)
}
