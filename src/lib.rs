//! Deep shadow maps.
mod error;
pub mod function;

pub use error::{Error, ErrorKind, Place, Result};
pub use function::{
    Channels, Curve, Deviation, Ray, Reference, Side, Sweep, Vertex, VertexRgb, Visibility,
    deviation, product,
};
