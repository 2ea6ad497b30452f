//! A small reference renderer, to look at shadows and to measure them.
//!
//! Shadows come from one of four sources: a deep shadow map, shadow rays, a plain shadow map, or
//! none. All sources get the same camera rays, footprints and bias, so that two pictures differ in
//! their shadows only. It does not compete with production renderers.
//!
//! | module | contents |
//! |---|---|
//! | [`mod@render`] | renders a scene to a picture |
//! | [`mod@trace`] | traces one camera ray |
//! | [`mod@camera`] | camera rays and their widths |
//! | [`mod@surfaces`] | meshes and strands in a bounding volume hierarchy |
//! | [`mod@triangle`] | intersects a ray with a triangle |
//! | [`mod@shade`] | reflection of light by surfaces |
//! | [`mod@lamp`] | lights, footprints and bias |
//! | [`mod@shadow`] | fraction of a light that reaches a point |
//! | [`mod@kernel`] | jittered offsets over a footprint |
//! | [`mod@image`] | pictures, PNG and OpenEXR files |
//! | [`mod@compare`] | differences between two pictures |
//! | [`mod@args`] | the command line |
//! | [`mod@program`] | the program |

pub mod args;
pub mod camera;
pub mod compare;
pub mod image;
pub mod kernel;
pub mod lamp;
pub mod program;
pub mod render;
pub mod shade;
pub mod shadow;
pub mod surfaces;
pub mod trace;
pub mod triangle;
