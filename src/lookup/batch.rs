//! Many lookups in one call: sorted by tile, their memory sent for ahead.
//!
//! One by one, a lookup at a random place waits for memory three or four times in a row. Here lookups of one tile come together, so that
//! each tile is found once, and while one is answered the vertices of the next are on their way.

use super::pixel::{self, Search};
use super::planes::Found;
use super::query::{Batch, Query};
use super::sampler::{Address, Sampler, blend, check, narrow, side_of};
use crate::{Error, Filter, Result};

/// Lookups that are sorted together.
const CHUNK: usize = 8192;

/// How many lookups ahead memory is sent for: the table of vertices, and the vertices.
const AHEAD: [usize; 2] = [16, 8];

/// One level of one lookup.
#[derive(Clone, Copy, Debug)]
struct Task {
    address: Address,
    level: u32,
    query: u32,
}

/// What a sampler keeps between batches.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    tasks: Vec<Task>,
    /// Values of both levels of each lookup.
    values: Vec<[[f64; 3]; 2]>,
    blends: Vec<f64>,
}

impl Batch<'_> {
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
    /// [`Sampler::visibility`] of many queries; the answers are the same, and random ones come at least twice as fast.
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
        self.each_answer::<1>(batch, |i, v| out[i] = narrow(v[0]))
    }

    /// [`Sampler::visibility_rgb`] of many queries.
    ///
    /// # Errors
    /// As [`Sampler::visibility_batch`].
    pub fn visibility_rgb_batch(&mut self, batch: &Batch<'_>, out: &mut [[f32; 3]]) -> Result<()> {
        batch.check(out.len())?;
        self.each_answer::<3>(batch, |i, v| out[i] = v.map(narrow))
    }

    fn each_answer<const C: usize>(
        &mut self,
        batch: &Batch<'_>,
        mut answer: impl FnMut(usize, [f64; C]),
    ) -> Result<()> {
        let mut scratch = std::mem::take(&mut self.batch);
        let mut result = Ok(());
        for start in (0..batch.x.len()).step_by(CHUNK) {
            let end = (start + CHUNK).min(batch.x.len());
            result = self.chunk::<C>(batch, start..end, &mut scratch);
            if result.is_err() {
                break;
            }
            for (i, (values, &t)) in scratch.values.iter().zip(&scratch.blends).enumerate() {
                let [fine, coarse] = values.map(|v| std::array::from_fn(|c| v[c]));
                answer(
                    start + i,
                    if t == 0.0 {
                        fine
                    } else {
                        blend(fine, coarse, t)
                    },
                );
            }
        }
        self.batch = scratch;
        result
    }

    /// The values of the queries of a range, both levels.
    fn chunk<const C: usize>(
        &mut self,
        batch: &Batch<'_>,
        range: std::ops::Range<usize>,
        scratch: &mut Scratch,
    ) -> Result<()> {
        let Scratch {
            tasks,
            values,
            blends,
        } = scratch;
        tasks.clear();
        values.clear();
        blends.clear();
        values.resize(range.len(), [[0.0; 3]; 2]);
        let filter = self.options().filter;
        let side = side_of(filter);
        for (i, values) in values.iter_mut().enumerate() {
            let query = batch.query(range.start + i);
            check(&query)?;
            let plan = self.plan(&query.footprint);
            blends.push(plan.blend);
            for (k, level) in [plan.level, plan.level + 1].into_iter().enumerate() {
                if k == 1 && plan.blend == 0.0 {
                    continue;
                }
                let (own, shift) = (self.level(level), self.shift());
                let (origin, whole) = match side {
                    1 => own.place::<1>(filter, &query, shift),
                    2 => own.place::<2>(filter, &query, shift),
                    _ => own.place::<4>(filter, &query, shift),
                };
                if plan.is_unit() && whole {
                    tasks.push(Task {
                        address: own.address(level, origin, shift),
                        level: level as u32,
                        query: (2 * i + k) as u32,
                    });
                } else {
                    let value = self.level_value::<C>(&plan, level, &query)?;
                    values[k][..C].copy_from_slice(&value);
                }
            }
        }
        tasks.sort_unstable_by_key(|task| task.address.tile);
        let mut rest = &tasks[..];
        while let Some(first) = rest.first() {
            let same = rest
                .iter()
                .take_while(|task| task.address.tile == first.address.tile)
                .count();
            let (own, others) = rest.split_at(same);
            rest = others;
            let query = |task: &Task| batch.query(range.start + task.query as usize / 2);
            let level = first.level as usize;
            match self.options().filter {
                Filter::Nearest => self.tile_of::<C, 1>(level, own, query, values),
                Filter::Box | Filter::Triangle => self.tile_of::<C, 2>(level, own, query, values),
                Filter::Gaussian | Filter::CatmullRom => {
                    self.tile_of::<C, 4>(level, own, query, values)
                }
            }?;
        }
        Ok(())
    }

    /// The values of lookups in one tile.
    fn tile_of<const C: usize, const N: usize>(
        &mut self,
        level: usize,
        tasks: &[Task],
        query: impl Fn(&Task) -> Query,
        values: &mut [[[f64; 3]; 2]],
    ) -> Result<()> {
        let filter = self.options().filter;
        let mut put = |task: &Task, value: [f64; C]| {
            values[task.query as usize / 2][task.query as usize % 2][..C].copy_from_slice(&value);
        };
        let first = &tasks[0].address;
        let found = if C == 1 {
            let own = self.level(level).clone();
            self.with_planes(level, first, |planes| {
                for task in tasks.iter().take(AHEAD[0]) {
                    planes.send_for_table(task.address.at);
                }
                // Blocks whose vertices are on their way.
                let begin = |task: &Task| {
                    let query = query(task);
                    let (_, wx, wy) = own.block::<N>(filter, query.x, query.y);
                    Found::new(planes, task.address.at, wx, wy)
                };
                let mut coming: [Option<Found<'_, N>>; AHEAD[1]] =
                    std::array::from_fn(|i| tasks.get(i).map(begin));
                for (i, task) in tasks.iter().enumerate() {
                    if let Some(task) = tasks.get(i + AHEAD[0]) {
                        planes.send_for_table(task.address.at);
                    }
                    let next = tasks.get(i + AHEAD[1]).map(begin);
                    let found = std::mem::replace(&mut coming[i % AHEAD[1]], next);
                    let query = query(task);
                    let depth = query.depth - query.bias;
                    if let Some(found) = found {
                        put(task, [found.value(depth, &mut Search); C]);
                    }
                }
            })
        } else {
            let own = self.level(level).clone();
            self.with_tile(level, first, |tile| {
                for task in tasks {
                    let query = query(task);
                    let (_, wx, wy) = own.block::<N>(filter, query.x, query.y);
                    let depth = query.depth - query.bias;
                    put(
                        task,
                        pixel::block::<C, N>(tile, task.address.at, (&wx, &wy), depth),
                    );
                }
            })
        };
        if let Err(e) = found {
            let value = self.replace(e)?;
            tasks.iter().for_each(|task| put(task, [value; C]));
        }
        Ok(())
    }
}
