//! Functions of depth: how to make, evaluate, combine and compress them. No bytes, no files.
//!
//! | module | LV00 | contents |
//! |---|---|---|
//! | [`view`] | 3.1 | a borrowed function: evaluation, the laws, the canonical form |
//! | [`curve`] | 3.2 | a function before compression: f64 values and their error so far |
//! | [`visibility`] | 3.1 | a stored function: f32 vertices in canonical form |
//! | [`ray`] | 3.1, 3.2 | surface hits, thick samples and media of one ray |
//! | [`sweep`] | 5.1 | the filter-weighted sum of many functions |
//! | [`product`] | 3.2 | products of functions |
//! | [`deviation`] | 3.3 | the largest deviation of a stored function from the exact one |
//! | [`compress`] | 3.3 | bounded-error compressors |
//! | [`deep`] | | a function as samples of a deep image |

pub mod compress;
pub mod curve;
pub mod deep;
pub mod deviation;
mod product;
pub mod ray;
pub mod sweep;
pub mod view;
pub mod visibility;

pub use curve::Curve;
pub use deep::DeepSample;
pub use deviation::Deviation;
pub use ray::{Channels, Ray};
pub use sweep::Sweep;
pub use view::FunctionRef;
pub use visibility::{Vertex, Visibility};

pub(crate) use view::Broken;

use crate::{Error, Result};

/// Checks that a function has one channel or three.
pub(crate) fn check_channels(channels: usize) -> Result<()> {
    match channels {
        1 | 3 => Ok(()),
        n => Err(Error::input(format!(
            "a function has 1 or 3 channels, not {n}"
        ))),
    }
}

/// A depth as an integer. Keeps the order: adjacent floats become adjacent integers.
pub(crate) fn ordered_bits(z: f32) -> u32 {
    let bits = z.to_bits();
    bits ^ (((bits as i32 >> 31) as u32) | 0x8000_0000)
}

/// The inverse of [`ordered_bits`].
pub(crate) fn from_ordered_bits(ordered: u32) -> f32 {
    let flip = if ordered >> 31 == 1 {
        0x8000_0000
    } else {
        u32::MAX
    };
    f32::from_bits(ordered ^ flip)
}

/// The farthest f32 depth up to `z + h`, but at least the float after `z` and at most `end`.
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

/// The smallest chord tolerance. It bounds the number of subdivisions of a curved piece.
pub(crate) const LEAST_CHORD_TOLERANCE: f64 = 1e-9;
