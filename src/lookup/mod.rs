//! Filtered lookups (LV00, sections 3.4 and 5.3).
//!
//! | module | what it holds |
//! |---|---|
//! | [`query`] | what is asked, and the options |
//! | [`footprint`] | footprint to levels and kernels |
//! | [`pixel`] | the innermost arithmetic |
//! | [`sampler`] | [`Sampler`]: one map, one thread |
//! | [`batch`] | many lookups at once |

mod batch;
mod footprint;
mod pixel;
mod query;
mod sampler;

pub use pixel::Cursor;
pub use query::{Batch, Border, Footprint, Levels, OnError, Query, SamplerOptions};
pub use sampler::{Sampler, Visit};
