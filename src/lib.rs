//! Deep shadow maps.
mod error;
pub mod function;

pub use error::{Error, ErrorKind, Place, Result};
pub use function::{Curve, Vertex, VertexRgb, Visibility};
