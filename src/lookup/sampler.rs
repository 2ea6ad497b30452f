//! The sampler: chooses levels for a footprint, finds the windows of pixels, evaluates them.

use super::descriptor::{Kernel, Located, Split, Window};
use super::grid::{Grid, side_of};
use super::kernel::{Cursor, Native};
use super::plan::{FootprintPlan, plan};
use super::query::{Footprint, OnError, Query, SamplerOptions};
use super::tiles::TileTable;
use crate::cache::{CachedFile, Descriptor, TileRef};
use crate::format::wide::wide;
use crate::{Error, MapId, Result};

/// Answers filtered lookups in one map (LV00, sections 3.4 and 5.3).
///
/// A lookup averages the visibility functions of the pixels around a point at one depth, weighted
/// by the filter. The footprint's width chooses the levels, so that a wide filter costs as much as
/// a narrow one. The answer depends only on the stored vertices, the options and the query. It does
/// not depend on the cache, the codec, other lookups or threads. Single lookups, lookups with a
/// cursor and batches give the same answers.
///
/// Each thread needs a sampler of its own; a sampler is `Send`. It holds a few tiles, and a table
/// of the tiles of its map: blocks of 256 tiles, 14 KiB each, allocated on first use. The first
/// block is not charged to the cache. After the first lookups of each kind, a lookup allocates only
/// for tiles that it loads.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// # let mut writer = Writer::in_memory();
/// # let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
/// # writer.pixel(map, Pixel::new(2, 1), &Curve::mono(vec![5.0], vec![0.25])?)?; // glass
/// # let file = DsmFile::from_bytes(writer.into_bytes()?)?;
/// let light = TileCache::new(64 << 20).add(file);
/// let mut sampler = Sampler::new(&light, MapId(0))?;
/// // Pixel (2, 1) lets a quarter of the light through, its neighbours all of it.
/// let centre = Query::new(2.5, 1.5, 6.0);
/// assert_eq!(sampler.visibility(&centre)?, 0.25);
/// assert_eq!(sampler.visibility(&centre.depth(5.0))?, 1.0); // the glass does not shadow itself
/// let edge = Query::new(3.0, 1.5, 6.0); // half way to the next pixel
/// assert_eq!(sampler.visibility(&edge)?, 0.625);
/// let four = Query::new(3.0, 1.0, 6.0).width(2.0); // a pixel of level 1: the mean of four
/// assert_eq!(sampler.visibility(&four)?, 0.8125);
/// # Ok(()) }
/// ```
pub struct Sampler {
    file: CachedFile,
    map: MapId,
    options: SamplerOptions,
    pub(super) grids: Box<[Grid]>,
    pub(super) tiles: TileTable,
    /// Buffer for the weights of one row of a wide kernel.
    pub(super) weights: Vec<f32>,
    replaced: u64,
    pub(super) kernel: Native,
}

impl Sampler {
    /// A sampler of a map of a file, with the default options.
    ///
    /// # Errors
    /// `Input` if there is no such map.
    pub fn new(file: &CachedFile, map: MapId) -> Result<Self> {
        Self::with_options(file, map, SamplerOptions::default())
    }

    /// A sampler with these options.
    ///
    /// # Errors
    /// `Input` if there is no such map, or an option is outside its domain.
    pub fn with_options(file: &CachedFile, map: MapId, options: SamplerOptions) -> Result<Self> {
        let info = file.file().map(map)?;
        if !(1.0..=64.0).contains(&options.anisotropy) {
            return Err(Error::input(format!(
                "an anisotropy of {}; 1 to 64 are possible",
                options.anisotropy
            )));
        }
        let mut tiles = 0;
        let levels = info.levels.iter().enumerate();
        let grids = levels.map(|(l, info)| {
            let first = tiles;
            tiles += info.shape.tiles() as usize;
            Grid::new(l, info, first, options.filter, options.border)
        });
        let grids = grids.collect();
        file.cache().add_sampler();
        Ok(Sampler {
            file: file.clone(),
            map,
            options,
            grids,
            tiles: TileTable::new(tiles),
            weights: Vec::new(),
            replaced: 0,
            kernel: Native::new(),
        })
    }

    /// The file.
    pub fn file(&self) -> &CachedFile {
        &self.file
    }

    /// The map.
    pub fn map(&self) -> MapId {
        self.map
    }

    /// The options.
    pub fn options(&self) -> &SamplerOptions {
        &self.options
    }

    /// Fraction of light, 0 to 1, that reaches the query's depth; in a coloured map the red
    /// channel.
    ///
    /// [`Border`](crate::Border) gives the values outside the map. Cost: one search for each pixel
    /// under the kernel, at most 2 x 2 or 4 x 4 in each of two levels.
    ///
    /// # Errors
    /// `Input` for coordinates or footprints that are not finite, or a depth of NaN; the error of
    /// [`DsmFile::tile`](crate::DsmFile::tile) for a tile that fails to load, unless [`OnError`]
    /// replaces the tile.
    #[inline(always)]
    pub fn visibility(&mut self, query: &Query) -> Result<f32> {
        self.answer::<1>(query).map(|[v]| v)
    }

    /// [`Sampler::visibility`] for red, green and blue.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    #[inline(always)]
    pub fn visibility_rgb(&mut self, query: &Query) -> Result<[f32; 3]> {
        self.answer::<3>(query)
    }

    /// [`Sampler::visibility`] with a cursor, which the caller keeps for lookups near this one. The
    /// answer is the same.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn visibility_with(&mut self, cursor: &mut Cursor, query: &Query) -> Result<f32> {
        let Query {
            x, y, depth, bias, ..
        } = *query;
        let held = match query.footprint {
            Footprint::Width(width) if !self.kernel.has_avx2() => {
                let z = depth - bias;
                cursor.begin();
                match side_of(self.options.filter) {
                    1 => self.held_by::<1, 1>(x, y, z, width, cursor),
                    2 => self.held_by::<1, 2>(x, y, z, width, cursor),
                    _ => self.held_by::<1, 4>(x, y, z, width, cursor),
                }
            }
            _ => None,
        };
        held.map_or_else(|| self.visibility(query), |[v]| Ok(v))
    }

    /// [`Sampler::visibility`] for callers that cannot handle errors: 1 in place of an error.
    #[inline]
    pub fn visibility_or_lit(&mut self, query: &Query) -> f32 {
        self.visibility(query).unwrap_or(1.0)
    }

    /// One minus the visibility behind everything. The query's depth and bias do not matter.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn opacity(&mut self, query: &Query) -> Result<f32> {
        let behind = query.depth(f32::INFINITY).bias(0.0);
        Ok(1.0 - self.visibility(&behind)?)
    }

    /// The first depth behind which visibility is below `t`; `None` if visibility never falls below
    /// `t`. The query's depth and bias do not matter.
    ///
    /// At a step, the result is the depth of the step. With [`Filter::CatmullRom`](crate::Filter),
    /// whose sums may rise with depth, it is one of the depths where visibility falls below `t`.
    /// Cost: 32 lookups, a bisection over all floats.
    ///
    /// # Errors
    /// As [`Sampler::visibility`].
    pub fn depth_below(&mut self, query: &Query, t: f32) -> Result<Option<f32>> {
        let mut below = |depth: f32| -> Result<bool> {
            Ok(self.visibility(&query.depth(depth).bias(0.0))? < t)
        };
        if !below(f32::INFINITY)? {
            return Ok(None);
        }
        // Visibility is not below `t` at `lit`, and is below it at `dark`.
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

    /// How often a tile counted as lit or dark because it failed to load.
    pub fn replaced_tiles(&self) -> u64 {
        self.replaced
    }

    /// Releases all tiles, and reports the counted hits to the cache's statistics.
    pub fn release(&mut self) {
        self.report();
        self.tiles.clear();
    }

    fn report(&self) {
        for (l, grid) in self.grids.iter().enumerate() {
            let hits = grid.hits.take();
            if hits > 0 {
                self.file.count(self.map.index(), l, |c| c.hits += hits);
            }
        }
    }

    #[inline(always)]
    pub(super) fn plan(&self, footprint: &Footprint) -> FootprintPlan {
        plan(footprint, &self.options, self.grids.len())
    }

    // The numbers of the usual query are passed in registers. A query in memory, written in halves
    // and read as a whole, would stall each lookup until the stores of the query have finished.
    #[inline(always)]
    pub(super) fn answer<const C: usize>(&mut self, query: &Query) -> Result<[f32; C]> {
        let Query {
            x, y, depth, bias, ..
        } = *query;
        let Footprint::Width(width) = query.footprint else {
            return self.wide(query);
        };
        match self.held::<C>(x, y, depth - bias, width) {
            Some(value) => Ok(value),
            None => self.beyond(x, y, depth, bias, width),
        }
    }

    /// [`Sampler::answer`] for round footprints, wherever their windows lie.
    #[expect(clippy::eq_op, reason = "NaN != NaN")]
    #[inline(never)]
    fn beyond<const C: usize>(
        &mut self,
        x: f32,
        y: f32,
        depth: f32,
        bias: f32,
        width: f32,
    ) -> Result<[f32; C]> {
        let z = depth - bias;
        // x - x is 0 for a finite x, otherwise NaN.
        if (x - x) + (y - y) == 0.0
            && let Some((level, blend)) = self.unit_levels(z, width)
        {
            return self.windows(level, blend, x, y, z);
        }
        let footprint = Footprint::Width(width);
        self.wide(&Query {
            x,
            y,
            depth,
            bias,
            footprint,
        })
    }

    /// A lookup with one window in each level, each in one held tile, by the fastest kernel of this
    /// processor; `None` if the query needs more.
    #[inline(always)]
    fn held<const C: usize>(&self, x: f32, y: f32, z: f32, width: f32) -> Option<[f32; C]> {
        match side_of(self.options.filter) {
            1 => self.held_in::<C, 1>(x, y, z, width),
            2 => self.held_in::<C, 2>(x, y, z, width),
            _ => self.held_in::<C, 4>(x, y, z, width),
        }
    }

    #[inline(always)]
    fn held_in<const C: usize, const N: usize>(
        &self,
        x: f32,
        y: f32,
        z: f32,
        width: f32,
    ) -> Option<[f32; C]> {
        #[cfg(target_arch = "x86_64")]
        if self.kernel.has_avx2() {
            // SAFETY: just asked for.
            return unsafe { self.held_avx2::<C, N>(x, y, z, width) };
        }
        self.held_portable::<C, N>(x, y, z, width)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn held_avx2<const C: usize, const N: usize>(
        &self,
        x: f32,
        y: f32,
        z: f32,
        width: f32,
    ) -> Option<[f32; C]> {
        self.held_by::<C, N>(x, y, z, width, &mut { self.kernel })
    }

    #[inline(never)]
    fn held_portable<const C: usize, const N: usize>(
        &self,
        x: f32,
        y: f32,
        z: f32,
        width: f32,
    ) -> Option<[f32; C]> {
        self.held_by::<C, N>(x, y, z, width, &mut { Native::PORTABLE })
    }

    #[inline(always)]
    fn held_by<const C: usize, const N: usize>(
        &self,
        x: f32,
        y: f32,
        z: f32,
        width: f32,
        kernel: &mut impl Kernel,
    ) -> Option<[f32; C]> {
        let (level, blend) = self.unit_levels(z, width)?;
        let fine = self.locate::<N>(level, x, y)?.find::<C>();
        fine.prefetch();
        let mut value;
        if blend == 0.0 {
            value = fine.value(z, kernel);
        } else {
            // Prefetches the vertices of both levels before the first search.
            let coarse = self.locate::<N>(level + 1, x, y)?.find::<C>();
            coarse.prefetch();
            value = fine.value(z, kernel);
            value = blended(value, coarse.value(z, kernel), blend);
            self.grids[level + 1].count(1);
        }
        self.grids[level].count(1);
        Some(narrow(value))
    }

    /// The level of a lookup whose kernel is one pixel wide, and the weight of the next level;
    /// `None` if the kernel is wider, or a number is NaN.
    #[inline(always)]
    pub(super) fn unit_levels(&self, z: f32, width: f32) -> Option<(usize, f64)> {
        if z.is_nan() {
            return None;
        }
        if (0.0..=1.0).contains(&width) {
            return Some((0, 0.0));
        }
        if !(width > 1.0 && width < Footprint::LONGEST) {
            return None;
        }
        let plan = self.plan(&Footprint::Width(width));
        plan.is_unit().then_some((plan.level, plan.blend))
    }

    /// The window of a point in a level, if it lies in one held tile.
    #[inline(always)]
    pub(super) fn locate<const N: usize>(
        &self,
        level: usize,
        x: f32,
        y: f32,
    ) -> Option<Located<'_, N>> {
        let (tile, at, window) = self.grids[level].near(x, y)?;
        let tile = self.tiles.get(tile)?;
        Some(Located { tile, at, window })
    }

    /// The window of a point in a level, and the number of its tiles, if all are held; `None` also
    /// if it lies outside a map with a lit border, or a number is not finite.
    #[expect(clippy::eq_op, reason = "NaN != NaN")]
    #[inline(never)]
    pub(super) fn split<const N: usize>(
        &self,
        level: usize,
        x: f32,
        y: f32,
    ) -> Option<(Split<'_, N>, u64)> {
        // x - x is 0 for a finite x, otherwise NaN.
        if (x - x) + (y - y) != 0.0 {
            return None;
        }
        let grid = &self.grids[level];
        let (origin, window) = grid.window::<N>(x, y);
        let quad = grid.quad::<N>(origin)?;
        let split = grid.split(origin, window, self.tiles.quad(&quad)?);
        Some((split, (quad.size[0] * quad.size[1]) as u64))
    }

    /// A lookup with one window in each level. Loads missing tiles.
    pub(super) fn windows<const C: usize>(
        &mut self,
        level: usize,
        blend: f64,
        x: f32,
        y: f32,
        z: f32,
    ) -> Result<[f32; C]> {
        let kernel = &mut { self.kernel };
        wide(
            #[inline(always)]
            || match side_of(self.options.filter) {
                1 => self.windows_by::<C, 1, _>(level, blend, x, y, z, kernel),
                2 => self.windows_by::<C, 2, _>(level, blend, x, y, z, kernel),
                _ => self.windows_by::<C, 4, _>(level, blend, x, y, z, kernel),
            },
        )
    }

    #[inline(always)]
    fn windows_by<const C: usize, const N: usize, K: Kernel>(
        &mut self,
        level: usize,
        blend: f64,
        x: f32,
        y: f32,
        depth: f32,
        kernel: &mut K,
    ) -> Result<[f32; C]> {
        let mut values = [[0.0; C]; 2];
        let levels = if blend == 0.0 { 1 } else { 2 };
        for (k, value) in values.iter_mut().enumerate().take(levels) {
            let (origin, window) = self.grids[level + k].window::<N>(x, y);
            *value = self.window::<C, N, K>(level + k, origin, window, depth, kernel)?;
        }
        let [fine, coarse] = values;
        Ok(narrow(if levels == 1 {
            fine
        } else {
            blended(fine, coarse, blend)
        }))
    }

    /// The weighted sum of a window of pixels of a level. Loads missing tiles.
    #[inline(always)]
    pub(super) fn window<const C: usize, const N: usize, K: Kernel>(
        &mut self,
        level: usize,
        origin: [i32; 2],
        window: Window<N>,
        depth: f32,
        kernel: &mut K,
    ) -> Result<[f64; C]> {
        let grid = &self.grids[level];
        if let Some((tile, at)) = grid.tile_of::<N>(origin) {
            let kept;
            let tile = match self.tiles.get(tile) {
                Some(tile) => {
                    grid.count(1);
                    tile
                }
                None => {
                    kept = self.keep(level, tile)?;
                    &kept.descriptor()
                }
            };
            let located = Located { tile, at, window };
            let found = located.find();
            found.prefetch();
            return Ok(found.value(depth, kernel));
        }
        let Some(quad) = grid.quad::<N>(origin) else {
            let lit = [[Descriptor::LIT; 2]; 2];
            return Ok(grid.split(origin, window, lit).value(depth, kernel));
        };
        if let Some(tiles) = self.tiles.quad(&quad) {
            grid.count((quad.size[0] * quad.size[1]) as u64);
            return Ok(grid.split(origin, window, tiles).value(depth, kernel));
        }
        // A load may displace another tile of the window, so all are kept until the end.
        let mut kept = [const { [const { None }; 2] }; 2];
        for (kept, tiles) in kept.iter_mut().zip(quad.tiles).take(quad.size[0]) {
            for (kept, tile) in kept.iter_mut().zip(tiles).take(quad.size[1]) {
                *kept = Some(self.keep(level, tile)?);
            }
        }
        let tiles = kept.each_ref().map(|row| {
            row.each_ref().map(|kept| match kept {
                Some(kept) => kept.descriptor(),
                None => *Descriptor::LIT,
            })
        });
        let [rows, columns] = quad.size.map(|n| n - 1);
        let tiles: [[&Descriptor<'_>; 2]; 2] =
            std::array::from_fn(|j| std::array::from_fn(|i| &tiles[j.min(rows)][i.min(columns)]));
        let split = self.grids[level].split(origin, window, tiles);
        Ok(split.value(depth, kernel))
    }

    /// A tile for one evaluation: from the table, the cache or the file; or its replacement if it
    /// fails to load.
    #[inline(never)]
    pub(super) fn keep(&mut self, level: usize, tile: usize) -> Result<Kept> {
        let grid = &self.grids[level];
        if let Some(pin) = self.tiles.pin(tile) {
            grid.count(1);
            return Ok(Kept::Held(TileRef::Counted(pin.clone())));
        }
        let held = match self.file.tile(self.map.index(), level, grid.index_of(tile)) {
            Ok(held) => held,
            Err(e) => {
                let value = match self.options.on_error {
                    OnError::Lit => Descriptor::LIT,
                    OnError::Dark => Descriptor::DARK,
                    OnError::Fail => return Err(e),
                };
                self.replaced += 1;
                return Ok(Kept::Replaced(value));
            }
        };
        let loaded = matches!(held, TileRef::Counted(_));
        if loaded {
            self.report();
        } else {
            grid.count(1);
        }
        let cache = self.file.cache();
        let most = cache.pin_budget();
        if self.tiles.wants(tile, held.bytes(), most) || loaded {
            self.tiles.hold(tile, held.pin(), most, cache);
        }
        Ok(Kept::Held(held))
    }
}

/// Keeps a tile in memory for one evaluation.
pub(super) enum Kept {
    Held(TileRef),
    /// The replacement of a tile that failed to load.
    Replaced(&'static Descriptor<'static>),
}

impl Kept {
    pub fn descriptor(&self) -> Descriptor<'_> {
        match self {
            Kept::Held(held) => Descriptor::of(held.tile()),
            Kept::Replaced(tile) => **tile,
        }
    }
}

impl Drop for Sampler {
    fn drop(&mut self) {
        self.report();
        self.file.cache().remove_sampler();
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

/// Rejects queries whose numbers are not finite or out of range.
#[expect(clippy::eq_op, reason = "NaN != NaN")]
pub(super) fn check(query: &Query) -> Result<()> {
    // x - x is 0 for a finite x, otherwise NaN.
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

/// The nearest f32 of an answer, clamped to 0 to 1: negative weights and rounding may leave that
/// range.
#[inline(always)]
pub(super) fn narrow<const C: usize>(values: [f64; C]) -> [f32; C] {
    let mut out = [0.0; C];
    for c in 0..C {
        out[c] = values[c].clamp(0.0, 1.0) as f32;
    }
    out
}

/// The blend of two levels' values; `t` is the weight of the coarser level.
#[inline(always)]
pub(super) fn blended<const C: usize>(mut fine: [f64; C], coarse: [f64; C], t: f64) -> [f64; C] {
    for c in 0..C {
        fine[c] += (coarse[c] - fine[c]) * t;
    }
    fine
}
