//! Builds deep shadow maps from scenes of hair, meshes and volumes. Objects may move, and lights
//! are spot, directional or point lights.
//!
//! The program `dsm-build` is built from this crate; `docs/scenes.md` is the guide to its scene
//! files. A program with its own geometry fills a [`scene::Scene`] and calls [`build::build`], as
//! the example below does. This crate uses only the public API of `deepshadow`, so any renderer can
//! do the same.
//!
//! ```text
//!     files: load    demo    scene file, command line
//!           |          |          |
//!           +----------+----------+
//!                      v
//!     Scene: objects and lights with validated values                     scene
//!                      |
//!                      v    one for each light, six for a point light
//!     View: the rays of a map, and the pixel of each                      scene::light
//!                      |
//!           +----------+------------------+
//!           v                             v
//!     Triangles: meshes and         Medium: volumes                       hits
//!     strands, sorted into the            |
//!     tiles that see them                 |
//!           |                             |
//! Block: the rays of some pixels      |                               samples
//!     Block: the rays of some pixels      |                               samples
//!     and the surfaces that they hit      |                               hits::raster
//!           |                             |
//!           v                             v   up to the first opaque surface
//!     Ray: the transmittance function of one ray                          deepshadow
//!           |
//!           v    times the filter's weight
//!     Curve: the visibility function of one pixel                         pixels
//!           |
//!           v    tile by tile, on all threads
//!     Writer: compression, levels, the file                               build
//! ```
//!
//! | module | content |
//! |---|---|
//! | [`mod@scene`] | objects, lights and camera; scene files |
//! | [`mod@geometry`], [`mod@transfer`] | triangles, strands, grids; transfer functions |
//! | [`mod@load`] | readers for files of meshes, strands and volumes |
//! | [`mod@demo`] | procedural objects |
//! | [`mod@samples`] | positions and times of rays |
//! | [`mod@hits`] | intersections of rays with surfaces and media |
//! | [`mod@pixels`] | visibility functions of pixels |
//! | [`mod@build`] | builds the file of a scene |
//! | [`mod@program`] | the program `dsm-build` |
//!
//! # Example
//!
//! A square blocks half of the light that travels along -z. All light reaches points in front of
//! it, and half of it reaches points behind it.
//!
//! ```
//! use deepshadow::{DsmFile, MapId, TileCache, WorldQuery, WorldSampler};
//! use deepshadow_scene::build::{Settings, build};
//! use deepshadow_scene::geometry::Mesh;
//! use deepshadow_scene::scene::{Light, LightKind, Object, Scene, Shape};
//! use glam::{DVec3, Vec3};
//!
//! # fn main() -> deepshadow_scene::Result<()> {
//! let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
//! let corners = corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
//! let square = Mesh::still(corners, vec![[0, 1, 2], [0, 2, 3]]);
//! let sun = LightKind::Directional {
//!     direction: -DVec3::Z,
//!     up: DVec3::Y,
//!     target: Some(DVec3::ZERO),
//!     size: Some(1.0), // the middle of the square
//! };
//! let scene = Scene {
//!     objects: vec![Object { opacity: [0.5; 3], ..Object::new("square", Shape::Mesh(square)) }],
//!     lights: vec![Light { samples: 16, tolerance: Some(0.001), ..Light::new("sun", sun) }],
//!     ..Scene::default()
//! };
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("square.dsm");
//! let report = build(&scene, &path, &Settings::default(), |_, _| {})?;
//! assert_eq!(report.rays, 512 * 512 * 16);
//! assert_eq!(report.hits, report.rays); // every ray hits it once, also at the shared edge
//!
//! let cache = TileCache::new(1 << 20);
//! let mut map = WorldSampler::new(&cache.add(DsmFile::open(&path)?), MapId(0))?;
//! assert_eq!(map.visibility(&WorldQuery::new([0.25, 0.25, 0.5]))?, 1.0); // in front
//! let behind = map.visibility(&WorldQuery::new([0.25, 0.25, -0.5]))?;
//! assert!((behind - 0.5).abs() <= 0.001); // within the tolerance
//! # Ok(())
//! # }
//! ```

pub mod build;
pub mod demo;
mod error;
pub mod geometry;
pub mod hits;
pub mod load;
pub mod pixels;
pub mod program;
pub mod samples;
pub mod scene;
pub mod transfer;

pub use error::{Error, ErrorKind, Result};
