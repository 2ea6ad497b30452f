//! TressFX `.tfx` files of version 4: strands that all have the same number of points.
//!
//! The header has 160 bytes: the version as f32, then as u32 the number of strands, the number of
//! points per strand, and the offsets of five arrays. Only the points are read, four f32 each. The
//! other arrays are texture coordinates of strands and of points, thickness, which TressFX itself
//! does not use, and colour.

use crate::error::Result;
use glam::Vec3;

use super::bytes::{Cursor, Endian};
use super::{fault, finish};
use crate::geometry::Curves;

/// Bytes of the header.
const HEADER: u64 = 160;

/// Parses the strands of a `.tfx` file. They have no width of their own.
///
/// # Errors
/// Another version, or a file that ends before its last point; then as [`finish::Strands`].
pub fn parse(bytes: &[u8]) -> Result<Curves> {
    let mut file = Cursor::new(bytes, Endian::Little);
    let version = file.f32("header")?;
    if version != 4.0 {
        return fault(format!("version {version} of TressFX; 4 is expected"));
    }
    let strands = u64::from(file.u32("header")?);
    let length = file.u32("header")?;
    let start = file.u32("header")?;
    file.at(0).take(HEADER, "header")?;
    if u64::from(start) < HEADER {
        return fault(format!("the points begin at byte {start}, in the header"));
    }
    let mut file = file.at(start as usize);
    let count = strands.saturating_mul(u64::from(length));
    let points = file.take(count.saturating_mul(16), "points")?;
    let mut points = Cursor::new(points, Endian::Little);
    let mut out = finish::Strands::default();
    let mut strand = Vec::new();
    for _ in 0..if length == 0 { 0 } else { strands } {
        strand.clear();
        for _ in 0..length {
            let mut x = || points.f32("points");
            strand.push(Vec3::new(x()?, x()?, x()?));
            points.f32("points")?;
        }
        out.add(&strand, &[])?;
    }
    out.finish()
}
