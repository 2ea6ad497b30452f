//! The reference answer of every lookup, in f64, by the plainest code.

use deepshadow::{DsmFile, FunctionRef, MapId, Tile, TileId};

use crate::queries::{Lookup, levels_of};

/// One pixel of a lookup: level, column, row and weight.
type Tap = (usize, u32, u32, f64);

/// The pixels that a triangle or Gaussian footprint of `width` pixels at (x, y) takes, weights
/// adding up to one.
pub fn taps(lookup: Lookup, width: f32, sizes: &[(u32, u32)], x: f32, y: f32) -> Vec<Tap> {
    let (x, y) = (f64::from(x), f64::from(y));
    match lookup {
        Lookup::Pixel => vec![(0, x as u32, y as u32, 1.0)],
        Lookup::Gaussian => window(0, sizes[0], x, y, 2, |d| {
            (-2.0 * d * d).exp() - (-8f64).exp()
        }),
        Lookup::Bilinear | Lookup::Trilinear => {
            let (fine, coarse, blend) = levels_of(width, sizes.len());
            let mut out = Vec::new();
            for (level, weight) in [(fine, 1.0 - blend), (coarse, blend)] {
                if weight > 0.0 {
                    let scale = 0.5f64.powi(level as i32);
                    let near = window(level, sizes[level], x * scale, y * scale, 1, |d| 1.0 - d);
                    out.extend(near.into_iter().map(|(l, i, j, w)| (l, i, j, w * weight)));
                }
            }
            out
        }
    }
}

/// The `2 reach` x `2 reach` pixels around (x, y), border pixels repeated, weighted by distance
/// along x times along y.
fn window(
    level: usize,
    size: (u32, u32),
    x: f64,
    y: f64,
    reach: i64,
    weight: impl Fn(f64) -> f64,
) -> Vec<Tap> {
    let axis = |at: f64, n: u32| -> Vec<(u32, f64)> {
        let first = (at - 0.5).floor() as i64 + 1 - reach;
        let near = first..first + 2 * reach;
        let near = near.map(|i| (i, weight((i as f64 + 0.5 - at).abs())));
        near.map(|(i, w)| (i.clamp(0, i64::from(n) - 1) as u32, w))
            .collect()
    };
    let (columns, rows) = (axis(x, size.0), axis(y, size.1));
    let total: f64 =
        columns.iter().map(|c| c.1).sum::<f64>() * rows.iter().map(|r| r.1).sum::<f64>();
    let mut out = Vec::new();
    for &(j, v) in &rows {
        out.extend(columns.iter().map(|&(i, w)| (level, i, j, w * v / total)));
    }
    out
}

/// Value of a function at depth `z`: 1 before it, constant behind it, linear between, the value in
/// front at a step.
pub fn evaluate<'a>(f: impl Into<FunctionRef<'a>>, z: f32) -> f64 {
    let f = f.into();
    let depths = f.depths();
    let value = |i: usize| f.value(i, 0);
    match depths.iter().position(|&d| d >= z) {
        Some(0) => 1.0,
        None => depths.len().checked_sub(1).map_or(1.0, value),
        Some(i) => {
            let (z0, z1) = (f64::from(depths[i - 1]), f64::from(depths[i]));
            value(i - 1) + (value(i) - value(i - 1)) * (f64::from(z) - z0) / (z1 - z0)
        }
    }
}

/// All levels of a map, decoded.
#[derive(Debug)]
pub struct Levels {
    /// Width and height of each level.
    pub sizes: Vec<(u32, u32)>,
    /// Promise of each level.
    pub errors: Vec<f64>,
    tiles: Vec<Vec<Tile>>,
    tile_size: u32,
}

impl Levels {
    /// Decodes the first map of a file.
    pub fn of(file: &DsmFile) -> Self {
        let info = &file.maps()[0];
        let mut tiles = Vec::new();
        for (l, level) in info.levels.iter().enumerate() {
            let mut all = Vec::new();
            for ty in 0..level.shape.tiles_y() {
                for tx in 0..level.shape.tiles_x() {
                    all.push(
                        file.tile(MapId(0).level(l as u32), TileId::new(tx, ty))
                            .expect("our own file"),
                    );
                }
            }
            tiles.push(all);
        }
        Levels {
            sizes: (info.levels.iter())
                .map(|l| (l.shape.width, l.shape.height))
                .collect(),
            errors: info.levels.iter().map(|l| l.max_error).collect(),
            tiles,
            tile_size: info.header.tile_size,
        }
    }

    /// Bytes of the decoded tiles of one level.
    pub fn bytes(&self, level: usize) -> usize {
        self.tiles[level].iter().map(Tile::bytes).sum()
    }

    /// Tiles of one level.
    pub fn tile_count(&self, level: usize) -> usize {
        self.tiles[level].len()
    }

    /// The stored function of a pixel.
    pub fn function(&self, level: usize, x: u32, y: u32) -> FunctionRef<'_> {
        let (t, side) = (&self.tiles[level], self.tile_size);
        let tile = &t[(y / side * self.sizes[level].0.div_ceil(side) + x / side) as usize];
        tile.function((y % side * tile.width() + x % side) as usize)
    }

    /// What the stored functions of the levels give for a lookup.
    pub fn stored(&self, lookup: Lookup, width: f32, (x, y, z): (f32, f32, f32)) -> f64 {
        let taps = taps(lookup, width, &self.sizes, x, y);
        let value = |&(l, i, j, w): &Tap| w * evaluate(self.function(l, i, j), z);
        taps.iter().map(value).sum()
    }

    /// What the functions of the base level give, pixels of higher levels being exact averages of
    /// those that they cover.
    pub fn exact(&self, lookup: Lookup, width: f32, (x, y, z): (f32, f32, f32)) -> f64 {
        let (w, h) = self.sizes[0];
        let average = |level: usize, i: u32, j: u32| -> f64 {
            let (rows, columns) = (
                j << level..((j + 1) << level).min(h),
                i << level..((i + 1) << level).min(w),
            );
            let (mut sum, mut n) = (0.0, 0.0);
            for y in rows {
                for x in columns.clone() {
                    sum += evaluate(self.function(0, x, y), z);
                    n += 1.0;
                }
            }
            sum / n
        };
        let taps = taps(lookup, width, &self.sizes, x, y);
        taps.iter().map(|&(l, i, j, w)| w * average(l, i, j)).sum()
    }

    /// The most that a lookup of `width` may be off what [`Levels::exact`] says.
    pub fn bound(&self, lookup: Lookup, width: f32) -> f64 {
        let (fine, coarse, blend) = match lookup {
            Lookup::Bilinear | Lookup::Trilinear => levels_of(width, self.sizes.len()),
            _ => (0, 0, 0.0),
        };
        // The base level is its own reference.
        let error = |level: usize| if level == 0 { 0.0 } else { self.errors[level] };
        error(fine) * (1.0 - blend) + error(coarse) * blend + 2f64.powi(-20)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deepshadow::Visibility;

    #[test]
    fn weights_add_up_to_one_also_at_the_border() {
        let sizes = [(5, 7), (3, 4), (2, 2), (1, 1)];
        for lookup in Lookup::ALL {
            for (x, y) in [(0.0, 0.0), (2.5, 3.5), (4.9, 6.9)] {
                let taps = taps(lookup, lookup.width(), &sizes, x, y);
                assert!((taps.iter().map(|t| t.3).sum::<f64>() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_surface_does_not_shadow_itself() {
        let f = Visibility::from_planes(vec![2.0, 4.0, 4.0], vec![vec![1.0, 0.5, 0.0]]).unwrap();
        let at = |z| evaluate(&f, z);
        assert_eq!(
            (at(1.0), at(2.0), at(3.0), at(4.0), at(5.0)),
            (1.0, 1.0, 0.75, 0.5, 0.0)
        );
    }
}
