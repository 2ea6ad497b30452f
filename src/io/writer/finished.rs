//! Finished maps: the stored functions of all levels as they are, under the promises that they have.

use super::{MapState, Writer, in_parallel};
use crate::format::{Codec, Tile};
use crate::io::StoredTile;
use crate::io::pyramid::{OpenTiles, Plan, Pyramid, Schedule};
use crate::map::{LevelShape, MapHeader};
use crate::{Encoding, Error, Mips, Place, Precision, Result};

impl Writer<'_> {
    /// Adds a map whose functions exist already, at every level: [`Writer::finished_tiles`] takes them, and nothing is
    /// compressed or averaged. `promises` holds the promise of each level from the base on, as many as the map shall have.
    ///
    /// This is how a map is copied with another codec, tile size, name or camera without touching a function or a promise.
    ///
    /// # Errors
    /// `Input` for headers outside their domain, for no promise or more than a full pyramid has levels, and for promises that are not finite or
    /// negative; `Unsupported` for a codec that this build lacks.
    ///
    /// ```
    /// use deepshadow::{Codec, DsmFile, MapHeader, Precision, TileBuilder, Vertex, Visibility, Writer};
    /// # fn main() -> deepshadow::Result<()> {
    /// let wall = Visibility::mono(vec![Vertex::new(2.0, 0.0)])?;
    /// let mut bytes = Vec::new();
    /// let mut writer = Writer::new(&mut bytes)?;
    /// let map = writer.add_finished_map(MapHeader::new("wall", 2, 1), Codec::None, &[0.0, 0.125])?;
    /// for (level, width) in [(0, 2), (1, 1)] {
    ///     let mut tile = TileBuilder::new(width, Precision::Lattice(1));
    ///     (0..width).for_each(|_| tile.push(&wall));
    ///     writer.finished_tiles(map, level, vec![(0, 0, tile.finish())])?;
    /// }
    /// writer.finish()?;
    /// let file = DsmFile::from_bytes(bytes)?;
    /// assert_eq!(file.level(0, 1)?.max_error, 0.125);
    /// assert_eq!(file.function(0, 1, 0, 0)?, wall);
    /// # Ok(()) }
    /// ```
    pub fn add_finished_map(
        &mut self,
        header: MapHeader,
        codec: Codec,
        promises: &[f64],
    ) -> Result<usize> {
        self.check_map(&header)?;
        codec.check()?;
        if promises.is_empty() || promises.len() > header.full_level_count() as usize {
            return Err(Error::input(format!(
                "promises for {} levels, of a map that may have 1 to {} (MAP-LEVELS)",
                promises.len(),
                header.full_level_count()
            )));
        }
        if let Some(e) = promises.iter().find(|e| !(e.is_finite() && **e >= 0.0)) {
            return Err(Error::input(format!("a promise of {e}")));
        }
        let levels = promises.len();
        let shapes = (0..levels).map(|l| LevelShape::of(&header, l as u32));
        let states: Vec<_> = shapes.map(super::LevelState::new).collect::<Result<_>>()?;
        let bits = |tiles: u64| vec![0; tiles.div_ceil(64) as usize];
        let encoding = Encoding {
            codec,
            mips: Mips::None,
            ..Encoding::default()
        };
        let plan = Plan {
            header,
            compressor: encoding.compressor,
            schedule: Schedule::Halved,
            promises: promises.to_vec(),
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
            promise: None,
        });
        Ok(self.maps.len() - 1)
    }

    /// Gives tiles (column, row, functions) of any level of a finished map, in any order. They are packed in parallel and stored as they are,
    /// lattice included. Tiles that are never given are lit.
    ///
    /// # Errors
    /// `Input` for maps that were not added by [`Writer::add_finished_map`], for levels and tiles that do not exist or were given before, for tiles of another size,
    /// or coloured ones in a map of one channel; `Io`, `Cancelled`.
    pub fn finished_tiles(
        &mut self,
        map: usize,
        level: usize,
        tiles: Vec<(u32, u32, Tile)>,
    ) -> Result<()> {
        for (tx, ty, tile) in &tiles {
            let given = Given {
                width: tile.width(),
                pixels: tile.pixels(),
                coloured: tile.is_coloured(),
            };
            self.accept_finished(map, level, (*tx, *ty), given)?;
        }
        let result = self.write_finished(map, level, tiles);
        self.failed |= result.is_err();
        result
    }

    /// Gives tiles (column, row, tile) of any level of a finished map as another file stores them, in any order. Their bytes are copied: codec,
    /// transform and lattice stay. Nothing is decoded.
    ///
    /// # Errors
    /// As [`Writer::finished_tiles`].
    ///
    /// ```
    /// use deepshadow::{Codec, Curve, DsmFile, Encoding, MapHeader, Writer};
    /// # fn main() -> deepshadow::Result<()> {
    /// let mut bytes = Vec::new();
    /// let mut writer = Writer::new(&mut bytes)?;
    /// let map = writer.add_map(MapHeader::new("old", 2, 2), Encoding::default())?;
    /// writer.pixel(map, 1, 1, &Curve::mono(vec![5.0], vec![0.25])?)?;
    /// writer.finish()?;
    /// let old = DsmFile::from_bytes(bytes)?;
    ///
    /// let levels = &old.maps()[0].levels;
    /// let errors: Vec<f64> = levels.iter().map(|l| l.max_error).collect();
    /// let mut bytes = Vec::new();
    /// let mut writer = Writer::new(&mut bytes)?;
    /// let map = writer.add_finished_map(MapHeader::new("new", 2, 2), Codec::None, &errors)?;
    /// for level in 0..levels.len() {
    ///     writer.stored_tiles(map, level, vec![(0, 0, old.stored_tile(0, level, 0, 0)?)])?;
    /// }
    /// writer.finish()?;
    /// let new = DsmFile::from_bytes(bytes)?;
    /// assert_eq!(new.payload(0, 1, 0, 0)?.1, old.payload(0, 1, 0, 0)?.1);
    /// # Ok(()) }
    /// ```
    pub fn stored_tiles(
        &mut self,
        map: usize,
        level: usize,
        tiles: Vec<(u32, u32, StoredTile)>,
    ) -> Result<()> {
        for (tx, ty, tile) in &tiles {
            let (width, height) = tile.extent;
            let given = Given {
                width,
                pixels: (width * height) as usize,
                coloured: tile.entry.coloured,
            };
            self.accept_finished(map, level, (*tx, *ty), given)?;
        }
        let mut tiles = tiles.into_iter();
        let result = tiles
            .try_for_each(|(tx, ty, t)| self.write_tile(map, (level, tx, ty), t.entry, &t.payload));
        self.failed |= result.is_err();
        result
    }

    fn accept_finished(
        &mut self,
        map: usize,
        level: usize,
        place: (u32, u32),
        tile: Given,
    ) -> Result<()> {
        let accepted = self.map(map)?.accept_finished(level, place, tile);
        accepted.map_err(|e| {
            e.at(Place {
                map: Some(map as u32),
                level: Some(level as u32),
                ..Place::default()
            })
        })
    }

    fn write_finished(
        &mut self,
        map: usize,
        level: usize,
        tiles: Vec<(u32, u32, Tile)>,
    ) -> Result<()> {
        let codec = self.maps[map].encoding.codec;
        let packed = in_parallel(tiles, |(tx, ty, tile)| Ok((tx, ty, tile.encode(codec)?)))?;
        for (tx, ty, (entry, payload)) in packed {
            self.write_tile(map, (level, tx, ty), entry, &payload)?;
        }
        Ok(())
    }
}

/// The properties of a tile that a finished map checks.
struct Given {
    width: u32,
    pixels: usize,
    coloured: bool,
}

impl MapState {
    /// Checks a tile of a finished map, and marks it as given.
    fn accept_finished(&mut self, level: usize, place: (u32, u32), tile: Given) -> Result<()> {
        if !self.finished {
            return Err(Error::input("the map was not added as finished"));
        }
        let levels = self.levels.len();
        let Some(state) = self.levels.get(level) else {
            return Err(Error::input(format!("no such level: there are {levels}")));
        };
        let shape = state.shape;
        shape.check_tile(place.0, place.1)?;
        let at = |e: Error| {
            e.at(Place {
                tile: Some(shape.tile_index(place.0, place.1)),
                ..Place::default()
            })
        };
        if self.is_given(level, place) {
            return Err(at(Error::input("the tile was given before")));
        }
        let (width, height) = shape.tile_extent(place.0, place.1);
        if (tile.width, tile.pixels) != (width, (width * height) as usize) {
            return Err(at(Error::input(format!(
                "{} functions, {} in a row, for a tile of {width} x {height} pixels",
                tile.pixels, tile.width
            ))));
        }
        if tile.coloured && self.plan.header.channels == 1 {
            return Err(at(Error::input(
                "a coloured function in a map of one channel",
            )));
        }
        self.mark_given(level, place);
        Ok(())
    }
}
