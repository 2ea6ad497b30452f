//! Bytes to values and back, on slices: no files, no threads. `spec/format.md` is the law here.
//!
//! | module | section | what it holds |
//! |---|---|---|
//! | [`layout`] | 3 to 6 | every fixed offset |
//! | [`header`] | 3, 4 | header and trailer |
//! | [`footer`] | 5 | maps, levels, groups, attributes |
//! | [`directory`] | 6 | entries and their blocks |
//! | [`tile`] | 7 | decoded tiles and the laws of their vertices |
//! | [`transform`] | 8 | delta planes |
//! | [`codec`] | 9 | none, lz4, zstd |

mod builder;
pub mod codec;
pub mod directory;
pub mod footer;
pub mod header;
mod laws;
pub mod layout;
pub mod tile;
pub mod transform;
mod wide;

pub use builder::TileBuilder;
pub use codec::Codec;
pub use tile::{Tile, TilePlanes, TileValues};
