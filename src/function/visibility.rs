//! The visibility function as it is stored: f32 depths, f32 visibilities, in canonical form.

use super::{Broken, Side, check_laws, evaluate};
use crate::Result;

/// One vertex of a monochrome visibility function.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vertex {
    /// Depth, in the units of the map.
    pub z: f32,
    /// Fraction of light that reaches it, 0 to 1.
    pub visibility: f32,
}

impl Vertex {
    /// A vertex at depth `z`.
    pub fn new(z: f32, visibility: f32) -> Self {
        Vertex { z, visibility }
    }
}

/// One vertex of a coloured visibility function (LV00, section 5.2).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VertexRgb {
    /// Depth, in the units of the map.
    pub z: f32,
    /// Fraction of red, green and blue light that reaches it, 0 to 1.
    pub visibility: [f32; 3],
}

impl VertexRgb {
    /// A vertex at depth `z`.
    pub fn new(z: f32, visibility: [f32; 3]) -> Self {
        VertexRgb { z, visibility }
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
/// assert_eq!(slab.at(2.0), 0.75); // half way through the slab
/// let wall = Visibility::mono(vec![Vertex::new(5.0, 0.0)]).unwrap();
/// assert_eq!((wall.at(5.0), wall.behind(5.0)), (1.0, 0.0)); // a surface does not shadow itself
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Visibility {
    channels: usize,
    z: Vec<f32>,
    v: Vec<f32>,
}

impl Default for Visibility {
    fn default() -> Self {
        Self::lit()
    }
}

impl Visibility {
    /// The function of a pixel that nothing shadows: 1 at every depth.
    pub fn lit() -> Self {
        Visibility {
            channels: 1,
            z: Vec::new(),
            v: Vec::new(),
        }
    }

    /// A monochrome function. Redundant vertices are removed, -0 becomes +0.
    ///
    /// # Errors
    /// `Input`, naming the vertex: depths that are not finite or not sorted, more than two vertices at a depth
    /// or two at the first, visibilities outside [0,1] or rising.
    pub fn mono(vertices: Vec<Vertex>) -> Result<Self> {
        let (z, v) = vertices.iter().map(|p| (p.z, p.visibility)).unzip();
        Self::from_parts(1, z, v)
    }

    /// A coloured function. One whose channels are all the same becomes monochrome.
    ///
    /// # Errors
    /// As [`Visibility::mono`], for any channel.
    pub fn rgb(vertices: Vec<VertexRgb>) -> Result<Self> {
        let z = vertices.iter().map(|p| p.z).collect();
        Self::from_parts(3, z, vertices.iter().flat_map(|p| p.visibility).collect())
    }

    /// A function from its depths (n) and its visibilities (n, or n x 3 with the channels of a vertex together).
    ///
    /// # Errors
    /// As [`Visibility::mono`]; and `Input` for lengths that do not fit.
    pub fn from_parts(channels: usize, z: Vec<f32>, v: Vec<f32>) -> Result<Self> {
        super::check_channels(channels)?;
        if z.len().checked_mul(channels) != Some(v.len()) {
            return Err(crate::Error::input(format!(
                "{} visibilities for {} depths of {channels} channels",
                v.len(),
                z.len()
            )));
        }
        check_laws(channels, &z, &v).map_err(Broken::input)?;
        let mut f = Visibility { channels, z, v };
        f.canonicalise();
        Ok(f)
    }

    /// Empties the function and makes it one of `channels`, keeping its memory.
    pub(crate) fn reset(&mut self, channels: usize) {
        self.channels = channels;
        self.z.clear();
        self.v.clear();
    }

    /// Appends a vertex whose laws the caller has seen to; [`Visibility::canonicalise`] ends a series of them.
    pub(crate) fn push_unchecked(&mut self, z: f32, v: &[f32]) {
        debug_assert_eq!(v.len(), self.channels);
        self.z.push(z);
        self.v.extend_from_slice(v);
    }

    /// Removes redundant vertices, makes -0 +0, and a coloured function with equal channels monochrome.
    pub(crate) fn canonicalise(&mut self) {
        if self.channels == 3 && self.v.chunks_exact(3).all(|t| t[0] == t[1] && t[0] == t[2]) {
            let n = self.z.len();
            for i in 0..n {
                self.v[i] = self.v[3 * i];
            }
            self.v.truncate(n);
            self.channels = 1;
        }
        let c = self.channels;
        let n = self.z.len();
        let mut kept = 0;
        for i in 0..n {
            let own = i * c..i * c + c;
            let same_as = |j: usize| self.v[own.clone()] == self.v[j * c..j * c + c];
            let flat_before = if kept == 0 {
                self.v[own.clone()].iter().all(|&v| v == 1.0)
            } else {
                same_as(kept - 1)
            };
            let flat_after = i + 1 == n || same_as(i + 1);
            // The second vertex of a depth is a step only if something falls there.
            let no_step = kept > 0 && self.z[kept - 1] == self.z[i] && same_as(kept - 1);
            // Where all before it went, the step from 1 is implicit: its depth holds one vertex.
            let implicit = kept == 0 && flat_before && i + 1 < n && self.z[i] == self.z[i + 1];
            if (flat_before && flat_after) || no_step || implicit {
                continue;
            }
            self.z[kept] = self.z[i] + 0.0;
            for k in 0..c {
                self.v[kept * c + k] = self.v[i * c + k] + 0.0;
            }
            kept += 1;
        }
        self.z.truncate(kept);
        self.v.truncate(kept * c);
        if kept == 0 {
            self.channels = 1;
        }
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.z.len()
    }

    /// Whether the pixel is lit at every depth: no vertex.
    pub fn is_empty(&self) -> bool {
        self.z.is_empty()
    }

    /// 1 for a monochrome function, 3 for a coloured one.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The depths, sorted.
    pub fn depths(&self) -> &[f32] {
        &self.z
    }

    /// The visibilities: as many as depths, or three times as many, the channels of a vertex together.
    pub fn values(&self) -> &[f32] {
        &self.v
    }

    /// Fraction of light that reaches depth `z`; of a coloured function, its red channel.
    ///
    /// Linear between vertices; 1 before the first, constant after the last. At a step the value in front
    /// of it, so a surface does not shadow itself. Cost: one binary search. LV00, section 3.1.
    pub fn at(&self, z: f32) -> f32 {
        evaluate(self.channels, &self.z, &self.v, 0, z, Side::At) as f32
    }

    /// Fraction of light just behind depth `z`: differs from [`Visibility::at`] only at a step.
    pub fn behind(&self, z: f32) -> f32 {
        evaluate(self.channels, &self.z, &self.v, 0, z, Side::Behind) as f32
    }

    /// [`Visibility::at`] for red, green and blue; three equal numbers for a monochrome function.
    pub fn at_rgb(&self, z: f32) -> [f32; 3] {
        self.each_channel(z, Side::At)
    }

    /// [`Visibility::behind`] for red, green and blue.
    pub fn behind_rgb(&self, z: f32) -> [f32; 3] {
        self.each_channel(z, Side::Behind)
    }

    fn each_channel(&self, z: f32, side: Side) -> [f32; 3] {
        std::array::from_fn(|c| {
            evaluate(self.channels, &self.z, &self.v, c % self.channels, z, side) as f32
        })
    }

    /// Visibility behind everything, for red, green and blue: one minus the pixel's opacity.
    ///
    /// ```
    /// # use deepshadow::{Vertex, Visibility};
    /// let glass = Visibility::mono(vec![Vertex::new(2.0, 0.25)]).unwrap();
    /// assert_eq!(glass.end(), [0.25; 3]);
    /// ```
    pub fn end(&self) -> [f32; 3] {
        match self.z.len() {
            0 => [1.0; 3],
            n => std::array::from_fn(|c| self.v[(n - 1) * self.channels + c % self.channels]),
        }
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
        assert_eq!(f.at(3.5), 0.5);
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
        let f = Visibility::rgb(step.map(|(z, v)| VertexRgb::new(z, v)).to_vec()).unwrap();
        assert_eq!(
            (f.depths(), f.values()),
            (&[2.0f32][..], &[1.0f32, 0.5, 1.0][..])
        );
    }

    #[test]
    fn equal_channels_become_mono() {
        let f = Visibility::rgb(vec![
            VertexRgb::new(1.0, [0.5; 3]),
            VertexRgb::new(2.0, [0.25; 3]),
        ])
        .unwrap();
        assert_eq!((f.channels(), f.values()), (1, &[0.5f32, 0.25][..]));
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
        assert_eq!((f.at(1.0), f.behind(1.0)), (1.0, 0.8));
        assert_eq!((f.at(2.0), f.behind(2.0)), (0.6, 0.2));
        assert_eq!(f.at(2.0f32.next_up()), 0.2);
        assert_eq!(f.at(f32::NEG_INFINITY), 1.0);
        assert_eq!(f.at(f32::INFINITY), 0.2);
    }
}
