//! The functions of a level, rectangle by rectangle.

use std::ops::Range;

use deepshadow::raw::directory::TileKind;
use deepshadow::raw::{Band, LevelShape, Precision};
use deepshadow::{DsmFile, LevelId, Tile, Visibility};

use deepshadow_frame::args::Region;
use deepshadow_frame::{Failure, Result};

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

    /// Number of pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.shape.width) * u64::from(self.shape.height)
    }

    /// The rectangle of all pixels.
    pub fn all(&self) -> Region {
        [0, 0, self.shape.width, self.shape.height]
    }

    /// Returns the rectangle of pixels that `--region` asks for, else that of all pixels.
    ///
    /// # Errors
    /// `Failed` for a rectangle that is not inside the level.
    pub fn region(&self, asked: Option<Region>) -> Result<Region> {
        let (across, down) = (self.shape.width, self.shape.height);
        let inside = |at: u32, n: u32, side: u32| u64::from(at) + u64::from(n) <= u64::from(side);
        match asked.unwrap_or(self.all()) {
            [x, y, w, h] if inside(x, w, across) && inside(y, h, down) => Ok([x, y, w, h]),
            [x, y, w, h] => Err(Failure::Failed(format!(
                "--region {x},{y},{w},{h}: not inside the {across} x {down} pixels of level {} of \
                 map {:?}",
                self.id.level,
                self.file.map(self.id.map)?.header.name
            ))),
        }
    }

    /// Whether any pixel has three channels. Reads the directory only.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn is_coloured(&self) -> Result<bool> {
        for run in self.file.runs(self.id)? {
            if run?.entry.coloured {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Returns the common lattice of all tiles, if there is one.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn lattice(&self) -> Result<Option<Precision>> {
        let mut found = None;
        for run in self.file.runs(self.id)? {
            let entry = run?.entry;
            if entry.kind != TileKind::Data {
                continue;
            }
            if entry.lattice == 0 || found.is_some_and(|l| l != entry.lattice) {
                return Ok(None);
            }
            found = Some(entry.lattice);
        }
        Ok(found.map(Precision::Lattice))
    }

    /// Decodes a rectangle of the level, as many rows of pixels at once as a tile has. Returns the
    /// rows of each band.
    ///
    /// # Errors
    /// The items: as [`DsmFile::band`].
    pub fn bands(&self, area: Region) -> impl Iterator<Item = Result<(Range<u32>, Band)>> {
        let [x, top, width, height] = area;
        let side = self.shape.tile_size;
        let bottom = top + height;
        (top..bottom).step_by(side as usize).map(move |y| {
            let rows = side.min(bottom - y);
            let band = self.file.band(self.id, [x, y, width, rows])?;
            Ok((y..y + rows, band))
        })
    }

    /// Reads the functions of a rectangle of pixels inside the level, row by row, and the common
    /// precision of its tiles.
    ///
    /// # Errors
    /// As [`DsmFile::band`].
    pub fn functions(&self, area: Region) -> Result<(Vec<Visibility>, Precision)> {
        let [x, y, width, height] = area;
        let band = self.file.band(self.id, area)?;
        let pixels = (y..y + height).flat_map(|j| (x..x + width).map(move |i| (i, j)));
        let functions = pixels.map(|(i, j)| band.function(i, j).to_visibility());
        let functions = functions.collect();
        let tiles = band.tiles().iter();
        let mut precisions = tiles.filter(|t| t.vertices() > 0).map(Tile::precision);
        let precision = match precisions.next() {
            Some(first) if precisions.all(|p| p == first) => first,
            _ => Precision::F32,
        };
        Ok((functions, precision))
    }

    /// Splits rectangles of pixels into parts that may be unpacked at once within the budget.
    ///
    /// # Errors
    /// As [`DsmFile::entry`]; `Failed` for a rectangle that alone exceeds the budget.
    pub fn parts<T>(&self, all: Vec<T>, area: impl Fn(&T) -> Region) -> Result<Vec<Vec<T>>> {
        let limits = self.file.limits();
        let cost = |item: &T| Ok(self.file.unpacked_bytes(self.id, area(item))?);
        in_parts(all, limits.memory / 2, cost, |bytes| {
            Ok(limits.check(2 * bytes, "a square of unpacked tiles")?)
        })
    }
}

/// Splits `all` into parts whose costs add up to at most `budget`. `check` judges a single item.
///
/// # Errors
/// Those of `cost` and `check`.
pub fn in_parts<T>(
    all: Vec<T>,
    budget: u64,
    cost: impl Fn(&T) -> Result<u64>,
    check: impl Fn(u64) -> Result<()>,
) -> Result<Vec<Vec<T>>> {
    let (mut parts, mut sum) = (vec![Vec::new()], 0);
    for item in all {
        let bytes = cost(&item)?;
        check(bytes)?;
        sum += bytes;
        if sum > budget {
            parts.push(Vec::new());
            sum = bytes;
        }
        parts.last_mut().expect("never empty").push(item);
    }
    Ok(parts)
}
