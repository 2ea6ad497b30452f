//! A function of depth before compression: f64 values, and the error it already carries.

use super::{Broken, Side, Visibility, check_laws, evaluate};
use crate::{Error, Result};

/// A transmittance or visibility function before compression.
///
/// Piecewise linear with f32 depths and f64 values, under the same laws as [`Visibility`] but for redundant
/// vertices: 1 before the first vertex, constant after the last, two vertices at a depth for a step (the step
/// from 1 at the first depth is implicit: that depth holds one vertex). [`Curve::error`] says how far the
/// function that it stands for may be from it, at any f32 depth: 0 for steps, the chord error for curved pieces.
///
/// ```
/// use deepshadow::Curve;
/// let c = Curve::mono(vec![1.0, 2.0, 2.0], vec![1.0, 0.75, 0.5]).unwrap();
/// assert_eq!((c.at(2.0, 0), c.behind(2.0, 0)), (0.75, 0.5));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    channels: usize,
    z: Vec<f32>,
    v: Vec<f64>,
    error: f64,
}

impl Default for Curve {
    fn default() -> Self {
        Curve::lit(1)
    }
}

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
            channels,
            z: Vec::new(),
            v: Vec::new(),
            error: 0.0,
        }
    }

    /// A function from its depths (n) and values (n, or n x 3 with the channels of a vertex together).
    ///
    /// # Errors
    /// `Input`, naming the vertex, where a law is broken (see [`Visibility::mono`]), and for lengths that do not fit.
    pub fn from_parts(channels: usize, mut z: Vec<f32>, v: Vec<f64>) -> Result<Self> {
        super::check_channels(channels)?;
        if z.len().checked_mul(channels) != Some(v.len()) {
            return Err(Error::input(format!(
                "{} values for {} depths of {channels} channels",
                v.len(),
                z.len()
            )));
        }
        check_laws(channels, &z, &v).map_err(Broken::input)?;
        z.iter_mut().for_each(|z| *z += 0.0);
        Ok(Curve {
            channels,
            z,
            v,
            error: 0.0,
        })
    }

    /// A monochrome function from its depths and values.
    ///
    /// # Errors
    /// As [`Curve::from_parts`].
    pub fn mono(z: Vec<f32>, v: Vec<f64>) -> Result<Self> {
        Self::from_parts(1, z, v)
    }

    /// A coloured function from its depths and values.
    ///
    /// # Errors
    /// As [`Curve::from_parts`].
    pub fn rgb(z: Vec<f32>, v: Vec<[f64; 3]>) -> Result<Self> {
        Self::from_parts(3, z, v.into_iter().flatten().collect())
    }

    /// The same function, said to be within `error` of what it stands for.
    pub fn with_error(mut self, error: f64) -> Self {
        self.error = error;
        self
    }

    /// Empties the function and makes it one of `channels`, without error, keeping its memory.
    pub(crate) fn reset(&mut self, channels: usize) {
        self.channels = channels;
        self.z.clear();
        self.v.clear();
        self.error = 0.0;
    }

    /// Makes room for `vertices` more.
    pub(crate) fn reserve(&mut self, vertices: usize) {
        self.z.reserve(vertices);
        self.v.reserve(vertices * self.channels);
    }

    /// Appends a vertex whose laws the caller has seen to.
    pub(crate) fn push_unchecked(&mut self, z: f32, v: &[f64]) {
        debug_assert_eq!(v.len(), self.channels);
        debug_assert!(z.is_finite() && self.z.last().is_none_or(|&last| last <= z));
        self.z.push(z + 0.0);
        self.v.extend_from_slice(v);
    }

    /// Appends depth `z`, where the function falls from `front` to `behind`, seeing to the law that the first depth
    /// holds one vertex and that a second one is there only for a step.
    #[inline]
    pub(crate) fn push_depth<const C: usize>(
        &mut self,
        z: f32,
        front: &[f64; C],
        behind: &[f64; C],
    ) {
        debug_assert_eq!(C, self.channels);
        debug_assert!(z.is_finite() && self.z.last().is_none_or(|&last| last < z));
        if !self.z.is_empty() {
            self.z.push(z + 0.0);
            self.v.extend_from_slice(front);
            if front == behind {
                return;
            }
        }
        self.z.push(z + 0.0);
        self.v.extend_from_slice(behind);
    }

    /// Makes a coloured function whose channels are all the same monochrome.
    pub(crate) fn merge_equal_channels(&mut self) {
        if self.channels == 3 && self.v.chunks_exact(3).all(|t| t[0] == t[1] && t[0] == t[2]) {
            for i in 0..self.z.len() {
                self.v[i] = self.v[3 * i];
            }
            self.v.truncate(self.z.len());
            self.channels = 1;
        }
    }

    pub(crate) fn set_error(&mut self, error: f64) {
        self.error = error;
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.z.len()
    }

    /// Whether the function is 1 everywhere because it has no vertex.
    pub fn is_empty(&self) -> bool {
        self.z.is_empty()
    }

    /// 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The depths, sorted.
    pub fn depths(&self) -> &[f32] {
        &self.z
    }

    /// The values: as many as depths, or three times as many, the channels of a vertex together.
    pub fn values(&self) -> &[f64] {
        &self.v
    }

    /// How far the function that this one stands for may be from it.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// Value of channel `c` at depth `z`; at a step, the one in front. A monochrome function has one value for all channels.
    pub fn at(&self, z: f32, c: usize) -> f64 {
        evaluate(
            self.channels,
            &self.z,
            &self.v,
            c % self.channels,
            z,
            Side::At,
        )
    }

    /// Value of channel `c` just behind depth `z`.
    pub fn behind(&self, z: f32, c: usize) -> f64 {
        evaluate(
            self.channels,
            &self.z,
            &self.v,
            c % self.channels,
            z,
            Side::Behind,
        )
    }

    /// Value of channel `c` behind everything.
    pub fn end(&self, c: usize) -> f64 {
        match self.z.len() {
            0 => 1.0,
            n => self.v[(n - 1) * self.channels + c % self.channels],
        }
    }

    /// Becomes the stored function `f`, said to be within `error` of what it stands for.
    pub fn assign(&mut self, f: &Visibility, error: f64) {
        self.reset(f.channels());
        self.z.extend_from_slice(f.depths());
        self.v.extend(f.values().iter().map(|&v| f64::from(v)));
        self.error = error;
    }
}
