//! Files: written in one pass, read tile by tile.
//!
//! | module | what it holds |
//! |---|---|
//! | [`source`] | where the bytes of a file come from |
//! | [`file`](mod@file) | [`DsmFile`]: opening, and reading single tiles and functions |
//! | [`verify`] | every rule over a whole file, and the content hash |
//! | [`stored`] | tiles as they lie in a file, on their way into another |
//! | [`writer`] | [`Writer`]: tiles in, file out |
//! | [`join`] | several files become one: [`Stitch`] beside each other, [`Merge`] one behind another |
//! | [`pyramid`] | the levels above the base, within a budget of memory |
//! | [`publish`] | files that appear whole or not at all |

pub mod file;
pub mod join;
pub mod publish;
pub mod pyramid;
pub mod source;
pub mod stored;
pub mod verify;
pub mod writer;

pub use file::DsmFile;
pub use join::{Merge, Stitch};
pub use publish::AtomicFile;
pub use source::ReadAt;
pub use stored::StoredTile;
pub use verify::Report;
pub use writer::{Encoding, Mips, Pixels, Summary, TileInput, Writer};

/// How far a long operation has come; what its callback is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Units done: tiles.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}
