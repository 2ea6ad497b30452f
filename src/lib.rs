//! Deep shadow maps, as Lokovic and Veach described them in 2000 ("LV00"): a file format with a
//! guaranteed error, and the library that writes and reads it.
//!
//! A shadow map stores one depth per pixel of a light's view. A *deep* shadow map stores a
//! **visibility function**: the fraction of light that reaches each depth. Hair, smoke, glass and
//! motion blur become a curve that falls from 1 to 0, and one lookup answers a question that would
//! take hundreds of samples of an ordinary map. Such functions have many vertices before compression
//! and few after it: every function in a file is within a stated error of the exact one, at every
//! depth, on both sides of every step.
//!
//! # A worked example
//!
//! One pixel sees a hair in front (opacity 0.5 at depth 2), then smoke from 4 to 8 that lets a
//! quarter through, then a wall at 10.
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
//! ray.flatten(0.0001, &mut curve); // the exponential inside the smoke, to within 0.0001
//!
//! let mut writer = Writer::in_memory();
//! let map = writer.add_map(MapHeader::new("key light", 64, 64), Encoding::new(0.01))?;
//! let pixel = Pixel::new(31, 17);
//! writer.pixel(map, pixel, &curve)?; // pixels without a function are lit
//!
//! let file = DsmFile::from_bytes(writer.into_bytes()?)?;
//! let base = map.level(0);
//! let stored = file.function(base, pixel)?;
//! assert_eq!(stored.visibility(2.0), 1.0); // the hair does not shadow itself
//! assert!((stored.visibility(6.0) - 0.25).abs() <= 0.01); // 0.5 behind the hair, half of it in the smoke
//! assert_eq!(stored.visibility_behind(10.0), 0.0); // behind the wall it is dark, exactly
//! assert!(ray.deviation(&stored).error <= file.level(base)?.max_error);
//! # Ok(()) }
//! ```
//!
//! # Lookups
//!
//! A renderer asks through a cache, with a footprint, from any number of threads, each with a
//! sampler of its own:
//!
//! ```no_run
//! use deepshadow::*;
//! # fn main() -> Result<()> {
//! let cache = TileCache::new(256 << 20); // bytes, for all files together
//! let light = cache.add(DsmFile::open("light.dsm")?);
//! let mut sampler = Sampler::new(&light, MapId(0))?;
//! // The fraction of light at depth 8.5 at this place of the map, averaged over four pixels' width.
//! let visibility = sampler.visibility(&Query::new(31.5, 17.5, 8.5).width(4.0))?;
//! # Ok(()) }
//! ```
//!
//! # The layers
//!
//! ```text
//! hits, extinction samples --> ray (transmittance) --> sweep (pixel) --> compress
//!     --> tile --> Writer --> file
//! file --> source --> directory --> tile bytes --> tile in the cache
//!     --> Sampler(point, footprint) --> visibility
//!
//! function    pure functions of depth: rays, sums, products, compressors. No bytes, no files.
//! map         everything about a map but its pixels: header, levels, groups, ids, camera.
//! format      bytes to values and back on slices. No files, no threads.
//! io          Writer and DsmFile.
//! cache       decoded tiles of many files in one byte budget.
//! lookup      filtered lookups: footprints, levels, kernels, batches, world space, groups of maps.
//! ```
//!
//! Each layer uses only those above it in this list. The bytes are specified in `spec/format.md`,
//! their meaning in `spec/semantics.md`; these two pages are enough to write another reader.
//!
//! Everything that a renderer or a pipeline needs is at the root of the crate and stable. [`raw`] has
//! the parts that tools, bindings and fuzzing need besides; it is not stable.
//!
//! # Features
//!
//! `mmap` (files through a memory map), `zstd` (the codec), `rayon` (tiles compressed on all cores);
//! all on by default. No feature changes the bytes of a file or weakens a check.

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

pub use cache::{CacheStats, CachedFile, TileCache};
pub use error::{Error, ErrorKind, Place, Result};
pub use filter::Filter;
pub use format::{Codec, Tile};
pub use function::compress::{Compressor, Precision};
pub use function::{Curve, DeepSample, Deviation, FunctionRef, Ray, Sweep, Vertex, Visibility};
pub use io::{
    DsmFile, Encoding, Merge, Mips, Pixels, Progress, ReadAt, Report, Stitch, Summary, Writer,
};
pub use limits::Limits;
pub use lookup::{
    Batch, Border, Cursor, Footprint, GroupSampler, LevelChoice, LightSpace, OnError, Query,
    Sampler, SamplerOptions, Tap, WorldQuery, WorldSampler,
};
pub use map::{
    Attribute, Camera, DepthKind, Group, GroupRole, Interpretation, LevelId, LevelInfo, MapHeader,
    MapId, MapInfo, Pixel, TileId,
};

/// The code of the README compiles.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
