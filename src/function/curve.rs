//! A function of depth before compression: f64 values, and the error it already carries.

use super::FunctionRef;
use super::view::{Vertices, owner_of_vertices};
use crate::Result;

/// A transmittance or visibility function before compression.
///
/// Piecewise linear with f32 depths and f64 values, under the same laws as
/// [`Visibility`](super::Visibility) but for redundant vertices: 1 before the first vertex,
/// constant after the last, two vertices at a depth for a step (the step from 1 at the first depth
/// is implicit: that depth holds one vertex). [`Curve::error`] bounds the distance of the exact
/// function from this one at any f32 depth: 0 for steps, the chord error for curved pieces.
///
/// ```
/// use deepshadow::Curve;
/// let c = Curve::mono(vec![1.0, 2.0, 2.0], vec![1.0, 0.75, 0.5]).unwrap();
/// assert_eq!((c.visibility(2.0), c.visibility_behind(2.0)), (0.75, 0.5));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    pub(super) vertices: Vertices<f64>,
    pub(super) error: f64,
}

impl Default for Curve {
    fn default() -> Self {
        Curve::lit(1)
    }
}

owner_of_vertices!(Curve, f64);

impl Curve {
    /// The function that is 1 everywhere, of 1 or 3 channels.
    ///
    /// # Panics
    /// If `channels` is neither 1 nor 3.
    pub fn lit(channels: usize) -> Self {
        assert!(
            channels == 1 || channels == 3,
            "a function has 1 or 3 channels"
        );
        Curve {
            vertices: Vertices::lit(channels),
            error: 0.0,
        }
    }

    /// A function from its depths and its one or three planes of values.
    ///
    /// # Errors
    /// `Input`, naming the vertex, where a law is broken (see
    /// [`Visibility::mono`](super::Visibility::mono)), and for lengths that do not fit.
    pub fn from_planes(depths: Vec<f32>, planes: Vec<Vec<f64>>) -> Result<Self> {
        Ok(Curve {
            vertices: Vertices::new(depths, planes)?,
            error: 0.0,
        })
    }

    /// A monochrome function from its depths and values.
    ///
    /// # Errors
    /// As [`Curve::from_planes`].
    pub fn mono(depths: Vec<f32>, values: Vec<f64>) -> Result<Self> {
        Self::from_planes(depths, vec![values])
    }

    /// A coloured function from its depths and values.
    ///
    /// # Errors
    /// As [`Curve::from_planes`].
    pub fn rgb(depths: Vec<f32>, values: Vec<[f64; 3]>) -> Result<Self> {
        let plane = |c: usize| values.iter().map(|v| v[c]).collect();
        Self::from_planes(depths, vec![plane(0), plane(1), plane(2)])
    }

    /// The same function, with `error` as the bound of its distance from the exact function.
    pub fn with_error(mut self, error: f64) -> Self {
        self.error = error;
        self
    }

    /// Empties the function and makes it one of `channels`, without error, keeping its memory.
    pub(crate) fn reset(&mut self, channels: usize) {
        self.vertices.reset(channels);
        self.error = 0.0;
    }

    /// Makes room for `vertices` more.
    pub(crate) fn reserve(&mut self, vertices: usize) {
        self.vertices.depths.reserve(vertices);
        for plane in &mut self.vertices.planes[..self.vertices.channels] {
            plane.reserve(vertices);
        }
    }

    /// Appends a vertex; the caller must uphold the laws.
    #[inline]
    pub(crate) fn push_unchecked(&mut self, depth: f32, values: &[f64]) {
        debug_assert!(depth.is_finite() && self.depths().last().is_none_or(|&d| d <= depth));
        self.vertices.push(depth + 0.0, values);
    }

    /// Appends a depth where the function falls from `front` to `behind`: one vertex if it is the
    /// first, or if nothing falls, else two.
    #[inline]
    pub(crate) fn push_depth<const C: usize>(
        &mut self,
        depth: f32,
        front: &[f64; C],
        behind: &[f64; C],
    ) {
        debug_assert!(self.depths().last().is_none_or(|&last| last < depth));
        if !self.is_empty() {
            self.push_unchecked(depth, front);
            if front == behind {
                return;
            }
        }
        self.push_unchecked(depth, behind);
    }

    /// The largest distance of the exact function from this one.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Becomes a copy of `f`, with `error` as the bound of its distance from the exact function.
    pub fn assign<'a>(&mut self, f: impl Into<FunctionRef<'a>>, error: f64) {
        self.vertices.assign(f.into(), |v| v);
        self.error = error;
    }
}
