//! Intersects rays with surfaces, by rasterising, and with media, by ray marching.
//!
//! | module | content |
//! |---|---|
//! | [`mod@triangles`] | all surfaces of a scene, projected to a view as triangles |
//! | [`mod@ribbon`] | strands as triangles |
//! | [`mod@bins`] | the triangles that each tile sees |
//! | [`mod@raster`] | intersects triangles with the rays of a block of pixels |
//! | [`mod@medium`] | extinction along a ray |

pub mod bins;
pub mod medium;
pub mod raster;
pub mod ribbon;
pub mod triangles;
