//! Reads and writes deep OpenEXR files block by block.
//!
//! [`DeepReader`] opens a file, checks every size against the file and its limits, and decodes one
//! block at a time. [`DeepWriter`] writes a file. [`samples`] turns channels into depths and
//! opacities.
//!
//! The crate reads and writes deep parts in scanlines and tiles, uncompressed or with RLE, ZIPS or
//! Zstandard (OpenEXR 3.5). It also reads flat parts, as one sample per pixel, with every
//! compression but HTJ2K. It reads only the full-size level of parts with mip levels. No file makes
//! it panic.
//!
//! ```
//! use deepshadow_exr::*;
//! # fn main() -> Result<()> {
//! let window = Rect { x: 0, y: 0, width: 2, height: 1 };
//! let part = Part::deep_scanline(window, vec![Channel::new("Z", SampleType::Float)]);
//! let mut bytes = std::io::Cursor::new(Vec::new());
//! let mut writer = DeepWriter::new(&mut bytes, vec![part])?;
//! writer.write(0, &DeepBlock {
//!     rect: window,
//!     offsets: vec![0, 2, 3],
//!     channels: vec![ChannelData::Float(vec![1.0, 2.0, 5.0])],
//! })?;
//! writer.finish()?;
//!
//! let reader = DeepReader::from_reader(bytes)?;
//! let block = reader.read_block(0, 0)?;
//! assert_eq!(block.samples(1, 0), Some(2..3));
//! assert_eq!(block.channels[0].get(2), 5.0);
//! # Ok(())
//! # }
//! ```

mod attribute;
mod block;
mod codec;
mod decode;
mod encode;
mod error;
mod geometry;
mod header;
mod limits;
mod parse;
mod reader;
pub mod samples;
mod source;
mod write_header;
mod writer;

pub use attribute::Attribute;
pub use block::{ChannelData, DeepBlock};
pub use encode::{BlockEncoder, EncodedBlock};
pub use error::{Error, ErrorKind, Place, Result};
pub use half::f16;
pub use header::{Channel, Compression, LevelMode, LineOrder, Part, Rect, SampleType, Tiles};
pub use limits::Limits;
pub use reader::DeepReader;
pub use writer::DeepWriter;
