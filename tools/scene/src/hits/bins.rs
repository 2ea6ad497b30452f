//! Bins: for each tile, the triangles that it sees.

use std::ops::Range;

use super::triangles::PixelBox;

/// The tiles of a view, and how far a tile's filter reaches beyond its border.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileGrid {
    /// Side of a tile in pixels.
    pub tile: i32,
    /// Reach of the filter beyond a tile's border, in pixels.
    pub margin: i32,
    /// First tile and end of the tiles in x, then in y.
    pub tiles: [i32; 4],
}

impl TileGrid {
    /// The columns of tiles that see a box.
    fn columns(&self, b: &PixelBox) -> Range<i32> {
        self.span(b[0], b[1], self.tiles[0], self.tiles[1])
    }

    /// The rows of tiles that see a box.
    fn rows(&self, b: &PixelBox) -> Range<i32> {
        self.span(b[2], b[3], self.tiles[2], self.tiles[3])
    }

    fn span(&self, first: i32, last: i32, begin: i32, end: i32) -> Range<i32> {
        if last < first {
            return 0..0;
        }
        // Tile t covers pixels from t * tile - margin to (t + 1) * tile + margin, exclusive.
        let low = (first - self.margin).div_euclid(self.tile);
        let high = (last + self.margin).div_euclid(self.tile) + 1;
        low.max(begin)..high.min(end).max(low.max(begin))
    }

    /// Index of a tile in the grid.
    fn number(&self, tx: i32, ty: i32) -> usize {
        let across = (self.tiles[1] - self.tiles[0]) as usize;
        (ty - self.tiles[2]) as usize * across + (tx - self.tiles[0]) as usize
    }

    fn len(&self) -> usize {
        (self.tiles[1] - self.tiles[0]) as usize * (self.tiles[3] - self.tiles[2]) as usize
    }

    /// Divides the grid into bands of whole rows of tiles whose bins hold at most about `most`
    /// items: one for each box that a tile sees, and eight for each tile. A row that exceeds `most`
    /// on its own becomes a band of its own.
    pub fn bands(&self, boxes: &[PixelBox], most: usize) -> Vec<TileGrid> {
        let first = self.tiles[2];
        // Difference between the items of a row and of the row before it.
        let mut change = vec![0i64; (self.tiles[3] - first) as usize + 1];
        for b in boxes {
            let (rows, columns) = (self.rows(b), self.columns(b).len() as i64);
            if !rows.is_empty() {
                change[(rows.start - first) as usize] += columns;
                change[(rows.end - first) as usize] -= columns;
            }
        }
        let mut bands = Vec::new();
        let (mut begin, mut held, mut row_holds) = (first, 0, 0i64);
        let across = (self.tiles[1] - self.tiles[0]) as usize * ITEMS_PER_TILE;
        for row in first..self.tiles[3] {
            row_holds += change[(row - first) as usize];
            let holds = row_holds as usize + across;
            if held > 0 && held + holds > most {
                bands.push(self.rows_of(begin, row));
                (begin, held) = (row, 0);
            }
            held += holds;
        }
        bands.push(self.rows_of(begin, self.tiles[3]));
        bands
    }

    fn rows_of(&self, begin: i32, end: i32) -> TileGrid {
        let [x0, x1, ..] = self.tiles;
        TileGrid {
            tiles: [x0, x1, begin, end],
            ..*self
        }
    }
}

/// Memory of a tile's entry in the bins, in items.
const ITEMS_PER_TILE: usize = 8;

/// For each tile of a grid, the indices of the boxes that it sees, in ascending order.
#[derive(Debug)]
pub struct Bins {
    grid: TileGrid,
    begins: Vec<usize>,
    items: Vec<u32>,
}

impl Bins {
    /// Sorts boxes into tiles.
    pub fn new(grid: TileGrid, boxes: &[PixelBox]) -> Self {
        let mut begins = vec![0usize; grid.len() + 1];
        let each = |visit: &mut dyn FnMut(usize, u32)| {
            for (i, b) in boxes.iter().enumerate() {
                for ty in grid.rows(b) {
                    for tx in grid.columns(b) {
                        visit(grid.number(tx, ty), i as u32);
                    }
                }
            }
        };
        each(&mut |tile, _| begins[tile + 1] += 1);
        for tile in 1..begins.len() {
            begins[tile] += begins[tile - 1];
        }
        let mut items = vec![0; begins[grid.len()]];
        let mut next = begins.clone();
        each(&mut |tile, i| {
            items[next[tile]] = i;
            next[tile] += 1;
        });
        Bins {
            grid,
            begins,
            items,
        }
    }

    /// Indices of the boxes that a tile sees.
    pub fn of(&self, tx: i32, ty: i32) -> &[u32] {
        let tile = self.grid.number(tx, ty);
        &self.items[self.begins[tile]..self.begins[tile + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: TileGrid = TileGrid {
        tile: 8,
        margin: 2,
        tiles: [1, 5, 0, 4],
    };

    #[test]
    fn a_tile_sees_boxes_that_reach_into_its_margin() {
        // Pixels 14 and 15 are in tile 1 and in the margin of tile 2, which begins at 14.
        let boxes = [
            [13, 13, 0, 0],
            [14, 15, 0, 0],
            [16, 17, 9, 9],
            [18, 18, 10, 10],
            [0, -1, 0, -1],
            [0, 5, 0, 0],
        ];
        let bins = Bins::new(GRID, &boxes);
        assert_eq!(bins.of(1, 0), [0, 1, 2]);
        assert_eq!(bins.of(2, 0), [1, 2]);
        assert_eq!(bins.of(2, 1), [2, 3]);
        assert_eq!(bins.of(1, 1), [2]);
        assert!(bins.of(4, 3).is_empty());
    }

    #[test]
    fn bands_divide_the_grid_and_lose_no_box() {
        let mut dice = 1u64;
        let mut roll = |n: i32| {
            dice = crate::samples::mix(dice + 1);
            (dice % n as u64) as i32
        };
        let boxes: Vec<PixelBox> = (0..500)
            .map(|_| {
                let (x, y) = (roll(60) - 10, roll(60) - 10);
                [x, x + roll(12) - 1, y, y + roll(12) - 1]
            })
            .collect();
        let whole = Bins::new(GRID, &boxes);
        for most in [1, 50, 200, 10_000] {
            let bands = GRID.bands(&boxes, most);
            assert_eq!((bands[0].tiles[2], bands.last().unwrap().tiles[3]), (0, 4));
            assert!(bands.windows(2).all(|b| b[0].tiles[3] == b[1].tiles[2]));
            for band in bands {
                let bins = Bins::new(band, &boxes);
                let rows = band.tiles[2]..band.tiles[3];
                let held = bins.items.len() + ITEMS_PER_TILE * band.len();
                assert!(held <= most || rows.len() == 1, "{most}");
                for ty in rows {
                    for tx in 1..5 {
                        assert_eq!(bins.of(tx, ty), whole.of(tx, ty));
                    }
                }
            }
        }
    }
}
