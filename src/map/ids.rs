//! Ids of maps, levels, tiles and pixels.

use std::fmt;

/// A map of a file: its index in [`DsmFile::maps`](crate::DsmFile::maps).
///
/// ```
/// use deepshadow::{LevelId, MapId};
/// let map = MapId(2);
/// assert_eq!(map.level(3), LevelId { map, level: 3 });
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapId(pub u32);

impl MapId {
    /// Level `level` of this map; 0 is the base, the map itself.
    pub const fn level(self, level: u32) -> LevelId {
        LevelId { map: self, level }
    }

    /// The index in [`DsmFile::maps`](crate::DsmFile::maps).
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// The map with this index, which fits because a file has at most 65,536 maps.
    pub(crate) const fn from_index(index: usize) -> Self {
        MapId(index as u32)
    }
}

impl fmt::Display for MapId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A level of a map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LevelId {
    /// The map.
    pub map: MapId,
    /// The level. 0 is the base; each next level has half as many pixels a side.
    pub level: u32,
}

impl LevelId {
    /// The index in [`MapInfo::levels`](crate::MapInfo::levels).
    pub const fn index(self) -> usize {
        self.level as usize
    }
}

/// A pixel of a level. Columns count from the left, rows from the top.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pixel {
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
}

impl Pixel {
    /// The pixel in column `x` of row `y`.
    pub const fn new(x: u32, y: u32) -> Self {
        Pixel { x, y }
    }
}

impl fmt::Display for Pixel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{}", self.x, self.y)
    }
}

/// A tile of a level. Columns count from the left, rows from the top, both in tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TileId {
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
}

impl TileId {
    /// The tile in column `x` of row `y`.
    pub const fn new(x: u32, y: u32) -> Self {
        TileId { x, y }
    }
}

impl fmt::Display for TileId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{}", self.x, self.y)
    }
}
