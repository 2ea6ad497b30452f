//! Geometry of a scene in object space: triangles, strands and voxel grids. These are plain values;
//! their creator upholds the documented invariants.

use glam::Vec3;

/// A triangle mesh. Adjacent triangles share vertices by index, so no light leaks between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions at each key of the shutter, all sets of the same length. One set is static;
    /// between several sets, vertices move in straight lines.
    pub positions: Vec<Vec<Vec3>>,
    /// Three indices into each set of positions.
    pub triangles: Vec<[u32; 3]>,
    /// A texture coordinate for each position (u to the right, v up), or empty.
    pub uvs: Vec<[f32; 2]>,
}

/// Strands of hair, fur or grass: polylines with a width.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// Points at each key of the shutter, strand after strand, all sets of the same length.
    pub points: Vec<Vec<Vec3>>,
    /// Index of each strand's first point, then the number of points: one entry more than strands.
    /// A strand has at least two points.
    pub strands: Vec<u32>,
    /// Width at each point, or empty: then the object's width applies to all points.
    pub widths: Vec<f32>,
}

/// A regular grid of samples: densities, or any values that a transfer function maps to extinction.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Number of samples along x, y and z: at least two each.
    pub size: [u32; 3],
    /// Position of the first sample.
    pub origin: Vec3,
    /// Distance between samples along each axis, positive. Samples are at the corners of cells: the
    /// grid extends from the first sample to the last.
    pub spacing: Vec3,
    /// The samples, x fastest, then y.
    pub values: Vec<f32>,
}

impl Mesh {
    /// A static mesh without texture coordinates.
    pub fn still(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        Mesh {
            positions: vec![positions],
            triangles,
            uvs: Vec::new(),
        }
    }
}

impl Grid {
    /// The least and the greatest sample.
    pub fn range(&self) -> (f32, f32) {
        let start = (f32::INFINITY, f32::NEG_INFINITY);
        self.values
            .iter()
            .fold(start, |(lo, hi), &v| (lo.min(v), hi.max(v)))
    }

    /// Position of the last sample.
    pub fn last(&self) -> Vec3 {
        let cells = self.size.map(|n| n as f32 - 1.0);
        self.origin + self.spacing * Vec3::from_array(cells)
    }
}

/// The smallest box that contains the points; `None` without points.
pub fn bounds<'a>(points: impl IntoIterator<Item = &'a Vec3>) -> Option<(Vec3, Vec3)> {
    let mut points = points.into_iter().copied();
    let first = points.next()?;
    Some(points.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p))))
}
