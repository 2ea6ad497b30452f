//! What rays meet: surfaces by rasterising, media by marching.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@triangles`] | all surfaces of a scene as triangles in the plane of a view |
//! | [`mod@ribbon`] | strands as triangles |
//! | [`mod@bins`] | which triangles a tile sees |
//! | [`mod@raster`] | triangles against the rays of a block of pixels |
//! | [`mod@medium`] | extinction along a ray |

pub mod bins;
pub mod medium;
pub mod raster;
pub mod ribbon;
pub mod triangles;
