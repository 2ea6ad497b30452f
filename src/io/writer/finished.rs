//! Finished maps: the caller gives the stored functions of all levels, and their largest errors.

use super::{Encoded, MapState, TileInput, Writer};
use crate::format::directory::Entry;
use crate::format::{Codec, Tile};
use crate::function::compress::Precision;
use crate::io::StoredTile;
use crate::io::pyramid::{MipPlan, Schedule};
use crate::map::{LevelId, MapHeader, MapId, TileId};
use crate::{Encoding, Error, Result};

impl Writer {
    /// Adds a map whose stored functions exist already, at every level.
    ///
    /// [`Writer::finished_tiles`] and [`Writer::stored_tiles`] take its tiles. The writer neither
    /// compresses nor averages. `max_errors` holds the largest error of each level, from the base
    /// up. Use this to copy a map with another codec, tile size, name or camera: functions and
    /// errors stay the same.
    ///
    /// # Errors
    /// `Input` for headers outside their domain, for no error or more errors than a full pyramid
    /// has levels, and for errors that are not finite or negative; `Unsupported` for a codec that
    /// this build lacks.
    ///
    /// ```
    /// use deepshadow::*;
    /// # fn main() -> Result<()> {
    /// let wall = Visibility::mono(vec![Vertex::new(2.0, 0.0)])?;
    /// let mut writer = Writer::in_memory();
    /// let header = MapHeader::new("wall", 2, 1);
    /// let map = writer.add_finished_map(header, Codec::None, &[0.0, 0.125])?;
    /// for (level, width) in [(0, 2), (1, 1)] {
    ///     let mut tile = raw::TileBuilder::new(width, raw::Precision::Lattice(1));
    ///     (0..width).for_each(|_| tile.push(&wall));
    ///     writer.finished_tiles(map.level(level), vec![(TileId::new(0, 0), tile.finish())])?;
    /// }
    /// let file = DsmFile::from_bytes(writer.into_bytes()?)?;
    /// assert_eq!(file.level(map.level(1))?.max_error, 0.125);
    /// assert_eq!(file.function(map.level(1), Pixel::new(0, 0))?, wall);
    /// # Ok(()) }
    /// ```
    pub fn add_finished_map(
        &mut self,
        header: MapHeader,
        codec: Codec,
        max_errors: &[f64],
    ) -> Result<MapId> {
        self.check_map(&header)?;
        codec.check()?;
        let (levels, most) = (max_errors.len(), header.full_level_count());
        if levels == 0 || levels > most as usize {
            return Err(Error::input(format!(
                "maximum errors for {levels} levels, \
                 of a map that may have 1 to {most} (MAP-LEVELS)"
            )));
        }
        if let Some(e) = max_errors.iter().find(|e| !(e.is_finite() && **e >= 0.0)) {
            return Err(Error::input(format!("a maximum error of {e}")));
        }
        let encoding = Encoding::default().codec(codec);
        let plan = MipPlan {
            header,
            compressor: encoding.compressor,
            schedule: Schedule::Halved,
            max_errors: max_errors.to_vec(),
            precisions: vec![Precision::F32; levels],
        };
        self.push_map(plan, encoding, true)
    }

    /// Gives tiles of any level of a finished map, in any order. Packs them in parallel and keeps
    /// their lattice. Tiles that are never given are lit.
    ///
    /// # Errors
    /// `Input` for maps that were not added by [`Writer::add_finished_map`], for levels and tiles
    /// that do not exist or were given before, and for tiles of another size or coloured tiles in a
    /// map of one channel; `Io`, `Cancelled`.
    pub fn finished_tiles(&mut self, level: LevelId, tiles: Vec<(TileId, Tile)>) -> Result<()> {
        let input = |tile: &Tile| TileInput {
            width: Some(tile.width()),
            pixels: tile.pixels(),
            coloured: tile.is_coloured(),
        };
        self.take_finished(level, tiles, input, |state, tile| {
            tile.encode(state.encoding.codec)
        })
    }

    /// Gives tiles of any level of a finished map as another file stores them, in any order. Copies
    /// their bytes without decoding: codec, transform and lattice stay.
    ///
    /// # Errors
    /// As [`Writer::finished_tiles`].
    ///
    /// ```
    /// use deepshadow::*;
    /// # fn main() -> Result<()> {
    /// let (corner, tile) = (Pixel::new(1, 1), TileId::new(0, 0));
    /// let mut writer = Writer::in_memory();
    /// let map = writer.add_map(MapHeader::new("old", 2, 2), Encoding::default())?;
    /// writer.pixel(map, corner, &Curve::mono(vec![5.0], vec![0.25])?)?;
    /// let old = DsmFile::from_bytes(writer.into_bytes()?)?;
    ///
    /// let max_errors: Vec<f64> = old.levels().map(|(_, level)| level.max_error).collect();
    /// let mut writer = Writer::in_memory();
    /// let map = writer.add_finished_map(MapHeader::new("new", 2, 2), Codec::None, &max_errors)?;
    /// for (level, _) in old.levels() {
    ///     writer.stored_tiles(level, vec![(tile, old.stored_tile(level, tile)?)])?;
    /// }
    /// let new = DsmFile::from_bytes(writer.into_bytes()?)?;
    /// assert_eq!(new.payload(map.level(1), tile)?.1, old.payload(map.level(1), tile)?.1);
    /// # Ok(()) }
    /// ```
    pub fn stored_tiles(&mut self, level: LevelId, tiles: Vec<(TileId, StoredTile)>) -> Result<()> {
        self.take_finished(level, tiles, StoredTile::input, |_, tile| {
            Ok((tile.entry, tile.payload))
        })
    }

    fn take_finished<T: Send>(
        &mut self,
        level: LevelId,
        tiles: Vec<(TileId, T)>,
        input: impl Fn(&T) -> TileInput,
        encode: impl Fn(&MapState, T) -> Result<(Entry, Vec<u8>)> + Sync + Send,
    ) -> Result<()> {
        let checked = self.map(level.map)?.check_finished(true);
        checked.map_err(|e| e.at(level))?;
        self.take(level, tiles, input, |state, tile, given| {
            let (entry, payload) = encode(state, given)?;
            Ok(Encoded {
                level: level.index(),
                tile,
                entry,
                payload,
                quarter: None,
            })
        })
    }
}
