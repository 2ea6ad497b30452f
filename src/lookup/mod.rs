//! Filtered lookups (LV00, sections 3.4 and 5.3).
//!
//! | module | what it holds |
//! |---|---|
//! | [`query`] | queries, batches and options |
//! | [`plan`] | chooses levels and kernels for a footprint |
//! | [`grid`] | finds the window of pixels around a point, their weights and tiles |
//! | [`tiles`] | the tiles that a sampler holds |
//! | [`descriptor`] | the vertices of pixels; the weighted sum over a window |
//! | [`kernel`] | evaluates pixels at a depth, on every machine |
//! | `avx2` | the same for processors with AVX2 |
//! | [`sampler`] | [`Sampler`]: lookups in one map by one thread |
//! | [`slice`] | the visibility of a rectangle of pixels at one depth |
//! | [`taps`] | kernels of any size and direction; the list of pixels that a lookup reads |
//! | [`batch`] | batched lookups |
//! | [`camera`] | projects world space into a map |
//! | [`world`] | lookups of points in world space, in a map or in a group of maps |

#[cfg(target_arch = "x86_64")]
mod avx2;
mod batch;
mod camera;
mod descriptor;
mod grid;
mod kernel;
mod plan;
mod query;
mod sampler;
mod slice;
mod taps;
mod tiles;
mod world;

pub use camera::LightSpace;
pub use kernel::Cursor;
pub use query::{Batch, Border, Footprint, LevelChoice, OnError, Query, SamplerOptions};
pub use sampler::Sampler;
pub use taps::Tap;
pub use world::{WorldQuery, WorldSampler};
