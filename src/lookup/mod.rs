//! Filtered lookups (LV00, sections 3.4 and 5.3).
//!
//! | module | what it holds |
//! |---|---|
//! | [`query`] | what is asked, and the options |
//! | [`plan`] | a footprint to levels and kernels |
//! | [`grid`] | a point to a window of pixels, weights and tiles |
//! | [`tiles`] | the tiles that a sampler holds |
//! | [`descriptor`] | where the planes of a tile lie; the sum over a window |
//! | [`kernel`] | pixels at a depth, on every machine |
//! | `avx2` | the same where the processor has AVX2 |
//! | [`sampler`] | [`Sampler`]: one map, one thread |
//! | [`slice`] | the visibility of a rectangle of pixels at one depth |
//! | [`taps`] | kernels of any size and direction; the pixels behind an answer |
//! | [`batch`] | many lookups in one call |
//! | [`camera`] | from world space to a map |
//! | [`world`] | lookups of points in world space |
//! | [`group`] | several maps at once: faces, clusters |

#[cfg(target_arch = "x86_64")]
mod avx2;
mod batch;
mod camera;
mod descriptor;
mod grid;
mod group;
mod kernel;
mod plan;
mod query;
mod sampler;
mod slice;
mod taps;
mod tiles;
mod world;

pub use camera::LightSpace;
pub use group::GroupSampler;
pub use kernel::Cursor;
pub use query::{Batch, Border, Footprint, LevelChoice, OnError, Query, SamplerOptions};
pub use sampler::Sampler;
pub use taps::Tap;
pub use world::{WorldQuery, WorldSampler};
