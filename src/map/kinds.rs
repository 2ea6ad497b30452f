//! Enums of the header with their names and bytes, and attributes.

use crate::names::{bytes, names};

/// The quantity that a map's depths measure (`spec/semantics.md`, section 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum DepthKind {
    /// Not stated. Lookups in world space are not possible.
    #[default]
    Unspecified = 0,
    /// The z coordinate in camera space.
    Planar = 1,
    /// The distance from the camera's origin along the ray.
    RayDistance = 2,
}

names!(DepthKind, "depth kind" {
    Unspecified = "unspecified",
    Planar = "planar",
    RayDistance = "ray" | "distance" | "ray_distance",
});
bytes!(DepthKind, "MAP-DEPTH");

/// How light falls between the samples of a map's source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpretation {
    /// Not stated.
    #[default]
    Unspecified = 0,
    /// Samples are surfaces: visibility falls in steps.
    Discrete = 1,
    /// Samples are media: visibility falls between samples.
    Continuous = 2,
}

names!(Interpretation, "interpretation" {
    Unspecified = "unspecified",
    Discrete = "discrete",
    Continuous = "continuous",
});
bytes!(Interpretation, "MAP-INTERPRETATION");

/// How the maps of a [`Group`](crate::Group) work together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GroupRole {
    /// A lookup uses one map: the maps are faces of a cube around a point light.
    Faces = 1,
    /// A lookup multiplies all maps. A map counts as 1 outside its frustum.
    Clusters = 2,
}

names!(GroupRole, "group role" {
    Faces = "faces",
    Clusters = "clusters",
});
bytes!(GroupRole, "GROUP-ROLE");

/// The value of a named attribute of a file or a map. It does not affect the functions.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Attribute {
    /// Text.
    Text(String),
    /// One or more integers.
    Integers(Vec<i64>),
    /// One or more numbers.
    Numbers(Vec<f64>),
    /// Bytes of a type that the format does not define. The type `exr:NAME` is an OpenEXR
    /// attribute, in the bytes of OpenEXR.
    Opaque {
        /// Name of the type.
        type_name: String,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// A kind that this version of the crate cannot interpret.
    Unknown {
        /// Number of the kind, 4 to 255.
        kind: u8,
        /// The bytes.
        bytes: Vec<u8>,
    },
}

impl From<&str> for Attribute {
    fn from(text: &str) -> Self {
        Attribute::Text(text.into())
    }
}

impl From<String> for Attribute {
    fn from(text: String) -> Self {
        Attribute::Text(text)
    }
}
