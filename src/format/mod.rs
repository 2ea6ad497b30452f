//! Bytes to values and back, on slices: no files, no threads. `spec/format.md` defines the bytes.
//!
//! | module | section | contents |
//! |---|---|---|
//! | [`layout`] | 3 to 6 | every fixed offset |
//! | [`header`] | 3, 4 | header and trailer |
//! | [`footer`] | 5 | maps, levels, groups, attributes |
//! | [`directory`] | 6 | entries and their blocks |
//! | [`tile`] | 7 | decoded tiles |
//! | `laws` | 7 | the laws of the vertices of a tile |
//! | [`transform`] | 8 | delta planes |
//! | [`codec`] | 9 | none, lz4, zstd |

mod builder;
pub mod codec;
pub mod directory;
pub mod footer;
pub mod header;
mod laws;
pub mod layout;
mod record;
pub mod tile;
pub mod transform;
pub(crate) mod wide;

pub use builder::TileBuilder;
pub use codec::Codec;
pub use tile::{Tile, TilePlanes, TileValues};

use crate::{Error, Result};

/// Returns the error that the file breaks `rule`, unless `holds`.
#[inline]
fn ensure<W: Into<String>>(
    holds: bool,
    rule: &'static str,
    what: impl FnOnce() -> W,
) -> Result<()> {
    match holds {
        true => Ok(()),
        false => Err(Error::corrupt(rule, what())),
    }
}
