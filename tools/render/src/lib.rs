//! A small, honest reference renderer: pictures of scenes, to look at shadows and to measure them.
//!
//! The same rays of a camera, the same footprints and the same bias ask one of four for the light that arrives: a deep shadow map, shadow rays, a plain
//! shadow map, or nobody. What differs between two pictures is then the shadows alone. It is not meant to compete with renderers.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@render`] | from a scene to a picture |
//! | [`mod@trace`] | one ray of the camera |
//! | [`mod@camera`] | where rays begin, and how wide they are |
//! | [`mod@surfaces`] | meshes and strands for rays from one side |
//! | [`mod@triangle`] | a ray against a triangle |
//! | [`mod@shade`] | what surfaces make of light |
//! | [`mod@lamp`] | lights, footprints and bias |
//! | [`mod@shadow`] | how much of a light reaches a point |
//! | [`mod@kernel`] | jittered places over a footprint |
//! | [`mod@image`] | pictures and their files |
//! | [`mod@compare`] | how far two pictures are apart |
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
