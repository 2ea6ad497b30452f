//! The levels of a map and their shapes; maps as a file lists them; groups of maps.

use super::header::MapHeader;
use super::ids::{MapId, Pixel, TileId};
use super::kinds::GroupRole;
use crate::{Error, Result};

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
    /// Shape of level `level` of a map. Each level halves the size, rounding up.
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

    /// Width and height of a tile in pixels. The border of the map cuts tiles off.
    pub fn tile_extent(&self, tile: TileId) -> (u32, u32) {
        let side = |n: u32, t: u32| (n - t * self.tile_size).min(self.tile_size);
        (side(self.width, tile.x), side(self.height, tile.y))
    }

    /// Index of a tile in the directory, row by row.
    pub fn tile_index(&self, tile: TileId) -> u64 {
        u64::from(tile.y) * u64::from(self.tiles_x()) + u64::from(tile.x)
    }

    /// The tile with this index in the directory.
    pub fn tile_at(&self, index: u64) -> TileId {
        let across = u64::from(self.tiles_x());
        TileId::new((index % across) as u32, (index / across) as u32)
    }

    /// All tiles in the order of the directory.
    pub fn tile_ids(&self) -> impl Iterator<Item = TileId> + use<> {
        let shape = *self;
        (0..self.tiles()).map(move |index| shape.tile_at(index))
    }

    /// The tile that holds a pixel.
    pub fn tile_of(&self, pixel: Pixel) -> TileId {
        TileId::new(pixel.x / self.tile_size, pixel.y / self.tile_size)
    }

    /// The pixel in the upper left corner of a tile.
    pub fn first_pixel(&self, tile: TileId) -> Pixel {
        Pixel::new(tile.x * self.tile_size, tile.y * self.tile_size)
    }

    /// Index of a pixel in its tile, row by row.
    pub fn index_in_tile(&self, pixel: Pixel) -> usize {
        let (width, _) = self.tile_extent(self.tile_of(pixel));
        (pixel.y % self.tile_size * width + pixel.x % self.tile_size) as usize
    }

    /// # Errors
    /// `Input` if there is no such tile.
    pub(crate) fn check_tile(&self, tile: TileId) -> Result<()> {
        if tile.x < self.tiles_x() && tile.y < self.tiles_y() {
            return Ok(());
        }
        Err(Error::input(format!(
            "tile {tile} is outside the {} x {} tiles of the level",
            self.tiles_x(),
            self.tiles_y()
        )))
    }

    /// # Errors
    /// `Input` if there is no such pixel.
    pub(crate) fn check_pixel(&self, pixel: Pixel) -> Result<()> {
        if pixel.x < self.width && pixel.y < self.height {
            return Ok(());
        }
        Err(Error::input(format!(
            "pixel {pixel} is outside the {} x {} pixels of the level",
            self.width, self.height
        )))
    }
}

/// One level of a map in a file.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LevelInfo {
    /// Pixels and tiles.
    pub shape: LevelShape,
    /// Largest error: every stored function is this close to the exact one at all depths.
    pub max_error: f64,
    /// Vertices of all pixels.
    pub vertices: u64,
    /// Bytes of all tile payloads.
    pub payload_bytes: u64,
}

/// One map of a file.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct MapInfo {
    /// Name, size, camera and other properties.
    pub header: MapHeader,
    /// The levels; level 0, the base, is the map itself.
    pub levels: Vec<LevelInfo>,
}

/// Maps that are looked up together.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Group {
    /// 1 to 255 bytes, unique in the file.
    pub name: String,
    /// How the maps work together.
    pub role: GroupRole,
    /// The maps.
    pub maps: Vec<MapId>,
}

impl Group {
    /// A group of these maps.
    pub fn new(name: impl Into<String>, role: GroupRole, maps: Vec<MapId>) -> Self {
        Group {
            name: name.into(),
            role,
            maps,
        }
    }
}
