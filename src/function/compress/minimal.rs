//! Nearly the fewest vertices: a breadth-first search over a few storable values at every depth.
//!
//! A state is an input depth with a value just behind it; its cost is the number of vertices up to there. From all
//! states of one depth and cost, segments are walked forward together, as in [`super::walk`], and every
//! state that they pass is reached for one vertex more, or two through a step. Depths are visited in order of
//! cost, so the first way to the end value is a shortest one, among the states that are considered.

use super::tube::{Event, SLACK, Tube, Window};
use crate::Visibility;

/// States of a depth. The lattice of [`super::lattice_for`] has nine values in the tube, all of which are states.
const STATES: usize = 12;
/// Depths of one cost that are continued.
const BREADTH: usize = 24;
/// Marks a state that is reached through a step.
const STEP: u32 = 1 << 31;
const NONE: u32 = u32::MAX;

/// The values considered behind one depth, the lowest first.
#[derive(Clone, Copy, Debug)]
struct States<const C: usize> {
    y: [[f64; STATES]; C],
    n: usize,
}

/// Segments from the states of one depth.
#[derive(Clone, Copy, Debug)]
struct Lanes<const C: usize> {
    y: [[f64; STATES]; C],
    lo: [[f64; STATES]; C],
    hi: [[f64; STATES]; C],
    /// Lanes in use, with what fills them up to a multiple of four.
    n: usize,
}

impl<const C: usize> Lanes<C> {
    fn new(states: &States<C>, mut mask: u16) -> (Self, [u8; STATES]) {
        let mut lanes = Lanes {
            y: [[0.0; STATES]; C],
            lo: [[f64::NEG_INFINITY; STATES]; C],
            hi: [[f64::NEG_INFINITY; STATES]; C],
            n: 0,
        };
        let mut of = [0; STATES];
        let mut n = 0;
        while mask != 0 {
            let s = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            for c in 0..C {
                lanes.y[c][n] = states.y[c][s];
                lanes.hi[c][n] = 0.0;
            }
            of[n] = s as u8;
            n += 1;
        }
        // What fills up keeps a greatest slope of minus infinity, so it is never alive.
        lanes.n = n.next_multiple_of(4);
        (lanes, of)
    }

    /// Narrows the slopes to those that pass `w`. Whether any lane is left.
    #[inline(always)]
    fn clip(&mut self, w: &Window<C>, inverse: f64) -> bool {
        let n = self.n.min(STATES);
        let mut alive = [true; STATES];
        for c in 0..C {
            let (y, lo, hi) = (&self.y[c][..n], &mut self.lo[c][..n], &mut self.hi[c][..n]);
            for k in 0..n {
                let a = (w.lo[c] - y[k]) * inverse;
                let b = (w.hi[c] - y[k]) * inverse;
                lo[k] = if a > lo[k] { a } else { lo[k] };
                hi[k] = if b < hi[k] { b } else { hi[k] };
                alive[k] &= lo[k] <= hi[k];
            }
        }
        alive[..n].iter().fold(false, |any, &a| any | a)
    }

    /// A lane whose segments pass `y` at distance `dz`.
    #[inline]
    fn passing(&self, y: &[f64; C], dz: f64) -> Option<usize> {
        (0..self.n.min(STATES)).find(|&k| {
            (0..C).all(|c| {
                let y0 = self.y[c][k];
                let fall = y[c] - y0;
                fall <= 0.0
                    && fall >= self.lo[c][k] * dz - SLACK
                    && fall <= self.hi[c][k] * dz + SLACK
            })
        })
    }

    /// The least and the greatest storable values that lane `k` reaches at distance `dz`.
    fn reach(&self, tube: &Tube<C>, k: usize, dz: f64) -> Option<([f64; C], [f64; C])> {
        let (mut first, mut last) = ([0.0; C], [0.0; C]);
        for c in 0..C {
            let y = self.y[c][k];
            if !(self.lo[c][k] <= self.hi[c][k]) {
                return None;
            }
            let lo = (y + self.lo[c][k] * dz - SLACK).max(tube.end[c]);
            let hi = (y + self.hi[c][k] * dz + SLACK).min(y);
            (first[c], last[c]) = tube.grid.between(lo, hi)?;
        }
        Some((first, last))
    }
}

/// The search; it holds one function at a time.
#[derive(Clone, Debug)]
pub(super) struct Search<const C: usize> {
    tube: Tube<C>,
    events: Vec<Event<C>>,
    windows: Vec<Window<C>>,
    states: Vec<States<C>>,
    /// States inside the window of a segment that passes the depth.
    passable: Vec<u16>,
    /// States of the costs so far; of the cost at hand, of the next, and of the one after that.
    done: Vec<u16>,
    cost: [Vec<u16>; 3],
    from: Vec<u32>,
    layer: Vec<u32>,
    path: Vec<u32>,
}

impl<const C: usize> Search<C> {
    pub fn new(tube: Tube<C>) -> Self {
        Search {
            tube,
            events: Vec::new(),
            windows: Vec::new(),
            states: Vec::new(),
            passable: Vec::new(),
            done: Vec::new(),
            cost: Default::default(),
            from: Vec::new(),
            layer: Vec::new(),
            path: Vec::new(),
        }
    }

    /// Starts on another function.
    pub fn begin(&mut self, tube: Tube<C>) {
        self.tube = tube;
        self.events.clear();
    }

    /// Takes the next event.
    #[inline]
    pub fn event(&mut self, e: &Event<C>) {
        self.events.push(*e);
    }

    /// Finds the output.
    pub fn finish(&mut self, out: &mut Visibility) {
        if self.events.is_empty() || self.tube.end.iter().all(|&e| e == 1.0) {
            return;
        }
        self.prepare();
        let end = self.search();
        self.trace(end, out);
    }

    fn prepare(&mut self) {
        let n = self.events.len();
        self.windows.clear();
        self.states.clear();
        self.passable.clear();
        for e in &self.events {
            let through = self.tube.through(e);
            let states = states(&self.tube, e, &through);
            let mut mask = 0;
            for s in 0..states.n {
                let inside = |c: usize| {
                    let y = states.y[c][s];
                    through.lo[c] <= y && y <= through.hi[c]
                };
                mask |= u16::from((0..C).all(inside)) << s;
            }
            self.windows.push(through);
            self.states.push(states);
            self.passable.push(mask);
        }
        for list in self.cost.iter_mut().chain([&mut self.done]) {
            list.clear();
            list.resize(n, 0);
        }
        self.from.clear();
        self.from.resize(n * STATES, NONE);
    }

    /// Returns the state at which the output has come to its end value.
    fn search(&mut self) -> u32 {
        // Cost 1: the step from 1 at the first vertex is free.
        let (mut begin, mut end) = (0, 0);
        for (i, e) in self.events.iter().enumerate() {
            if !self.tube.lit(e) {
                break;
            }
            self.cost[0][i] = (1 << self.states[i].n) - 1;
            end = i + 1;
            if self.tube.tail(e) {
                return (i * STATES) as u32;
            }
            if !self.tube.lit_through(e) {
                break;
            }
        }
        loop {
            self.layer.clear();
            self.layer.extend(
                (begin..end)
                    .filter(|&i| self.cost[0][i] != 0)
                    .map(|i| i as u32),
            );
            thin(&mut self.layer);
            let mut far = end;
            for at in 0..self.layer.len() {
                let i = self.layer[at] as usize;
                if self.tube.tail(&self.events[i]) && self.cost[0][i] & 1 != 0 {
                    return (i * STATES) as u32;
                }
            }
            for at in 0..self.layer.len() {
                let i = self.layer[at] as usize;
                match self.expand(i) {
                    Ok(reached) => far = far.max(reached + 1),
                    Err(end) => return end,
                }
            }
            for i in begin..far {
                let cost = &mut self.cost;
                self.done[i] |= cost[0][i];
                cost[0][i] = cost[1][i] & !self.done[i];
                cost[1][i] = cost[2][i] & !cost[0][i] & !self.done[i];
                cost[2][i] = 0;
            }
            while begin < far && self.cost[0][begin] == 0 && self.cost[1][begin] == 0 {
                begin += 1;
            }
            end = far;
            if begin >= end {
                debug_assert!(false, "no way to the end value");
                return ((self.events.len() - 1) * STATES) as u32;
            }
        }
    }

    /// Walks on from the states at `i` of the cost at hand. Returns the furthest depth reached, or the
    /// state at the end value as an error.
    fn expand(&mut self, i: usize) -> Result<usize, u32> {
        let z0 = self.events[i].z;
        let (mut lanes, of) = Lanes::new(&self.states[i], self.cost[0][i]);
        let mut furthest = i;
        for j in i + 1..self.events.len() {
            let dz = self.events[j].z - z0;
            let before = lanes;
            if !lanes.clip(&self.windows[j], 1.0 / dz) {
                if self.step(i, j, before, &of) {
                    furthest = j;
                }
                break;
            }
            let mut wanted = self.passable[j] & !self.done[j] & !self.cost[0][j] & !self.cost[1][j];
            while wanted != 0 {
                let s = wanted.trailing_zeros() as usize;
                wanted &= wanted - 1;
                let y = std::array::from_fn(|c| self.states[j].y[c][s]);
                if let Some(k) = lanes.passing(&y, dz) {
                    self.from[j * STATES + s] = (i * STATES) as u32 + u32::from(of[k]);
                    self.cost[1][j] |= 1 << s;
                    furthest = j;
                    if s == 0 && self.tube.tail(&self.events[j]) {
                        return Err((j * STATES) as u32);
                    }
                }
            }
            if (j == i + 1 && self.passable[j] == 0) || j + 1 == self.events.len() {
                if self.step(i, j, before, &of) {
                    furthest = j;
                }
            }
        }
        Ok(furthest)
    }

    /// Ends the segments from `i` in front of the step at `j`. Whether that is possible.
    fn step(&mut self, i: usize, j: usize, mut lanes: Lanes<C>, of: &[u8; STATES]) -> bool {
        let dz = self.events[j].z - self.events[i].z;
        let states = self.states[j];
        lanes.clip(&self.tube.front(&self.events[j]), 1.0 / dz);
        let mut possible = false;
        for k in 0..lanes.n {
            let Some((_, high)) = lanes.reach(&self.tube, k, dz) else {
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

    /// Stores the way to `end`.
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
            let from = self.from[state as usize];
            if from != NONE && from & STEP != 0 {
                let high = self.front_of_step(from & !STEP, j, &y);
                out.push_unchecked(self.events[j].z as f32, &high.map(|v| v as f32));
            }
            out.push_unchecked(self.events[j].z as f32, &y.map(|v| v as f32));
        }
    }

    /// The value in front of a step at `j`, walked once more from the state before, near the input's.
    fn front_of_step(&self, from: u32, j: usize, y: &[f64; C]) -> [f64; C] {
        let (i, s) = (from as usize / STATES, from as usize % STATES);
        let (mut lanes, _) = Lanes::new(&self.states[i], 1 << s);
        let dz = |j: usize| self.events[j].z - self.events[i].z;
        for between in i + 1..j {
            lanes.clip(&self.windows[between], 1.0 / dz(between));
        }
        lanes.clip(&self.tube.front(&self.events[j]), 1.0 / dz(j));
        let (first, last) = match lanes.reach(&self.tube, 0, dz(j)) {
            Some(range) => range,
            None => (*y, self.value(from)),
        };
        std::array::from_fn(|c| {
            let near = self.tube.grid.nearest(self.events[j].front[c]);
            near.clamp(first[c].max(y[c]), last[c])
        })
    }
}

/// Keeps the second half of what may stay, and an even choice of the rest.
fn thin(layer: &mut Vec<u32>) {
    let n = layer.len();
    if n <= BREADTH {
        return;
    }
    let (half, rest) = (BREADTH / 2, n - BREADTH / 2);
    for k in 0..half {
        layer[k] = layer[k * rest / half];
    }
    layer.copy_within(rest.., half);
    layer.truncate(BREADTH);
}

/// The values to consider behind `e`: all that are storable, or an even choice of them.
fn states<const C: usize>(tube: &Tube<C>, e: &Event<C>, through: &Window<C>) -> States<C> {
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
    };
    for (c, &(first, last)) in ends.iter().enumerate() {
        for s in 0..n {
            let y = first + (last - first) * (s as f64 / (n - 1).max(1) as f64);
            states.y[c][s] = tube.grid.nearest(y).clamp(first, last);
        }
    }
    // From any state, the lowest value at which the next depth can be passed is in reach.
    let lowest: [Option<(f64, f64)>; C] =
        std::array::from_fn(|c| tube.grid.between(through.lo[c], through.hi[c]));
    if n < most && lowest.iter().all(Option::is_some) {
        for c in 0..C {
            states.y[c][n] = lowest[c].map_or(0.0, |(first, _)| first);
        }
        states.n = n + 1;
    }
    states
}
