//! Tiles in their stored form, to be copied into another file.

use super::file::DsmFile;
use crate::Result;
use crate::error::Place;
use crate::format::Tile;
use crate::format::directory::Entry;
use crate::format::tile::Words;
use crate::map::{LevelId, TileId};

/// A tile in its stored form. [`crate::Pixels::Stored`] copies it byte for byte.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, MapId, Pixel, Pixels, TileId, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// let mut writer = Writer::in_memory();
/// let map = writer.add_map(MapHeader::new("left", 32, 32), Encoding::default())?;
/// writer.pixel(map, Pixel::new(2, 1), &Curve::mono(vec![5.0], vec![0.25])?)?;
/// let left = DsmFile::from_bytes(writer.into_bytes()?)?;
///
/// // A map of twice the width; the tile becomes its right half.
/// let base = MapId(0).level(0);
/// let (only, right) = (TileId::new(0, 0), TileId::new(1, 0));
/// let encoding = Encoding::default().source_error(left.level(base)?.max_error);
/// let mut writer = Writer::in_memory();
/// let map = writer.add_map(MapHeader::new("both", 64, 32), encoding)?;
/// writer.tile(map, right, Pixels::Stored(left.stored_tile(base, only)?))?;
/// let both = DsmFile::from_bytes(writer.into_bytes()?)?;
/// assert_eq!(both.payload(base, right)?.1, left.payload(base, only)?.1);
/// assert_eq!(both.function(base, Pixel::new(34, 1))?.visibility_behind(5.0), 0.25);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug)]
pub struct StoredTile {
    pub(super) entry: Entry,
    pub(super) payload: Vec<u8>,
    pub(super) extent: (u32, u32),
    /// Name of the file for errors, where several are joined.
    file: Option<String>,
    limit: u64,
    place: Place,
}

impl DsmFile {
    /// A tile of a level in its stored form. Checks its CRC, but does not decode it.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn stored_tile(&self, level: LevelId, tile: TileId) -> Result<StoredTile> {
        let (entry, payload) = self.payload(level, tile)?;
        Ok(StoredTile {
            entry,
            payload: payload.into_owned(),
            extent: self.level(level)?.shape.tile_extent(tile),
            file: None,
            limit: self.limits().memory,
            place: self.payload_place(level, tile, &entry),
        })
    }
}

impl StoredTile {
    /// Width and height in pixels.
    pub fn extent(&self) -> (u32, u32) {
        self.extent
    }

    /// Names the file of the tile in its errors.
    pub(super) fn name_file(&mut self, name: &str) {
        self.file = Some(name.to_owned());
    }

    /// The decoded tile; checks every rule.
    pub(super) fn tile(&self) -> Result<Tile> {
        let (entry, extent) = (&self.entry, self.extent);
        let tile = Tile::decode_checked(entry, &self.payload, extent, self.limit, Words::EMPTY);
        tile.map_err(|e| {
            let e = e.at(self.place);
            self.file.iter().fold(e, |e, name| e.in_file(name))
        })
    }
}
