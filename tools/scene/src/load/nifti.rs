//! NIfTI-1 in one file, of either byte order: the samples, and the spacing in `pixdim`. The scene's
//! transform gives the orientation.

use crate::error::Result;

use super::bytes::{Cursor, Endian};
use super::samples::{self, Kind};
use super::{fault, packed};
use crate::geometry::Grid;

/// Bytes of the header; also the value of its first field.
const HEADER: u32 = 348;

/// Offsets of the fields that are read.
mod field {
    pub const DIM: usize = 40;
    pub const DATATYPE: usize = 70;
    pub const PIXDIM: usize = 76;
    pub const VOX_OFFSET: usize = 108;
    pub const SCL_SLOPE: usize = 112;
    pub const SCL_INTER: usize = 116;
    pub const MAGIC: usize = 344;
}

/// The fields of the header that are used.
struct Header {
    endian: Endian,
    size: [u64; 3],
    spacing: [f64; 3],
    kind: Kind,
    offset: u64,
    /// Slope and intercept of the samples.
    scale: (f32, f32),
}

/// The grid in a `.nii` file.
///
/// # Errors
/// Not NIfTI-1; samples in another file, with several components, or over time; and as
/// [`samples::Header::grid`].
pub fn parse(bytes: &[u8]) -> Result<Grid> {
    let header = header(bytes)?;
    let mut file = Cursor::new(bytes, header.endian);
    file.take(header.offset, "header")?;
    let samples = samples::exactly(file.rest(), header.size, header.kind, true)?;
    let (slope, inter) = header.scale;
    samples::plain(
        samples,
        header.size,
        header.spacing,
        (header.kind, header.endian),
        |v| {
            if (slope, inter) == (1.0, 0.0) {
                v
            } else {
                (f64::from(v) * f64::from(slope) + f64::from(inter)) as f32
            }
        },
    )
}

/// The grid in a `.nii.gz` file. Unpacks no more bytes than the header announces.
///
/// # Errors
/// As [`parse`], and data that is not gzip.
pub fn parse_packed(bytes: &[u8]) -> Result<Grid> {
    let header = header(&packed::gzip_up_to(bytes, u64::from(HEADER))?)?;
    let size = samples::count(header.size)?.saturating_mul(header.kind.bytes());
    parse(&packed::gzip_up_to(
        bytes,
        size.saturating_add(header.offset),
    )?)
}

fn header(bytes: &[u8]) -> Result<Header> {
    let mut file = Cursor::new(bytes, Endian::Little);
    let endian = match file.u32("header")? {
        HEADER => Endian::Little,
        n if n.swap_bytes() == HEADER => Endian::Big,
        n if n == 540 || n.swap_bytes() == 540 => {
            return fault("NIfTI-2; only NIfTI-1 is read");
        }
        n => return fault(format!("begins with {n}, not with 348 as NIfTI-1 does")),
    };
    let file = Cursor::new(bytes, endian);
    file.at(0).take(u64::from(HEADER), "header")?;
    match file.at(field::MAGIC).take(4, "header")? {
        b"n+1\0" => {}
        b"ni1\0" => return fault("the samples are in another file; only one file is read"),
        _ => return fault("does not have the magic n+1 of NIfTI-1 in one file"),
    }
    let f32_at = |at: usize| file.at(at).f32("header");
    let mut dims = file.at(field::DIM);
    let mut dim = [0; 8];
    for d in &mut dim {
        *d = dims.u16("header")?;
    }
    let axes = usize::from(dim[0]);
    if !(3..=7).contains(&axes) || dim[4..=axes].iter().any(|&n| n != 1) {
        let shown = &dim[1..=axes.min(7)];
        return fault(format!(
            "{axes} axes of {shown:?} samples; one volume of three axes is expected"
        ));
    }
    let kind = match file.at(field::DATATYPE).u16("header")? {
        2 => Kind::U8,
        4 => Kind::I16,
        8 => Kind::I32,
        16 => Kind::F32,
        64 => Kind::F64,
        256 => Kind::I8,
        512 => Kind::U16,
        768 => Kind::U32,
        code => {
            return fault(format!(
                "samples of NIfTI type {code}; \
                 only u8, i8, u16, i16, u32, i32, f32 and f64 are read"
            ));
        }
    };
    // The sign belongs to the orientation; 0 means that no spacing is given.
    let step = |axis: usize| -> Result<f64> {
        let step = f32_at(field::PIXDIM + 4 * axis)?;
        Ok(match step.abs() {
            0.0 => 1.0,
            step => f64::from(step),
        })
    };
    let offset = f32_at(field::VOX_OFFSET)?;
    if !(offset >= HEADER as f32 && offset.fract() == 0.0 && offset < 16_777_216.0) {
        return fault(format!(
            "the samples begin at byte {offset}, which is not after the header"
        ));
    }
    // A slope of 0 or NaN means that the samples are not scaled.
    let (slope, inter) = (f32_at(field::SCL_SLOPE)?, f32_at(field::SCL_INTER)?);
    let scaled = slope.is_finite() && slope != 0.0 && inter.is_finite();
    Ok(Header {
        endian,
        size: [1, 2, 3].map(|i| u64::from(dim[i])),
        spacing: [step(1)?, step(2)?, step(3)?],
        kind,
        offset: offset as u64,
        scale: if scaled { (slope, inter) } else { (1.0, 0.0) },
    })
}
