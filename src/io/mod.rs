//! Files: a writer in one pass, a reader tile by tile.
//!
//! | module | contents |
//! |---|---|
//! | [`source`] | sources of the bytes of a file |
//! | [`file`](mod@file) | [`DsmFile`]: opens a file, reads single tiles and functions |
//! | [`verify`] | checks of every rule over a whole file, and the content hash |
//! | [`walk`] | walks over a whole level, in bounded memory |
//! | [`stored`] | tiles in their stored form, to be copied into another file |
//! | [`writer`] | [`Writer`]: takes tiles, builds levels, writes the file |
//! | [`pyramid`] | the levels above the base, within a budget of memory |
//! | [`join`] | [`Join`]: joins several files, side by side or as a product |
//! | [`publish`] | files that appear whole or not at all |
//! | [`temporary`] | temporary files, and the operations of the file system that publish them |

mod file;
mod join;
mod publish;
mod pyramid;
mod source;
mod stored;
mod temporary;
mod verify;
mod walk;
mod writer;

pub use file::DsmFile;
pub use join::Join;
pub use publish::AtomicFile;
pub use source::ReadAt;
pub use stored::StoredTile;
pub use temporary::{FileSystem, remove_temporaries};
pub use verify::Report;
pub use walk::{Band, Run};
pub use writer::{Encoding, Mips, Pixels, Summary, Writer};
