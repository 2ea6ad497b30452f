//! Batched lookups: a ring of started lookups, whose memory is prefetched before it is needed.
//!
//! A single lookup at a random place waits for memory two or three times in a row: for the table of
//! its tile, then for the vertices of its pixels. A batch prefetches the tables of a lookup, and
//! later its vertices, while it evaluates earlier lookups.

#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
use super::descriptor::{Found, Kernel, Located, Split};
use super::grid::side_of;
use super::kernel::Portable;
use super::query::{Batch, Footprint, Query};
use super::sampler::{Sampler, blended, narrow};
use crate::{Error, Result};

/// Capacity of the ring of started lookups; a power of two.
const RING: usize = 32;

impl Batch<'_> {
    #[inline(always)]
    fn query(&self, i: usize) -> Query {
        let one = self.footprints.len() == 1;
        Query {
            x: self.x[i],
            y: self.y[i],
            depth: self.depth[i],
            bias: self.bias,
            footprint: self.footprints[if one { 0 } else { i }],
        }
    }

    fn check(&self, out: usize) -> Result<()> {
        let n = self.x.len();
        let footprints = self.footprints.len();
        if self.y.len() != n
            || self.depth.len() != n
            || out != n
            || (footprints != 1 && footprints != n)
        {
            return Err(Error::input(format!(
                "a batch of {n} x, {} y, {} depths and {footprints} footprints for {out} answers",
                self.y.len(),
                self.depth.len(),
            )));
        }
        Ok(())
    }
}

impl Sampler {
    /// [`Sampler::visibility`] of many queries. The answers are the same; queries at random places
    /// take a half to a third of the time.
    ///
    /// # Errors
    /// As [`Sampler::visibility`], for any of the queries; `Input` if the lengths do not match. The
    /// contents of `out` are then unspecified.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # fn main() -> Result<()> {
    /// # let mut writer = Writer::in_memory();
    /// # let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
    /// # writer.pixel(map, Pixel::new(2, 1), &Curve::mono(vec![5.0], vec![0.25])?)?;
    /// # let light = TileCache::new(64 << 20).add(DsmFile::from_bytes(writer.into_bytes()?)?);
    /// # let mut sampler = Sampler::new(&light, MapId(0))?;
    /// let batch = Batch::new(&[2.5, 3.0], &[1.5, 1.5], &[6.0, 6.0]);
    /// let mut out = [0.0; 2];
    /// sampler.visibility_batch(&batch, &mut out)?;
    /// assert_eq!(out, [0.25, 0.625]);
    /// # Ok(()) }
    /// ```
    pub fn visibility_batch(&mut self, batch: &Batch<'_>, out: &mut [f32]) -> Result<()> {
        self.answer_all(batch, bytemuck::cast_slice_mut::<f32, [f32; 1]>(out))
    }

    /// [`Sampler::visibility_rgb`] of many queries.
    ///
    /// # Errors
    /// As [`Sampler::visibility_batch`].
    pub fn visibility_rgb_batch(&mut self, batch: &Batch<'_>, out: &mut [[f32; 3]]) -> Result<()> {
        self.answer_all(batch, out)
    }

    pub(super) fn answer_all<const C: usize>(
        &mut self,
        batch: &Batch<'_>,
        out: &mut [[f32; C]],
    ) -> Result<()> {
        batch.check(out.len())?;
        let mut done = 0;
        while done < out.len() {
            done += match side_of(self.options().filter) {
                1 => self.ring::<C, 1>(batch, done, &mut out[done..]),
                2 => self.ring::<C, 2>(batch, done, &mut out[done..]),
                // Sixteen pixels keep enough loads under way by themselves.
                _ => 0,
            };
            // This query may load tiles and displace others, so the ring must be empty.
            if done < out.len() {
                out[done] = self.answer(&batch.query(done))?;
                done += 1;
            }
        }
        Ok(())
    }

    /// Answers the queries from `start` up to the first that needs a wide kernel or a tile that is
    /// not held. Returns their number.
    fn ring<const C: usize, const N: usize>(
        &self,
        batch: &Batch<'_>,
        start: usize,
        out: &mut [[f32; C]],
    ) -> usize {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            // SAFETY: a value of `Avx2` exists only if the processor has these features.
            return unsafe { self.ring_avx2::<C, N>(batch, start, out, avx2) };
        }
        self.ring_by::<C, N, _>(batch, start, out, Portable)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
    fn ring_avx2<const C: usize, const N: usize>(
        &self,
        batch: &Batch<'_>,
        start: usize,
        out: &mut [[f32; C]],
        avx2: Avx2,
    ) -> usize {
        self.ring_by::<C, N, _>(batch, start, out, avx2)
    }

    #[inline(always)]
    fn ring_by<const C: usize, const N: usize, K: Kernel>(
        &self,
        batch: &Batch<'_>,
        start: usize,
        out: &mut [[f32; C]],
        mut kernel: K,
    ) -> usize {
        // Lookups between a prefetch and the use of the memory. A lookup of one pixel is little
        // work, so it needs a larger distance.
        let ahead = if N == 1 { 16 } else { 4 };
        let mut ring: [Option<UnderWay<'_, N>>; RING] = [const { None }; RING];
        let mut end = out.len();
        for step in 0..end + 2 * ahead {
            // Oldest lookup first: the newest takes its slot.
            if let Some(i) = step.checked_sub(2 * ahead) {
                if i >= end {
                    break;
                }
                if let Some(own) = &ring[i % RING] {
                    out[i] = self.end::<C, N, K>(own, &mut kernel);
                }
            }
            if let Some(i) = step.checked_sub(ahead)
                && i < end
                && let Some(own) = &mut ring[i % RING]
            {
                self.prefetch::<C, N>(own);
            }
            if step < end {
                let begun = self.begin::<C, N>(&batch.query(start + step));
                if begun.is_none() {
                    end = step;
                }
                ring[step % RING] = begun;
            }
        }
        end
    }

    /// Locates the windows of a query, and prefetches the table entries of their pixels.
    #[inline(always)]
    fn begin<const C: usize, const N: usize>(&self, query: &Query) -> Option<UnderWay<'_, N>> {
        let Footprint::Width(width) = query.footprint else {
            return None;
        };
        let depth = query.depth - query.bias;
        let (level, blend) = self.unit_levels(query.x, query.y, depth, width)?;
        let fine = self.side::<C, N>(level, query)?;
        let coarse = if blend == 0.0 {
            Side::None
        } else {
            self.side::<C, N>(level + 1, query)?
        };
        Some(UnderWay {
            x: query.x,
            y: query.y,
            depth,
            level,
            blend,
            fine,
            coarse,
        })
    }

    #[inline(always)]
    fn side<const C: usize, const N: usize>(
        &self,
        level: usize,
        query: &Query,
    ) -> Option<Side<'_, N>> {
        let grid = &self.grids[level];
        let (origin, window) = grid.window::<N>(query.x, query.y);
        if let Some((tile, at)) = grid.tile_of::<N>(origin) {
            let tile = self.tiles.get(tile)?;
            let located = Located { tile, at, window };
            located.prefetch::<C>();
            return Some(Side::Located(located));
        }
        let tiles = self.tiles.quad(&grid.quad::<N>(origin)?)?;
        grid.split(origin, window, tiles).prefetch::<C>();
        Some(Side::Split)
    }

    /// Finds the vertices of a lookup and prefetches them.
    #[inline(always)]
    fn prefetch<'a, const C: usize, const N: usize>(&'a self, own: &mut UnderWay<'a, N>) {
        let (level, x, y) = (own.level, own.x, own.y);
        for (k, side) in [&mut own.fine, &mut own.coarse].into_iter().enumerate() {
            match side {
                Side::Located(located) => *side = Side::Found(located.find::<C>()),
                Side::Split => self.split::<N>(level + k, x, y).find::<C>(),
                _ => {}
            }
        }
    }

    /// Evaluates a lookup.
    #[inline(always)]
    fn end<const C: usize, const N: usize, K: Kernel>(
        &self,
        own: &UnderWay<'_, N>,
        kernel: &mut K,
    ) -> [f32; C] {
        let fine = self.side_value::<C, N, K>(own, own.level, &own.fine, kernel);
        if let Side::None = own.coarse {
            return fine.map(narrow);
        }
        let coarse = self.side_value::<C, N, K>(own, own.level + 1, &own.coarse, kernel);
        blended(fine, coarse, own.blend).map(narrow)
    }

    #[inline(always)]
    fn side_value<const C: usize, const N: usize, K: Kernel>(
        &self,
        own: &UnderWay<'_, N>,
        level: usize,
        side: &Side<'_, N>,
        kernel: &mut K,
    ) -> [f64; C] {
        if let Side::Found(found) = side {
            self.grids[level].count(1);
            return found.value::<C>(own.depth, kernel);
        }
        let split = self.split::<N>(level, own.x, own.y);
        self.grids[level].count((N * N) as u64);
        split.value::<C>(own.depth, kernel)
    }

    /// The window of a point in several held tiles.
    #[inline(never)]
    fn split<const N: usize>(&self, level: usize, x: f32, y: f32) -> Split<'_, N> {
        let grid = &self.grids[level];
        let (origin, window) = grid.window::<N>(x, y);
        let quad = grid.quad::<N>(origin);
        let tiles = quad.and_then(|quad| self.tiles.quad(&quad));
        grid.split(origin, window, tiles.expect("they were held"))
    }
}

/// A started lookup.
struct UnderWay<'a, const N: usize> {
    x: f32,
    y: f32,
    depth: f32,
    level: usize,
    blend: f64,
    fine: Side<'a, N>,
    coarse: Side<'a, N>,
}

/// The window of a lookup in one level.
enum Side<'a, const N: usize> {
    /// The lookup has one level.
    None,
    /// In one tile.
    Located(Located<'a, N>),
    /// In one tile, with its vertices prefetched.
    Found(Found<'a, N>),
    /// In several tiles. Such windows are rare; they are located again for each step.
    Split,
}
