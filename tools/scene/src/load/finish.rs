//! The last step of every reader: checks the invariants of geometry.

use crate::error::Result;
use glam::Vec3;

use super::fault;
use crate::geometry::{Curves, Mesh};

/// Makes a mesh from the data of a file, and checks it.
///
/// `uvs` has an entry for each position, or is empty.
///
/// # Errors
/// A position or texture coordinate that is not finite, an index out of range, or no triangles.
pub fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, uvs: Vec<[f32; 2]>) -> Result<Mesh> {
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
    if triangles.is_empty() {
        return fault("holds no faces");
    }
    Ok(Mesh {
        positions: vec![positions],
        triangles,
        uvs,
    })
}

/// Collects the strands of a file. Strands of one point are dropped.
#[derive(Debug, Default)]
pub struct Strands {
    points: Vec<Vec3>,
    starts: Vec<u32>,
    widths: Vec<f32>,
    seen: usize,
}

impl Strands {
    /// Adds a strand. `widths` has an entry for each point, or is empty.
    ///
    /// # Errors
    /// A point that is not finite, a width that is negative or not finite, or more than 2^32 - 1
    /// points.
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
        if points.len() < 2 {
            return Ok(());
        }
        let start = self.points.len();
        self.points.extend_from_slice(points);
        self.widths.extend_from_slice(widths);
        if u32::try_from(self.points.len()).is_err() {
            return fault("more points than 2^32 - 1");
        }
        self.starts.push(start as u32);
        Ok(())
    }

    /// Returns all added strands.
    ///
    /// # Errors
    /// There are no strands of at least two points.
    pub fn finish(mut self) -> Result<Curves> {
        if self.starts.is_empty() {
            return match self.seen {
                0 => fault("holds no strands"),
                n => fault(format!("none of its {n} strands has two points")),
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
