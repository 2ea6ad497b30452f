//! Many lookups in one call: their memory is sent for ahead.
//!
//! One by one, a lookup at a random place waits for memory two or three times in a row: for the table of its tile, then for the vertices of its
//! pixels. Here some lookups go through each step together, so that they wait together.

use super::pixel::Search;
use super::planes::Found;
use super::query::{Batch, Footprint, Query};
use super::sampler::{Sampler, blend, check, narrow};
use crate::{Error, Filter, Result};

/// Lookups that go together. Their blocks of pixels stay in the first cache of the processor.
const TOGETHER: usize = 32;

impl Batch<'_> {
    #[inline(always)]
    fn query(&self, i: usize) -> Query {
        let one = self.footprint.len() == 1;
        Query {
            x: self.x[i],
            y: self.y[i],
            depth: self.depth[i],
            bias: self.bias,
            footprint: self.footprint[if one { 0 } else { i }],
        }
    }

    fn check(&self, out: usize) -> Result<()> {
        let n = self.x.len();
        let footprints = self.footprint.len();
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
    /// [`Sampler::visibility`] of many queries; the answers are the same, and random ones come about twice as fast.
    ///
    /// # Errors
    /// As [`Sampler::visibility`], of one of the queries; `Input` if the lengths do not fit. What is in `out` then is not defined.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # fn main() -> Result<()> {
    /// # let mut bytes = Vec::new();
    /// # let mut writer = Writer::new(&mut bytes)?;
    /// # let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
    /// # writer.pixel(map, 2, 1, &Curve::mono(vec![5.0], vec![0.25])?)?;
    /// # writer.finish()?;
    /// # let light = TileCache::new(64 << 20).add(DsmFile::from_bytes(bytes)?);
    /// # let mut sampler = Sampler::new(&light, 0)?;
    /// let batch = Batch { x: &[2.5, 3.0], y: &[1.5, 1.5], depth: &[6.0, 6.0], footprint: &[Footprint::Width(1.0)], bias: 0.0 };
    /// let mut out = [0.0; 2];
    /// sampler.visibility_batch(&batch, &mut out)?;
    /// assert_eq!(out, [0.25, 0.625]);
    /// # Ok(()) }
    /// ```
    pub fn visibility_batch(&mut self, batch: &Batch<'_>, out: &mut [f32]) -> Result<()> {
        batch.check(out.len())?;
        for (k, out) in out.chunks_mut(TOGETHER).enumerate() {
            match self.options().filter {
                Filter::Nearest => self.together::<1>(batch, k * TOGETHER, out),
                Filter::Box | Filter::Triangle => self.together::<2>(batch, k * TOGETHER, out),
                Filter::Gaussian | Filter::CatmullRom => {
                    self.together::<4>(batch, k * TOGETHER, out)
                }
            }?;
        }
        Ok(())
    }

    /// [`Sampler::visibility_rgb`] of many queries.
    ///
    /// # Errors
    /// As [`Sampler::visibility_batch`].
    pub fn visibility_rgb_batch(&mut self, batch: &Batch<'_>, out: &mut [[f32; 3]]) -> Result<()> {
        batch.check(out.len())?;
        for (i, out) in out.iter_mut().enumerate() {
            *out = self.visibility_rgb(&batch.query(i))?;
        }
        Ok(())
    }

    /// The answers to the queries from `start` on.
    fn together<const N: usize>(
        &mut self,
        batch: &Batch<'_>,
        start: usize,
        out: &mut [f32],
    ) -> Result<()> {
        // The levels of each lookup that is a block of pixels of one pinned tile in each of them; else the long way.
        let mut plans = [None; TOGETHER];
        for (i, plan) in plans[..out.len()].iter_mut().enumerate() {
            let query = batch.query(start + i);
            check(&query)?;
            if let Footprint::Width(_) = query.footprint {
                let own = self.plan(&query.footprint);
                if own.is_unit() {
                    *plan = Some((own.level, own.blend));
                    self.send_for_table::<N>(own.level, query.x, query.y);
                    if own.blend != 0.0 {
                        self.send_for_table::<N>(own.level + 1, query.x, query.y);
                    }
                }
            }
        }
        {
            let mut found: [[Option<Found<'_, N>>; 2]; TOGETHER] =
                [const { [const { None }; 2] }; TOGETHER];
            for (i, (plan, found)) in plans.iter_mut().zip(&mut found).enumerate() {
                if let Some((level, t)) = *plan {
                    let (x, y) = (batch.x[start + i], batch.y[start + i]);
                    found[0] = self.find::<N>(level, x, y);
                    if t != 0.0 {
                        found[1] = self.find::<N>(level + 1, x, y);
                    }
                    if found[0].is_none() || (t != 0.0 && found[1].is_none()) {
                        *plan = None;
                    }
                }
            }
            for (i, ((plan, found), out)) in plans.iter().zip(&found).zip(&mut *out).enumerate() {
                if let (Some((_, t)), [Some(fine), coarse]) = (plan, found) {
                    let depth = batch.depth[start + i] - batch.bias;
                    let mut value = fine.value(depth, &mut Search);
                    if let Some(coarse) = coarse {
                        [value] = blend([value], [coarse.value(depth, &mut Search)], *t);
                    }
                    *out = narrow(value);
                }
            }
        }
        for (i, (plan, out)) in plans.iter().zip(&mut *out).enumerate() {
            match plan {
                Some((level, t)) => {
                    self.count(*level);
                    if *t != 0.0 {
                        self.count(level + 1);
                    }
                }
                None => *out = self.visibility(&batch.query(start + i))?,
            }
        }
        Ok(())
    }
}
