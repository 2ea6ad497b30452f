//! What scenes are made of, in object space: triangles, strands, voxels. Plain values; whoever makes one keeps its laws.

use glam::Vec3;

/// Triangles. Vertices that triangles share are shared by index, so that no light falls between the two.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions at each key of the shutter, all of the same length: one set stands still, several move in straight lines.
    pub positions: Vec<Vec<Vec3>>,
    /// Three indices of positions each.
    pub triangles: Vec<[u32; 3]>,
    /// A texture coordinate for each position (u to the right, v up), or none.
    pub uvs: Vec<[f32; 2]>,
}

/// Strands of hair, fur or grass: polylines with a width.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// Points at each key of the shutter, strand after strand, all of the same length.
    pub points: Vec<Vec<Vec3>>,
    /// Where each strand begins in the points, then their number: one more than strands. A strand has at least two points.
    pub strands: Vec<u32>,
    /// Width at each point, or none: then the object's width is that of all.
    pub widths: Vec<f32>,
}

/// A regular grid of numbers: density, or whatever a transfer function turns into extinction.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Samples along x, y and z: at least two each.
    pub size: [u32; 3],
    /// The first sample's place.
    pub origin: Vec3,
    /// From one sample to the next along each axis, positive. Samples stand at the corners of cells: the grid reaches from the first to the last.
    pub spacing: Vec3,
    /// x fastest, then y.
    pub values: Vec<f32>,
}

impl Mesh {
    /// Triangles that stand still.
    pub fn still(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        Mesh {
            positions: vec![positions],
            triangles,
            uvs: Vec::new(),
        }
    }
}

impl Grid {
    /// The least and the greatest value.
    pub fn range(&self) -> (f32, f32) {
        let start = (f32::INFINITY, f32::NEG_INFINITY);
        self.values
            .iter()
            .fold(start, |(lo, hi), &v| (lo.min(v), hi.max(v)))
    }

    /// The last sample's place.
    pub fn last(&self) -> Vec3 {
        let cells = self.size.map(|n| n as f32 - 1.0);
        self.origin + self.spacing * Vec3::from_array(cells)
    }
}

/// The least box that holds the points.
pub fn bounds<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> Option<(Vec3, Vec3)> {
    let mut points = points.into_iter().copied();
    let first = points.next()?;
    Some(points.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
}
