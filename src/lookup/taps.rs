//! Wide and elongated kernels, evaluated row by row; and the list of pixels that a lookup reads.

use std::collections::BTreeMap;

use super::descriptor::Window;
use super::grid::side_of;
use super::kernel::Native;
use super::plan::FootprintPlan;
use super::query::{Border, Query};
use super::sampler::{Sampler, blended, check, narrow};
use crate::{Filter, Result};

/// One pixel that a lookup reads, and its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tap {
    /// The pixel's level.
    pub level: usize,
    /// Column of the pixel in its level.
    pub x: u32,
    /// Row of the pixel in its level.
    pub y: u32,
    /// The pixel's weight in the answer; it may be negative with [`Filter::CatmullRom`].
    pub weight: f64,
}

impl Sampler {
    /// Least and greatest depth of a vertex in the pixels under the footprint; `None` if they have
    /// no vertices. The query's depth and bias do not matter.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn depth_range(&mut self, query: &Query) -> Result<Option<[f32; 2]>> {
        check(query)?;
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for tap in self.taps(query)? {
            let place = [tap.x as i32, tap.y as i32];
            let (tile, at) = (self.grids[tap.level].tile_of::<1>(place)).expect("a pixel inside");
            let own = self.keep(tap.level, tile)?.descriptor().depth_range(at);
            if let Some(own) = own {
                range = [range[0].min(own[0]), range[1].max(own[1])];
            }
        }
        Ok((range[0] <= range[1]).then_some(range))
    }

    /// The pixels that a query reads, with the weights that the lookup uses.
    ///
    /// Each pixel of a level is listed once. The weights and that of the area outside the map add
    /// up to 1, up to rounding. Pixels of weight 0 are left out. The query's depth and bias do not
    /// matter.
    ///
    /// # Errors
    /// `Input`, as [`Sampler::visibility`].
    pub fn taps(&mut self, query: &Query) -> Result<Vec<Tap>> {
        check(query)?;
        let mut out = Vec::new();
        let plan = self.plan(&query.footprint);
        for (level, share) in plan.levels() {
            // A clamped border repeats its pixels.
            let mut pixels = BTreeMap::new();
            let mut add = |x: i32, y: i32, weight: f64| {
                if weight != 0.0 {
                    *pixels.entry((y as u32, x as u32)).or_insert(0.0) += weight;
                }
            };
            let total = if self.has_window(&plan) {
                match side_of(self.options().filter) {
                    1 => self.each_window_pixel::<1>(level, query, add),
                    2 => self.each_window_pixel::<2>(level, query, add),
                    _ => self.each_window_pixel::<4>(level, query, add),
                }
                1.0
            } else {
                let mut inside = 0.0;
                let outside = self.each_row(&plan, level, query, |_, y, x0, weights, row| {
                    for (weight, x) in weights.iter().zip(x0..) {
                        let weight = f64::from(*weight) * f64::from(row);
                        inside += weight;
                        add(x, y, weight);
                    }
                    Ok(())
                })?;
                inside + outside
            };
            out.extend(pixels.into_iter().map(|((y, x), weight)| Tap {
                level,
                x,
                y,
                weight: weight * (share / total),
            }));
        }
        Ok(out)
    }

    /// Whether the kernel is a window of fixed size in each of its levels.
    fn has_window(&self, plan: &FootprintPlan) -> bool {
        plan.is_unit() || self.options().filter == Filter::Nearest
    }

    /// Calls `f` with x, y and weight of each pixel of the query's window that is inside the map.
    fn each_window_pixel<const N: usize>(
        &self,
        level: usize,
        query: &Query,
        mut f: impl FnMut(i32, i32, f64),
    ) {
        let grid = &self.grids[level];
        let ([x0, y0], window) = grid.window::<N>(query.x, query.y);
        let clamp = self.options().border == Border::Clamp;
        for (y, wy) in (y0..).zip(window.rows) {
            for (x, wx) in (x0..).zip(window.columns) {
                let inner = [x.clamp(0, grid.width - 1), y.clamp(0, grid.height - 1)];
                if clamp || inner == [x, y] {
                    f(inner[0], inner[1], wx * wy);
                }
            }
        }
    }

    /// A lookup with a kernel of any size and direction, or a query that is not finite.
    #[inline(never)]
    pub(super) fn wide<const C: usize>(&mut self, query: &Query) -> Result<[f32; C]> {
        check(query)?;
        let plan = self.plan(&query.footprint);
        if self.has_window(&plan) {
            let (x, y, depth) = (query.x, query.y, query.depth - query.bias);
            let (level, blend) = (plan.level, plan.blend);
            return self.windows(level, blend, x, y, depth);
        }
        let fine = self.wide_level(&plan, plan.level, query)?;
        if plan.blend == 0.0 {
            return Ok(narrow(fine));
        }
        let coarse = self.wide_level(&plan, plan.level + 1, query)?;
        Ok(narrow(blended(fine, coarse, plan.blend)))
    }

    /// The weighted mean under a kernel in one level, row by row.
    fn wide_level<const C: usize>(
        &mut self,
        plan: &FootprintPlan,
        level: usize,
        query: &Query,
    ) -> Result<[f64; C]> {
        let depth = query.depth - query.bias;
        let (mut sum, mut inside) = ([0.0; C], 0.0);
        let outside = self.each_row(plan, level, query, |sampler, y, x, weights, row| {
            for (&weight, x) in weights.iter().zip(x..) {
                let weight = f64::from(weight) * f64::from(row);
                if weight != 0.0 {
                    let one = Window::<1>::pixel();
                    let value =
                        sampler.window(level, [x, y], one, depth, &mut { Native::PORTABLE })?;
                    for (sum, value) in sum.iter_mut().zip::<[f64; C]>(value) {
                        *sum += weight * value;
                    }
                    inside += weight;
                }
            }
            Ok(())
        })?;
        Ok(sum.map(|sum| (sum + outside) / (inside + outside)))
    }

    /// Calls `f` with each row of pixels of the map under a kernel: y, first x, the weights, and
    /// the row's factor for all of them. Returns the sum of the weights outside the map, where
    /// visibility is 1; it is 0 with a clamped border.
    fn each_row(
        &mut self,
        plan: &FootprintPlan,
        level: usize,
        query: &Query,
        mut f: impl FnMut(&mut Self, i32, i32, &[f32], f32) -> Result<()>,
    ) -> Result<f64> {
        let (width, height) = (self.grids[level].width, self.grids[level].height);
        let kernel = plan.kernel(self.options().filter, width.max(height));
        let reach = kernel.reach();
        let scale = self.grids[level].scale;
        // All places beyond the kernel's reach give the same answer.
        let c = [(query.x, width, 0), (query.y, height, 1)].map(|(c, side, k)| {
            let far = reach[k] + 8.0;
            (c * scale).clamp(-far, side as f32 + far)
        });
        let ends = |k: usize| {
            let (low, high) = (c[k] - reach[k] - 0.5, c[k] + reach[k] - 0.5);
            [low.ceil() as i32, high.floor() as i32]
        };
        let ([x0, x1], [y0, y1]) = (ends(0), ends(1));
        let lit = self.options().border == Border::Lit;
        let (first, last) = if lit {
            (x0.max(0), x1.min(width - 1))
        } else {
            (x0.clamp(0, width - 1), x1.clamp(0, width - 1))
        };
        let distance = |i: i32, k: usize| i as f32 + 0.5 - c[k];
        let mut weights = std::mem::take(&mut self.weights);
        let (mut outside, mut within, mut beside) = (0.0, 0.0, 0.0);
        let mut result = Ok(());
        for y in y0..=y1 {
            if y == y0 || !kernel.is_separable() {
                weights.clear();
                weights.resize((last - first + 1).max(0) as usize, 0.0);
                (within, beside) = (0.0, 0.0);
                for x in x0..=x1 {
                    let weight = if kernel.is_separable() {
                        kernel.along(0, distance(x, 0))
                    } else {
                        kernel.weight([distance(x, 0), distance(y, 1)])
                    };
                    if !lit || (first..=last).contains(&x) {
                        weights[(x.clamp(first, last) - first) as usize] += weight;
                        within += f64::from(weight);
                    } else {
                        beside += f64::from(weight);
                    }
                }
            }
            let row = if kernel.is_separable() {
                kernel.along(1, distance(y, 1))
            } else {
                1.0
            };
            outside += f64::from(row) * beside;
            if lit && !(0..height).contains(&y) {
                outside += f64::from(row) * within;
            } else if row != 0.0 {
                result = f(self, y.clamp(0, height - 1), first, &weights, row);
            }
            if result.is_err() {
                break;
            }
        }
        self.weights = weights;
        result?;
        Ok(outside)
    }
}
