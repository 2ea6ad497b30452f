//! The function of depth on borrowed planes: its laws, its canonical form and its evaluation.

use crate::error::Place;
use crate::{Error, Result};

/// A visibility or transmittance function that borrows its depths and values.
///
/// A [`Curve`](crate::Curve), a [`Visibility`](crate::Visibility) and every pixel of a
/// [`Tile`](crate::Tile) give one without a copy. Depths are f32 and sorted. Values are planar: one
/// plane for a monochrome function, three for a coloured one, each of f64, of f32 or of numerators
/// `k` of `k / L`. The laws are those of [`Visibility`](crate::Visibility).
///
/// Methods that take a channel give the one value of a monochrome function for all three.
///
/// ```
/// use deepshadow::{FunctionRef, Vertex, Visibility};
/// let slab = Visibility::mono(vec![Vertex::new(1.0, 1.0), Vertex::new(3.0, 0.5)]).unwrap();
/// let f: FunctionRef = slab.function();
/// assert_eq!((f.len(), f.depths(), f.value(1, 0)), (2, &[1.0, 3.0][..], 0.5));
/// assert_eq!(f.visibility(2.0), 0.75); // half way through the slab
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FunctionRef<'a> {
    depths: &'a [f32],
    channels: usize,
    values: ValuePlanes<'a>,
}

/// Three planes of values, as long as the depths; all the same for a monochrome function.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ValuePlanes<'a> {
    F32([&'a [f32]; 3]),
    F64([&'a [f64]; 3]),
    /// Numerators, and their denominator.
    Lattice([&'a [u16]; 3], u16),
}

/// The f32 nearest to k / L.
#[inline]
pub(crate) fn lattice_value(k: u16, lattice: u16) -> f32 {
    f32::from(k) / f32::from(lattice)
}

/// The k with `lattice_value(k, lattice) == v`, if there is one.
#[inline]
pub(crate) fn lattice_index(v: f32, lattice: u16) -> Option<u16> {
    let k = (f64::from(v) * f64::from(lattice)).round() as u16;
    (lattice_value(k, lattice) == v).then_some(k)
}

/// A law of `spec/semantics.md` that a function breaks, and the index of the vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Broken {
    pub rule: &'static str,
    pub why: &'static str,
    pub vertex: usize,
}

impl Broken {
    /// The error of a caller whose argument breaks the law.
    pub fn input(self) -> Error {
        Error::input(format!("{} ({})", self.why, self.rule)).at(Place::sample(self.vertex))
    }
}

impl<'a> FunctionRef<'a> {
    pub(crate) fn new(depths: &'a [f32], channels: usize, values: ValuePlanes<'a>) -> Self {
        FunctionRef {
            depths,
            channels,
            values,
        }
    }

    /// Number of vertices.
    pub fn len(self) -> usize {
        self.depths.len()
    }

    /// Whether the function is 1 at every depth because it has no vertex.
    pub fn is_empty(self) -> bool {
        self.depths.is_empty()
    }

    /// 1 for a monochrome function, 3 for a coloured one.
    pub fn channels(self) -> usize {
        self.channels
    }

    /// The depths, sorted.
    pub fn depths(self) -> &'a [f32] {
        self.depths
    }

    /// The value of a channel at a vertex.
    ///
    /// # Panics
    /// If there is no such vertex, or `channel` is above 2.
    #[inline]
    pub fn value(self, vertex: usize, channel: usize) -> f64 {
        match self.values {
            ValuePlanes::F32(planes) => f64::from(planes[channel][vertex]),
            ValuePlanes::F64(planes) => planes[channel][vertex],
            ValuePlanes::Lattice(planes, lattice) => {
                f64::from(lattice_value(planes[channel][vertex], lattice))
            }
        }
    }

    /// One channel as a monochrome function, which may have redundant vertices.
    ///
    /// # Panics
    /// If `channel` is above 2.
    pub fn channel(self, channel: usize) -> FunctionRef<'a> {
        FunctionRef {
            channels: 1,
            values: match self.values {
                ValuePlanes::F32(planes) => ValuePlanes::F32([planes[channel]; 3]),
                ValuePlanes::F64(planes) => ValuePlanes::F64([planes[channel]; 3]),
                ValuePlanes::Lattice(planes, lattice) => {
                    ValuePlanes::Lattice([planes[channel]; 3], lattice)
                }
            },
            ..self
        }
    }

    /// Fraction of light that reaches `depth`; of a coloured function, of its red light.
    ///
    /// Linear between vertices; 1 before the first, constant after the last. At a step the value in
    /// front of it, so a surface does not shadow itself. Cost: one binary search. LV00, section
    /// 3.1.
    pub fn visibility(self, depth: f32) -> f64 {
        let [v] = self.evaluate(depth, false);
        v
    }

    /// Fraction of light just behind `depth`: differs from [`FunctionRef::visibility`] only at a
    /// step.
    pub fn visibility_behind(self, depth: f32) -> f64 {
        let [v] = self.evaluate(depth, true);
        v
    }

    /// [`FunctionRef::visibility`] of red, green and blue.
    pub fn visibility_rgb(self, depth: f32) -> [f64; 3] {
        self.evaluate(depth, false)
    }

    /// [`FunctionRef::visibility_behind`] of red, green and blue.
    pub fn visibility_behind_rgb(self, depth: f32) -> [f64; 3] {
        self.evaluate(depth, true)
    }

    /// Visibility behind everything; of a coloured function, its red channel.
    pub fn end(self) -> f64 {
        let [v] = self.last();
        v
    }

    /// Visibility behind everything, of red, green and blue: one minus the pixel's opacity.
    pub fn end_rgb(self) -> [f64; 3] {
        self.last()
    }

    /// The values of the last vertex.
    pub(crate) fn last<const C: usize>(self) -> [f64; C] {
        match self.len() {
            0 => [1.0; C],
            n => self.vertex(n - 1),
        }
    }

    /// The values of a vertex.
    #[inline]
    fn vertex<const C: usize>(self, i: usize) -> [f64; C] {
        std::array::from_fn(|c| self.value(i, c))
    }

    /// The values at a depth, or just behind it. O(log n).
    #[inline]
    pub(crate) fn evaluate<const C: usize>(self, depth: f32, behind: bool) -> [f64; C] {
        let z = self.depths;
        let next = match behind {
            false => z.partition_point(|&d| d < depth),
            true => z.partition_point(|&d| d <= depth),
        };
        if next == 0 {
            return [1.0; C]; // in front of the first vertex, whose own step is implicit
        }
        let i = next - 1;
        if next == z.len() || z[i] == depth {
            return self.vertex(i);
        }
        let t = (f64::from(depth) - f64::from(z[i])) / (f64::from(z[next]) - f64::from(z[i]));
        std::array::from_fn(|c| {
            let (front, back) = (self.value(i, c), self.value(next, c));
            front + (back - front) * t
        })
    }

    /// Whether red, green and blue are the same everywhere.
    pub fn is_monochrome(self) -> bool {
        let equal = |i| {
            let [r, g, b] = self.vertex(i);
            r == g && r == b
        };
        self.channels == 1 || (0..self.len()).all(equal)
    }

    /// Checks the laws of every function: finite sorted depths, at most two vertices a depth and
    /// one at the first, values in 0 to 1 that never rise.
    pub(crate) fn check_laws(self) -> std::result::Result<(), Broken> {
        match self.channels {
            1 => self.check_channels::<1>(),
            _ => self.check_channels::<3>(),
        }
    }

    fn check_channels<const C: usize>(self) -> std::result::Result<(), Broken> {
        let mut last = [1.0; C];
        for (vertex, &z) in self.depths.iter().enumerate() {
            let broken = |rule, why| Err(Broken { rule, why, vertex });
            let before = &self.depths[..vertex];
            if !z.is_finite() {
                return broken("DEPTH-FINITE", "a depth is not a finite number");
            }
            if before.last().is_some_and(|&last| z < last) {
                return broken("DEPTH-ORDER", "a depth is less than the one before it");
            }
            if before == [z] {
                return broken("DEPTH-FIRST", "the first depth holds two vertices");
            }
            if before.ends_with(&[z, z]) {
                return broken("DEPTH-PAIR", "three vertices share one depth");
            }
            let values: [f64; C] = self.vertex(vertex);
            for (value, last) in values.iter().zip(&last) {
                if !(0.0..=1.0).contains(value) {
                    return broken("VISIBILITY-RANGE", "a visibility is outside 0 to 1");
                }
                if value > last {
                    return broken("VISIBILITY-RISE", "a visibility rises with depth");
                }
            }
            last = values;
        }
        Ok(())
    }

    /// Checks the laws of every function that is stored: canonical form included.
    pub(crate) fn check_canonical(self) -> std::result::Result<(), Broken> {
        self.check_laws()?;
        let negative_zero = |v: f64| v == 0.0 && v.is_sign_negative();
        let broken = |(rule, why), vertex| Err(Broken { rule, why, vertex });
        for i in 0..self.len() {
            if negative_zero(self.depths[i].into())
                || (0..self.channels).any(|c| negative_zero(self.value(i, c)))
            {
                return broken(("DEPTH-ZERO", "zero is stored as -0"), i);
            }
            if let Some(law) = self.redundancy(i.checked_sub(1), i) {
                return broken(law, i);
            }
        }
        if self.channels == 3 && self.is_monochrome() {
            return broken(("COLOUR-EQUAL", "a coloured pixel is monochrome"), 0);
        }
        Ok(())
    }

    /// Why vertex `i` is redundant behind vertex `before`, if it is.
    #[inline]
    pub(super) fn redundancy(
        self,
        before: Option<usize>,
        i: usize,
    ) -> Option<(&'static str, &'static str)> {
        let same = |j| (0..self.channels).all(|c| self.value(i, c) == self.value(j, c));
        let at_same_depth = |j: usize| self.depths[i] == self.depths[j];
        let falls = match before {
            None => (0..self.channels).any(|c| self.value(i, c) != 1.0),
            Some(j) => !same(j),
        };
        if falls {
            return None;
        }
        if before.is_some_and(at_same_depth) {
            return Some((
                "VERTEX-STEP",
                "nothing falls between two vertices of one depth",
            ));
        }
        // With nothing before it, a step from 1 is implicit: its depth holds one vertex.
        let is_redundant =
            i + 1 == self.len() || same(i + 1) || (before.is_none() && at_same_depth(i + 1));
        is_redundant.then_some(("VERTEX-REDUNDANT", "a vertex is redundant"))
    }
}

/// Equal depths and equal values, however they are stored.
impl PartialEq for FunctionRef<'_> {
    fn eq(&self, other: &Self) -> bool {
        let same = |i| (0..self.channels).all(|c| self.value(i, c) == other.value(i, c));
        (self.channels, self.depths) == (other.channels, other.depths) && (0..self.len()).all(same)
    }
}

/// The methods that [`Curve`](super::Curve) and [`Visibility`](crate::Visibility) share, in their
/// number types.
macro_rules! owner_of_vertices {
    ($owner:ident, $number:ty) => {
        impl $owner {
            /// Fraction of light that reaches `depth`; of a coloured function, of its red light.
            ///
            /// Linear between vertices; 1 before the first, constant after the last. At a step the
            /// value in front of it, so a surface does not shadow itself. Cost: one binary search.
            /// LV00, section 3.1.
            pub fn visibility(&self, depth: f32) -> $number {
                self.function().visibility(depth) as $number
            }

            /// Fraction of light just behind `depth`. Differs from the visibility at `depth` only
            /// at a step.
            pub fn visibility_behind(&self, depth: f32) -> $number {
                self.function().visibility_behind(depth) as $number
            }

            /// The visibility of red, green and blue; three equal numbers for a monochrome
            /// function.
            pub fn visibility_rgb(&self, depth: f32) -> [$number; 3] {
                self.function()
                    .evaluate(depth, false)
                    .map(|v: f64| v as $number)
            }

            /// The visibility of red, green and blue just behind `depth`.
            pub fn visibility_behind_rgb(&self, depth: f32) -> [$number; 3] {
                self.function()
                    .evaluate(depth, true)
                    .map(|v: f64| v as $number)
            }

            /// Visibility behind everything; of a coloured function, its red channel.
            pub fn end(&self) -> $number {
                self.function().end() as $number
            }

            /// Visibility behind everything, of red, green and blue: one minus the opacity.
            pub fn end_rgb(&self) -> [$number; 3] {
                self.function().end_rgb().map(|v| v as $number)
            }

            /// The function, borrowed.
            pub fn function(&self) -> FunctionRef<'_> {
                self.vertices.view()
            }

            /// Number of vertices.
            pub fn len(&self) -> usize {
                self.vertices.depths.len()
            }

            /// Whether the function is 1 at every depth because it has no vertex.
            pub fn is_empty(&self) -> bool {
                self.vertices.depths.is_empty()
            }

            /// 1 for a monochrome function, 3 for a coloured one.
            pub fn channels(&self) -> usize {
                self.vertices.channels
            }

            /// The depths, sorted.
            pub fn depths(&self) -> &[f32] {
                &self.vertices.depths
            }

            /// The values of a channel, as many as depths. A monochrome function has one plane for
            /// all channels.
            ///
            /// # Panics
            /// If `channel` is above 2.
            pub fn values(&self, channel: usize) -> &[$number] {
                self.vertices.values::<3>()[channel]
            }
        }

        impl<'a> From<&'a $owner> for FunctionRef<'a> {
            fn from(owner: &'a $owner) -> Self {
                owner.function()
            }
        }
    };
}
pub(super) use owner_of_vertices;

/// The number type of owned values.
pub(super) trait Value: Copy + Into<f64> {
    fn planes(planes: [&[Self]; 3]) -> ValuePlanes<'_>;
}

impl Value for f32 {
    fn planes(planes: [&[f32]; 3]) -> ValuePlanes<'_> {
        ValuePlanes::F32(planes)
    }
}

impl Value for f64 {
    fn planes(planes: [&[f64]; 3]) -> ValuePlanes<'_> {
        ValuePlanes::F64(planes)
    }
}

/// The vertices of a function that owns them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Vertices<T> {
    pub channels: usize,
    pub depths: Vec<f32>,
    /// The planes in use are as long as `depths`, the others empty.
    pub planes: [Vec<T>; 3],
}

impl<T: Value> Vertices<T> {
    pub const fn lit(channels: usize) -> Self {
        Vertices {
            channels,
            depths: Vec::new(),
            planes: [const { Vec::new() }; 3],
        }
    }

    /// Vertices that obey the laws.
    pub fn new(mut depths: Vec<f32>, planes: Vec<Vec<T>>) -> Result<Self> {
        let channels = planes.len();
        if ![1, 3].contains(&channels) {
            let what = format!("a function has 1 or 3 channels, not {channels}");
            return Err(Error::input(what));
        }
        if let Some(plane) = planes.iter().find(|plane| plane.len() != depths.len()) {
            let (n, values) = (depths.len(), plane.len());
            return Err(Error::input(format!(
                "{values} values in a plane for {n} depths"
            )));
        }
        depths.iter_mut().for_each(|z| *z += 0.0);
        let mut planes = planes.into_iter();
        let made = Vertices {
            channels,
            depths,
            planes: std::array::from_fn(|_| planes.next().unwrap_or_default()),
        };
        made.view().check_laws().map_err(Broken::input)?;
        Ok(made)
    }

    #[inline]
    pub fn view(&self) -> FunctionRef<'_> {
        FunctionRef::new(&self.depths, self.channels, T::planes(self.values()))
    }

    /// The plane of each channel.
    #[inline]
    pub fn values<const C: usize>(&self) -> [&[T]; C] {
        std::array::from_fn(|c| &self.planes[if self.channels == 1 { 0 } else { c }][..])
    }

    /// Empties the function and makes it one of `channels`, keeping its memory.
    pub fn reset(&mut self, channels: usize) {
        self.channels = channels;
        self.depths.clear();
        self.planes.iter_mut().for_each(Vec::clear);
    }

    /// Becomes a copy of `f`, whose values are converted.
    pub fn assign(&mut self, f: FunctionRef<'_>, value: impl Fn(f64) -> T) {
        self.reset(f.channels);
        self.depths.extend_from_slice(f.depths);
        for (c, plane) in self.planes[..f.channels].iter_mut().enumerate() {
            plane.extend((0..f.len()).map(|i| value(f.value(i, c))));
        }
    }

    /// Appends a vertex; the caller must uphold the laws.
    #[inline]
    pub fn push(&mut self, depth: f32, values: &[T]) {
        debug_assert_eq!(values.len(), self.channels);
        self.depths.push(depth);
        for (plane, value) in self.planes.iter_mut().zip(values) {
            plane.push(*value);
        }
    }

    /// Makes a coloured function whose channels are all the same monochrome.
    pub fn merge_equal_channels(&mut self) {
        if self.view().is_monochrome() {
            self.channels = 1;
            self.planes[1..].iter_mut().for_each(Vec::clear);
        }
    }
}
