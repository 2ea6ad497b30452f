//! Unstable parts: the bytes of a file, tile by tile, and the pieces that programs are built from.
//!
//! **This module may change in any release.** Tools, bindings and fuzz targets use it to read
//! directory entries and stored tiles, to build tiles by hand, and to check the specification. A
//! renderer does not need to name anything here. It does meet some of these types as the values of
//! methods, and may use their fields and methods:
//!
//! | type | returned by |
//! |---|---|
//! | [`CacheStats`] | [`TileCache::stats`](crate::TileCache::stats) |
//! | [`DeepSample`] | [`FunctionRef::deep_samples`](crate::FunctionRef::deep_samples) |
//! | [`Deviation`] | [`Ray::deviation`](crate::Ray::deviation) |
//! | [`LevelShape`] | [`DsmFile::level`](crate::DsmFile::level) |
//! | [`Place`] | [`Error::place`](crate::Error::place) |
//! | [`Report`] | [`DsmFile::verify`](crate::DsmFile::verify) |
//! | [`Summary`] | [`Writer::finish`](crate::Writer::finish) |
//! | [`Tap`] | [`Sampler::taps`](crate::Sampler::taps) |
//!
//! Experiments set a [`Precision`] with [`Encoding::precision`](crate::Encoding::precision); by
//! default the writer chooses it.

pub use crate::cache::CacheStats;
pub use crate::error::Place;
pub use crate::format::{TileBuilder, TilePlanes, TileValues};
pub use crate::format::{codec, directory, footer, header, layout, transform};
pub use crate::function::compress::{Encoder, Precision};
pub use crate::function::{Channels, DeepSample, Deviation};
pub use crate::io::remove_temporaries;
pub use crate::io::{AtomicFile, Band, FileSystem, Report, Run, StoredTile, Summary};
pub use crate::lookup::Tap;
pub use crate::map::LevelShape;
