//! The blocks of a part and their pixels.
//!
//! A block is the unit of compression: one scanline of a deep scanline part (several in flat
//! images), or one tile. Blocks are numbered row by row from the top left, independent of their
//! order in the file.

use crate::error::{Error, Result};
use crate::header::{LevelMode, Part, Rect, Tiles};

impl Part {
    /// Number of blocks of the full-size image.
    pub fn block_count(&self) -> usize {
        let (columns, rows) = self.grid();
        usize::try_from(columns * rows).unwrap_or(usize::MAX)
    }

    /// The pixels of block `index`, or `None` if there is no such block.
    ///
    /// ```
    /// use deepshadow_exr::{Channel, Part, Rect, SampleType, Tiles};
    /// let window = Rect { x: -1, y: 0, width: 5, height: 3 };
    /// let z = vec![Channel::new("Z", SampleType::Float)];
    /// let part = Part::deep_tiled(window, z, Tiles::new(4, 2));
    /// assert_eq!(part.block_count(), 4);
    /// assert_eq!(part.block_rect(3), Some(Rect { x: 3, y: 2, width: 1, height: 1 }));
    /// ```
    pub fn block_rect(&self, index: usize) -> Option<Rect> {
        let (columns, rows) = self.grid();
        let index = index as u64;
        if index >= columns * rows {
            return None;
        }
        let (width, height) = self.block_size();
        let w = &self.data_window;
        let (left, top) = (
            index % columns * u64::from(width),
            index / columns * u64::from(height),
        );
        Some(Rect {
            // Both sums lie in the data window, so they fit into i32.
            x: (i64::from(w.x) + left as i64) as i32,
            y: (i64::from(w.y) + top as i64) as i32,
            width: u64::from(width).min(u64::from(w.width) - left) as u32,
            height: u64::from(height).min(u64::from(w.height) - top) as u32,
        })
    }

    /// All blocks with their pixels, row by row from the top.
    pub fn blocks(&self) -> impl Iterator<Item = (usize, Rect)> + '_ {
        (0..self.block_count()).filter_map(|i| Some((i, self.block_rect(i)?)))
    }

    /// The blocks that intersect `rect`, row by row from the top.
    pub fn blocks_in(&self, rect: Rect) -> impl Iterator<Item = (usize, Rect)> + '_ {
        let (width, height) = self.block_size();
        let columns = self.grid().0;
        let w = self.data_window;
        let spans = w.intersection(&rect).map(|r| {
            let column = |x: i64| (x - i64::from(w.x)) as u64 / u64::from(width);
            let row = |y: i64| (y - i64::from(w.y)) as u64 / u64::from(height);
            (
                column(r.x.into())..column(r.x_end() - 1) + 1,
                row(r.y.into())..row(r.y_end() - 1) + 1,
            )
        });
        spans.into_iter().flat_map(move |(xs, ys)| {
            ys.flat_map(move |y| xs.clone().map(move |x| y * columns + x))
                .filter_map(|i| Some((i as usize, self.block_rect(i as usize)?)))
        })
    }

    /// Columns and rows of a full block.
    pub(crate) fn block_size(&self) -> (u32, u32) {
        match &self.tiles {
            Some(t) => (t.width.max(1), t.height.max(1)),
            None => (
                self.data_window.width.max(1),
                self.compression.lines_per_block().unwrap_or(1),
            ),
        }
    }

    /// Columns and rows of blocks.
    pub(crate) fn grid(&self) -> (u64, u64) {
        let (width, height) = self.block_size();
        (
            u64::from(self.data_window.width.div_ceil(width)),
            u64::from(self.data_window.height.div_ceil(height)),
        )
    }

    /// Number of blocks of all levels, the length of the offset table.
    pub(crate) fn chunk_count(&self) -> Result<u64> {
        let full = || {
            let (columns, rows) = self.grid();
            columns * rows
        };
        let Some(t) = &self.tiles else {
            if self.compression.lines_per_block().is_none() {
                return Err(Error::unsupported(format!(
                    "compression {} is unknown",
                    self.compression.code()
                )));
            }
            return Ok(full());
        };
        let w = &self.data_window;
        let tiles = |size: u64, tile: u32| size.div_ceil(u64::from(tile));
        let sides = |size: u32| (0..level_count(size, t)).map(move |l| level_size(size, l, t));
        let too_many = || Error::corrupt("the part has more than 2^64 tiles");
        match t.levels {
            LevelMode::One => Ok(full()),
            LevelMode::Mipmap => (0..level_count(w.width.max(w.height), t))
                .map(|l| (level_size(w.width, l, t), level_size(w.height, l, t)))
                .try_fold(0_u64, |sum, (x, y)| {
                    sum.checked_add(tiles(x, t.width).checked_mul(tiles(y, t.height))?)
                })
                .ok_or_else(too_many),
            LevelMode::Ripmap => {
                let columns: u64 = sides(w.width).map(|x| tiles(x, t.width)).sum();
                let rows: u64 = sides(w.height).map(|y| tiles(y, t.height)).sum();
                columns.checked_mul(rows).ok_or_else(too_many)
            }
        }
    }
}

/// Number of levels down to a size of 1.
fn level_count(size: u32, tiles: &Tiles) -> u32 {
    let size = size.max(1);
    let floor = size.ilog2();
    1 + if tiles.round_up && !size.is_power_of_two() {
        floor + 1
    } else {
        floor
    }
}

fn level_size(size: u32, level: u32, tiles: &Tiles) -> u64 {
    let size = u64::from(size);
    let halved = if tiles.round_up {
        size.div_ceil(1 << level)
    } else {
        size >> level
    };
    halved.max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::header::{Channel, SampleType};

    fn tiled(width: u32, height: u32, levels: LevelMode, round_up: bool) -> Part {
        let mut tiles = Tiles::new(16, 16);
        tiles.levels = levels;
        tiles.round_up = round_up;
        let window = Rect {
            x: 0,
            y: 0,
            width,
            height,
        };
        Part::deep_tiled(window, vec![Channel::new("Z", SampleType::Float)], tiles)
    }

    #[test]
    fn tiles_of_all_levels_are_counted() {
        // 33x17: 33x17 16x8 8x4 4x2 2x1 1x1 down; 33x17 17x9 9x5 5x3 3x2 2x1 1x1 up.
        let count = |part: Part| part.chunk_count().unwrap();
        assert_eq!(count(tiled(33, 17, LevelMode::One, false)), 6);
        assert_eq!(count(tiled(33, 17, LevelMode::Mipmap, false)), 6 + 5);
        assert_eq!(count(tiled(33, 17, LevelMode::Mipmap, true)), 6 + 2 + 5);
        // Columns 3 1 1 1 1 1, rows 2 1 1 1 1.
        assert_eq!(count(tiled(33, 17, LevelMode::Ripmap, false)), 8 * 6);
    }

    #[test]
    fn blocks_in_a_rectangle_share_a_pixel_with_it() {
        let part = tiled(33, 17, LevelMode::One, false);
        for (x, y, width, height) in [(0, 0, 1, 1), (15, 15, 2, 2), (-9, 16, 99, 9), (33, 0, 4, 4)]
        {
            let rect = Rect {
                x,
                y,
                width,
                height,
            };
            let slow: Vec<_> = part
                .blocks()
                .filter(|(_, r)| r.intersection(&rect).is_some())
                .collect();
            assert_eq!(part.blocks_in(rect).collect::<Vec<_>>(), slow);
        }
    }
}
