//! Walks over a whole level, in bounded memory: runs of equal directory entries, and bands of
//! decoded tiles.

use std::ops::Range;

use super::DsmFile;
use super::writer::{batch, in_parallel};
use crate::format::Tile;
use crate::format::directory::{Entry, TileKind};
use crate::format::layout::BLOCK_ENTRIES;
use crate::format::tile::decode::decoding_bytes;
use crate::map::{LevelId, LevelShape, TileId};
use crate::{FunctionRef, Result};

/// Successive tiles of a row of a level that have the same size and equal directory entries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// Index of the first tile in the directory.
    pub first: u64,
    /// Number of tiles; 1 for tiles with a payload.
    pub tiles: u64,
    /// Width and height of each in pixels.
    pub extent: (u32, u32),
    /// The entry of each.
    pub entry: Entry,
}

impl Run {
    /// Number of pixels of all its tiles.
    pub fn pixels(&self) -> u64 {
        self.tiles * u64::from(self.extent.0) * u64::from(self.extent.1)
    }
}

/// The decoded tiles of a rectangle of a level. Tiles whose pixels are all equal take no planes.
#[derive(Debug)]
pub struct Band {
    shape: LevelShape,
    columns: Range<u32>,
    rows: Range<u32>,
    /// Row by row. A tile of one pixel stands for equal pixels.
    tiles: Vec<Tile>,
}

/// The most runs of a batch.
const BATCH: usize = 1024;

/// Bytes of a tile of a band besides its planes.
const TILE: u64 = size_of::<Tile>() as u64 + 256;

impl DsmFile {
    /// The tiles of a level in the order of the directory. Reads one block of the directory at a
    /// time.
    ///
    /// # Errors
    /// `Input` if there is no such level. The items: as [`DsmFile::entry`]; the first error is the
    /// last item.
    pub fn runs(&self, level: LevelId) -> Result<impl Iterator<Item = Result<Run>> + use<'_>> {
        let shape = self.level(level)?.shape;
        let mut at = 0;
        Ok(std::iter::from_fn(move || {
            let run = (at < shape.tiles()).then(|| self.run(level, shape, at))?;
            at = run.as_ref().map_or(shape.tiles(), |run| at + run.tiles);
            Some(run)
        }))
    }

    fn run(&self, level: LevelId, shape: LevelShape, first: u64) -> Result<Run> {
        let tile = shape.tile_at(first);
        let entry = self.entry(level, tile)?;
        // The last tile of a row may have another width.
        let last = u64::from(shape.tiles_x() - 1 - tile.x).max(1);
        let most = last.min(BLOCK_ENTRIES - first % BLOCK_ENTRIES);
        let tiles = match entry.kind {
            TileKind::Data => 1,
            _ => self.equal_entries(level, first, most)?,
        };
        Ok(Run {
            first,
            tiles,
            extent: shape.tile_extent(tile),
            entry,
        })
    }

    /// The runs of a level, in parts whose tiles may all be decoded at once within
    /// [`Limits::memory`](crate::Limits::memory). First checks the layout, as [`DsmFile::band`].
    ///
    /// # Errors
    /// As [`DsmFile::runs`] and [`DsmFile::check_layout`].
    pub fn batches(
        &self,
        level: LevelId,
    ) -> Result<impl Iterator<Item = Result<Vec<Run>>> + use<'_>> {
        self.check_layout()?;
        let mut runs = self.runs(level)?.peekable();
        Ok(std::iter::from_fn(move || {
            let (mut batch, mut bytes) = (Vec::new(), 0);
            while let Some(run) = runs.peek() {
                let Ok(run) = run else {
                    return runs.next().map(|run| run.map(|run| vec![run]));
                };
                bytes += decoding_bytes(&run.entry, run.extent.0 * run.extent.1);
                let room = bytes <= self.limits().memory && batch.len() < BATCH;
                if !room && !batch.is_empty() {
                    break;
                }
                batch.push(*run);
                runs.next();
            }
            (!batch.is_empty()).then_some(Ok(batch))
        }))
    }

    /// Bytes that the functions of a rectangle of pixels take, at most, while they are unpacked and
    /// compressed again.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    ///
    /// # Panics
    /// If the rectangle is not inside the level.
    pub fn unpacked_bytes(&self, level: LevelId, [x, y, width, height]: [u32; 4]) -> Result<u64> {
        let shape = self.level(level)?.shape;
        let side = shape.tile_size;
        let mut bytes = 0;
        for ty in y / side..(y + height).div_ceil(side) {
            for tx in x / side..(x + width).div_ceil(side) {
                let vertices = self.entry(level, TileId::new(tx, ty))?.vertices;
                bytes += 512 * u64::from(side * side) + 256 * u64::from(vertices);
            }
        }
        Ok(bytes)
    }

    /// Decodes the tiles of a rectangle of pixels: left, top, width, height. First checks that no
    /// two tiles of the file share bytes ([`DsmFile::check_layout`]), so that the memory and the
    /// time that a file causes are proportional to its length.
    ///
    /// # Errors
    /// As [`DsmFile::tile`] and [`DsmFile::check_layout`]; `Limit` if the tiles together exceed
    /// [`Limits::memory`](crate::Limits::memory).
    ///
    /// # Panics
    /// If the rectangle is not inside the level.
    pub fn band(&self, level: LevelId, [x, y, width, height]: [u32; 4]) -> Result<Band> {
        self.check_layout()?;
        let shape = self.level(level)?.shape;
        let side = shape.tile_size;
        let columns = x / side..(x + width).div_ceil(side);
        let rows = y / side..(y + height).div_ceil(side);
        let (mut ids, mut held, mut most) = (Vec::new(), 0, 0);
        for y in rows.clone() {
            for x in columns.clone() {
                let tile = TileId::new(x, y);
                let entry = self.entry(level, tile)?;
                let planes = self.planes_bytes(&entry, shape.tile_extent(tile)) as u64;
                let (w, h) = shape.tile_extent(tile);
                held += TILE + planes;
                most = decoding_bytes(&entry, w * h)
                    .saturating_sub(planes)
                    .max(most);
                ids.push((tile, entry.kind));
            }
        }
        self.limits()
            .check(held + most, "a band of decoded tiles")?;
        let at_once = ((self.limits().memory - held) / most.max(1)).clamp(1, batch() as u64);
        let mut tiles = Vec::with_capacity(ids.len());
        for ids in ids.chunks(at_once as usize) {
            tiles.extend(in_parallel(ids.to_vec(), |(tile, kind)| match kind {
                TileKind::Data => self.tile(level, tile),
                _ => self.tile_of_one_pixel(level, tile),
            })?);
        }
        Ok(Band {
            shape,
            columns,
            rows,
            tiles,
        })
    }
}

impl Band {
    /// The function of pixel (x, y) of the level.
    ///
    /// # Panics
    /// If the pixel is outside the tiles of the band.
    pub fn function(&self, x: u32, y: u32) -> FunctionRef<'_> {
        let side = self.shape.tile_size;
        let row = (y / side - self.rows.start) as usize * self.columns.len();
        let tile = &self.tiles[row + (x / side - self.columns.start) as usize];
        match tile.pixels() {
            1 => tile.function(0),
            _ => tile.function((y % side * tile.width() + x % side) as usize),
        }
    }

    /// The functions of a row of pixels, from the first column of tiles to the last.
    pub fn row(&self, y: u32) -> impl Iterator<Item = FunctionRef<'_>> {
        let side = self.shape.tile_size;
        let row = (y / side - self.rows.start) as usize * self.columns.len();
        let tiles = self.columns.clone().zip(&self.tiles[row..]);
        tiles.flat_map(move |(column, tile)| {
            let width = (self.shape.width - column * side).min(side);
            (0..width).map(move |x| match tile.pixels() {
                1 => tile.function(0),
                _ => tile.function((y % side * width + x) as usize),
            })
        })
    }

    /// The tiles, row by row. A tile of one pixel stands for equal pixels.
    pub fn tiles(&self) -> &[Tile] {
        &self.tiles
    }
}
