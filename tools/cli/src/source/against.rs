//! The largest true error of each level of a map, against its source image.
//!
//! Up to level `PRODUCTS`, each stored function is compared with the plain average of its source
//! pixels' products. This shares no code with the writer. Above that level, the average would take
//! hours. There, the reference is the sum of the pixels' steps (exact to 1e-13), with curved pieces
//! replaced by chords that are off by at most `CHORD`.

use std::ops::Range;

use deepshadow::raw::{Band, Deviation, LevelShape};
use deepshadow::{Curve, DsmFile, FunctionRef, LevelId, MapId, Pixel, Ray, Sweep};
use rayon::prelude::*;

use super::DeepSource;
use deepshadow_frame::{Failure, InFile, Result};

/// The last level that is compared with plain products. 2^PRODUCTS rows are in memory at once.
const PRODUCTS: usize = 4;

/// Largest error of the chords for curved pieces of a ray, above level `PRODUCTS`.
const CHORD: f64 = 1e-6;

/// Columns of the source that one read covers.
const COLUMNS: u32 = 4096;

/// The largest error of one level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelDeviation {
    /// The level.
    pub level: u32,
    /// The largest deviation over all pixels, depths, sides of steps, and channels.
    pub worst: Deviation,
    /// Uncertainty of `worst.error`: above 0 only for high levels of images with thick samples.
    pub slack: f64,
    /// The pixel of the level.
    pub pixel: Pixel,
    /// The largest error that the file states for the level.
    pub max_error: f64,
}

impl LevelDeviation {
    /// Whether the error is within `max_error`. Evaluation in f32 may add 2^-22
    /// (`spec/semantics.md`, section 1).
    pub fn is_kept(&self) -> bool {
        self.worst.error <= self.max_error + self.slack + 2f64.powi(-22)
    }

    fn add(&mut self, worst: Deviation, slack: f64, pixel: Pixel) {
        self.slack = self.slack.max(slack);
        if worst.error > self.worst.error {
            (self.worst, self.pixel) = (worst, pixel);
        }
    }
}

/// Measures the largest true error of each level of map `map`, over all pixels, all depths and both
/// sides of each step, against the exact average of the source pixels that a pixel covers.
///
/// Calls `progress` with the number of source rows done and the total. Memory: the functions of 16
/// x 4096 source pixels, and for a level above the fourth about 20 bytes for each sample of 2^level
/// rows. Runs on all cores.
///
/// # Errors
/// `Failed` if image and map differ in size, or if either cannot be read.
pub fn against(
    file: &DsmFile,
    map: MapId,
    source: &DeepSource,
    mut progress: impl FnMut(u64, u64),
) -> Result<Vec<LevelDeviation>> {
    let info = file.map(map)?;
    let (w, h) = (info.header.width, info.header.height);
    let (sw, sh) = (source.header().width, source.header().height);
    if (w, h) != (sw, sh) {
        let line = format!("the image has {sw} x {sh} pixels, but the map has {w} x {h}");
        return Err(Failure::Failed(line)).in_file(source.path());
    }
    let fresh = |level: u32| LevelDeviation {
        level,
        worst: Deviation::default(),
        slack: 0.0,
        pixel: Pixel::new(0, 0),
        max_error: info.levels[level as usize].max_error,
    };
    let mut worst: Vec<_> = (0..info.levels.len() as u32).map(fresh).collect();
    let low = worst.len().min(PRODUCTS + 1);
    let passes = 1 + worst.len() - low;
    let total = passes as u64 * u64::from(h);
    let mut done = 0;

    let band = 1 << (low - 1);
    let new = |l| TileRows::new(file, map.level(l));
    let mut rows = (0..low as u32).map(new).collect::<Result<Vec<_>>>()?;
    for y in (0..h).step_by(band as usize) {
        let height = band.min(h - y);
        for (l, row) in rows.iter_mut().enumerate() {
            row.load(y >> l, (y + height - 1) >> l)?;
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
    for worst in &mut worst[low..] {
        let l = worst.level;
        let mut row = TileRows::new(file, map.level(l))?;
        for y in 0..row.shape.height {
            let source_rows = span(y, l, h);
            row.load(y, y)?;
            sums_of_row(source, &row, y, source_rows.clone(), worst, |rows| {
                progress(done + u64::from(rows), total);
            })?;
            done += u64::from(source_rows.end - source_rows.start);
        }
    }
    Ok(worst)
}

/// Returns the columns or rows of the base that `at` of `level` covers.
fn span(at: u32, level: u32, side: u32) -> Range<u32> {
    at << level..((at + 1) << level).min(side)
}

/// Decoded rows of tiles of one level.
struct TileRows<'a> {
    file: &'a DsmFile,
    id: LevelId,
    shape: LevelShape,
    /// The decoded rows of tiles.
    rows: Range<u32>,
    band: Option<Band>,
}

impl<'a> TileRows<'a> {
    fn new(file: &'a DsmFile, id: LevelId) -> Result<Self> {
        Ok(TileRows {
            file,
            id,
            shape: file.level(id)?.shape,
            rows: 0..0,
            band: None,
        })
    }

    /// Decodes the tiles of pixel rows `first` to `last`, unless they are decoded already.
    fn load(&mut self, first: u32, last: u32) -> Result<()> {
        let side = self.shape.tile_size;
        let rows = first / side..last / side + 1;
        if self.rows != rows {
            self.band = None;
            let area = [0, first, self.shape.width, last + 1 - first];
            self.band = Some(self.file.band(self.id, area)?);
            self.rows = rows;
        }
        Ok(())
    }

    fn function(&self, x: u32, y: u32) -> FunctionRef<'_> {
        self.band.as_ref().expect("loaded before").function(x, y)
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
        let level = row.id.level;
        let columns = self.x >> level..((self.x + self.width - 1) >> level) + 1;
        let lines = self.y >> level..((self.y + self.height - 1) >> level) + 1;
        let pixels: Vec<_> = lines
            .flat_map(|y| columns.clone().map(move |x| Pixel { x, y }))
            .collect();
        let measure = |&Pixel { x, y }: &Pixel| {
            let mut sources = Vec::new();
            for j in span(y - (self.y >> level), level, self.height) {
                for i in span(x - (self.x >> level), level, self.width) {
                    sources.push((1.0, &self.rays[(j * self.width + i) as usize]));
                }
            }
            (
                Deviation::of_average(&sources, row.function(x, y)),
                Pixel { x, y },
            )
        };
        let measured: Vec<_> = pixels.par_iter().map(measure).collect();
        for (deviation, pixel) in measured {
            worst.add(deviation, 0.0, pixel);
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
    let (level, width) = (row.id.level, source.header().width);
    let mut sums = vec![Sweep::new(); row.shape.width as usize];
    let step = 32u32;
    for top in source_rows.clone().step_by(step as usize) {
        let height = step.min(source_rows.end - top);
        // A column of the level may be wider than one read; both are powers of two.
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
        worst.add(deviation, slack, Pixel::new(x as u32, y));
    }
    Ok(())
}
