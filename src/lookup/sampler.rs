//! The sampler: footprints to levels, levels to pixels, pixels to an answer.

use super::footprint::{Plan, plan};
use super::level::{Address, Level};
use super::pins::Pins;
use super::pixel::{self, Cursor, Hint, Search};
use super::planes::{Across, Found, LIT, Planes};
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
    pub(super) levels: Box<[Level]>,
    pins: Pins,
    /// Weights of a row, and the positions of its pixels: of footprints that are no block.
    pub(super) weights: Vec<f32>,
    replaced: u64,
    /// Binary logarithm of a tile's side.
    pub(super) shift: u32,
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
                .map(|(l, info)| Level::new(l, info, options.filter))
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
    #[expect(clippy::eq_op, reason = "what is no number differs from itself")]
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
                if let Some(value) = self.value_across::<N>(0, x, y, z) {
                    return Ok(narrow(value));
                }
            } else if width > 1.0 && width < Footprint::LONGEST {
                let plan = self.plan(&Footprint::Width(width));
                let (level, t) = (plan.level, plan.blend);
                if plan.is_unit() {
                    let fine = self.find::<N>(level, x, y);
                    if t == 0.0 {
                        if let Some(fine) = fine {
                            let value = fine.value(z, hint);
                            self.levels[level].hits += 1;
                            return Ok(narrow(value));
                        }
                        if let Some(value) = self.value_across::<N>(level, x, y, z) {
                            return Ok(narrow(value));
                        }
                    } else {
                        // Both are on their way before either is searched.
                        let coarse = self.find::<N>(level + 1, x, y);
                        if let (Some(fine), Some(coarse)) = (fine, coarse) {
                            let fine = fine.value(z, hint);
                            let coarse = coarse.value(z, &mut Search);
                            self.levels[level].hits += 1;
                            self.levels[level + 1].hits += 1;
                            return Ok(narrow(blend([fine], [coarse], t)[0]));
                        }
                        if let Some(value) = self.two_across::<N>(level, t, x, y, z) {
                            return Ok(narrow(value));
                        }
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

    /// The same for a block that lies in several tiles, all of them pinned, or beyond the border.
    #[inline(always)]
    fn find_across<const N: usize>(&self, level: usize, x: f32, y: f32) -> Option<Across<'_, N>> {
        let own = &self.levels[level];
        let (origin, wx, wy) = own.block::<N>(self.options.filter, x, y);
        let size = [own.width, own.height];
        // Places inside the map, and whether they were.
        let axis = |k: usize| -> [(i32, bool); N] {
            std::array::from_fn(|i| {
                let c = origin[k] + i as i32;
                (c.clamp(0, size[k] - 1), (0..size[k]).contains(&c))
            })
        };
        let (columns, rows) = (axis(0), axis(1));
        // A block is smaller than a tile: it lies in one or two of them each way.
        let [left, right] = [columns[0].0, columns[N - 1].0];
        let [top, bottom] = [rows[0].0, rows[N - 1].0];
        let planes = |x: i32, y: i32| self.pins.get(&own.tile(level, [x, y], self.shift));
        let planes = [
            [planes(left, top)?, planes(right, top)?],
            [planes(left, bottom)?, planes(right, bottom)?],
        ];
        let lit = self.options.border == Border::Lit;
        let mut pixels = [[(LIT, 0); N]; N];
        for (row, (y, in_y)) in pixels.iter_mut().zip(rows) {
            for (pixel, (x, in_x)) in row.iter_mut().zip(columns) {
                if !lit || (in_x && in_y) {
                    let second = [
                        y >> self.shift != top >> self.shift,
                        x >> self.shift != left >> self.shift,
                    ];
                    let planes = planes[usize::from(second[0])][usize::from(second[1])];
                    *pixel = (planes, planes.place([x, y], self.shift));
                }
            }
        }
        Some(Across::new(pixels, (wx, wy)))
    }

    /// One level of [`Sampler::short_way`], where its block lies in several tiles.
    #[inline(never)]
    fn value_across<const N: usize>(
        &mut self,
        level: usize,
        x: f32,
        y: f32,
        z: f32,
    ) -> Option<f64> {
        let value = self.find_across::<N>(level, x, y)?.value(z);
        // As pixel by pixel.
        self.levels[level].hits += (N * N) as u64;
        Some(value)
    }

    /// Two levels, where the block of one or both lies in several tiles.
    #[inline(never)]
    fn two_across<const N: usize>(
        &mut self,
        level: usize,
        t: f64,
        x: f32,
        y: f32,
        z: f32,
    ) -> Option<f64> {
        let (mut values, mut hits) = ([0.0; 2], [0; 2]);
        for k in 0..2 {
            (values[k], hits[k]) = match self.find::<N>(level + k, x, y) {
                Some(found) => (found.value(z, &mut Search), 1),
                None => {
                    let found = self.find_across::<N>(level + k, x, y)?;
                    (found.value(z), (N * N) as u64)
                }
            };
        }
        self.levels[level].hits += hits[0];
        self.levels[level + 1].hits += hits[1];
        Some(blend([values[0]], [values[1]], t)[0])
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
        let most = self.file.cache().share();
        if self.pins.wants(&address.tile, held.bytes(), most) || loaded {
            self.pins.set(&address.tile, held.pin(), most);
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
    pub(super) fn pixel<const C: usize>(
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
