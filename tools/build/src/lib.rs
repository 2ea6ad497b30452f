//! Deep shadow maps from scenes: hair, meshes, volumes and any mix of them, moving or not, as several kinds of light see them.

pub mod build;
pub mod demo;
pub mod geometry;
pub mod hits;
pub mod load;
pub mod pixels;
pub mod program;
pub mod samples;
pub mod scene;
pub mod transfer;
