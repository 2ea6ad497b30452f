//! TressFX `.tfx` files of version 4: strands of equally many points.
//!
//! A header of 160 bytes: version f32, then u32 each: strands, points of a strand, and where arrays begin (points, and four that
//! are passed over: texture coordinates of strands and points, thickness, which TressFX itself does not use, colour). Points are four f32.

use crate::error::Result;
use glam::Vec3;

use super::bytes::{Cursor, Endian};
use super::{fault, finish};
use crate::geometry::Curves;

/// Bytes of the header.
const HEADER: u64 = 160;

/// The strands in a `.tfx` file. They have no width of their own.
///
/// # Errors
/// Another version, or a file that ends before its points do; then as [`finish::Strands`].
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
