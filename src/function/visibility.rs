//! The stored visibility function: f32 depths and f32 visibilities in canonical form.

use super::FunctionRef;
use super::view::{Vertices, owner_of_vertices};
use crate::Result;

/// One vertex of a visibility function: one visibility, or three (`Vertex<[f32; 3]>`, LV00,
/// section 5.2).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vertex<V = f32> {
    /// Depth, in the units of the map.
    pub depth: f32,
    /// Fraction of light that reaches it, 0 to 1.
    pub visibility: V,
}

impl<V> Vertex<V> {
    /// A vertex at `depth`.
    pub fn new(depth: f32, visibility: V) -> Self {
        Vertex { depth, visibility }
    }
}

/// The visibility function of one pixel: how much light reaches each depth (LV00, section 3.1).
///
/// Piecewise linear, never rising, 1 before the first vertex and constant after the last; one
/// channel, or three. Two vertices at one depth are a step. Always in the canonical form of
/// `spec/semantics.md`: no vertex is redundant, and the step from 1 at the first depth is implicit.
///
/// ```
/// use deepshadow::{Vertex, Visibility};
/// let slab = Visibility::mono(vec![Vertex::new(1.0, 1.0), Vertex::new(3.0, 0.5)]).unwrap();
/// assert_eq!(slab.visibility(2.0), 0.75); // half way through the slab
/// let wall = Visibility::mono(vec![Vertex::new(5.0, 0.0)]).unwrap();
/// // A surface does not shadow itself.
/// assert_eq!((wall.visibility(5.0), wall.visibility_behind(5.0)), (1.0, 0.0));
/// let glass = Visibility::mono(vec![Vertex::new(2.0, 0.25)]).unwrap();
/// assert_eq!(glass.end_rgb(), [0.25; 3]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Visibility {
    pub(super) vertices: Vertices<f32>,
}

impl Default for Visibility {
    fn default() -> Self {
        Self::lit()
    }
}

owner_of_vertices!(Visibility, f32);

impl FunctionRef<'_> {
    /// A copy that owns its vertices, in f32 and in canonical form.
    pub fn to_visibility(self) -> Visibility {
        let mut out = Visibility::lit();
        out.assign(self);
        out
    }
}

impl Visibility {
    /// The function of a pixel that nothing shadows: 1 at every depth.
    pub const fn lit() -> Self {
        Visibility {
            vertices: Vertices::lit(1),
        }
    }

    /// A monochrome function. Redundant vertices are removed, -0 becomes +0.
    ///
    /// # Errors
    /// `Input`, naming the vertex: depths that are not finite or not sorted, more than two vertices
    /// at a depth or two at the first, visibilities outside 0 to 1 or rising.
    pub fn mono(vertices: Vec<Vertex>) -> Result<Self> {
        let (depths, values) = vertices.iter().map(|p| (p.depth, p.visibility)).unzip();
        Self::from_planes(depths, vec![values])
    }

    /// A coloured function. One whose channels are all the same becomes monochrome.
    ///
    /// # Errors
    /// As [`Visibility::mono`], for any channel.
    pub fn rgb(vertices: Vec<Vertex<[f32; 3]>>) -> Result<Self> {
        let plane = |c: usize| vertices.iter().map(|p| p.visibility[c]).collect();
        let depths = vertices.iter().map(|p| p.depth).collect();
        Self::from_planes(depths, vec![plane(0), plane(1), plane(2)])
    }

    /// A function from its depths and its one or three planes of visibilities.
    ///
    /// # Errors
    /// As [`Visibility::mono`]; and `Input` for lengths that do not fit.
    pub fn from_planes(depths: Vec<f32>, planes: Vec<Vec<f32>>) -> Result<Self> {
        let mut f = Visibility {
            vertices: Vertices::new(depths, planes)?,
        };
        f.canonicalise();
        Ok(f)
    }

    /// Becomes a copy of `f`, keeping its memory.
    pub fn assign<'a>(&mut self, f: impl Into<FunctionRef<'a>>) {
        self.vertices.assign(f.into(), |v| v as f32);
        self.canonicalise();
    }

    /// Removes redundant vertices, makes -0 +0, and a coloured function with equal channels
    /// monochrome.
    pub(super) fn canonicalise(&mut self) {
        self.vertices.merge_equal_channels();
        let mut kept = 0usize;
        for i in 0..self.len() {
            if self.function().redundancy(kept.checked_sub(1), i).is_some() {
                continue;
            }
            self.vertices.depths[kept] = self.vertices.depths[i] + 0.0;
            for plane in &mut self.vertices.planes[..self.vertices.channels] {
                plane[kept] = plane[i] + 0.0;
            }
            kept += 1;
        }
        self.vertices.depths.truncate(kept);
        self.vertices
            .planes
            .iter_mut()
            .for_each(|p| p.truncate(kept));
        if kept == 0 {
            self.vertices.channels = 1;
        }
    }
}
