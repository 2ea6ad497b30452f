//! Files: written in one pass, read tile by tile.
//!
//! | module | contents |
//! |---|---|
//! | [`source`] | where the bytes of a file come from |
//! | [`file`](mod@file) | [`DsmFile`]: opening, and reading single tiles and functions |
//! | [`verify`] | every rule over a whole file, and the content hash |
//! | [`stored`] | tiles as they lie in a file, on their way into another |
//! | [`writer`] | [`Writer`]: tiles in, file out |
//! | [`join`] | several files become one: [`Stitch`] beside each other, [`Merge`] one behind another |
//! | [`pyramid`] | the levels above the base, within a budget of memory |
//! | [`publish`] | files that appear whole or not at all |

mod file;
mod join;
mod publish;
mod pyramid;
mod source;
mod stored;
mod verify;
mod writer;

pub use file::DsmFile;
pub use join::{Merge, Stitch};
pub use publish::AtomicFile;
pub use source::ReadAt;
pub use stored::StoredTile;
pub use verify::Report;
pub use writer::{Encoding, Mips, Pixels, Summary, Writer};

/// The state of a long operation, as its callback gets it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Progress {
    /// Units done: tiles.
    pub done: u64,
    /// Units in all.
    pub total: u64,
}
