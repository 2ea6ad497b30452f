//! Cem Yuksel's `.hair` files: a header of 128 bytes, then arrays. Transparency and colour are
//! ignored.

use crate::error::Result;
use glam::Vec3;

use super::bytes::{Cursor, Endian};
use super::{fault, finish};
use crate::geometry::Curves;

/// Bytes of the header: magic, five numbers, colour and 88 bytes of text.
const HEADER: usize = 128;

/// Flags of the arrays that a file has.
mod flag {
    pub const SEGMENTS: u32 = 1;
    pub const POINTS: u32 = 2;
    pub const THICKNESS: u32 = 4;
    pub const ALL: u32 = 31;
}

/// Parses the strands of a `.hair` file. Their width is the thickness array, or else the thickness
/// in the header; if that is 0, they have no width of their own.
///
/// # Errors
/// Not a `.hair` file, one that ends early, or one whose segments do not add up to its points; then
/// as [`finish::Strands`].
pub fn parse(bytes: &[u8]) -> Result<Curves> {
    let mut file = Cursor::new(bytes, Endian::Little);
    if file.take(4, "header")? != b"HAIR" {
        return fault("does not begin with HAIR");
    }
    let strands = file.u32("header")?;
    let count = u64::from(file.u32("header")?);
    let flags = file.u32("header")?;
    let default_segments = file.u32("header")?;
    let default_thickness = file.f32("header")?;
    file.at(0).take(HEADER as u64, "header")?;
    if flags & !flag::ALL != 0 || flags & flag::POINTS == 0 {
        return fault(format!(
            "the flags are {flags:#x}: they must contain {:#x} (points), and no bit outside {:#x}",
            flag::POINTS,
            flag::ALL
        ));
    }
    let mut file = file.at(HEADER);
    let segments = match flags & flag::SEGMENTS {
        0 => None,
        _ => Some(file.take(u64::from(strands) * 2, "segments")?),
    };
    let sum = match segments {
        None => u64::from(strands).saturating_mul(u64::from(default_segments) + 1),
        Some(bytes) => segment_counts(bytes).map(|n| n + 1).sum(),
    };
    if sum != count {
        return fault(format!(
            "{strands} strands of {sum} points in all, and the header says {count} points"
        ));
    }
    let mut points = Cursor::new(file.take(count * 12, "points")?, Endian::Little);
    let thickness = match flags & flag::THICKNESS {
        0 => None,
        _ => Some(file.take(count * 4, "thickness")?),
    };
    let mut thickness = thickness.map(|bytes| Cursor::new(bytes, Endian::Little));

    let mut out = finish::Strands::default();
    let (mut strand, mut widths) = (Vec::new(), Vec::new());
    // Without points there are no strands to read, whatever count the header announces.
    for n in 0..if count == 0 { 0 } else { strands as usize } {
        let segments = match segments {
            None => default_segments,
            Some(bytes) => u32::from(u16::from_le_bytes([bytes[2 * n], bytes[2 * n + 1]])),
        };
        strand.clear();
        widths.clear();
        for _ in 0..=segments {
            let mut x = || points.f32("points");
            strand.push(Vec3::new(x()?, x()?, x()?));
            match &mut thickness {
                Some(t) => widths.push(t.f32("thickness")?),
                None if default_thickness != 0.0 => widths.push(default_thickness),
                None => {}
            }
        }
        out.add(&strand, &widths)?;
    }
    out.finish()
}

fn segment_counts(bytes: &[u8]) -> impl Iterator<Item = u64> {
    let pairs = bytes.chunks_exact(2);
    pairs.map(|b| u64::from(u16::from_le_bytes([b[0], b[1]])))
}
