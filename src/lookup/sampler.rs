//! The sampler: footprints to levels, levels to pixels, pixels to an answer.

use super::batch::Scratch;
use super::footprint::{Plan, plan};
use super::pixel::{self, Cursor, Hint, Search};
use super::query::{Border, Footprint, OnError, Query, SamplerOptions};
use crate::cache::{CachedFile, Content, Held, Pin, content};
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
    pins: Box<[PinSlot; PINS]>,
    /// Weights of a row, and the positions of its pixels: of footprints that are no block.
    weights: Vec<f32>,
    replaced: u64,
    /// Binary logarithm of a tile's side.
    shift: u32,
    pub(super) batch: Scratch,
}

/// Tiles that a sampler holds.
const PINS: usize = 64;

/// Hits that are counted before they are reported.
const REPORT: u32 = 1 << 16;

#[derive(Default)]
struct PinSlot {
    /// The tile that is pinned, or the one that was last asked for: a tile is pinned when it is asked for twice in a row.
    key: u64,
    last: u64,
    pin: Option<Pin>,
}

/// What a lookup needs to know of a level.
struct Level {
    width: i32,
    height: i32,
    /// Pixels of this level in one of level 0.
    scale: f32,
    tiles_x: u32,
    hits: u32,
}

/// Where a pixel is: its tile, the pin of that tile, and its place in the tile.
#[derive(Clone, Copy, Debug)]
pub(super) struct Address {
    pub key: u64,
    pub pin: usize,
    pub at: usize,
}

/// No tile.
const NOWHERE: u64 = u64::MAX;

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
        Ok(Sampler {
            file: file.clone(),
            map,
            options,
            levels: levels
                .map(|(l, info)| Level {
                    width: info.shape.width as i32,
                    height: info.shape.height as i32,
                    scale: 0.5f32.powi(l as i32),
                    tiles_x: info.shape.tiles_x(),
                    hits: 0,
                })
                .collect(),
            pins: Box::new(std::array::from_fn(|_| PinSlot {
                key: NOWHERE,
                last: NOWHERE,
                pin: None,
            })),
            weights: Vec::new(),
            replaced: 0,
            shift: file.file().maps()[map].header.tile_size.trailing_zeros(),
            batch: Scratch::default(),
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
    #[inline]
    pub fn visibility(&mut self, query: &Query) -> Result<f32> {
        check(query)?;
        self.filtered::<1>(query, &mut Search).map(|v| narrow(v[0]))
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
    #[inline]
    pub fn visibility_with(&mut self, cursor: &mut Cursor, query: &Query) -> Result<f32> {
        check(query)?;
        self.filtered::<1>(query, cursor).map(|v| narrow(v[0]))
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
            let address = self.address(visit.level, visit.x as i32, visit.y as i32);
            let own = self.with_tile(visit.level, address, |tile| {
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
        let mut out = Vec::new();
        let plan = self.plan(&query.footprint);
        for (level, share) in plan.levels() {
            let first = out.len();
            let total = self.each_row(&plan, level, query, |_, y, x0, weights, row| {
                let own = weights.iter().zip(x0..).filter(|(w, _)| **w != 0.0);
                out.extend(own.map(|(weight, x)| Visit {
                    level,
                    x: x as u32,
                    y: y as u32,
                    weight: f64::from(weight * row),
                }));
                Ok(())
            })?;
            for visit in &mut out[first..] {
                visit.weight *= share / total;
            }
        }
        Ok(out)
    }

    /// Tiles that counted as lit or dark because they could not be had.
    pub fn replaced_tiles(&self) -> u64 {
        self.replaced
    }

    /// Lets go of all tiles, and reports the hits that were counted.
    pub fn release(&mut self) {
        for slot in self.pins.iter_mut() {
            *slot = PinSlot {
                key: NOWHERE,
                last: NOWHERE,
                pin: None,
            };
        }
        self.report();
    }

    fn report(&mut self) {
        for (l, level) in self.levels.iter_mut().enumerate() {
            let hits = std::mem::take(&mut level.hits);
            if hits > 0 {
                self.file.counters(self.map, l).add_hits(hits.into());
            }
        }
    }

    pub(super) fn plan(&self, footprint: &Footprint) -> Plan {
        plan(footprint, &self.options, self.levels.len())
    }

    #[inline(always)]
    fn filtered<const C: usize>(
        &mut self,
        query: &Query,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        let plan = self.plan(&query.footprint);
        if plan.blend != 0.0 {
            self.send_ahead(&plan, plan.level + 1, query);
        }
        let first = self.level_value::<C>(&plan, plan.level, query, hint)?;
        if plan.blend == 0.0 {
            return Ok(first);
        }
        // The second level has no hints: they belong to the first.
        let second = self.level_value::<C>(&plan, plan.level + 1, query, &mut Search)?;
        Ok(blend(first, second, plan.blend))
    }

    /// Sends for the memory of a level, if its tile is pinned.
    #[inline(always)]
    fn send_ahead(&self, plan: &Plan, level: usize, query: &Query) {
        match self.options.filter {
            _ if !plan.is_unit() => {}
            Filter::Nearest => self.send_for::<1>(level, query),
            Filter::Box | Filter::Triangle => self.send_for::<2>(level, query),
            Filter::Gaussian | Filter::CatmullRom => self.send_for::<4>(level, query),
        }
    }

    #[inline(always)]
    fn send_for<const N: usize>(&self, level: usize, query: &Query) {
        let origin = self.frame(level).block::<N>(query).0;
        if self.in_one_tile(level, origin, N as i32) {
            let address = self.address(level, origin[0], origin[1]);
            let slot = &self.pins[address.pin];
            if slot.key == address.key
                && let Some(pin) = &slot.pin
            {
                pixel::send_for::<N>(content(pin), address.at);
            }
        }
    }

    /// The filtered value in one level.
    #[inline(always)]
    pub(super) fn level_value<const C: usize>(
        &mut self,
        plan: &Plan,
        level: usize,
        query: &Query,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        if !plan.is_unit() {
            return self.wide(plan, level, query);
        }
        let frame = self.frame(level);
        match self.options.filter {
            Filter::Nearest => self.unit::<C, 1>(level, &frame, query, hint),
            Filter::Box | Filter::Triangle => self.unit::<C, 2>(level, &frame, query, hint),
            Filter::Gaussian | Filter::CatmullRom => self.unit::<C, 4>(level, &frame, query, hint),
        }
    }

    /// What places blocks in a level.
    #[inline(always)]
    pub(super) fn frame(&self, level: usize) -> Frame {
        let own = &self.levels[level];
        Frame {
            filter: self.options.filter,
            scale: own.scale,
            far: [own.width as f32 + 8.0, own.height as f32 + 8.0],
        }
    }

    /// First pixel of the block that a query looks at in a level, for kernels of one pixel's width.
    #[inline(always)]
    pub(super) fn origin(&self, level: usize, query: &Query) -> [i32; 2] {
        let frame = self.frame(level);
        match self.options.filter {
            Filter::Nearest => frame.block::<1>(query).0,
            Filter::Box | Filter::Triangle => frame.block::<2>(query).0,
            Filter::Gaussian | Filter::CatmullRom => frame.block::<4>(query).0,
        }
    }

    /// Whether the block of `n` x `n` pixels from (x, y) on lies in one tile.
    #[inline(always)]
    pub(super) fn in_one_tile(&self, level: usize, [x, y]: [i32; 2], n: i32) -> bool {
        let own = &self.levels[level];
        let s = self.shift;
        x >= 0
            && y >= 0
            && x + n <= own.width
            && y + n <= own.height
            && x >> s == (x + n - 1) >> s
            && y >> s == (y + n - 1) >> s
    }

    /// Where pixel (x, y) of a level is, which must be one of it.
    #[inline(always)]
    pub(super) fn address(&self, level: usize, x: i32, y: i32) -> Address {
        let (own, s) = (&self.levels[level], self.shift);
        let (x, y, mask) = (x as u32, y as u32, (1u32 << s) - 1);
        let (tx, ty) = (x >> s, y >> s);
        let stride = (1 << s).min(own.width as u32 - (tx << s));
        let index = u64::from(ty) * u64::from(own.tiles_x) + u64::from(tx);
        Address {
            key: (level as u64) << 56 | index,
            pin: (((tx & 7) | (ty & 7) << 3) as usize ^ (level * 37)) % PINS,
            at: ((y & mask) * stride + (x & mask)) as usize,
        }
    }

    /// Calls `f` with a tile: a pinned one, or as it passes.
    #[inline(always)]
    pub(super) fn with_tile<R>(
        &mut self,
        level: usize,
        address: Address,
        f: impl FnOnce(&Content) -> R,
    ) -> Result<R> {
        let slot = &self.pins[address.pin];
        if slot.key == address.key
            && let Some(pin) = &slot.pin
        {
            let result = f(content(pin));
            self.count(level);
            return Ok(result);
        }
        let held = self.hold(level, address)?;
        Ok(f(held.content()))
    }

    #[inline(never)]
    fn hold(&mut self, level: usize, address: Address) -> Result<Held> {
        let index = address.key & ((1 << 56) - 1);
        let held = self.file.hold(self.map, level, index)?;
        match held {
            Held::Passing(_) => self.count(level),
            Held::Loaded(_) => self.report(),
        }
        let slot = &mut self.pins[address.pin];
        if slot.last == address.key || matches!(held, Held::Loaded(_)) {
            slot.pin = Some(held.pin());
            slot.key = address.key;
        }
        slot.last = address.key;
        Ok(held)
    }

    #[inline(always)]
    fn count(&mut self, level: usize) {
        let hits = &mut self.levels[level].hits;
        *hits += 1;
        if *hits == REPORT {
            self.report();
        }
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

    /// A kernel of one pixel's width.
    #[inline(always)]
    fn unit<const C: usize, const N: usize>(
        &mut self,
        level: usize,
        frame: &Frame,
        query: &Query,
        hint: &mut impl Hint,
    ) -> Result<[f64; C]> {
        let (origin, wx, wy) = frame.block::<N>(query);
        let depth = query.depth - query.bias;
        if !self.in_one_tile(level, origin, N as i32) {
            return self.unit_across(level, origin, (&wx, &wy), depth);
        }
        let address = self.address(level, origin[0], origin[1]);
        let found = self.with_tile(level, address, |tile| {
            pixel::block::<C, N>(tile, address.at, (&wx, &wy), depth, hint)
        });
        match found {
            Ok(value) => Ok(value),
            Err(e) => self.replace(e).map(|value| [value; C]),
        }
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
        let address = self.address(level, x, y);
        let found = self.with_tile(level, address, |tile| {
            pixel::block::<C, 1>(tile, address.at, (&[1.0], &[1.0]), depth, &mut Search)
        });
        found.or_else(|e| self.replace(e).map(|value| [value; C]))
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
        let total = self.each_row(plan, level, query, |sampler, y, x, weights, row| {
            for (i, &weight) in weights.iter().enumerate() {
                let weight = f64::from(weight * row);
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
        // What is outside the map is lit.
        Ok(sum.map(|sum| (sum + (total - inside)) / total))
    }

    /// Calls `f` with every row of pixels of the map that a kernel touches: y, first x, weights, and what all of them are multiplied by.
    /// Returns the sum of all weights, those outside the map included; with a clamped border there are none.
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
        let (mut total, mut row_total, mut result) = (0.0, 0.0, Ok(()));
        for y in y0..=y1 {
            if y == y0 || !kernel.is_separable() {
                weights.clear();
                weights.resize((last - first + 1).max(0) as usize, 0.0);
                row_total = 0.0;
                for x in x0..=x1 {
                    let weight = if kernel.is_separable() {
                        kernel.along(0, distance(x, 0))
                    } else {
                        kernel.weight([distance(x, 0), distance(y, 1)])
                    };
                    row_total += f64::from(weight);
                    if !lit || (first..=last).contains(&x) {
                        weights[(x.clamp(first, last) - first) as usize] += weight;
                    }
                }
            }
            let row = if kernel.is_separable() {
                kernel.along(1, distance(y, 1))
            } else {
                1.0
            };
            total += f64::from(row) * row_total;
            if !lit || (0..height).contains(&y) {
                result = f(self, y.clamp(0, height - 1), first, &weights, row);
            }
            if result.is_err() {
                break;
            }
        }
        self.weights = weights;
        result?;
        Ok(total)
    }

    /// [`Sampler::each_row`] without a filter.
    fn nearest_row(
        &mut self,
        level: usize,
        c: [f32; 2],
        mut f: impl FnMut(&mut Self, i32, i32, &[f32], f32) -> Result<()>,
    ) -> Result<f64> {
        let [x, y] = c.map(floor);
        let (width, height) = (self.levels[level].width, self.levels[level].height);
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        if inside || self.options.border == Border::Clamp {
            f(
                self,
                y.clamp(0, height - 1),
                x.clamp(0, width - 1),
                &[1.0],
                1.0,
            )?;
        }
        Ok(1.0)
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        self.report();
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

/// Where blocks of pixels are in a level, and what they weigh.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    filter: Filter,
    scale: f32,
    /// Beyond this, and beyond -8, all places are alike.
    far: [f32; 2],
}

impl Frame {
    /// First pixel of the block of a kernel of one pixel's width, and the weights of its columns and rows.
    #[inline(always)]
    pub fn block<const N: usize>(&self, query: &Query) -> ([i32; 2], [f64; N], [f64; N]) {
        let (x, wx) = self.axis(query.x, self.far[0]);
        let (y, wy) = self.axis(query.y, self.far[1]);
        ([x, y], wx, wy)
    }

    #[inline(always)]
    fn axis<const N: usize>(&self, c: f32, far: f32) -> (i32, [f64; N]) {
        let c = (c * self.scale).clamp(-8.0, far);
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
        let weights = match self.filter {
            Filter::CatmullRom => catmull_rom(f),
            _ => gaussian(f),
        };
        (before - 1, std::array::from_fn(|i| weights[i % 4]))
    }
}

/// Whether a query is one that can be answered.
#[inline(always)]
pub(super) fn check(query: &Query) -> Result<()> {
    let sound = query.x.is_finite()
        && query.y.is_finite()
        && !(query.depth - query.bias).is_nan()
        && match &query.footprint {
            Footprint::Width(w) => (0.0..f32::INFINITY).contains(w),
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

/// The integer below; without the library call that older processors need.
#[inline(always)]
fn floor(v: f32) -> i32 {
    let i = v as i32;
    i - i32::from(i as f32 > v)
}

/// exp(-2 d²) at d = -1 - f, -f, 1 - f, 2 - f, their sum made 1.
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
    let w = w.map(f64::from);
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
