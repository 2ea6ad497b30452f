//! Filtered lookups (LV00, sections 3.4 and 5.3).
//!
//! | module | what it holds |
//! |---|---|
//! | [`query`] | what is asked, and the options |
//! | [`footprint`] | footprint to levels and kernels |
//! | [`level`] | points to blocks of pixels and their weights |
//! | [`pixel`] | pixels at a depth, and the cursor |
//! | [`pins`] | the tiles that a sampler holds |
//! | [`planes`] | the same for one channel, at speed |
//! | [`sampler`] | [`Sampler`]: one map, one thread |
//! | [`wide`] | kernels of any size and direction |
//! | [`batch`] | many lookups at once |
//! | [`camera`] | from world space to a map |
//! | [`world`] | lookups of points in world space |
//! | [`group`] | several maps at once: faces, clusters |

mod batch;
mod camera;
mod footprint;
mod group;
mod level;
mod pins;
mod pixel;
mod planes;
mod query;
mod sampler;
mod wide;
mod world;

pub use camera::{LightPoint, LightSpace};
pub use group::GroupSampler;
pub use pixel::Cursor;
pub use query::{Batch, Border, Footprint, Levels, OnError, Query, SamplerOptions};
pub use sampler::Sampler;
pub use wide::Visit;
pub use world::{WorldFootprint, WorldQuery, WorldSampler};
