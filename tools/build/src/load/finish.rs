//! The last step of every loader: the laws of geometry, so that what follows need not ask again.

use deepshadow_cli::Result;
use glam::Vec3;

use super::fault;
use crate::geometry::{Curves, Mesh};

/// A mesh, its triangles without area dropped.
///
/// `uvs` has an entry for each position, or none.
///
/// # Errors
/// A position or texture coordinate that is not finite, an index without a position, or nothing left.
pub fn mesh(
    positions: Vec<Vec3>,
    mut triangles: Vec<[u32; 3]>,
    uvs: Vec<[f32; 2]>,
) -> Result<Mesh> {
    debug_assert!(uvs.is_empty() || uvs.len() == positions.len());
    if let Some(i) = positions.iter().position(|p| !p.is_finite()) {
        return fault(format!(
            "vertex {} is not at a finite place, but at {}",
            i + 1,
            place(positions[i])
        ));
    }
    if let Some(i) = uvs.iter().position(|uv| !uv.iter().all(|x| x.is_finite())) {
        return fault(format!(
            "the texture coordinate of vertex {} is not finite",
            i + 1
        ));
    }
    let corners = triangles.iter().flatten();
    if let Some(index) = corners
        .into_iter()
        .find(|&&i| i as usize >= positions.len())
    {
        return fault(format!(
            "a face names vertex {index} (counted from 0), and there are {}",
            positions.len()
        ));
    }
    let before = triangles.len();
    triangles.retain(|t| has_area(t.map(|i| positions[i as usize])));
    match (triangles.len(), before) {
        (0, 0) => fault("holds no faces"),
        (0, n) => fault(format!("none of its {n} triangles has an area")),
        _ => Ok(Mesh {
            positions: vec![positions],
            triangles,
            uvs,
        }),
    }
}

/// Whether three corners span an area; in f64, where the product of the smallest differences of floats is still no 0.
fn has_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    (b - a).cross(c - a) != glam::DVec3::ZERO
}

/// Strands, as they come out of a file: points that repeat the one before, and strands of one point, are dropped.
#[derive(Debug, Default)]
pub struct Strands {
    points: Vec<Vec3>,
    starts: Vec<u32>,
    widths: Vec<f32>,
    seen: usize,
}

impl Strands {
    /// Adds a strand; `widths` has an entry for each point, or none.
    ///
    /// # Errors
    /// A point that is not finite, a width that is negative or not finite, or more points than 32 bits count.
    pub fn add(&mut self, points: &[Vec3], widths: &[f32]) -> Result<()> {
        debug_assert!(widths.is_empty() || widths.len() == points.len());
        self.seen += 1;
        if let Some(i) = points.iter().position(|p| !p.is_finite()) {
            return fault(format!(
                "point {} of strand {} is not at a finite place, but at {}",
                i + 1,
                self.seen,
                place(points[i])
            ));
        }
        if let Some(w) = widths.iter().find(|w| !(w.is_finite() && **w >= 0.0)) {
            return fault(format!(
                "strand {} is {w} wide, which is not a finite number from 0 up",
                self.seen
            ));
        }
        let start = self.points.len();
        for (i, &point) in points.iter().enumerate() {
            if self.points.len() == start || self.points.last() != Some(&point) {
                self.points.push(point);
                self.widths.extend(widths.get(i));
            }
        }
        if self.points.len() < start + 2 {
            self.points.truncate(start);
            self.widths.truncate(start);
            return Ok(());
        }
        if u32::try_from(self.points.len()).is_err() {
            return fault("more points than 2^32 - 1");
        }
        self.starts.push(start as u32);
        Ok(())
    }

    /// All strands that were added.
    ///
    /// # Errors
    /// Nothing is left.
    pub fn finish(mut self) -> Result<Curves> {
        if self.starts.is_empty() {
            return match self.seen {
                0 => fault("holds no strands"),
                n => fault(format!("none of its {n} strands has a length")),
            };
        }
        self.starts.push(self.points.len() as u32);
        Ok(Curves {
            points: vec![self.points],
            strands: self.starts,
            widths: self.widths,
        })
    }
}

fn place(p: Vec3) -> String {
    format!("({}, {}, {})", p.x, p.y, p.z)
}
