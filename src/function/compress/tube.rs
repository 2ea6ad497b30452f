//! The values that an output may take: storable values inside the tube around the input.

use super::Precision;
use crate::Curve;
use crate::function::view::lattice_value;

/// Bound of the f64 rounding error of a value that the compressors compute, with a wide margin. The
/// tube is narrower than the tolerance by ten times this, so the tolerance holds for the exact
/// interpolation of the stored values.
pub(super) const SLACK: f64 = 1e-13;

/// The storable values: all f32 values, or a lattice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    /// Number of lattice steps from 0 to 1; 0 means that every f32 is storable.
    pub lattice: u16,
    scale: f64,
    /// Any interval in [0,1] of at least this length contains a storable value.
    pub gap: f64,
}

impl Grid {
    pub fn new(precision: Precision) -> Self {
        let lattice = precision.lattice();
        let scale = f64::from(lattice);
        let step = if lattice == 0 { 0.0 } else { 1.0 / scale };
        Grid {
            lattice,
            scale,
            // Rounding to f32 moves each of two neighbours by up to 2^-25.
            gap: step + 1.0 / f64::from(1 << 23),
        }
    }

    fn value(self, k: u32) -> f64 {
        f64::from(lattice_value(k as u16, self.lattice))
    }

    /// The storable value nearest to `x` in [0,1].
    pub fn nearest(self, x: f64) -> f64 {
        match self.lattice {
            0 => f64::from(x as f32),
            _ => self.value((x * self.scale + 0.5) as u32),
        }
    }

    /// The least storable value that is at least `x`, for `x` up to 1.
    fn above(self, x: f64) -> f64 {
        let near = self.nearest(x.max(0.0));
        if near >= x {
            return near;
        }
        match self.lattice {
            0 => f64::from((near as f32).next_up()),
            _ => self.value((near * self.scale + 1.5) as u32),
        }
    }

    /// The greatest storable value that is at most `x`, for `x` from 0 up.
    fn below(self, x: f64) -> f64 {
        let near = self.nearest(x.min(1.0));
        if near <= x {
            return near;
        }
        match self.lattice {
            0 => f64::from((near as f32).next_down()),
            _ => self.value((near * self.scale - 0.5) as u32),
        }
    }

    /// The least and the greatest storable value in [lo, hi], if there is one.
    #[inline]
    pub fn between(self, lo: f64, hi: f64) -> Option<(f64, f64)> {
        let (first, last) = (self.above(lo), self.below(hi));
        (first <= last).then_some((first, last))
    }
}

/// One input depth, with the values in front of it and just behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Knot<const C: usize> {
    pub z: f64,
    pub front: [f64; C],
    pub behind: [f64; C],
}

/// Allowed output values of each channel at one depth; none where `lo > hi`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window<const C: usize> {
    pub lo: [f64; C],
    pub hi: [f64; C],
}

/// The tube of allowed outputs: within `eps` of the input, and between the end value and 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tube<const C: usize> {
    pub eps: f64,
    /// The storable value at which the output ends.
    pub end: [f64; C],
    pub grid: Grid,
}

impl<const C: usize> Tube<C> {
    /// A tube for outputs that lie within `tolerance` of a function that ends at `end`.
    pub fn new(tolerance: f64, end: [f64; C], grid: Grid) -> Self {
        Tube {
            eps: tolerance * (1.0 - 1e-12) - 10.0 * SLACK,
            end: end.map(|v| grid.nearest(v)),
            grid,
        }
    }

    fn window(&self, over: &[f64; C], under: &[f64; C]) -> Window<C> {
        Window {
            lo: std::array::from_fn(|c| (over[c] - self.eps).max(self.end[c])),
            hi: std::array::from_fn(|c| (under[c] + self.eps).min(1.0)),
        }
    }

    /// Allowed values for a segment that passes the depth: inside the tube on both sides of it.
    #[inline]
    pub fn through(&self, e: &Knot<C>) -> Window<C> {
        self.window(&e.front, &e.behind)
    }

    /// Allowed values at the depth.
    pub fn front(&self, e: &Knot<C>) -> Window<C> {
        self.window(&e.front, &e.front)
    }

    /// Allowed values just behind the depth.
    pub fn behind(&self, e: &Knot<C>) -> Window<C> {
        self.window(&e.behind, &e.behind)
    }

    /// The least and the greatest storable value of at least `low` that a segment reaches at
    /// distance `dz` from its origin, for each channel.
    ///
    /// `segment` returns the value at the origin and the least and greatest slope of a channel. The
    /// rounding of slopes may take a segment out of the tube. But a vertex must not lie below the
    /// tube, not even by the last bit: the next segment cannot rise to follow a level input.
    #[inline(always)]
    pub fn reach(
        &self,
        segment: impl Fn(usize) -> [f64; 3],
        dz: f64,
        low: &[f64; C],
    ) -> Option<([f64; C], [f64; C])> {
        let (mut first, mut last) = ([0.0; C], [0.0; C]);
        for c in 0..C {
            let [y, lo, hi] = segment(c);
            if lo > hi {
                return None;
            }
            let least = (y + lo * dz - SLACK).max(low[c]);
            let most = (y + hi * dz + SLACK).min(y);
            (first[c], last[c]) = self.grid.between(least, most)?;
        }
        Some((first, last))
    }

    /// Whether the end value is in the tube from just behind the depth to the end.
    #[inline]
    pub fn tail(&self, e: &Knot<C>) -> bool {
        (0..C).all(|c| e.behind[c] - self.eps <= self.end[c])
    }

    /// Whether 1 is in the tube at the depth.
    pub fn lit(&self, e: &Knot<C>) -> bool {
        (0..C).all(|c| e.front[c] + self.eps >= 1.0)
    }

    /// Whether 1 is in the tube at the depth and just behind it.
    pub fn lit_through(&self, e: &Knot<C>) -> bool {
        (0..C).all(|c| e.behind[c] + self.eps >= 1.0)
    }
}

/// Passes the depths of a function to `take`, and whether each is the last, until `take` returns
/// false.
#[inline(always)]
pub fn knots<const C: usize>(curve: &Curve, mut take: impl FnMut(&Knot<C>, bool) -> bool) {
    let z = curve.depths();
    let planes = curve.vertices.values::<C>().map(|plane| &plane[..z.len()]);
    let v = |i: usize| planes.map(|plane| plane[i]);
    let mut next = 0;
    while next < z.len() {
        let first = next;
        let is_step = first > 0 && z.get(first + 1) == Some(&z[first]);
        let last = first + usize::from(is_step);
        next = last + 1;
        let e = Knot {
            z: f64::from(z[first]),
            front: if first == 0 { [1.0; C] } else { v(first) },
            behind: v(last),
        };
        if !take(&e, next == z.len()) {
            return;
        }
    }
}
