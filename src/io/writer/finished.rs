//! Finished maps: the stored functions of all levels as they are, under the promises that they have.

use super::{MapState, Writer, in_parallel};
use crate::format::{Codec, Tile};
use crate::io::StoredTile;
use crate::io::pyramid::{MipPlan, OpenTiles, Pyramid, Schedule};
use crate::map::{LevelId, LevelShape, MapHeader, MapId, TileId};
use crate::{Encoding, Error, Mips, Place, Precision, Result};

impl Writer {
    /// Adds a map whose functions exist already, at every level: [`Writer::finished_tiles`] takes them, and nothing is
    /// compressed or averaged. `max_errors` holds the error of each level from the base on, as many as the map has levels.
    ///
    /// This is how a map is copied with another codec, tile size, name or camera without touching a function or a promise.
    ///
    /// # Errors
    /// `Input` for headers outside their domain, for no promise or more than a full pyramid has levels, and for promises that are not finite or
    /// negative; `Unsupported` for a codec that this build lacks.
    ///
    /// ```
    /// use deepshadow::*;
    /// # fn main() -> Result<()> {
    /// let wall = Visibility::mono(vec![Vertex::new(2.0, 0.0)])?;
    /// let mut writer = Writer::in_memory();
    /// let header = MapHeader::new("wall", 2, 1);
    /// let map = writer.add_finished_map(header, Codec::None, &[0.0, 0.125])?;
    /// for (level, width) in [(0, 2), (1, 1)] {
    ///     let mut tile = raw::TileBuilder::new(width, Precision::Lattice(1));
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
        if max_errors.is_empty() || max_errors.len() > header.full_level_count() as usize {
            return Err(Error::input(format!(
                "maximum errors for {} levels, of a map that may have 1 to {} (MAP-LEVELS)",
                max_errors.len(),
                header.full_level_count()
            )));
        }
        if let Some(e) = max_errors.iter().find(|e| !(e.is_finite() && **e >= 0.0)) {
            return Err(Error::input(format!("a maximum error of {e}")));
        }
        let levels = max_errors.len();
        let shapes = (0..levels).map(|l| LevelShape::of(&header, l as u32));
        let states: Vec<_> = shapes.map(super::LevelState::new).collect::<Result<_>>()?;
        let bits = |tiles: u64| vec![0; tiles.div_ceil(64) as usize];
        let encoding = Encoding {
            codec,
            mips: Mips::None,
            ..Encoding::default()
        };
        let plan = MipPlan {
            header,
            compressor: encoding.compressor,
            schedule: Schedule::Halved,
            max_errors: max_errors.to_vec(),
            precisions: vec![Precision::F32; levels],
        };
        self.maps.push(MapState {
            plan,
            encoding,
            given: states.iter().map(|l| bits(l.shape.tiles())).collect(),
            finished: true,
            levels: states,
            pyramid: Pyramid::new(levels, self.scratch.clone()),
            open: OpenTiles::default(),
            complete: Vec::new(),
            max_error: None,
        });
        Ok(MapId::from_index(self.maps.len() - 1))
    }

    /// Gives tiles of any level of a finished map, in any order. They are packed in parallel and
    /// stored as they are, lattice included. Tiles that are never given are lit.
    ///
    /// # Errors
    /// `Input` for maps that were not added by [`Writer::add_finished_map`], for levels and tiles
    /// that do not exist or were given before, for tiles of another size, or coloured ones in a map
    /// of one channel; `Io`, `Cancelled`.
    pub fn finished_tiles(&mut self, level: LevelId, tiles: Vec<(TileId, Tile)>) -> Result<()> {
        for (id, tile) in &tiles {
            let properties = Properties {
                width: tile.width(),
                pixels: tile.pixels(),
                coloured: tile.is_coloured(),
            };
            self.accept_finished(level, *id, properties)?;
        }
        let result = self.write_finished(level, tiles);
        self.failed |= result.is_err();
        result
    }

    /// Gives tiles of any level of a finished map as another file stores them, in any order. Their
    /// bytes are copied: codec, transform and lattice stay. Nothing is decoded.
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
        for (id, tile) in &tiles {
            let (width, height) = tile.extent;
            let properties = Properties {
                width,
                pixels: (width * height) as usize,
                coloured: tile.entry.coloured,
            };
            self.accept_finished(level, *id, properties)?;
        }
        let result = tiles.into_iter().try_for_each(|(id, tile)| {
            self.write_tile(level.map, level.index(), id, tile.entry, &tile.payload)
        });
        self.failed |= result.is_err();
        result
    }

    fn accept_finished(&mut self, level: LevelId, id: TileId, tile: Properties) -> Result<()> {
        let state = self.map(level.map)?;
        let accepted = state.accept_finished(level.index(), id, tile);
        accepted.map_err(|e| e.at(level))
    }

    fn write_finished(&mut self, level: LevelId, tiles: Vec<(TileId, Tile)>) -> Result<()> {
        let codec = self.maps[level.map.index()].encoding.codec;
        let packed = in_parallel(tiles, |(id, tile)| Ok((id, tile.encode(codec)?)))?;
        for (id, (entry, payload)) in packed {
            self.write_tile(level.map, level.index(), id, entry, &payload)?;
        }
        Ok(())
    }
}

/// The properties of a tile that a finished map checks.
struct Properties {
    width: u32,
    pixels: usize,
    coloured: bool,
}

impl MapState {
    /// Checks a tile of a finished map, and marks it as given.
    fn accept_finished(&mut self, level: usize, id: TileId, tile: Properties) -> Result<()> {
        if !self.finished {
            return Err(Error::input("the map was not added as finished"));
        }
        let levels = self.levels.len();
        let Some(state) = self.levels.get(level) else {
            return Err(Error::input(format!("no such level: there are {levels}")));
        };
        let shape = state.shape;
        shape.check_tile(id)?;
        let input = |what: String| Err(Error::input(what).at(Place::tile(shape.tile_index(id))));
        if self.is_given(level, id) {
            return input("the tile was given before".into());
        }
        let (width, height) = shape.tile_extent(id);
        if (tile.width, tile.pixels) != (width, (width * height) as usize) {
            return input(format!(
                "{} functions, {} in a row, for a tile of {width} x {height} pixels",
                tile.pixels, tile.width
            ));
        }
        if tile.coloured && self.plan.header.channels == 1 {
            return input("a coloured function in a map of one channel".into());
        }
        self.mark_given(level, id);
        Ok(())
    }
}
