//! Pure functions of depth: no bytes, no files.
//!
//! | module | LV00 | what it holds |
//! |---|---|---|
//! | [`visibility`] | 3.1 | the stored function: f32 vertices, evaluation, the laws |
//! | [`curve`] | 3.2 | the same before compression: f64 values and the error they already carry |
//! | [`transmittance`] | 3.1, 3.2 | surface hits, thick samples and media of one ray |
//! | [`sweep`] | 5.1 | the filter-weighted sum of many functions |
//! | [`combine`] | 3.2 | products of functions |
//! | [`compress`] | 3.3 | bounded-error compressors |
//! | [`exact`] | 3.3 | the measuring stick: the largest deviation of a stored function |

pub mod combine;
pub mod compress;
pub mod curve;
pub mod exact;
pub mod sweep;
pub mod transmittance;
pub mod visibility;

pub use combine::product;
pub use curve::Curve;
pub use exact::{Deviation, Reference, deviation};
pub use sweep::Sweep;
pub use transmittance::{Channels, Ray};
pub use visibility::{Vertex, VertexRgb, Visibility};

use crate::{Error, Place, Result};

/// A law of `spec/semantics.md` that a list of vertices breaks, and the index of the vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Broken {
    pub rule: &'static str,
    pub why: &'static str,
    pub vertex: usize,
}

impl Broken {
    /// The law broken by a caller's argument.
    pub fn input(self) -> Error {
        Error::input(format!("{} ({})", self.why, self.rule)).at(Place::sample(self.vertex))
    }
}

/// The two value types of functions: f32 stored, f64 before compression.
pub(crate) trait Value: Copy + PartialOrd + Into<f64> {}
impl Value for f32 {}
impl Value for f64 {}

/// Checks the laws that every function of depth obeys: finite sorted depths, at most two
/// vertices a depth and one at the first, values in [0,1] that never rise.
pub(crate) fn check_laws<T: Value>(
    channels: usize,
    z: &[f32],
    v: &[T],
) -> std::result::Result<(), Broken> {
    let broken = |rule, why, vertex| Err(Broken { rule, why, vertex });
    for (i, depth) in z.iter().enumerate() {
        if !depth.is_finite() {
            return broken("DEPTH-FINITE", "a depth is not a finite number", i);
        }
        if i >= 1 && z[i - 1] > *depth {
            return broken("DEPTH-ORDER", "a depth is less than the one before it", i);
        }
        if i == 1 && z[0] == *depth {
            return broken("DEPTH-FIRST", "the first depth holds two vertices", i);
        }
        if i >= 2 && z[i - 2] == *depth {
            return broken("DEPTH-PAIR", "three vertices share one depth", i);
        }
        for c in 0..channels {
            let value: f64 = v[i * channels + c].into();
            if !(0.0..=1.0).contains(&value) {
                return broken("VISIBILITY-RANGE", "a visibility is outside 0 to 1", i);
            }
            if i >= 1 && v[(i - 1) * channels + c] < v[i * channels + c] {
                return broken("VISIBILITY-RISE", "a visibility rises with depth", i);
            }
        }
    }
    Ok(())
}

/// Which side of a depth is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The value at the depth, which is the one in front of a step.
    At,
    /// The value just behind it.
    Behind,
}

/// Value of channel `c` at depth `z`: linear between vertices, 1 before the first, constant after
/// the last. O(log n).
pub(crate) fn evaluate<T: Value>(
    channels: usize,
    zs: &[f32],
    v: &[T],
    c: usize,
    z: f32,
    side: Side,
) -> f64 {
    let value = |i: usize| -> f64 { v[i * channels + c].into() };
    let next = match side {
        Side::At => zs.partition_point(|&d| d < z),
        Side::Behind => zs.partition_point(|&d| d <= z),
    };
    if next == 0 {
        return 1.0; // in front of the first vertex, whose own step is implicit
    }
    let i = next - 1;
    if next == zs.len() || zs[i] == z {
        return value(i);
    }
    let t = (f64::from(z) - f64::from(zs[i])) / (f64::from(zs[next]) - f64::from(zs[i]));
    value(i) + (value(next) - value(i)) * t
}

/// Values per vertex that functions may have: one channel or three.
pub(crate) fn check_channels(channels: usize) -> Result<()> {
    match channels {
        1 | 3 => Ok(()),
        n => Err(Error::input(format!(
            "a function has 1 or 3 channels, not {n}"
        ))),
    }
}

/// Depths as integers in the same order: adjacent floats are adjacent integers.
pub(crate) fn ordered_bits(z: f32) -> u32 {
    let bits = z.to_bits();
    bits ^ (((bits as i32 >> 31) as u32) | 0x8000_0000)
}

/// The depth of [`ordered_bits`].
pub(crate) fn from_ordered_bits(ordered: u32) -> f32 {
    let flip = if ordered >> 31 == 1 {
        0x8000_0000
    } else {
        u32::MAX
    };
    f32::from_bits(ordered ^ flip)
}

/// The farthest f32 depth that is at most `h` behind `z`, but at least the next one and at most `end`.
pub(crate) fn step_by(z: f32, h: f64, end: f32) -> f32 {
    let target = f64::from(z) + h;
    if target >= f64::from(end) {
        return end;
    }
    let mut next = target as f32;
    if f64::from(next) > target {
        next = next.next_down();
    }
    next.max(z.next_up()).min(end)
}

/// The smallest chord tolerance that is honoured; it bounds the number of subdivisions of a curved piece.
pub(crate) const LEAST_CHORD_TOLERANCE: f64 = 1e-9;
