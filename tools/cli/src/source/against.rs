//! The largest true error of every level of a map, against the image that it was made from.
//!
//! Up to level `PRODUCTS` each stored function is compared with the plain average of its source pixels' products, which shares no
//! code with what made it. Above, where that would take hours, with the sum of their steps (exact to 1e-13), curved
//! pieces being replaced by chords that are off by at most `CHORD`.

use std::ops::Range;

use deepshadow::raw::LevelShape;
use deepshadow::{Curve, Deviation, DsmFile, FunctionRef, MapId, Ray, Sweep, Tile, TileId};
use rayon::prelude::*;

use super::DeepSource;
use deepshadow_frame::{Failure, InFile, Result};

/// The last level whose functions are compared with plain products: 2^PRODUCTS rows are held at once.
const PRODUCTS: usize = 4;

/// How far chords may be from the curved pieces of a ray, above level `PRODUCTS`.
const CHORD: f64 = 1e-6;

/// Columns of the source that are read at once.
const COLUMNS: u32 = 4096;

/// The largest error of one level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelDeviation {
    /// The level.
    pub level: usize,
    /// The largest deviation over all pixels, depths, sides of steps and channels.
    pub worst: Deviation,
    /// How far its error may be off: 0 but for high levels of images with thick samples.
    pub slack: f64,
    /// The pixel, in the level's coordinates.
    pub pixel: (u32, u32),
    /// What the file promises for the level.
    pub promise: f64,
}

impl LevelDeviation {
    /// Whether the level keeps its promise; evaluating in f32 may add 2^-22 (`spec/semantics.md`, section 1).
    pub fn is_kept(&self) -> bool {
        self.worst.error <= self.promise + self.slack + 2f64.powi(-22)
    }

    fn see(&mut self, worst: Deviation, slack: f64, pixel: (u32, u32)) {
        self.slack = self.slack.max(slack);
        if worst.error > self.worst.error {
            (self.worst, self.pixel) = (worst, pixel);
        }
    }
}

/// Measures the largest true error of every level of map `map`: over all pixels, all depths and both sides of every step,
/// against the exact average of the source pixels that the pixel stands for.
///
/// `progress` is told source rows done, and rows in all. Memory: the functions of 16 x 4096 source pixels, and for a level above
/// the fourth some 20 bytes for every sample of the 2^level rows under way. Runs on all cores.
///
/// # Errors
/// `Failed` if the image and the map differ in size, or either cannot be read.
pub fn against(
    file: &DsmFile,
    map: usize,
    source: &DeepSource,
    mut progress: impl FnMut(u64, u64),
) -> Result<Vec<LevelDeviation>> {
    file.level(MapId(map as u32).level(0))?;
    let info = &file.maps()[map];
    let (w, h) = (info.header.width, info.header.height);
    let (sw, sh) = (source.header().width, source.header().height);
    if (w, h) != (sw, sh) {
        let line = format!("it has {sw} x {sh} pixels, the map {w} x {h}");
        return Err(Failure::Failed(line)).in_file(source.path());
    }
    let fresh = |level: usize| LevelDeviation {
        level,
        worst: Deviation::default(),
        slack: 0.0,
        pixel: (0, 0),
        promise: info.levels[level].max_error,
    };
    let mut worst: Vec<_> = (0..info.levels.len()).map(fresh).collect();
    let low = worst.len().min(PRODUCTS + 1);
    let passes = 1 + worst.len() - low;
    let total = passes as u64 * u64::from(h);
    let mut done = 0;

    let band = 1 << (low - 1);
    let mut rows: Vec<TileRows> = (0..low).map(|l| TileRows::new(file, map, l)).collect();
    for y in (0..h).step_by(band as usize) {
        let height = band.min(h - y);
        for (l, row) in rows.iter_mut().enumerate() {
            row.reach(y >> l, (y + height - 1) >> l)?;
        }
        for x in (0..w).step_by(COLUMNS as usize) {
            let width = COLUMNS.min(w - x);
            let rays = source.rays(x, y, width, height)?;
            let part = Part {
                rays: &rays,
                x,
                y,
                width,
                height,
            };
            for (l, row) in rows.iter().enumerate() {
                part.compare(row, &mut worst[l]);
            }
        }
        done += u64::from(height);
        progress(done, total);
    }
    drop(rows);
    for (l, worst) in worst.iter_mut().enumerate().skip(low) {
        let mut row = TileRows::new(file, map, l);
        for y in 0..row.shape.height {
            let source_rows = span(y, l, h);
            row.reach(y, y)?;
            sums_of_row(source, &row, y, source_rows.clone(), worst, |rows| {
                progress(done + u64::from(rows), total);
            })?;
            done += u64::from(source_rows.end - source_rows.start);
        }
    }
    Ok(worst)
}

/// Pixels of the base that pixel `at` of `level` stands for.
fn span(at: u32, level: usize, side: u32) -> Range<u32> {
    at << level..((at + 1) << level).min(side)
}

/// Some rows of tiles of one level, decoded.
struct TileRows<'a> {
    file: &'a DsmFile,
    map: usize,
    level: usize,
    shape: LevelShape,
    /// The rows that are there, and their tiles.
    rows: Range<u32>,
    tiles: Vec<Tile>,
}

impl<'a> TileRows<'a> {
    fn new(file: &'a DsmFile, map: usize, level: usize) -> Self {
        TileRows {
            file,
            map,
            level,
            shape: file.maps()[map].levels[level].shape,
            rows: 0..0,
            tiles: Vec::new(),
        }
    }

    /// Decodes the tiles of the level's pixel rows `first` to `last`, unless they are there.
    fn reach(&mut self, first: u32, last: u32) -> Result<()> {
        let side = self.shape.tile_size;
        let rows = first / side..last / side + 1;
        if self.rows != rows {
            let across = self.shape.tiles_x();
            let tile = |i: u32| {
                let (tx, ty) = (i % across, rows.start + i / across);
                self.file.tile(
                    MapId(self.map as u32).level(self.level as u32),
                    TileId::new(tx, ty),
                )
            };
            let count = rows.len() as u32 * across;
            let tiles: deepshadow::Result<Vec<Tile>> =
                (0..count).into_par_iter().map(tile).collect();
            self.tiles = tiles?;
            self.rows = rows;
        }
        Ok(())
    }

    fn function(&self, x: u32, y: u32) -> FunctionRef<'_> {
        let side = self.shape.tile_size;
        let row = y / side - self.rows.start;
        let tile = &self.tiles[(row * self.shape.tiles_x() + x / side) as usize];
        tile.function((y % side * tile.width() + x % side) as usize)
    }
}

/// A rectangle of source pixels.
struct Part<'a> {
    rays: &'a [Ray],
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Part<'_> {
    fn compare(&self, row: &TileRows<'_>, worst: &mut LevelDeviation) {
        let level = row.level;
        let columns = self.x >> level..((self.x + self.width - 1) >> level) + 1;
        let lines = self.y >> level..((self.y + self.height - 1) >> level) + 1;
        let pixels: Vec<_> = lines
            .flat_map(|y| columns.clone().map(move |x| (x, y)))
            .collect();
        let measure = |&(x, y): &(u32, u32)| {
            let mut sources = Vec::new();
            for j in span(y - (self.y >> level), level, self.height) {
                for i in span(x - (self.x >> level), level, self.width) {
                    sources.push((1.0, &self.rays[(j * self.width + i) as usize]));
                }
            }
            (Deviation::of_average(&sources, row.function(x, y)), (x, y))
        };
        let measured: Vec<_> = pixels.par_iter().map(measure).collect();
        for (deviation, pixel) in measured {
            worst.see(deviation, 0.0, pixel);
        }
    }
}

/// Compares row `y` of a high level with the sums of its source rows.
fn sums_of_row(
    source: &DeepSource,
    row: &TileRows<'_>,
    y: u32,
    source_rows: Range<u32>,
    worst: &mut LevelDeviation,
    mut progress: impl FnMut(u32),
) -> Result<()> {
    let (level, width) = (row.level, source.header().width);
    let mut sums = vec![Sweep::new(); row.shape.width as usize];
    let step = 32u32;
    for top in source_rows.clone().step_by(step as usize) {
        let height = step.min(source_rows.end - top);
        // A column of the level may be wider than what is read at once; both are powers of two.
        for left in (0..width).step_by(COLUMNS as usize) {
            let columns = COLUMNS.min(width - left);
            let rays = source.rays(left, top, columns, height)?;
            let first = left >> level;
            let last = (left + columns - 1) >> level;
            let sums = &mut sums[first as usize..=last as usize];
            sums.par_iter_mut().enumerate().try_for_each(|(i, sum)| {
                let covered = span(first + i as u32, level, width);
                let from = covered.start.max(left) - left;
                let to = covered.end.min(left + columns) - left;
                for j in 0..height {
                    for x in from..to {
                        sum.add_ray(&rays[(j * columns + x) as usize], CHORD, 1.0)?;
                    }
                }
                deepshadow::Result::Ok(())
            })?;
        }
        progress(top + height - source_rows.start);
    }
    let measured: deepshadow::Result<Vec<_>> = sums
        .into_par_iter()
        .enumerate()
        .map(|(x, mut sum)| {
            let mut exact = Curve::lit(1);
            sum.finish(&mut exact)?;
            Ok((exact.deviation(row.function(x as u32, y)), exact.error()))
        })
        .collect();
    for (x, (deviation, slack)) in measured?.into_iter().enumerate() {
        worst.see(deviation, slack, (x as u32, y));
    }
    Ok(())
}
