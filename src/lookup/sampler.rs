//! The sampler: footprints to levels, levels to pixels, pixels to an answer.

use std::collections::BTreeMap;

use super::footprint::{Plan, plan};
use super::pins::{Pins, TileKey};
use super::pixel::{self, Cursor, Hint, Search};
use super::planes::{Found, Planes};
use super::query::{Border, Footprint, OnError, Query, SamplerOptions};
use crate::cache::{CachedFile, Content, Held};
use crate::{Error, Filter, Result};

/// Answers filtered lookups in one map (LV00, sections 3.4 and 5.3). One for each thread: it is `Send`, and holds a few tiles.
///
/// A lookup averages the visibility functions of the pixels around a point, weighted by the filter, at one depth. The footprint's width
/// chooses the levels, so that a wide filter costs as much as a narrow one. The answer depends on the stored vertices, the
/// options and the query alone: not on the cache, the codec, other lookups or threads, nor on whether it is asked singly, with a cursor or in a batch.
///
/// After the first lookups of each kind nothing is allocated, but for tiles that are loaded.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// # let mut bytes = Vec::new();
/// # let mut writer = Writer::new(&mut bytes)?;
/// # let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
/// # writer.pixel(map, 2, 1, &Curve::mono(vec![5.0], vec![0.25])?)?; // a sheet of glass
/// # writer.finish()?;
/// # let file = DsmFile::from_bytes(bytes)?;
/// let light = TileCache::new(64 << 20).add(file);
/// let mut sampler = Sampler::new(&light, 0)?;
/// // Pixel (2, 1) lets a quarter of the light through, its neighbours all of it.
/// assert_eq!(sampler.visibility(&Query::new(2.5, 1.5, 6.0))?, 0.25);
/// assert_eq!(sampler.visibility(&Query::new(3.0, 1.5, 6.0))?, 0.625); // half way to the next pixel
/// assert_eq!(sampler.visibility(&Query::new(2.5, 1.5, 5.0))?, 1.0); // the glass does not shadow itself
/// assert_eq!(sampler.visibility(&Query::new(3.0, 1.0, 6.0).width(2.0))?, 0.8125); // the mean of four pixels: one of level 1
/// # Ok(()) }
/// ```
pub struct Sampler {
    file: CachedFile,
    map: usize,
    options: SamplerOptions,
    levels: Box<[Level]>,
    pins: Pins,
    /// Weights of a row, and the positions of its pixels: of footprints that are no block.
    weights: Vec<f32>,
    replaced: u64,
    /// Binary logarithm of a tile's side.
    shift: u32,
}

/// Where a pixel is: its tile, and its place in the tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Address {
    pub tile: TileKey,
    pub at: usize,
}

/// Pixels in a row of the block that a kernel of one pixel's width looks at.
pub(super) fn side_of(filter: Filter) -> u32 {
    match filter {
        Filter::Nearest => 1,
        Filter::Box | Filter::Triangle => 2,
        Filter::Gaussian | Filter::CatmullRom => 4,
    }
}

/// What a lookup needs to know of a level.
#[derive(Clone)]
pub(super) struct Level {
    width: i32,
    height: i32,
    /// A block lies inside the level if its first pixel is before this.
    inside: [u32; 2],
    /// Beyond this, and beyond -8, all places are alike.
    far: [f32; 2],
    /// Pixels of this level in one of level 0.
    scale: f32,
    tiles_x: u32,
    hits: u64,
}

/// One pixel that a lookup looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visit {
    /// Its level.
    pub level: usize,
    /// Its place in the level.
    pub x: u32,
    /// Its place in the level.
    pub y: u32,
    /// Its share of the answer.
    pub weight: f64,
}

impl Sampler {
    /// Lookups in map number `map` of a file, with the default options.
    ///
    /// # Errors
    /// `Input` if there is no such map.
    pub fn new(file: &CachedFile, map: usize) -> Result<Self> {
        Self::with_options(file, map, SamplerOptions::default())
    }

    /// Lookups with these options.
    ///
    /// # Errors
    /// `Input` if there is no such map, or an option is outside its domain.
    pub fn with_options(file: &CachedFile, map: usize, options: SamplerOptions) -> Result<Self> {
        file.file().level(map, 0)?;
        if !(1.0..=64.0).contains(&options.anisotropy) {
            return Err(Error::input(format!(
                "an anisotropy of {}; 1 to 64 are possible",
                options.anisotropy
            )));
        }
        let levels = file.file().maps()[map].levels.iter().enumerate();
        file.cache().enter();
        Ok(Sampler {
            file: file.clone(),
            map,
            options,
            levels: levels
                .map(|(l, info)| Level {
                    width: info.shape.width as i32,
                    height: info.shape.height as i32,
                    inside: [info.shape.width, info.shape.height]
                        .map(|side| (side + 1).saturating_sub(side_of(options.filter))),
                    far: [
                        info.shape.width as f32 + 8.0,
                        info.shape.height as f32 + 8.0,
                    ],
                    scale: 0.5f32.powi(l as i32),
                    tiles_x: info.shape.tiles_x(),
                    hits: 0,
                })
                .collect(),
            pins: Pins::new(),
            weights: Vec::new(),
            replaced: 0,
            shift: file.file().maps()[map].header.tile_size.trailing_zeros(),
        })
    }

    /// The file.
    pub fn file(&self) -> &CachedFile {
        &self.file
    }

    /// Index of the map in its file.
    pub fn map(&self) -> usize {
        self.map
    }

    /// How it answers.
    pub fn options(&self) -> &SamplerOptions {
        &self.options
    }

    /// Fraction of light, 0 to 1, that reaches the query's depth; of a coloured map its red channel.
    ///
    /// Outside the map as [`Border`] says. Cost: one search for each pixel under the kernel, at most 2 x 2 or 4 x 4 in each of two levels.
    ///
    /// # Errors
    /// `Input` for coordinates or footprints that are not finite, or a depth that is no number; what [`DsmFile::tile`](crate::DsmFile::tile) says of
    /// a tile that cannot be had, unless [`OnError`] says otherwise.
    #[inline(always)]
    pub fn visibility(&mut self, query: &Query) -> Result<f32> {
        self.narrow_answer(query, &mut Search)
    }

    /// [`Sampler::visibility`] for red, green and blue.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    #[inline]
    pub fn visibility_rgb(&mut self, query: &Query) -> Result<[f32; 3]> {
        check(query)?;
        self.filtered::<3>(query, &mut Search)
            .map(|v| v.map(narrow))
    }

    /// [`Sampler::visibility`] with a cursor that the caller keeps for lookups near this one. The answer is the same.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    #[inline(always)]
    pub fn visibility_with(&mut self, cursor: &mut Cursor, query: &Query) -> Result<f32> {
        self.narrow_answer(query, cursor)
    }

    /// [`Sampler::visibility`] for callers that cannot take an error: where the query is not finite, and where a tile cannot be had and the
    /// options do not say what it counts as, the answer is 1, lit.
    #[inline]
    pub fn visibility_or_lit(&mut self, query: &Query) -> f32 {
        self.visibility(query).unwrap_or(1.0)
    }

    /// One minus the visibility behind everything.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn opacity(&mut self, query: &Query) -> Result<f32> {
        let behind = Query {
            depth: f32::INFINITY,
            bias: 0.0,
            ..*query
        };
        Ok(1.0 - self.visibility(&behind)?)
    }

    /// The first depth behind which visibility is below `t`; `None` if it is nowhere. The query's depth and bias do not matter.
    ///
    /// At a step, the depth of the step. Found by bisection over all floats, 32 lookups. With `CatmullRom`, whose sums may rise,
    /// it is one of the depths where visibility falls below `t`.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn depth_below(&mut self, query: &Query, t: f32) -> Result<Option<f32>> {
        let mut below = |depth: f32| -> Result<bool> {
            let at = Query {
                depth,
                bias: 0.0,
                ..*query
            };
            Ok(self.visibility(&at)? < t)
        };
        if !below(f32::INFINITY)? {
            return Ok(None);
        }
        // The greatest depth that is not below: just behind it, light is.
        let (mut lit, mut dark) = (
            crate::function::ordered_bits(f32::MIN),
            crate::function::ordered_bits(f32::INFINITY),
        );
        while dark - lit > 1 {
            let middle = lit + (dark - lit) / 2;
            if below(crate::function::from_ordered_bits(middle))? {
                dark = middle;
            } else {
                lit = middle;
            }
        }
        Ok(Some(crate::function::from_ordered_bits(lit)))
    }

    /// Least and greatest depth of a vertex of the pixels under the footprint; `None` if there is none. The query's depth and bias do
    /// not matter.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn depth_range(&mut self, query: &Query) -> Result<Option<[f32; 2]>> {
        check(query)?;
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for visit in self.visits(query)? {
            let own = &self.levels[visit.level];
            let address = own.address(visit.level, [visit.x as i32, visit.y as i32], self.shift);
            let own = self.with_tile(visit.level, &address, |tile| {
                pixel::depth_range(tile, address.at)
            });
            if let Some(own) = own.or_else(|e| self.replace(e).map(|_| None))? {
                range = [range[0].min(own[0]), range[1].max(own[1])];
            }
        }
        Ok((range[0] <= range[1]).then_some(range))
    }

    /// The pixels that a query looks at, with their weights, which add up to 1 with that of the outside; for people who want to know.
    ///
    /// # Errors
    /// `Input`, as [`Sampler::visibility`].
    pub fn visits(&mut self, query: &Query) -> Result<Vec<Visit>> {
        check(query)?;
        let mut out: Vec<Visit> = Vec::new();
        let plan = self.plan(&query.footprint);
        for (level, share) in plan.levels() {
            let mut pixels = BTreeMap::new();
            let mut inside = 0.0;
            let outside = self.each_row(&plan, level, query, |_, y, x0, weights, row| {
                for (weight, x) in weights.iter().zip(x0..) {
                    let weight = f64::from(*weight) * f64::from(row);
                    if weight != 0.0 {
                        // With a clamped border, a pixel may come again.
                        *pixels.entry((y as u32, x as u32)).or_insert(0.0) += weight;
                        inside += weight;
                    }
                }
                Ok(())
            })?;
            let part = share / (inside + outside);
            out.extend(pixels.into_iter().map(|((y, x), weight)| Visit {
                level,
                x,
                y,
                weight: weight * part,
            }));
        }
        Ok(out)
    }

    /// Tiles that counted as lit or dark because they could not be had.
    pub fn replaced_tiles(&self) -> u64 {
        self.replaced
    }

    /// Lets go of all tiles, and reports the hits that were counted.
    pub fn release(&mut self) {
        self.report();
        self.pins.clear();
    }

    fn report(&mut self) {
        for (l, level) in self.levels.iter_mut().enumerate() {
            let hits = std::mem::take(&mut level.hits);
            if hits > 0 {
                self.file.counters(self.map, l).add_hits(hits);
            }
        }
    }

    pub(super) fn plan(&self, footprint: &Footprint) -> Plan {
        plan(footprint, &self.options, self.levels.len())
    }

    // The numbers of the usual query go on in registers: a query in memory, written by halves and read as a whole, would keep the
    // processor from beginning a lookup before the one before it has ended.
    #[inline(always)]
    fn narrow_answer(&mut self, query: &Query, hint: &mut impl Hint) -> Result<f32> {
        let Query {
            x, y, depth, bias, ..
        } = *query;
        match query.footprint {
            Footprint::Width(width) => match self.options.filter {
                Filter::Nearest => self.short_way::<1>(x, y, width, depth, bias, hint),
                Filter::Box | Filter::Triangle => {
                    self.short_way::<2>(x, y, width, depth, bias, hint)
                }
                _ => self.short_way::<4>(x, y, width, depth, bias, hint),
            },
            Footprint::Ellipse { .. } => self.long_way(query, hint),
        }
    }

    /// The usual lookups of one channel: a block of pixels of one tile, which is pinned, in one level or two. All else takes
    /// the long way.
    #[inline(never)]
    fn short_way<const N: usize>(
        &mut self,
        x: f32,
        y: f32,
        width: f32,
        depth: f32,
        bias: f32,
        hint: &mut impl Hint,
    ) -> Result<f32> {
        // A difference of a finite number with itself is 0, of any other it is no number.
        let z = depth - bias;
        if (x - x) + (y - y) == 0.0 && !z.is_nan() {
            if (0.0..=1.0).contains(&width) {
                if let Some(found) = self.find::<N>(0, x, y) {
                    let value = found.value(z, hint);
                    self.levels[0].hits += 1;
                    return Ok(narrow(value));
                }
            } else if width > 1.0 && width < Footprint::LONGEST {
                let plan = self.plan(&Footprint::Width(width));
                let (level, t) = (plan.level, plan.blend);
                if plan.is_unit()
                    && let Some(fine) = self.find::<N>(level, x, y)
                {
                    if t == 0.0 {
                        let value = fine.value(z, hint);
                        self.levels[level].hits += 1;
                        return Ok(narrow(value));
                    }
                    if let Some(coarse) = self.find::<N>(level + 1, x, y) {
                        let (fine, coarse) = (fine.value(z, hint), coarse.value(z, &mut Search));
                        self.levels[level].hits += 1;
                        self.levels[level + 1].hits += 1;
                        return Ok(narrow(blend([fine], [coarse], t)[0]));
                    }
                }
            }
        }
        let query = Query {
            x,
            y,
            depth,
            bias,
            footprint: Footprint::Width(width),
        };
        self.long_way(&query, hint)
    }

    /// The block of pixels of a lookup in one level, if its tile is one and pinned. Its memory is on its way when this returns.
    #[inline(always)]
    pub(super) fn find<const N: usize>(
        &self,
        level: usize,
        x: f32,
        y: f32,
    ) -> Option<Found<'_, N>> {
        let own = &self.levels[level];
        let (origin, wx, wy) = own.block::<N>(self.options.filter, x, y);
        if !own.holds::<N>(origin, self.shift) {
            return None;
        }
        let planes = self.pins.get(&own.tile(level, origin, self.shift))?;
        let at = planes.place(origin, self.shift);
        Some(Found::new(planes, at, wx, wy))
    }

    /// Sends for what [`Sampler::find`] will read.
    #[inline(always)]
    pub(super) fn send_for_table<const N: usize>(&self, level: usize, x: f32, y: f32) {
        let own = &self.levels[level];
        let origin = own.block::<N>(self.options.filter, x, y).0;
        if own.holds::<N>(origin, self.shift)
            && let Some(planes) = self.pins.get(&own.tile(level, origin, self.shift))
        {
            planes.send_for_table(planes.place(origin, self.shift));
        }
    }

    /// Counts a hit.
    #[inline(always)]
    pub(super) fn count(&mut self, level: usize) {
        self.levels[level].hits += 1;
    }

    #[inline(never)]
    fn long_way(&mut self, query: &Query, hint: &mut impl Hint) -> Result<f32> {
        check(query)?;
        self.filtered::<1>(query, hint).map(|v| narrow(v[0]))
    }

    fn filtered<const C: usize>(
        &mut self,
        query: &Query,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        let plan = self.plan(&query.footprint);
        if !plan.is_unit() {
            return self.blended(&plan, query);
        }
        if plan.blend == 0.0 {
            return self.unit_value(plan.level, query, hint);
        }
        let first = self.unit_value(plan.level, query, hint)?;
        // The second level has no hints: they belong to the first.
        let second = self.unit_value(plan.level + 1, query, &mut Search)?;
        Ok(blend(first, second, plan.blend))
    }

    /// Both levels of a kernel that is no block.
    fn blended<const C: usize>(&mut self, plan: &Plan, query: &Query) -> Result<[f64; C]> {
        let first = self.wide(plan, plan.level, query)?;
        if plan.blend == 0.0 {
            return Ok(first);
        }
        let second = self.wide(plan, plan.level + 1, query)?;
        Ok(blend(first, second, plan.blend))
    }

    /// The value in one level of a kernel of one pixel's width.
    #[inline(always)]
    fn unit_value<const C: usize>(
        &mut self,
        level: usize,
        query: &Query,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        match self.options.filter {
            Filter::Nearest => self.unit::<C, 1>(level, query, hint),
            Filter::Box | Filter::Triangle => self.unit::<C, 2>(level, query, hint),
            Filter::Gaussian | Filter::CatmullRom => self.unit::<C, 4>(level, query, hint),
        }
    }

    /// Calls `f` with a tile: a pinned one, or as it passes.
    pub(super) fn with_tile<R>(
        &mut self,
        level: usize,
        address: &Address,
        f: impl FnOnce(&Content) -> R,
    ) -> Result<R> {
        if let Some(content) = self.pins.content(&address.tile) {
            self.levels[level].hits += 1;
            return Ok(f(content));
        }
        let held = self.hold(level, address)?;
        Ok(f(held.content()))
    }

    /// A tile that is not pinned; pinned, if it was wanted before.
    #[inline(never)]
    pub(super) fn hold(&mut self, level: usize, address: &Address) -> Result<Held> {
        let [tx, ty] = address.tile.place();
        let index = ty * u64::from(self.levels[level].tiles_x) + tx;
        let held = self.file.hold(self.map, level, index)?;
        let loaded = matches!(held, Held::Loaded(_));
        if loaded {
            self.report();
        } else {
            self.levels[level].hits += 1;
        }
        if self.pins.wants(&address.tile) || loaded {
            self.pins
                .set(&address.tile, held.pin(), self.file.cache().share());
        }
        Ok(held)
    }

    /// What a tile that cannot be had counts as.
    #[cold]
    pub(super) fn replace(&mut self, e: Error) -> Result<f64> {
        let value = match self.options.on_error {
            OnError::Lit => 1.0,
            OnError::Dark => 0.0,
            OnError::Fail => return Err(e),
        };
        self.replaced += 1;
        Ok(value)
    }

    /// A kernel of one pixel's width, which looks at `N` x `N` pixels.
    #[inline(never)]
    fn unit<const C: usize, const N: usize>(
        &mut self,
        level: usize,
        query: &Query,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        let own = &self.levels[level];
        let (origin, wx, wy) = own.block::<N>(self.options.filter, query.x, query.y);
        let depth = query.depth - query.bias;
        if !own.holds::<N>(origin, self.shift) {
            return self.unit_across(level, origin, (&wx, &wy), depth);
        }
        let address = own.address(level, origin, self.shift);
        self.block(level, &address, (&wx, &wy), depth, hint)
    }

    /// The weighted sum over a block of pixels of one tile, which need not be pinned.
    fn block<const C: usize, const N: usize>(
        &mut self,
        level: usize,
        address: &Address,
        (wx, wy): (&[f64; N], &[f64; N]),
        depth: f32,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        let found = if C == 1 {
            self.with_planes(level, address, |planes| {
                [Found::new(planes, address.at, *wx, *wy).value(depth, hint); C]
            })
        } else {
            self.with_tile(level, address, |tile| {
                pixel::block::<C, N>(tile, address.at, (wx, wy), depth)
            })
        };
        found.or_else(|e| self.replace(e).map(|value| [value; C]))
    }

    /// Calls `f` with the planes of a tile: a pinned one, or as it passes.
    #[inline(always)]
    pub(super) fn with_planes<R>(
        &mut self,
        level: usize,
        address: &Address,
        f: impl FnOnce(&Planes<'_>) -> R,
    ) -> Result<R> {
        if let Some(planes) = self.pins.get(&address.tile) {
            self.levels[level].hits += 1;
            return Ok(f(planes));
        }
        let held = self.hold(level, address)?;
        Ok(f(&Planes::of(held.content())))
    }

    /// The same across tiles or the border, pixel by pixel.
    #[inline(never)]
    fn unit_across<const C: usize, const N: usize>(
        &mut self,
        level: usize,
        [x, y]: [i32; 2],
        (wx, wy): (&[f64; N], &[f64; N]),
        depth: f32,
    ) -> Result<[f64; C]> {
        let mut total = [0.0; C];
        for (wy, y) in wy.iter().zip(y..) {
            for (wx, x) in wx.iter().zip(x..) {
                let value = self.pixel::<C>(level, x, y, depth)?;
                let weight = wx * wy;
                for (total, value) in total.iter_mut().zip(value) {
                    *total += weight * value;
                }
            }
        }
        Ok(total)
    }

    /// The value of a pixel, which may be outside the map.
    fn pixel<const C: usize>(
        &mut self,
        level: usize,
        mut x: i32,
        mut y: i32,
        depth: f32,
    ) -> Result<[f64; C]> {
        let own = &self.levels[level];
        if x < 0 || y < 0 || x >= own.width || y >= own.height {
            if self.options.border == Border::Lit {
                return Ok([1.0; C]);
            }
            (x, y) = (x.clamp(0, own.width - 1), y.clamp(0, own.height - 1));
        }
        let address = self.levels[level].address(level, [x, y], self.shift);
        self.block(level, &address, (&[1.0], &[1.0]), depth, &mut Search)
    }

    /// A kernel of any size and direction, row by row.
    #[inline(never)]
    fn wide<const C: usize>(
        &mut self,
        plan: &Plan,
        level: usize,
        query: &Query,
    ) -> Result<[f64; C]> {
        let depth = query.depth - query.bias;
        let (mut sum, mut inside) = ([0.0; C], 0.0);
        let outside = self.each_row(plan, level, query, |sampler, y, x, weights, row| {
            for (i, &weight) in weights.iter().enumerate() {
                let weight = f64::from(weight) * f64::from(row);
                if weight != 0.0 {
                    let value = sampler.pixel::<C>(level, x + i as i32, y, depth)?;
                    for (sum, value) in sum.iter_mut().zip(value) {
                        *sum += weight * value;
                    }
                    inside += weight;
                }
            }
            Ok(())
        })?;
        Ok(sum.map(|sum| (sum + outside) / (inside + outside)))
    }

    /// Calls `f` with every row of pixels of the map that a kernel touches: y, first x, weights, and what all of them are multiplied by.
    /// Returns the sum of the weights outside the map, where all is lit; with a clamped border there are none.
    fn each_row(
        &mut self,
        plan: &Plan,
        level: usize,
        query: &Query,
        mut f: impl FnMut(&mut Self, i32, i32, &[f32], f32) -> Result<()>,
    ) -> Result<f64> {
        let (width, height) = (self.levels[level].width, self.levels[level].height);
        let kernel = plan.kernel(self.options.filter, width.max(height));
        let reach = kernel.reach();
        let scale = self.levels[level].scale;
        // Beyond the reach all places are alike.
        let c = [(query.x, width, 0), (query.y, height, 1)].map(|(c, side, k)| {
            let far = reach[k] + 8.0;
            (c * scale).clamp(-far, side as f32 + far)
        });
        if self.options.filter == Filter::Nearest {
            return self.nearest_row(level, c, f);
        }
        let ends = |k: usize| {
            let (low, high) = (c[k] - reach[k] - 0.5, c[k] + reach[k] - 0.5);
            [low.ceil() as i32, high.floor() as i32]
        };
        let ([x0, x1], [y0, y1]) = (ends(0), ends(1));
        let lit = self.options.border == Border::Lit;
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

    /// [`Sampler::each_row`] without a filter.
    fn nearest_row(
        &mut self,
        level: usize,
        c: [f32; 2],
        mut f: impl FnMut(&mut Self, i32, i32, &[f32], f32) -> Result<()>,
    ) -> Result<f64> {
        let [x, y] = c.map(|c| c.floor() as i32);
        let (width, height) = (self.levels[level].width, self.levels[level].height);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        if !inside && self.options.border == Border::Lit {
            return Ok(1.0);
        }
        let (x, y) = (x.clamp(0, width - 1), y.clamp(0, height - 1));
        f(self, y, x, &[1.0], 1.0)?;
        Ok(0.0)
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        self.report();
        self.file.cache().leave();
    }
}

impl std::fmt::Debug for Sampler {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sampler")
            .field("map", &self.map)
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

impl Level {
    /// First pixel of the block of a kernel of one pixel's width, and the weights of its columns and rows.
    #[inline(always)]
    pub fn block<const N: usize>(
        &self,
        filter: Filter,
        x: f32,
        y: f32,
    ) -> ([i32; 2], [f64; N], [f64; N]) {
        let (x, wx) = self.axis(filter, x, self.far[0]);
        let (y, wy) = self.axis(filter, y, self.far[1]);
        ([x, y], wx, wy)
    }

    /// Whether the block of `N` x `N` pixels from (x, y) on lies in one tile.
    #[inline(always)]
    pub fn holds<const N: usize>(&self, [x, y]: [i32; 2], shift: u32) -> bool {
        let last = N as i32 - 1;
        // As unsigned numbers, what is negative is large.
        (x as u32) < self.inside[0]
            && (y as u32) < self.inside[1]
            && (N == 1 || ((x ^ (x + last)) | (y ^ (y + last))) >> shift == 0)
    }

    /// The tile of pixel (x, y), which must be one of the level.
    #[inline(always)]
    pub fn tile(&self, level: usize, [x, y]: [i32; 2], shift: u32) -> TileKey {
        TileKey::new(level, [x as u32 >> shift, y as u32 >> shift])
    }

    /// Where pixel (x, y) is, which must be one of the level: its tile, and its place in the tile.
    #[inline(always)]
    pub fn address(&self, level: usize, [x, y]: [i32; 2], shift: u32) -> Address {
        let mask = (1u32 << shift) - 1;
        let stride = (1 << shift).min(self.width as u32 - (x as u32 & !mask));
        Address {
            tile: self.tile(level, [x, y], shift),
            at: ((y as u32 & mask) * stride + (x as u32 & mask)) as usize,
        }
    }

    #[inline(always)]
    fn axis<const N: usize>(&self, filter: Filter, c: f32, far: f32) -> (i32, [f64; N]) {
        let c = c * self.scale;
        // In this form each is one instruction, and what is no number becomes -8.
        let c = if c > -8.0 { c } else { -8.0 };
        let c = if c < far { c } else { far };
        if N == 1 {
            return (floor(c), [1.0; N]);
        }
        // The pixel whose centre is at or before the point, and how far the point is behind it; exact.
        let before = floor(c - 0.5);
        let f = c - 0.5 - before as f32;
        if N == 2 {
            let f = f64::from(f);
            return (before, std::array::from_fn(|i| [1.0 - f, f][i % 2]));
        }
        let weights = match filter {
            Filter::CatmullRom => catmull_rom(f),
            _ => gaussian(f),
        };
        (before - 1, std::array::from_fn(|i| weights[i % 4]))
    }
}

/// Whether a query is one that can be answered.
#[expect(clippy::eq_op, reason = "what is no number differs from itself")]
#[inline(always)]
pub(super) fn check(query: &Query) -> Result<()> {
    // A difference of a finite number with itself is 0, of any other it is no number.
    let place = (query.x - query.x) + (query.y - query.y);
    let depth = query.depth - query.bias;
    let sound = place == 0.0
        && depth == depth
        && match &query.footprint {
            Footprint::Width(w) => *w >= 0.0 && *w < f32::INFINITY,
            Footprint::Ellipse { dx, dy } => {
                dx.iter().chain(dy).all(|v| v.abs() < Footprint::LONGEST)
            }
        };
    if sound { Ok(()) } else { Err(unsound(query)) }
}

#[cold]
fn unsound(query: &Query) -> Error {
    Error::input(format!("a lookup that is not finite: {query:?}"))
}

/// An answer: nearest f32, inside 0 to 1 whatever lobes and rounding do.
#[inline(always)]
pub(super) fn narrow(v: f64) -> f32 {
    v.clamp(0.0, 1.0) as f32
}

/// A value of two levels.
#[inline(always)]
pub(super) fn blend<const C: usize>(fine: [f64; C], coarse: [f64; C], t: f64) -> [f64; C] {
    std::array::from_fn(|c| fine[c] + (coarse[c] - fine[c]) * t)
}

/// The integer below `v`, which lies between -8 and 2^21 or is made to; without the library call that older processors need.
#[inline(always)]
fn floor(v: f32) -> i32 {
    debug_assert!((-16.0..4e6).contains(&v));
    // SAFETY: `v` is a number that an i32 holds: `axis` alone calls this, and has clamped it in a way that leaves no NaN.
    let i = unsafe { v.to_int_unchecked::<i32>() };
    i - i32::from(i as f32 > v)
}

/// exp(-2 d²) - exp(-8) at d = -1 - f, -f, 1 - f, 2 - f, their sum made 1.
#[inline(always)]
fn gaussian(f: f32) -> [f64; 4] {
    // exp(-2 (a - f)²) = exp(-2 a²) exp(-2 f²) exp(4 a f): two exponentials are enough.
    const E2: f32 = 0.135_335_28;
    const E8: f32 = 0.000_335_462_63;
    let (centre, e) = ((-2.0 * f * f).exp(), (4.0 * f).exp());
    let w = [
        E2 * centre / e,
        centre,
        E2 * centre * e,
        E8 * centre * e * e,
    ];
    // In f64, so that the weights of what is lit all around add up to light.
    let w = w.map(|w| f64::from((w - E8).max(0.0)));
    let part = 1.0 / ((w[0] + w[1]) + (w[2] + w[3]));
    w.map(|w| w * part)
}

/// The interpolating cubic at d = -1 - f, -f, 1 - f, 2 - f; their sum is 1.
#[inline(always)]
fn catmull_rom(f: f32) -> [f64; 4] {
    let f = f64::from(f);
    let (f2, f3) = (f * f, f * f * f);
    [
        f2 - 0.5 * (f3 + f),
        1.5 * f3 - 2.5 * f2 + 1.0,
        2.0 * f2 + 0.5 * f - 1.5 * f3,
        0.5 * (f3 - f2),
    ]
}
