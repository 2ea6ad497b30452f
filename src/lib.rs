//! Deep shadow maps.
mod error;
pub mod format;
pub mod function;
pub mod io;
mod limits;
mod map;

pub use error::{Error, ErrorKind, Place, Result};
pub use format::{Codec, Tile, TileBuilder};
pub use function::compress::{
    Compressor, Encoder, MIN_TOLERANCE, Precision, default_tolerance, lattice_for,
    tolerance_warning,
};
pub use function::{
    Channels, Curve, Deviation, Ray, Reference, Side, Sweep, Vertex, VertexRgb, Visibility,
    deviation, product,
};
pub use io::{
    AtomicFile, DsmFile, Encoding, Mips, Pixels, Progress, ReadAt, Report, Summary, TileInput,
    Writer,
};
pub use limits::Limits;
pub use map::{
    Attribute, AttributeValue, Camera, DepthKind, Group, GroupRole, Interpretation, LevelInfo,
    LevelShape, MapHeader, MapInfo, Matrix, full_level_count,
};
