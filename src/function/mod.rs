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
//! | [`depth`] | | steps from one f32 depth to another, and checks that several modules share |
//! | [`deep`] | | a function as samples of a deep image |

pub mod compress;
pub mod curve;
pub mod deep;
mod depth;
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

pub(crate) use depth::{LEAST_CHORD_TOLERANCE, from_ordered_bits, ordered_bits, step_by};
pub(crate) use view::Broken;
