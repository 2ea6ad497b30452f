//! Deep shadow maps.
mod error;
pub mod format;
pub mod function;
mod limits;
mod map;

pub use error::{Error, ErrorKind, Place, Result};
pub use format::{Codec, Tile, TileBuilder};
pub use function::{Curve, Precision, Vertex, VertexRgb, Visibility};
pub use limits::Limits;
pub use map::{
    Attribute, AttributeValue, Camera, DepthKind, Group, GroupRole, Interpretation, LevelInfo,
    LevelShape, MapHeader, MapInfo, Matrix, full_level_count,
};
