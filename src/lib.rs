//! Deep shadow maps.
mod error;
pub mod function;

pub use error::{Error, ErrorKind, Place, Result};
pub use function::compress::{
    Compressor, Encoder, MIN_TOLERANCE, Precision, default_tolerance, lattice_for,
    tolerance_warning,
};
pub use function::{Curve, Vertex, VertexRgb, Visibility};
