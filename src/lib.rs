//! Deep shadow maps after Lokovic and Veach (SIGGRAPH 2000, "LV00"): a file format with a
//! guaranteed error, and the library that writes it, reads it and looks it up.
//!
//! An ordinary shadow map stores one depth per pixel of the light's view. A *deep* shadow map
//! stores a **visibility function** per pixel: the fraction of light that reaches each depth. Hair,
//! smoke, glass and motion blur become a curve that falls from 1 towards 0. One lookup in it
//! replaces hundreds of lookups in an ordinary map.
//!
//! The exact functions have many vertices. The writer compresses each of them within a *tolerance*,
//! and every level of a file states its *largest error*. No stored function is further than that
//! from the exact one, at any depth, on either side of any step.
//!
//! # A worked example
//!
//! One pixel sees a hair (opacity 0.5 at depth 2), then smoke from 4 to 8 that lets a quarter of
//! the light through, then a wall at 10.
//!
//! ```
//! use deepshadow::*;
//! # fn main() -> Result<()> {
//! let mut ray = Ray::new();
//! ray.surface(2.0, 0.5)?;
//! ray.thick(4.0, 8.0, 0.75)?;
//! ray.surface(10.0, 1.0)?;
//!
//! let mut curve = Curve::lit(1);
//! ray.flatten(0.0001, &mut curve); // segments within 0.0001 of the exponential in the smoke
//!
//! let mut writer = Writer::in_memory();
//! let map = writer.add_map(MapHeader::new("key light", 64, 64), Encoding::new(0.01))?;
//! let pixel = Pixel::new(31, 17);
//! writer.pixel(map, pixel, &curve)?; // all other pixels are lit
//!
//! let file = DsmFile::from_bytes(writer.into_bytes()?)?;
//! let base = map.level(0);
//! let stored = file.function(base, pixel)?;
//! assert_eq!(stored.visibility(2.0), 1.0); // the hair does not shadow itself
//! // The hair leaves 0.5. Half of the smoke leaves half of that.
//! assert!((stored.visibility(6.0) - 0.25).abs() <= 0.01);
//! assert_eq!(stored.visibility_behind(10.0), 0.0); // no light passes the wall
//! assert!(ray.deviation(&stored).error <= file.level(base)?.max_error);
//! # Ok(()) }
//! ```
//!
//! # Lookups
//!
//! A renderer looks up a point and a footprint through a cache of decoded tiles. Any number of
//! threads may share the cache; each thread has a sampler of its own.
//!
//! ```no_run
//! use deepshadow::*;
//! # fn main() -> Result<()> {
//! let cache = TileCache::new(256 << 20); // bytes, for all files together
//! let light = cache.add(DsmFile::open("light.dsm")?);
//! let mut sampler = Sampler::new(&light, MapId(0))?;
//! // The average over a footprint four pixels wide, at depth 8.5.
//! let visibility = sampler.visibility(&Query::new(31.5, 17.5, 8.5).width(4.0))?;
//! # Ok(()) }
//! ```
//!
//! # The layers
//!
//! ```text
//! write:  surfaces, media --> Ray --> Sweep (average of a pixel) --> Curve
//!             --> compressor --> tile --> Writer --> file
//! read:   file --> directory --> tile --> TileCache --> Sampler --> visibility
//!
//! function    functions of depth: rays, sums, products, compressors
//! map         header, levels, groups, ids and camera of a map
//! format      bytes to values and back, on slices
//! io          Writer, DsmFile, joining files
//! cache       decoded tiles of many files within one byte budget
//! lookup      filtered lookups: footprints, levels, batches, world space, groups of maps
//! ```
//!
//! Each layer uses only the layers above it in this list. `spec/format.md` specifies the bytes and
//! `spec/semantics.md` their meaning; the two documents suffice to write another reader.
//!
//! The root of the crate holds everything that a renderer or a pipeline needs, and is stable.
//! [`raw`] adds the parts that tools, bindings and fuzz targets need; it is unstable.
//!
//! # Features
//!
//! | feature | adds |
//! |---|---|
//! | `mmap` | files through a memory map, and huge pages for large caches |
//! | `zstd` | the zstd codec |
//! | `rayon` | compression of tiles on all cores |
//!
//! All are on by default. No feature changes the bytes of a file or weakens a check.

mod cache;
mod error;
mod filter;
mod format;
mod function;
mod io;
mod limits;
mod lookup;
mod map;
mod names;
pub mod raw;
mod scratch;

pub use cache::{CachedFile, TileCache};
pub use error::{Error, ErrorKind, Result};
pub use filter::Filter;
pub use format::{Codec, Tile};
pub use function::compress::Compressor;
pub use function::{Curve, FunctionRef, Ray, Sweep, Vertex, Visibility};
pub use io::{DsmFile, Encoding, Join, Mips, Pixels, ReadAt, Writer};
pub use limits::Limits;
pub use lookup::{
    Batch, Border, Cursor, Footprint, LevelChoice, LightSpace, OnError, Query, Sampler,
    SamplerOptions, WorldQuery, WorldSampler,
};
pub use map::{
    Attribute, Camera, DepthKind, Group, GroupRole, Interpretation, LevelId, LevelInfo, MapHeader,
    MapId, MapInfo, Pixel, TileId,
};

/// Compiles the code of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
