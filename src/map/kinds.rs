//! Kinds of depths, sources, groups and attributes: their names and their bytes.

use crate::names::{bytes, names};

/// The quantity that a map's depths measure (`spec/semantics.md`, section 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum DepthKind {
    /// Known only to the user; points of world space cannot be looked up.
    #[default]
    Unspecified = 0,
    /// The third coordinate in camera space.
    Planar = 1,
    /// The distance from the camera's origin along the ray.
    RayDistance = 2,
}

names!(DepthKind, "depth kind" {
    Unspecified = "unspecified",
    Planar = "planar",
    RayDistance = "ray" | "distance" | "ray_distance",
});
bytes!(DepthKind);

/// How light falls between the samples of a map's source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpretation {
    /// Not stated.
    #[default]
    Unspecified = 0,
    /// Samples are surfaces: light falls in steps.
    Discrete = 1,
    /// Samples are media: light falls between them.
    Continuous = 2,
}

names!(Interpretation, "interpretation" {
    Unspecified = "unspecified",
    Discrete = "discrete",
    Continuous = "continuous",
});
bytes!(Interpretation);

/// How the maps of a [`Group`](crate::Group) work together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GroupRole {
    /// A lookup selects one map, as the faces of a cube around a point light.
    Faces = 1,
    /// A lookup multiplies the maps; outside a map's frustum it counts 1.
    Clusters = 2,
}

names!(GroupRole, "group role" {
    Faces = "faces",
    Clusters = "clusters",
});
bytes!(GroupRole);

/// A value that travels with a file or a map under a name and does not change its meaning.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Attribute {
    /// Text.
    Text(String),
    /// One or more integers.
    Integers(Vec<i64>),
    /// One or more numbers.
    Numbers(Vec<f64>),
    /// Bytes of a type that only its users understand; `exr:NAME` is an OpenEXR attribute as that
    /// format stores it.
    Opaque {
        /// Name of the type.
        type_name: String,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// A kind that this version of the crate does not know.
    Unknown {
        /// Its number, 4 to 255.
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
