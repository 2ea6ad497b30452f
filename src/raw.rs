//! Unstable parts: the bytes of a file, tile by tile, and the pieces that programs are built from.
//!
//! **This module may change in any release.** Tools, bindings and fuzz targets use it to read
//! directory entries and stored tiles, to build tiles by hand, and to check the specification. A
//! renderer does not need it.

pub use crate::format::{TileBuilder, TilePlanes, TileValues};
pub use crate::format::{codec, directory, footer, header, layout, transform};
pub use crate::function::Channels;
pub use crate::function::compress::Encoder;
pub use crate::io::{AtomicFile, Band, Run, StoredTile};
pub use crate::map::LevelShape;
