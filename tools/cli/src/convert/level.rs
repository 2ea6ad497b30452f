//! The functions of a level, rectangle by rectangle.

use deepshadow::raw::LevelShape;
use deepshadow::{DsmFile, LevelId, Precision, Tile, TileId, Visibility};
use rayon::prelude::*;

use deepshadow_frame::Result;

/// One level of a map.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    /// The file.
    pub file: &'a DsmFile,
    /// The level.
    pub id: LevelId,
    /// Its pixels and tiles.
    pub shape: LevelShape,
}

impl<'a> Level<'a> {
    /// Returns level `id` of a map.
    ///
    /// # Errors
    /// `Failed` for a level that the map does not have.
    pub fn new(file: &'a DsmFile, id: LevelId) -> Result<Self> {
        let shape = file.level(id)?.shape;
        Ok(Level { file, id, shape })
    }

    /// Whether any pixel has three channels. Reads the directory only.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn is_coloured(&self) -> Result<bool> {
        for (tx, ty) in self.tiles() {
            if self.file.entry(self.id, TileId::new(tx, ty))?.coloured {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Returns all tiles, row by row, as columns and rows.
    pub fn tiles(&self) -> impl Iterator<Item = (u32, u32)> + use<> {
        let (across, down) = (self.shape.tiles_x(), self.shape.tiles_y());
        (0..down).flat_map(move |ty| (0..across).map(move |tx| (tx, ty)))
    }

    /// Returns the common lattice of all tiles, if there is one.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn lattice(&self) -> Result<Option<Precision>> {
        let mut found = None;
        for (tx, ty) in self.tiles() {
            let entry = self.file.entry(self.id, TileId::new(tx, ty))?;
            if entry.stored_size == 0 {
                continue;
            }
            if entry.lattice == 0 || found.is_some_and(|l| l != entry.lattice) {
                return Ok(None);
            }
            found = Some(entry.lattice);
        }
        Ok(found.map(Precision::Lattice))
    }

    /// Reads the functions of a rectangle of pixels inside the level, row by row. Decodes tiles in
    /// parallel.
    ///
    /// # Errors
    /// As [`DsmFile::tile`].
    pub fn functions(&self, x: u32, y: u32, width: u32, height: u32) -> Result<Vec<Visibility>> {
        Ok(self.rectangle(x, y, width, height)?.0)
    }

    /// As [`Level::functions`]; also returns the common precision of the tiles.
    ///
    /// # Errors
    /// As [`DsmFile::tile`].
    pub fn rectangle(
        &self,
        x: u32,
        y: u32,
        width: u32,
        height: u32,
    ) -> Result<(Vec<Visibility>, Precision)> {
        let side = self.shape.tile_size;
        let columns = x / side..(x + width).div_ceil(side);
        let rows = y / side..(y + height).div_ceil(side);
        let across = columns.len();
        let first = (columns.start, rows.start);
        let places: Vec<_> = rows
            .flat_map(|ty| columns.clone().map(move |tx| (tx, ty)))
            .collect();
        let tiles: deepshadow::Result<Vec<Tile>> = places
            .into_par_iter()
            .map(|(tx, ty)| self.file.tile(self.id, TileId::new(tx, ty)))
            .collect();
        let tiles = tiles?;
        let mut functions = Vec::with_capacity(width as usize * height as usize);
        for j in y..y + height {
            for i in x..x + width {
                let row = (j / side - first.1) as usize;
                let tile = &tiles[row * across + (i / side - first.0) as usize];
                let place = (j % side * tile.width() + i % side) as usize;
                functions.push(tile.function(place).to_visibility());
            }
        }
        let mut precisions = tiles
            .iter()
            .filter(|t| t.vertices() > 0)
            .map(Tile::precision);
        let precision = match precisions.next() {
            Some(first) if precisions.all(|p| p == first) => first,
            _ => Precision::F32,
        };
        Ok((functions, precision))
    }
}
