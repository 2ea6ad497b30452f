//! Tiles as they lie in a file, on their way into another.

use std::borrow::Cow;

use super::file::{DsmFile, tile_place};
use crate::format::Tile;
use crate::format::directory::{Entry, TileKind};
use crate::format::tile::Words;
use crate::{Place, Result};

/// A tile of a file, as it is stored: what [`crate::Pixels::Stored`] copies byte for byte.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, Pixels, TileInput, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// let mut bytes = Vec::new();
/// let mut writer = Writer::new(&mut bytes)?;
/// let map = writer.add_map(MapHeader::new("left", 32, 32), Encoding::default())?;
/// writer.pixel(map, 2, 1, &Curve::mono(vec![5.0], vec![0.25])?)?;
/// writer.finish()?;
/// let left = DsmFile::from_bytes(bytes)?;
///
/// // Twice as wide: the tile becomes the right one.
/// let mut bytes = Vec::new();
/// let mut writer = Writer::new(&mut bytes)?;
/// let given_error = left.level(0, 0)?.max_error;
/// let encoding = Encoding { given_error, ..Encoding::default() };
/// let map = writer.add_map(MapHeader::new("both", 64, 32), encoding)?;
/// let pixels = Pixels::Stored(left.stored_tile(0, 0, 0, 0)?);
/// writer.tile(map, TileInput { tx: 1, ty: 0, pixels })?;
/// writer.finish()?;
/// let both = DsmFile::from_bytes(bytes)?;
/// assert_eq!(both.payload(0, 0, 1, 0)?.1, left.payload(0, 0, 0, 0)?.1);
/// assert_eq!(both.function(0, 0, 34, 1)?.behind(5.0), 0.25);
/// # Ok(()) }
/// ```
#[derive(Clone, Debug)]
pub struct StoredTile {
    pub(super) entry: Entry,
    pub(super) payload: Vec<u8>,
    pub(super) extent: (u32, u32),
    decoded: Option<Tile>,
    limit: u64,
    place: Place,
}

impl DsmFile {
    /// Tile (tx, ty) of a level as it is stored: its CRC is checked, and it is not decoded.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn stored_tile(&self, map: usize, level: usize, tx: u32, ty: u32) -> Result<StoredTile> {
        let (entry, payload) = self.payload(map, level, tx, ty)?;
        let shape = self.maps()[map].levels[level].shape;
        let place = tile_place(map, level, shape.tile_index(tx, ty));
        Ok(StoredTile {
            entry,
            payload: payload.into_owned(),
            extent: shape.tile_extent(tx, ty),
            decoded: None,
            limit: self.limits().tile_bytes,
            place: Place {
                byte: Some(entry.offset),
                ..place
            },
        })
    }
}

impl StoredTile {
    /// Width and height in pixels.
    pub fn extent(&self) -> (u32, u32) {
        self.extent
    }

    /// Decodes it now, so that what is wrong is said of the file that it comes from.
    pub(super) fn decode(&mut self) -> Result<()> {
        let tile = self.tile()?.into_owned();
        self.decoded = Some(tile);
        Ok(())
    }

    /// Its functions, every rule checked.
    pub(super) fn tile(&self) -> Result<Cow<'_, Tile>> {
        if let Some(tile) = &self.decoded {
            return Ok(Cow::Borrowed(tile));
        }
        let (entry, extent, limit) = (&self.entry, self.extent, self.limit);
        let tile = match entry.kind {
            TileKind::Data => {
                Tile::decode_checked(entry, &self.payload, extent, limit, Words::EMPTY)
            }
            _ => Tile::decode(entry, &[], extent, limit),
        };
        tile.map(Cow::Owned).map_err(|e| e.at(self.place))
    }
}
