//! The header of a map: size, tiles, depths, camera, attributes.

use super::camera::Camera;
use super::kinds::{Attribute, DepthKind, Interpretation};

/// The most pixels in a row or column of a map.
pub const MAX_SIDE: u32 = 1 << 20;

/// The properties of a map, except its levels and pixels. Its setters can be chained.
///
/// ```
/// use deepshadow::{DepthKind, MapHeader};
/// let map = MapHeader::new("key light", 512, 256).depth_kind(DepthKind::Planar);
/// assert_eq!((map.tile_size, map.channels), (32, 3));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct MapHeader {
    /// 1 to 255 bytes, unique in the file.
    pub name: String,
    /// Pixels, 1 to 2^20.
    pub width: u32,
    /// Pixels, 1 to 2^20.
    pub height: u32,
    /// The most channels of a pixel, 1 or 3. With 3, each pixel has one channel or three.
    pub channels: usize,
    /// Side of a tile in pixels: 8, 16, 32, 64, 128 or 256.
    pub tile_size: u32,
    /// The quantity that depths measure.
    pub depth_kind: DepthKind,
    /// Metres in one unit of depth; 0 if not stated.
    pub depth_unit: f64,
    /// How light falls between the samples of the source.
    pub interpretation: Interpretation,
    /// The light's camera.
    pub camera: Camera,
    /// Position x, y of the map's pixel (0,0) in the pixel coordinates of the display window.
    pub data_origin: [i32; 2],
    /// Visible part of the image that the map is a window of: first x, first y, last x, last y.
    pub display_window: [i32; 4],
    /// Values by name. Names have 1 to 255 bytes and are unique in the map.
    pub attributes: Vec<(String, Attribute)>,
}

impl MapHeader {
    /// A map of `width` x `height` pixels with three channels and tiles of 32 x 32 pixels.
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
            // `check` refuses sides beyond the format; they must not overflow here.
            display_window: [0, 0, last_pixel(width), last_pixel(height)],
            attributes: Vec::new(),
        }
    }

    /// Sets the most channels of a pixel, 1 or 3.
    pub fn channels(mut self, channels: usize) -> Self {
        self.channels = channels;
        self
    }

    /// Sets the side of a tile in pixels: 8, 16, 32, 64, 128 or 256.
    pub fn tile_size(mut self, pixels: u32) -> Self {
        self.tile_size = pixels;
        self
    }

    /// Sets the quantity that depths measure.
    pub fn depth_kind(mut self, kind: DepthKind) -> Self {
        self.depth_kind = kind;
        self
    }

    /// Sets the light's camera.
    pub fn camera(mut self, camera: Camera) -> Self {
        self.camera = camera;
        self
    }

    /// Sets the position of pixel (0,0) in the pixel coordinates of the display window: x, y.
    pub fn data_origin(mut self, origin: [i32; 2]) -> Self {
        self.data_origin = origin;
        self
    }

    /// Sets the visible part of the image: first x, first y, last x, last y.
    pub fn display_window(mut self, window: [i32; 4]) -> Self {
        self.display_window = window;
        self
    }

    /// Adds an attribute.
    pub fn attribute(mut self, name: impl Into<String>, value: impl Into<Attribute>) -> Self {
        self.attributes.push((name.into(), value.into()));
        self
    }

    /// Number of levels of a full pyramid, down to one pixel.
    pub fn full_level_count(&self) -> u32 {
        1 + u32::BITS - (self.width.max(self.height).max(1) - 1).leading_zeros()
    }

    /// # Errors
    /// The first rule of the specification that the header breaks, and how.
    pub(crate) fn check(&self) -> std::result::Result<(), (&'static str, String)> {
        let (width, height) = (self.width, self.height);
        let sides = 1..=MAX_SIDE;
        let tiles = self.tile_size;
        let unit = self.depth_unit;
        let matrices = [self.camera.camera_from_world, self.camera.ndc_from_world];
        let [x0, y0, x1, y1] = self.display_window;
        let rules = [
            (
                sides.contains(&width) && sides.contains(&height),
                "MAP-SIZE",
                format!("{width} x {height} pixels"),
            ),
            (
                [1, 3].contains(&self.channels),
                "MAP-CHANNELS",
                format!("{} channels", self.channels),
            ),
            (
                tiles.is_power_of_two() && (8..=256).contains(&tiles),
                "MAP-TILE",
                format!("tiles of {tiles} pixels"),
            ),
            (
                unit.is_finite() && unit.is_sign_positive(),
                "MAP-UNIT",
                format!("a depth unit of {unit} metres"),
            ),
            (
                matrices.iter().flatten().flatten().all(|v| v.is_finite()),
                "MAP-CAMERA",
                "a matrix holds a number that is not finite".into(),
            ),
            (
                x0 <= x1 && y0 <= y1,
                "MAP-WINDOW",
                format!("display window {:?}", self.display_window),
            ),
        ];
        let broken = rules.into_iter().find(|(kept, ..)| !kept);
        broken.map_or(Ok(()), |(_, rule, what)| Err((rule, what)))
    }
}

/// Index of the last of `side` pixels.
fn last_pixel(side: u32) -> i32 {
    i32::try_from(side.saturating_sub(1)).unwrap_or(i32::MAX)
}
