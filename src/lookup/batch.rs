//! Batched lookups: a ring of started lookups, whose memory is prefetched before it is needed.
//!
//! A single lookup at a random place waits for memory two or three times in a row: for the table of
//! its tile, then for the vertices of its pixels. A batch prefetches the tables of a lookup, and
//! later its vertices, while it evaluates earlier lookups.

use super::descriptor::{Located, Split};
use super::grid::side_of;
use super::kernel::Native;
use super::query::{Batch, Footprint, Query};
use super::sampler::{Sampler, blended, narrow};
use crate::format::wide::wide;
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
        wide(
            #[inline(always)]
            || self.ring_here::<C, N>(batch, start, out),
        )
    }

    #[inline(always)]
    fn ring_here<const C: usize, const N: usize>(
        &self,
        batch: &Batch<'_>,
        start: usize,
        out: &mut [[f32; C]],
    ) -> usize {
        // Lookups between a prefetch and the use of the memory. A lookup of one pixel is little
        // work, so it needs a larger distance.
        let ahead = if N == 1 { 16 } else { 4 };
        let mut ring: [Option<UnderWay<'_, N>>; RING] = [const { None }; RING];
        let mut kernel = self.kernel;
        let mut end = out.len();
        for step in 0..end + 2 * ahead {
            // Oldest lookup first: the newest takes its slot.
            if let Some(i) = step.checked_sub(2 * ahead) {
                if i >= end {
                    break;
                }
                if let Some(own) = &ring[i % RING] {
                    out[i] = self.end(own, &mut kernel);
                }
            }
            if let Some(i) = step.checked_sub(ahead)
                && i < end
                && let Some(own) = &ring[i % RING]
            {
                self.prefetch::<C, N>(own, 0);
                if own.blend != 0.0 {
                    self.prefetch::<C, N>(own, 1);
                }
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
        let (x, y, depth) = (query.x, query.y, query.depth - query.bias);
        let (level, blend) = self.unit_levels(depth, width)?;
        let fine = self.side::<C, N>(level, x, y)?;
        let mut coarse = None;
        if blend != 0.0 {
            coarse = self.side::<C, N>(level + 1, x, y)?;
        }
        Some(UnderWay {
            x,
            y,
            depth,
            level,
            blend,
            sides: [fine, coarse],
        })
    }

    /// The window of a point in a level if its tiles are held, `Some(None)` if they are several.
    #[inline(always)]
    fn side<const C: usize, const N: usize>(
        &self,
        level: usize,
        x: f32,
        y: f32,
    ) -> Option<Option<Located<'_, N>>> {
        let located = self.locate::<N>(level, x, y);
        match &located {
            Some(located) => located.prefetch::<C>(),
            None => {
                let (split, _) = self.split::<N>(level, x, y)?;
                split.prefetch::<C>();
            }
        }
        Some(located)
    }

    /// Finds the vertices of a lookup in its first or second level, and prefetches them.
    #[inline(always)]
    fn prefetch<const C: usize, const N: usize>(&self, own: &UnderWay<'_, N>, k: usize) {
        match &own.sides[k] {
            Some(located) => located.find::<C>().prefetch(),
            None => {
                let (split, _) = self.still_held(own, k);
                let pixels = split.pixels.as_flattened().iter();
                pixels.for_each(|pixel| pixel.find::<C>().prefetch());
            }
        }
    }

    fn still_held<const N: usize>(&self, own: &UnderWay<'_, N>, k: usize) -> (Split<'_, N>, u64) {
        let split = self.split(own.level + k, own.x, own.y);
        split.expect("its tiles were held")
    }

    #[inline(always)]
    fn side_value<const C: usize, const N: usize>(
        &self,
        own: &UnderWay<'_, N>,
        k: usize,
        kernel: &mut Native,
    ) -> [f64; C] {
        let grid = &self.grids[own.level + k];
        if let Some(located) = &own.sides[k] {
            grid.count(1);
            return located.find().value(own.depth, kernel);
        }
        let (split, tiles) = self.still_held(own, k);
        grid.count(tiles);
        split.value(own.depth, &mut { Native::PORTABLE })
    }

    /// Evaluates a lookup.
    #[inline(always)]
    fn end<const C: usize, const N: usize>(
        &self,
        own: &UnderWay<'_, N>,
        kernel: &mut Native,
    ) -> [f32; C] {
        let fine = self.side_value::<C, N>(own, 0, kernel);
        if own.blend == 0.0 {
            return narrow(fine);
        }
        let coarse = self.side_value::<C, N>(own, 1, kernel);
        narrow(blended(fine, coarse, own.blend))
    }
}

/// A started lookup.
struct UnderWay<'a, const N: usize> {
    x: f32,
    y: f32,
    depth: f32,
    level: usize,
    blend: f64,
    /// The windows in one or two levels. Those in several tiles are rare; they are `None` here, and
    /// are located again for each step.
    sides: [Option<Located<'a, N>>; 2],
}
