//! The compressor with nearly the fewest vertices: a breadth-first search over a few storable
//! values at every depth.
//!
//! A state is an input depth and a value just behind it. Its cost is the number of vertices up to
//! there. The search extends segments from all states of one depth and cost together, as in
//! [`super::walk`]. Every state that a segment passes costs one vertex more, or two through a step.
//! The search visits states in order of cost, so the first path to the end value is a shortest one
//! among the states considered. For each cost it considers the last depths that the cost reaches.

// Channels, blocks and lanes are indices into several arrays at once.
#![allow(clippy::needless_range_loop)]

use super::tube::{Knot, SLACK, Tube, Window, knots};
use super::walk::{CANDIDATES, Walk};
use crate::{Curve, Visibility};

/// The largest number of states of a depth. The lattice of [`crate::raw::Precision::for_tolerance`]
/// has nine values in the tube; all of them are states.
const STATES: usize = 12;
/// The search continues each cost from the last `BREADTH` depths that the cost reaches.
const BREADTH: usize = 24;
/// Of these, the last `DENSE` are all used. The others are used with a stride of 1 to 4: segment
/// ends that are far apart differ more than neighbours.
const DENSE: usize = 3;
/// The stride is the length of a segment, in depths, divided by this.
const STRIDES: usize = 3;
/// Set in the predecessor of a state that is reached through a step.
const STEP: u32 = 1 << 31;
/// The predecessor of a first vertex.
const NONE: u32 = u32::MAX;

const BLOCKS: usize = STATES / 4;
/// One number per state, in blocks that fit vector registers.
type Row = [[f64; 4]; BLOCKS];

/// The values that the search considers just behind one depth, the lowest first.
#[derive(Clone, Copy, Debug)]
struct States<const C: usize> {
    y: [[f64; STATES]; C],
    n: usize,
    /// Mask of the states inside the window of a segment that passes the depth.
    passable: u16,
}

/// Segments from the states of one depth, one per lane.
#[derive(Clone, Copy, Debug)]
struct Lanes<const C: usize> {
    y: [Row; C],
    lo: [Row; C],
    hi: [Row; C],
    /// Number of blocks in use.
    n: usize,
}

impl<const C: usize> Lanes<C> {
    /// The lanes of the states in `mask`, and the state of each lane.
    fn new(states: &States<C>, mut mask: u16) -> (Self, [u8; STATES]) {
        // Unused lanes of a block keep a greatest slope of minus infinity, so they never pass.
        let mut lanes = Lanes {
            y: [[[0.0; 4]; BLOCKS]; C],
            lo: [[[f64::NEG_INFINITY; 4]; BLOCKS]; C],
            hi: [[[f64::NEG_INFINITY; 4]; BLOCKS]; C],
            n: 0,
        };
        let mut of = [0; STATES];
        let mut n = 0;
        while mask != 0 && n < STATES {
            let s = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            for c in 0..C {
                lanes.y[c][n / 4][n % 4] = states.y[c][s];
                lanes.hi[c][n / 4][n % 4] = 0.0;
            }
            of[n] = s as u8;
            n += 1;
        }
        lanes.n = n.div_ceil(4);
        (lanes, of)
    }

    /// Writes to `to` the lanes with their slopes narrowed to those that pass `w`. Returns whether
    /// any lane passes.
    #[inline(always)]
    fn clip(&self, w: &Window<C>, inverse: f64, to: &mut Self) -> bool {
        let mut widest = [f64::NEG_INFINITY; 4];
        for b in 0..self.n.min(BLOCKS) {
            let mut room = [f64::INFINITY; 4];
            for c in 0..C {
                let (y, lo, hi) = (&self.y[c][b], &self.lo[c][b], &self.hi[c][b]);
                let (to_lo, to_hi) = (&mut to.lo[c][b], &mut to.hi[c][b]);
                for k in 0..4 {
                    let least = (w.lo[c] - y[k]) * inverse;
                    let most = (w.hi[c] - y[k]) * inverse;
                    to_lo[k] = if least > lo[k] { least } else { lo[k] };
                    to_hi[k] = if most < hi[k] { most } else { hi[k] };
                    let r = to_hi[k] - to_lo[k];
                    room[k] = if r < room[k] { r } else { room[k] };
                }
            }
            for k in 0..4 {
                widest[k] = if room[k] > widest[k] {
                    room[k]
                } else {
                    widest[k]
                };
            }
        }
        widest.iter().any(|&r| r >= 0.0)
    }

    /// The least and the greatest value that each lane reaches at distance `dz`.
    #[inline(always)]
    fn spans(&self, dz: f64) -> [[Row; C]; 2] {
        let mut spans = [[[[f64::NAN; 4]; BLOCKS]; C]; 2];
        for b in 0..self.n.min(BLOCKS) {
            for c in 0..C {
                let (y, lo, hi) = (&self.y[c][b], &self.lo[c][b], &self.hi[c][b]);
                for k in 0..4 {
                    let most = y[k] + hi[k] * dz + SLACK;
                    spans[0][c][b][k] = y[k] + lo[k] * dz - SLACK;
                    spans[1][c][b][k] = if most < y[k] { most } else { y[k] };
                }
            }
        }
        spans
    }

    /// The first lane whose span contains `y`.
    #[inline(always)]
    fn passing(&self, spans: &[[Row; C]; 2], y: &[f64; C]) -> Option<usize> {
        for b in 0..self.n.min(BLOCKS) {
            let mut hit = [1u64; 4];
            for c in 0..C {
                for k in 0..4 {
                    let (lo, hi) = (spans[0][c][b][k], spans[1][c][b][k]);
                    hit[k] &= u64::from(lo <= y[c]) & u64::from(y[c] <= hi);
                }
            }
            if hit != [0; 4] {
                return hit.iter().position(|&hit| hit != 0).map(|k| 4 * b + k);
            }
        }
        None
    }

    /// The least and the greatest storable values that lane `k` reaches at distance `dz`.
    fn reach(&self, tube: &Tube<C>, k: usize, dz: f64) -> Option<([f64; C], [f64; C])> {
        let at = |row: &Row| row[k / 4][k % 4];
        let segment = |c: usize| [at(&self.y[c]), at(&self.lo[c]), at(&self.hi[c])];
        tube.reach(segment, dz, &tube.end)
    }
}

/// Functions with more depths than this use the walk with several candidates instead of the search.
/// If segments span a hundred thousand depths, the search takes more than linear time and finds no
/// better output.
const LONG: usize = 1 << 16;

/// The search over one function. Its memory is reused for the next one.
#[derive(Clone, Debug)]
pub(super) struct MinimalSearch<const C: usize> {
    tube: Tube<C>,
    knots: Vec<Knot<C>>,
    windows: Vec<Window<C>>,
    /// States of each depth; empty until the search reaches the depth.
    states: Vec<States<C>>,
    /// Mask, for each depth, of the states with lower costs than the current one.
    done: Vec<u16>,
    /// Masks, for each depth, of the states at the current cost, at the next, and at the one after.
    cost: [Vec<u16>; 3],
    /// Predecessor of each state, with the bit [`STEP`], or [`NONE`].
    from: Vec<u32>,
    /// Index of the first depth behind which the end value is in the tube to the end.
    ending: usize,
    /// The states of the output, last first.
    path: Vec<u32>,
}

impl<const C: usize> MinimalSearch<C> {
    pub fn new(tube: Tube<C>) -> Self {
        MinimalSearch {
            tube,
            knots: Vec::new(),
            windows: Vec::new(),
            states: Vec::new(),
            done: Vec::new(),
            cost: Default::default(),
            from: Vec::new(),
            ending: 0,
            path: Vec::new(),
        }
    }

    /// Compresses a function and appends its vertices to `out`.
    pub fn compress(&mut self, tube: Tube<C>, curve: &Curve, out: &mut Visibility) {
        self.tube = tube;
        self.knots.clear();
        knots(curve, |e, _| {
            self.knots.push(*e);
            true
        });
        if tube.end == [1.0; C] {
            return;
        }
        let is_short = self.knots.len() <= LONG;
        match is_short.then(|| self.search()).flatten() {
            Some(end) => self.trace(end, out),
            None => Walk::<C, CANDIDATES>::new(tube).compress(tube, curve, out),
        }
    }

    fn prepare(&mut self) {
        let (n, tube) = (self.knots.len(), &self.tube);
        self.windows.clear();
        let windows = self.knots.iter().map(|e| tube.through(e));
        self.windows.extend(windows);
        self.states.clear();
        let none = States {
            y: [[0.0; STATES]; C],
            n: 0,
            passable: 0,
        };
        self.states.resize(n, none);
        for list in self.cost.iter_mut().chain([&mut self.done]) {
            list.clear();
            list.resize(n, 0);
        }
        self.from.resize(n * STATES, NONE);
        self.ending = self.knots.partition_point(|e| !tube.tail(e));
    }

    /// The states of depth `i`. Computes them at the first call.
    #[inline]
    fn states_of(&mut self, i: usize) -> &States<C> {
        if self.states[i].n == 0 {
            self.states[i] = states(&self.tube, &self.knots[i], &self.windows[i]);
        }
        &self.states[i]
    }

    /// Returns the state at which the output reaches its end value, or `None` if no path leads
    /// there.
    fn search(&mut self) -> Option<u32> {
        self.prepare();
        // Cost 1: the step from 1 at the first vertex costs no vertex of its own.
        let mut far = 0;
        for (i, e) in self.knots.iter().enumerate() {
            if !self.tube.lit(e) {
                break;
            }
            far = i;
            if self.tube.tail(e) || !self.tube.lit_through(e) {
                break;
            }
        }
        let mut low = (far + 1).saturating_sub(BREADTH);
        for i in low..=far {
            self.cost[0][i] = (1 << self.states_of(i).n) - 1;
            self.from[i * STATES..][..STATES].fill(NONE);
        }
        loop {
            // No state has this cost if the previous one reached states only through steps.
            let reached = self.cost[0][low..=far].iter().rposition(|&mask| mask != 0);
            let now = low + reached.unwrap_or(0);
            let first = (now + 1).saturating_sub(BREADTH).max(low);
            if let Some(i) =
                (first..=now).find(|&i| self.cost[0][i] & 1 != 0 && self.tube.tail(&self.knots[i]))
            {
                return Some((i * STATES) as u32);
            }
            // The farthest state comes first, because it shows about how far this cost reaches.
            let mut next = reached.map_or(now, |_| self.probe(now));
            let stride = ((next - now) / STRIDES).clamp(1, 4);
            for i in (first..=now).rev() {
                if self.cost[0][i] == 0 {
                    continue;
                }
                match self.expand(i, (next + 1).saturating_sub(BREADTH), stride) {
                    Ok(reached) => next = next.max(reached),
                    Err(end) => return Some(end),
                }
            }
            far = far.max(next);
            for i in low..=far {
                let cost = &mut self.cost;
                self.done[i] |= cost[0][i];
                cost[0][i] = cost[1][i] & !self.done[i];
                cost[1][i] = cost[2][i] & !cost[0][i] & !self.done[i];
                cost[2][i] = 0;
            }
            while low < far && self.cost[0][low] == 0 && self.cost[1][low] == 0 {
                low += 1;
            }
            if self.cost[0][low] == 0 && self.cost[1][low] == 0 {
                return None;
            }
        }
    }

    /// Index of the last depth that a segment from the states at `i` passes.
    fn probe(&self, i: usize) -> usize {
        let z0 = self.knots[i].z;
        let (mut lanes, _) = Lanes::new(&self.states[i], self.cost[0][i]);
        let (mut lanes, mut clipped) = (&mut lanes.clone(), &mut lanes);
        for j in i + 1..self.knots.len() {
            if !lanes.clip(&self.windows[j], 1.0 / (self.knots[j].z - z0), clipped) {
                return j - 1;
            }
            std::mem::swap(&mut lanes, &mut clipped);
        }
        self.knots.len() - 1
    }

    /// Extends segments from the states at `i` with the current cost, and marks the states that
    /// they reach.
    ///
    /// Considers depths from index `from` on, in strides except for the last few. Returns the index
    /// of the farthest depth reached or, as an error, the state at the end value.
    fn expand(&mut self, i: usize, from: usize, stride: usize) -> Result<usize, u32> {
        let z0 = self.knots[i].z;
        let (mut lanes, of) = Lanes::new(&self.states[i], self.cost[0][i]);
        let (mut lanes, mut clipped) = (&mut lanes.clone(), &mut lanes);
        let mut furthest = i;
        for j in i + 1..self.knots.len() {
            let dz = self.knots[j].z - z0;
            let alive = lanes.clip(&self.windows[j], 1.0 / dz, clipped);
            if !alive {
                // To end a segment at a small step and start another behind it saves almost
                // nothing.
                let e = &self.knots[j];
                let large = |c: usize| e.front[c] - e.behind[c] > 0.5 * self.tube.eps;
                if ((0..C).any(large) || j == i + 1) && self.step(i, j, lanes, &of) {
                    furthest = j;
                }
                break;
            }
            let kept = j >= from && (j >= from + (BREADTH - DENSE) || j % stride == 0);
            // The end value is a target at every depth, also where the other states are skipped.
            let ending = j >= self.ending;
            if kept || ending || j == i + 1 {
                let passable = self.states_of(j).passable;
                let seen = self.done[j] | self.cost[0][j] | self.cost[1][j];
                let mut wanted = passable & !seen;
                if !kept && j != i + 1 {
                    wanted &= 1;
                }
                let spans = (wanted != 0).then(|| clipped.spans(dz));
                while wanted != 0 {
                    let s = wanted.trailing_zeros() as usize;
                    wanted &= wanted - 1;
                    let y = std::array::from_fn(|c| self.states[j].y[c][s]);
                    let passing = spans.as_ref().and_then(|spans| clipped.passing(spans, &y));
                    if let Some(k) = passing {
                        self.from[j * STATES + s] = (i * STATES) as u32 + u32::from(of[k]);
                        self.cost[1][j] |= 1 << s;
                        furthest = j;
                        if s == 0 && ending {
                            return Err((j * STATES) as u32);
                        }
                    }
                }
                if ((j == i + 1 && passable == 0) || j + 1 == self.knots.len())
                    && self.step(i, j, lanes, &of)
                {
                    furthest = j;
                }
            }
            std::mem::swap(&mut lanes, &mut clipped);
        }
        Ok(furthest)
    }

    /// Ends the segments from `i` in front of the step at `j`, and marks the states behind it.
    /// Returns whether any segment can end there.
    fn step(&mut self, i: usize, j: usize, lanes: &Lanes<C>, of: &[u8; STATES]) -> bool {
        let dz = self.knots[j].z - self.knots[i].z;
        let states = *self.states_of(j);
        let mut clipped = *lanes;
        lanes.clip(&self.tube.front(&self.knots[j]), 1.0 / dz, &mut clipped);
        let mut possible = false;
        for k in 0..4 * lanes.n {
            let Some((_, high)) = clipped.reach(&self.tube, k, dz) else {
                continue;
            };
            possible = true;
            let [now, next, later] = &self.cost;
            let mut wanted = ((1 << states.n) - 1) & !self.done[j] & !now[j] & !next[j] & !later[j];
            while wanted != 0 {
                let s = wanted.trailing_zeros() as usize;
                wanted &= wanted - 1;
                if (0..C).all(|c| states.y[c][s] <= high[c]) {
                    self.from[j * STATES + s] = ((i * STATES) as u32 + u32::from(of[k])) | STEP;
                    self.cost[2][j] |= 1 << s;
                }
            }
        }
        possible
    }

    fn value(&self, state: u32) -> [f64; C] {
        let (i, s) = (state as usize / STATES, state as usize % STATES);
        std::array::from_fn(|c| self.states[i].y[c][s])
    }

    /// Stores the path to the state `end`.
    fn trace(&mut self, end: u32, out: &mut Visibility) {
        self.path.clear();
        self.path.push(end);
        while let Some(&last) = self.path.last() {
            let from = self.from[last as usize];
            if from == NONE {
                break;
            }
            self.path.push(from & !STEP);
        }
        for at in (0..self.path.len()).rev() {
            let state = self.path[at];
            let (j, y) = (state as usize / STATES, self.value(state));
            let (from, z) = (self.from[state as usize], self.knots[j].z as f32);
            if from != NONE && from & STEP != 0 {
                let high = self.front_of_step(from & !STEP, j, &y);
                out.vertices.push(z, &high.map(|v| v as f32));
            }
            out.vertices.push(z, &y.map(|v| v as f32));
        }
    }

    /// The value in front of the step at `j`: the reachable one nearest to the input.
    ///
    /// Extends the segment from the state `from` again; `y` is the value behind the step.
    fn front_of_step(&self, from: u32, j: usize, y: &[f64; C]) -> [f64; C] {
        let (i, s) = (from as usize / STATES, from as usize % STATES);
        let (mut lanes, _) = Lanes::new(&self.states[i], 1 << s);
        let dz = |j: usize| self.knots[j].z - self.knots[i].z;
        let mut clipped = lanes;
        for between in i + 1..j {
            lanes.clip(&self.windows[between], 1.0 / dz(between), &mut clipped);
            std::mem::swap(&mut lanes, &mut clipped);
        }
        let front = self.tube.front(&self.knots[j]);
        lanes.clip(&front, 1.0 / dz(j), &mut clipped);
        let range = clipped.reach(&self.tube, 0, dz(j));
        let (first, last) = range.unwrap_or_else(|| (*y, self.value(from)));
        std::array::from_fn(|c| {
            let near = self.tube.grid.nearest(self.knots[j].front[c]);
            near.clamp(first[c].max(y[c]), last[c])
        })
    }
}

/// The values to consider just behind `e`: all storable ones in the tube, or an even selection.
fn states<const C: usize>(tube: &Tube<C>, e: &Knot<C>, through: &Window<C>) -> States<C> {
    let w = tube.behind(e);
    let range = |lo: f64, hi: f64| tube.grid.between(lo, hi).unwrap_or((lo, lo));
    let ends: [(f64, f64); C] = std::array::from_fn(|c| range(w.lo[c], w.hi[c]));
    let most = ends
        .iter()
        .map(|&(first, last)| ((last - first) / tube.grid.gap).ceil() as usize + 1)
        .fold(1, usize::max);
    let n = most.min(STATES - 1);
    let mut states = States {
        y: [[0.0; STATES]; C],
        n,
        passable: 0,
    };
    for (c, &(first, last)) in ends.iter().enumerate() {
        for s in 0..n {
            let y = first + (last - first) * (s as f64 / (n - 1).max(1) as f64);
            states.y[c][s] = tube.grid.nearest(y).clamp(first, last);
        }
    }
    // A segment from any state that passes this depth can reach the lowest storable value that
    // passes it. With several channels the even selection may lack that value: it may be low in the
    // range of one channel and high in that of another.
    let lowest: [Option<(f64, f64)>; C] =
        std::array::from_fn(|c| tube.grid.between(through.lo[c], through.hi[c]));
    if (n < most || C > 1) && lowest.iter().all(Option::is_some) {
        let y: [f64; C] = lowest.map(|range| range.map_or(0.0, |(first, _)| first));
        if n < most || !(0..n).any(|s| (0..C).all(|c| states.y[c][s] == y[c])) {
            for c in 0..C {
                states.y[c][n] = y[c];
            }
            states.n = n + 1;
        }
    }
    for s in 0..states.n {
        let inside = |c: usize| (through.lo[c]..=through.hi[c]).contains(&states.y[c][s]);
        states.passable |= u16::from((0..C).all(inside)) << s;
    }
    states
}
