//! What is known of a map beside its pixels: size, depth kind, levels, typed metadata.

use crate::camera::Camera;
use crate::format::layout;
use crate::{Error, Result};

/// What the depths of a map measure (`spec/semantics.md`, section 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum DepthKind {
    /// Known only to the user; points of world space cannot be looked up.
    #[default]
    Unspecified,
    /// The third coordinate in camera space.
    Planar,
    /// The distance from the camera's origin along the ray.
    RayDistance,
}

/// How the source of a map was meant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpretation {
    /// Not stated.
    #[default]
    Unspecified,
    /// Samples are surfaces: light falls in steps.
    Discrete,
    /// Samples are media: light falls between them.
    Continuous,
}

/// Value of an [`Attribute`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum AttributeValue {
    /// Text.
    Text(String),
    /// One or more integers.
    Integers(Vec<i64>),
    /// One or more numbers.
    Numbers(Vec<f64>),
    /// Bytes of a type that only its users understand; `exr:NAME` is an OpenEXR attribute as that format stores it.
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

/// A named value that travels with a file or a map and does not change its meaning.
#[derive(Clone, Debug, PartialEq)]
pub struct Attribute {
    /// 1 to 255 bytes, unique in its file or map.
    pub name: String,
    /// What it says.
    pub value: AttributeValue,
}

impl Attribute {
    /// An attribute whose value is text.
    pub fn text(name: impl Into<String>, value: impl Into<String>) -> Self {
        Attribute {
            name: name.into(),
            value: AttributeValue::Text(value.into()),
        }
    }
}

/// All that is fixed of a map before its pixels are known.
///
/// ```
/// use deepshadow::{DepthKind, MapHeader};
/// let mut map = MapHeader::new("key light", 512, 256);
/// map.depth_kind = DepthKind::Planar;
/// assert_eq!((map.tile_size, map.channels), (32, 3));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct MapHeader {
    /// 1 to 255 bytes, unique in the file.
    pub name: String,
    /// Pixels, 1 to 2^20.
    pub width: u32,
    /// Pixels, 1 to 2^20.
    pub height: u32,
    /// Channels that a pixel may have, 1 or 3; with 3, each pixel has one or three.
    pub channels: usize,
    /// Side of a tile in pixels: 8, 16, 32, 64, 128 or 256.
    pub tile_size: u32,
    /// What depths measure.
    pub depth_kind: DepthKind,
    /// Metres in one unit of depth; 0 if not stated.
    pub depth_unit: f64,
    /// How the source was meant.
    pub interpretation: Interpretation,
    /// The light's camera.
    pub camera: Camera,
    /// Where pixel (0,0) of the map lies in the pixel coordinates of the display window: x, y.
    pub data_origin: [i32; 2],
    /// First x, first y, last x, last y of the visible part of the image that the map is a window of.
    pub display_window: [i32; 4],
    /// Named values.
    pub attributes: Vec<Attribute>,
}

impl MapHeader {
    /// A map of `width` x `height` pixels, with tiles of 32 x 32 and room for colour.
    pub fn new(name: impl Into<String>, width: u32, height: u32) -> Self {
        MapHeader {
            name: name.into(),
            width,
            height,
            channels: 3,
            tile_size: 32,
            depth_kind: DepthKind::Unspecified,
            depth_unit: 0.0,
            interpretation: Interpretation::Unspecified,
            camera: Camera::default(),
            data_origin: [0, 0],
            // Sides beyond the format are refused later, and must not overflow here.
            display_window: [0, 0, last_pixel(width), last_pixel(height)],
            attributes: Vec::new(),
        }
    }

    /// Levels of a full pyramid, down to one pixel.
    pub fn full_level_count(&self) -> u32 {
        full_level_count(self.width, self.height)
    }

    /// # Errors
    /// `Input`, naming the rule of the specification that the header would break in a file.
    pub(crate) fn check(&self) -> std::result::Result<(), (&'static str, String)> {
        let sides = 1..=layout::MAX_SIDE;
        if !sides.contains(&self.width) || !sides.contains(&self.height) {
            return Err((
                "MAP-SIZE",
                format!("{} x {} pixels", self.width, self.height),
            ));
        }
        if self.channels != 1 && self.channels != 3 {
            return Err(("MAP-CHANNELS", format!("{} channels", self.channels)));
        }
        if !self.tile_size.is_power_of_two() || !(8..=256).contains(&self.tile_size) {
            return Err(("MAP-TILE", format!("tiles of {} pixels", self.tile_size)));
        }
        if !self.depth_unit.is_finite() || self.depth_unit.is_sign_negative() {
            return Err((
                "MAP-UNIT",
                format!("a depth unit of {} metres", self.depth_unit),
            ));
        }
        let matrices = [self.camera.camera_from_world, self.camera.ndc_from_world];
        if matrices.iter().flatten().flatten().any(|v| !v.is_finite()) {
            return Err((
                "MAP-CAMERA",
                "a matrix holds a number that is not finite".into(),
            ));
        }
        let [x0, y0, x1, y1] = self.display_window;
        if x1 < x0 || y1 < y0 {
            return Err((
                "MAP-WINDOW",
                format!("display window {:?}", self.display_window),
            ));
        }
        Ok(())
    }
}

/// Index of the last of `side` pixels.
fn last_pixel(side: u32) -> i32 {
    i32::try_from(side.saturating_sub(1)).unwrap_or(i32::MAX)
}

/// Levels of a full pyramid over a map of this size, down to one pixel.
pub fn full_level_count(width: u32, height: u32) -> u32 {
    1 + u32::BITS - (width.max(height).max(1) - 1).leading_zeros()
}

/// The shape of one level: its pixels and its tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelShape {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Side of a tile in pixels.
    pub tile_size: u32,
}

impl LevelShape {
    /// Level `level` of a map: sizes halve, rounding up.
    pub fn of(map: &MapHeader, level: u32) -> Self {
        let half = |side: u32| ((u64::from(side) + (1u64 << level) - 1) >> level) as u32;
        LevelShape {
            width: half(map.width),
            height: half(map.height),
            tile_size: map.tile_size,
        }
    }

    /// Tiles in a row.
    pub fn tiles_x(&self) -> u32 {
        self.width.div_ceil(self.tile_size)
    }

    /// Rows of tiles.
    pub fn tiles_y(&self) -> u32 {
        self.height.div_ceil(self.tile_size)
    }

    /// Tiles in the level.
    pub fn tiles(&self) -> u64 {
        u64::from(self.tiles_x()) * u64::from(self.tiles_y())
    }

    /// Width and height in pixels of tile (tx, ty), cut off at the border.
    pub fn tile_extent(&self, tx: u32, ty: u32) -> (u32, u32) {
        let side = |n: u32, t: u32| (n - t * self.tile_size).min(self.tile_size);
        (side(self.width, tx), side(self.height, ty))
    }

    /// Index of tile (tx, ty) in the directory.
    pub fn tile_index(&self, tx: u32, ty: u32) -> u64 {
        u64::from(ty) * u64::from(self.tiles_x()) + u64::from(tx)
    }

    /// # Errors
    /// `Input` if there is no such tile.
    pub(crate) fn check_tile(&self, tx: u32, ty: u32) -> Result<()> {
        if tx < self.tiles_x() && ty < self.tiles_y() {
            return Ok(());
        }
        Err(Error::input(format!(
            "tile {tx},{ty} is outside the {} x {} tiles of the level",
            self.tiles_x(),
            self.tiles_y()
        )))
    }
}

/// One level of a map in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelInfo {
    /// Pixels and tiles.
    pub shape: LevelShape,
    /// The promise: no stored function is further than this from the exact one, at any depth.
    pub max_error: f64,
    /// Vertices of all pixels.
    pub vertices: u64,
    /// Bytes of all tile payloads.
    pub payload_bytes: u64,
}

/// One map of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct MapInfo {
    /// Name, size, camera and so on.
    pub header: MapHeader,
    /// Level 0, the map itself, and the levels above it.
    pub levels: Vec<LevelInfo>,
}

/// What the maps of a [`Group`] are to each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum GroupRole {
    /// A lookup selects one map, as the faces of a cube around a point light.
    Faces,
    /// A lookup multiplies the maps; outside a map's frustum it counts 1.
    Clusters,
}

/// Maps that are looked up together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// 1 to 255 bytes, unique in the file.
    pub name: String,
    /// How the maps work together.
    pub role: GroupRole,
    /// Indices of maps in the file.
    pub maps: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_halve_rounding_up() {
        let map = MapHeader::new("m", 5, 7);
        let sizes: Vec<_> = (0..4)
            .map(|l| LevelShape::of(&map, l))
            .map(|s| (s.width, s.height))
            .collect();
        assert_eq!(sizes, [(5, 7), (3, 4), (2, 2), (1, 1)]);
        assert_eq!(map.full_level_count(), 4);
        for (w, h, n) in [(1, 1, 1), (2, 1, 2), (3, 3, 3), (4, 4, 3), (1 << 20, 1, 21)] {
            assert_eq!(full_level_count(w, h), n);
        }
    }

    #[test]
    fn a_header_of_any_size_can_be_made_and_is_checked_later() {
        for side in [0, 1 << 31, u32::MAX] {
            assert_eq!(
                MapHeader::new("m", side, 1).check().unwrap_err().0,
                "MAP-SIZE"
            );
        }
    }

    #[test]
    fn tiles_end_at_the_border() {
        let shape = LevelShape {
            width: 40,
            height: 33,
            tile_size: 32,
        };
        assert_eq!((shape.tiles(), shape.tile_extent(1, 1)), (4, (8, 1)));
    }
}
