//! The visibility function as it is stored: f32 depths, f32 visibilities, in canonical form.

use super::FunctionRef;
use super::view::Vertices;
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
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Visibility(Vertices<f32>);

impl Default for Visibility {
    fn default() -> Self {
        Self::lit()
    }
}

impl<'a> From<&'a Visibility> for FunctionRef<'a> {
    fn from(f: &'a Visibility) -> Self {
        f.function()
    }
}

impl Visibility {
    /// The function of a pixel that nothing shadows: 1 at every depth.
    pub const fn lit() -> Self {
        Visibility(Vertices::lit(1))
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
        let mut f = Visibility(Vertices::new(depths, planes)?);
        f.canonicalise();
        Ok(f)
    }

    /// Becomes a copy of `f`, keeping its memory.
    pub fn assign<'a>(&mut self, f: impl Into<FunctionRef<'a>>) {
        self.0.assign(f.into(), |v| v as f32);
        self.canonicalise();
    }

    /// Empties the function and makes it one of `channels`, keeping its memory.
    pub(crate) fn reset(&mut self, channels: usize) {
        self.0.reset(channels);
    }

    /// Appends a vertex; the caller must uphold the laws, and ends a series of them with
    /// [`Visibility::canonicalise`].
    pub(crate) fn push_unchecked(&mut self, depth: f32, values: &[f32]) {
        self.0.push(depth, values);
    }

    /// Removes redundant vertices, makes -0 +0, and a coloured function with equal channels
    /// monochrome.
    pub(crate) fn canonicalise(&mut self) {
        self.0.merge_equal_channels();
        let mut kept = 0usize;
        for i in 0..self.len() {
            if self.function().redundancy(kept.checked_sub(1), i).is_some() {
                continue;
            }
            self.0.depths[kept] = self.0.depths[i] + 0.0;
            for plane in &mut self.0.planes[..self.0.channels] {
                plane[kept] = plane[i] + 0.0;
            }
            kept += 1;
        }
        self.0.depths.truncate(kept);
        self.0.planes.iter_mut().for_each(|p| p.truncate(kept));
        if kept == 0 {
            self.0.channels = 1;
        }
    }

    /// The function, borrowed.
    pub fn function(&self) -> FunctionRef<'_> {
        self.0.view()
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.0.depths.len()
    }

    /// Whether the pixel is lit at every depth: no vertex.
    pub fn is_empty(&self) -> bool {
        self.0.depths.is_empty()
    }

    /// 1 for a monochrome function, 3 for a coloured one.
    pub fn channels(&self) -> usize {
        self.0.channels
    }

    /// The depths, sorted.
    pub fn depths(&self) -> &[f32] {
        &self.0.depths
    }

    /// The visibilities of a channel, as many as depths. A monochrome function has one for all
    /// channels.
    ///
    /// # Panics
    /// If `channel` is above 2.
    pub fn values(&self, channel: usize) -> &[f32] {
        self.0.values::<3>()[channel]
    }

    /// Fraction of light that reaches `depth`; of a coloured function, of its red light.
    ///
    /// Linear between vertices; 1 before the first, constant after the last. At a step the value in
    /// front of it, so a surface does not shadow itself. Cost: one binary search. LV00, section 3.1.
    pub fn visibility(&self, depth: f32) -> f32 {
        self.function().visibility(depth) as f32
    }

    /// Fraction of light just behind `depth`: differs from [`Visibility::visibility`] only at a
    /// step.
    pub fn visibility_behind(&self, depth: f32) -> f32 {
        self.function().visibility_behind(depth) as f32
    }

    /// [`Visibility::visibility`] of red, green and blue; three equal numbers for a monochrome
    /// function.
    pub fn visibility_rgb(&self, depth: f32) -> [f32; 3] {
        self.function().visibility_rgb(depth).map(|v| v as f32)
    }

    /// [`Visibility::visibility_behind`] of red, green and blue.
    pub fn visibility_behind_rgb(&self, depth: f32) -> [f32; 3] {
        self.function()
            .visibility_behind_rgb(depth)
            .map(|v| v as f32)
    }

    /// Visibility behind everything; of a coloured function, its red channel.
    pub fn end(&self) -> f32 {
        self.function().end() as f32
    }

    /// Visibility behind everything, of red, green and blue: one minus the pixel's opacity.
    ///
    /// ```
    /// # use deepshadow::{Vertex, Visibility};
    /// let glass = Visibility::mono(vec![Vertex::new(2.0, 0.25)]).unwrap();
    /// assert_eq!(glass.end_rgb(), [0.25; 3]);
    /// ```
    pub fn end_rgb(&self) -> [f32; 3] {
        self.function().end_rgb().map(|v| v as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mono(points: &[(f32, f32)]) -> Result<Visibility> {
        Visibility::mono(points.iter().map(|&(z, v)| Vertex::new(z, v)).collect())
    }

    #[test]
    fn redundant_vertices_go_and_the_function_stays() {
        let f = mono(&[
            (0.0, 1.0),
            (1.0, 1.0),
            (2.0, 0.5),
            (3.0, 0.5),
            (4.0, 0.5),
            (5.0, 0.2),
            (6.0, 0.2),
        ])
        .unwrap();
        assert_eq!(f.depths(), [1.0, 2.0, 4.0, 5.0]);
        assert_eq!(f.visibility(3.5), 0.5);
        assert!(mono(&[(0.0, 1.0), (7.0, 1.0)]).unwrap().is_empty());
        assert_eq!(
            mono(&[(1.0, 0.5), (2.0, 0.4), (2.0, 0.4), (3.0, 0.0)])
                .unwrap()
                .len(),
            3
        );
    }

    #[test]
    fn a_step_from_one_becomes_the_first_depth_when_nothing_is_left_before_it() {
        let f = mono(&[(1.0, 1.0), (2.0, 1.0), (2.0, 0.5), (3.0, 0.25)]).unwrap();
        assert_eq!(f, mono(&[(2.0, 0.5), (3.0, 0.25)]).unwrap());
        let step = [(1.0, [1.0; 3]), (2.0, [1.0; 3]), (2.0, [1.0, 0.5, 1.0])];
        let f = Visibility::rgb(step.map(|(z, v)| Vertex::new(z, v)).to_vec()).unwrap();
        let values = [0, 1, 2].map(|c| f.values(c));
        assert_eq!(
            (f.depths(), values),
            (&[2.0][..], [&[1.0][..], &[0.5], &[1.0]])
        );
    }

    #[test]
    fn equal_channels_become_mono() {
        let f = Visibility::rgb(vec![
            Vertex::new(1.0, [0.5; 3]),
            Vertex::new(2.0, [0.25; 3]),
        ])
        .unwrap();
        assert_eq!((f.channels(), f.values(0)), (1, &[0.5f32, 0.25][..]));
    }

    #[test]
    fn broken_laws_are_named() {
        for (points, rule) in [
            (vec![(f32::NAN, 0.5)], "DEPTH-FINITE"),
            (vec![(2.0, 0.5), (1.0, 0.4)], "DEPTH-ORDER"),
            (vec![(1.0, 0.5), (1.0, 0.4)], "DEPTH-FIRST"),
            (
                vec![(0.0, 0.9), (1.0, 0.5), (1.0, 0.4), (1.0, 0.3)],
                "DEPTH-PAIR",
            ),
            (vec![(1.0, 1.5)], "VISIBILITY-RANGE"),
            (vec![(1.0, f32::NAN)], "VISIBILITY-RANGE"),
            (vec![(1.0, 0.5), (2.0, 0.6)], "VISIBILITY-RISE"),
        ] {
            let e = mono(&points).unwrap_err().to_string();
            assert!(e.contains(rule), "{e}");
        }
    }

    #[test]
    fn both_sides_of_a_step() {
        let f = mono(&[(1.0, 0.8), (2.0, 0.6), (2.0, 0.2)]).unwrap();
        assert_eq!((f.visibility(1.0), f.visibility_behind(1.0)), (1.0, 0.8));
        assert_eq!((f.visibility(2.0), f.visibility_behind(2.0)), (0.6, 0.2));
        assert_eq!(f.visibility(2.0f32.next_up()), 0.2);
        assert_eq!(f.visibility(f32::NEG_INFINITY), 1.0);
        assert_eq!(f.visibility(f32::INFINITY), 0.2);
    }
}
