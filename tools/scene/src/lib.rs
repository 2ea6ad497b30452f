//! Deep shadow maps from scenes: hair, meshes and volumes, in any mix, moving or not, seen by spot, directional and point lights.
//!
//! `dsm-build` is this crate's program; `docs/scenes.md` is the guide to its scene files. Programs that have geometry of their own fill a
//! [`scene::Scene`] and call [`build::build`], as the example below does. The crate uses no more than deepshadow's public API: any renderer can do the same.
//!
//! ```text
//!     files: load    demo    scene file, command line
//!           |          |          |
//!           +----------+----------+
//!                      v
//!     Scene: objects and lights, every number checked                     scene
//!                      |
//!                      v    one for each light, six for a point light
//!     View: where rays go, and which pixel each belongs to                scene::light
//!                      |
//!           +----------+------------------+
//!           v                             v
//!     Triangles: meshes and         Medium: volumes                       hits
//!     strands, sorted into the            |
//!     tiles that see them                 |
//!           |                             |
//!           v                             |
//!     Block: the rays of some pixels      |                               samples
//!     and the surfaces that they meet     |                               hits::raster
//!           |                             |
//!           v                             v   as far as the first opaque surface
//!     Ray: the transmittance function of one ray                          deepshadow
//!           |
//!           v    times the filter's weight
//!     Curve: the visibility function of one pixel                         pixels
//!           |
//!           v    tile by tile, on all threads
//!     Writer: compression, levels, the file                               build
//! ```
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@scene`] | objects, lights, the camera of pictures; scene files |
//! | [`mod@geometry`], [`mod@transfer`] | triangles, strands, grids; from samples to extinction |
//! | [`mod@load`] | files of meshes, strands and volumes |
//! | [`mod@demo`] | objects without files |
//! | [`mod@samples`] | where and when rays go |
//! | [`mod@hits`] | what they meet |
//! | [`mod@pixels`] | from there to the functions of pixels |
//! | [`mod@build`] | from a scene to a file |
//! | [`mod@program`] | `dsm-build` |
//!
//! # Example
//!
//! A square that stops half of the light, which goes along -z: in front of it all light is there, behind it half.
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
//! assert_eq!(report.hits, report.rays); // each ray meets it once, also where its triangles touch
//!
//! let cache = TileCache::new(1 << 20);
//! let mut map = WorldSampler::new(&cache.add(DsmFile::open(&path)?), MapId(0))?;
//! assert_eq!(map.visibility(&WorldQuery::new([0.25, 0.25, 0.5]))?, 1.0); // in front
//! let behind = map.visibility(&WorldQuery::new([0.25, 0.25, -0.5]))?;
//! assert!((behind - 0.5).abs() <= 0.001); // as near as was asked
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
