//! The greedy walk of LV00, section 3.3, from one origin or from several at once.
//!
//! A *fan* is a set of `K` candidate origins for a segment. Each has the range of slopes that pass
//! every window so far. With one candidate this is the paper's algorithm. With several, the walk
//! extends the segment from all of them and stores the one that reaches farthest. Some candidates
//! lie at the last depth that the previous segment reaches, where the tube leaves few values to
//! choose from. The others lie at earlier depths, where it leaves more.

use std::ops::Range;

use super::tube::{Knot, SLACK, Tube, Window, knots};
use crate::{Curve, Visibility};

/// Number of knots that are kept while the slopes reach no storable value.
const MEMORY: usize = 64;
/// Number of candidates at one depth.
const GROUP: usize = 2;
/// Minimum length of the value range at the origin of each group after the first, in tolerances.
const SHARES: [f64; 3] = [0.4, 0.8, 1.3];
/// Number of candidates of a walk with all groups.
pub(super) const CANDIDATES: usize = GROUP * (1 + SHARES.len());

/// The candidate origins of a segment: depth, value, least and greatest slope.
#[derive(Clone, Copy, Debug)]
struct Fan<const C: usize, const K: usize> {
    z0: [f64; K],
    y: [[f64; K]; C],
    lo: [[f64; K]; C],
    hi: [[f64; K]; C],
}

impl<const C: usize, const K: usize> Fan<C, K> {
    /// All candidates have value 1 and every slope that does not rise.
    const NEW: Self = Fan {
        z0: [0.0; K],
        y: [[1.0; K]; C],
        lo: [[f64::NEG_INFINITY; K]; C],
        hi: [[0.0; K]; C],
    };

    /// Places the candidates in `lanes` at depth `z`, spread over the storable values from `first`
    /// to `last`.
    fn spread(
        &mut self,
        tube: &Tube<C>,
        lanes: Range<usize>,
        z: f64,
        first: &[f64; C],
        last: &[f64; C],
    ) {
        let n = lanes.len();
        for (i, k) in lanes.enumerate() {
            let t = match n {
                1 => 0.5,
                _ => i as f64 / (n - 1) as f64,
            };
            self.z0[k] = z;
            for c in 0..C {
                let y = first[c] + (last[c] - first[c]) * t;
                self.y[c][k] = tube.grid.nearest(y).clamp(first[c], last[c]);
                self.lo[c][k] = f64::NEG_INFINITY;
                self.hi[c][k] = 0.0;
            }
        }
    }

    /// Narrows the slopes to those that pass `w` at depth `z`.
    ///
    /// Returns the length of the longest range of values that a candidate still reaches there, in
    /// its narrowest channel. The length is negative if no candidate passes.
    #[inline(always)]
    fn clip(&mut self, w: &Window<C>, z: f64) -> f64 {
        self.clip_lanes(w, z, 0..K)
    }

    #[inline(always)]
    fn clip_lanes(&mut self, w: &Window<C>, z: f64, lanes: Range<usize>) -> f64 {
        let mut widest = f64::NEG_INFINITY;
        let mut room = [f64::INFINITY; K];
        let mut inverse = [0.0; K];
        for k in lanes.clone() {
            inverse[k] = 1.0 / (z - self.z0[k]);
        }
        for c in 0..C {
            for k in lanes.clone() {
                let a = (w.lo[c] - self.y[c][k]) * inverse[k];
                let b = (w.hi[c] - self.y[c][k]) * inverse[k];
                let lo = &mut self.lo[c][k];
                let hi = &mut self.hi[c][k];
                *lo = if a > *lo { a } else { *lo };
                *hi = if b < *hi { b } else { *hi };
                let r = *hi - *lo;
                room[k] = if r < room[k] { r } else { room[k] };
            }
        }
        for k in lanes {
            let r = room[k] * (z - self.z0[k]);
            widest = if r > widest { r } else { widest };
        }
        widest
    }

    /// [`Tube::reach`] of candidate `k` at depth `z`.
    fn reach(
        &self,
        tube: &Tube<C>,
        k: usize,
        z: f64,
        low: &[f64; C],
    ) -> Option<([f64; C], [f64; C])> {
        let segment = |c: usize| [self.y[c][k], self.lo[c][k], self.hi[c][k]];
        tube.reach(segment, z - self.z0[k], low)
    }

    /// Whether a candidate reaches a storable value of at least `low` at depth `z`. A quick test
    /// that may return false for one that does.
    #[inline(always)]
    fn holds(&self, tube: &Tube<C>, z: f64, low: &[f64; C]) -> bool {
        (0..K).any(|k| {
            let dz = z - self.z0[k];
            (0..C).all(|c| {
                let (lo, hi) = (self.lo[c][k] * dz, self.hi[c][k] * dz);
                let middle = self.y[c][k] + 0.5 * (lo + hi);
                let near = tube.grid.nearest(middle.clamp(0.0, 1.0));
                let fall = near - self.y[c][k];
                low[c] <= near && lo <= fall && fall <= hi
            })
        })
    }

    /// The candidate that reaches the longest range of storable values from `low` up at depth `z`,
    /// and the ends of that range.
    fn best(&self, tube: &Tube<C>, z: f64, low: &[f64; C]) -> Option<(usize, [f64; C], [f64; C])> {
        let mut best = None;
        let mut most = -1.0;
        for k in 0..K {
            if let Some((first, last)) = self.reach(tube, k, z, low) {
                let room = (0..C).fold(f64::INFINITY, |r, c| r.min(last[c] - first[c]));
                if room > most {
                    most = room;
                    best = Some((k, first, last));
                }
            }
        }
        best
    }

    /// A candidate that reaches the end value at depth `z`.
    fn arrives(&self, tube: &Tube<C>, z: f64) -> Option<usize> {
        (0..K).find(|&k| {
            let dz = z - self.z0[k];
            (0..C).all(|c| {
                let (y, e) = (self.y[c][k], tube.end[c]);
                y + self.lo[c][k] * dz <= e + SLACK
                    && y + self.hi[c][k] * dz >= e - SLACK
                    && self.lo[c][k] <= self.hi[c][k]
            })
        })
    }

    /// Removes the candidates in `lanes`.
    fn close(&mut self, lanes: Range<usize>) {
        for k in lanes {
            self.z0[k] = self.z0[0];
            for c in 0..C {
                (self.lo[c][k], self.hi[c][k]) = (f64::INFINITY, f64::NEG_INFINITY);
            }
        }
    }

    fn value(&self, k: usize) -> [f64; C] {
        std::array::from_fn(|c| self.y[c][k])
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    /// No vertex yet: the output is 1.
    Lit,
    /// The walk is inside a segment.
    Walking,
    /// The end value is stored, and the output stays there.
    Done,
}

/// The walk over one function. The size of its state does not depend on the length of the input.
#[derive(Clone, Debug)]
pub(super) struct Walk<const C: usize, const K: usize> {
    tube: Tube<C>,
    mode: Mode,
    /// Depth of the last origin among the fan's candidates.
    z0: f64,
    fan: Fan<C, K>,
    /// Depth of the last accepted knot. The fan reaches a storable value there if `pending` is
    /// empty.
    z: f64,
    /// Knots accepted after the last one at which the fan reached a storable value. That one is at
    /// depth `kept_z`, where the fan was `kept`.
    pending: Vec<Knot<C>>,
    kept: Fan<C, K>,
    kept_z: f64,
    /// The last knot that was passed while the output is 1.
    passed: Option<Knot<C>>,
    /// Stack of the knots that the walk takes next.
    todo: Vec<Knot<C>>,
    /// The knots since the earliest candidate.
    since: Vec<Knot<C>>,
    /// Whether `since` lost knots because there were too many.
    forgot: bool,
}

impl<const C: usize, const K: usize> Walk<C, K> {
    pub fn new(tube: Tube<C>) -> Self {
        Walk {
            tube,
            mode: Mode::Lit,
            z0: 0.0,
            fan: Fan::NEW,
            z: 0.0,
            pending: Vec::new(),
            kept: Fan::NEW,
            kept_z: 0.0,
            passed: None,
            todo: Vec::new(),
            since: Vec::new(),
            forgot: false,
        }
    }

    /// Compresses a function and appends its vertices to `out`.
    #[inline(always)]
    pub fn compress(&mut self, tube: Tube<C>, curve: &Curve, out: &mut Visibility) {
        self.tube = tube;
        self.pending.clear();
        self.passed = None;
        self.mode = match tube.end == [1.0; C] {
            true => Mode::Done,
            false => Mode::Lit,
        };
        knots(curve, |e, last| {
            self.knot(e, last, out);
            self.mode != Mode::Done
        });
    }

    /// Takes the next knot.
    #[inline(always)]
    pub fn knot(&mut self, e: &Knot<C>, last: bool, out: &mut Visibility) {
        if !last && self.mode == Mode::Walking && self.pending.is_empty() && !self.tube.tail(e) {
            let mut fan = self.fan;
            let through = self.tube.through(e);
            let room = fan.clip(&through, e.z);
            if room >= self.tube.grid.gap
                || (room >= 0.0 && fan.holds(&self.tube, e.z, &through.lo))
            {
                self.fan = fan;
                self.z = e.z;
                self.remember(e);
                return;
            }
        }
        self.take(*e, last, out);
    }

    #[inline(never)]
    fn take(&mut self, e: Knot<C>, last: bool, out: &mut Visibility) {
        self.todo.push(e);
        while let Some(e) = self.todo.pop() {
            let last = last && self.todo.is_empty();
            let accepted = match self.mode {
                Mode::Done => true,
                Mode::Lit => self.leave_light(&e, out),
                Mode::Walking => self.step(&e, last, out),
            };
            if !accepted {
                self.todo.push(e);
                self.todo.extend(self.pending.drain(..).rev());
            }
        }
    }

    /// Passes a knot while the output is 1. Returns false if the knot must be taken again.
    fn leave_light(&mut self, e: &Knot<C>, out: &mut Visibility) -> bool {
        let lit = self.tube.lit(e);
        if lit && self.tube.tail(e) {
            self.store(e.z, self.tube.end, out);
            self.mode = Mode::Done;
            return true;
        }
        if lit && self.tube.lit_through(e) {
            self.passed = Some(*e);
            return true;
        }
        // The step from 1 at the first vertex costs no vertex, so it is as late as possible.
        let at = match self.passed {
            Some(passed) if !lit => passed,
            _ => *e,
        };
        self.mode = Mode::Walking;
        self.fall(&at, [1.0; C]);
        at.z == e.z
    }

    /// Extends the segment by a knot, or ends it. Returns false if the pending knots and this one
    /// must be taken again.
    fn step(&mut self, e: &Knot<C>, last: bool, out: &mut Visibility) -> bool {
        let through = self.tube.through(e);
        if self.tube.tail(e)
            && (0..C).all(|c| through.lo[c] <= self.tube.end[c])
            && let Some(k) = self.fan.arrives(&self.tube, e.z)
        {
            self.store(self.fan.z0[k], self.fan.value(k), out);
            self.store(e.z, self.tube.end, out);
            self.mode = Mode::Done;
            return true;
        }
        if !last {
            let mut fan = self.fan;
            let room = fan.clip(&through, e.z);
            if room >= 0.0 {
                if room >= self.tube.grid.gap || fan.best(&self.tube, e.z, &through.lo).is_some() {
                    self.pending.clear();
                } else if self.pending.len() < MEMORY {
                    if self.pending.is_empty() {
                        (self.kept, self.kept_z) = (self.fan, self.z);
                    }
                    self.pending.push(*e);
                } else {
                    self.back_up(e, out);
                    return false;
                }
                (self.fan, self.z) = (fan, e.z);
                self.remember(e);
                return true;
            }
        }
        let forced = last || (0..C).any(|c| through.lo[c] > through.hi[c]);
        let fresh = self.pending.is_empty() && self.z == self.z0;
        if (forced || fresh) && self.drop_at(e, self.fan, fresh, out) {
            self.pending.clear();
            return true;
        }
        self.back_up(e, out);
        false
    }

    /// Ends the segment at the last depth where it reached a storable value, because it cannot take
    /// `e`.
    fn back_up(&mut self, e: &Knot<C>, out: &mut Visibility) {
        let (fan, z, next) = match self.pending.first() {
            None => (self.fan, self.z, e),
            Some(first) => (self.kept, self.kept_z, first),
        };
        // The tube at the next depth is no higher than at `z`, so `best` finds the value again.
        let low = self.tube.front(next).lo;
        if z > self.z0
            && let Some((k, first, last)) = fan.best(&self.tube, z, &low)
        {
            let (z0, y0) = (fan.z0[k], fan.value(k));
            self.store(z0, y0, out);
            self.fan
                .spread(&self.tube, 0..GROUP.min(K), z, &first, &last);
            (self.z0, self.z) = (z, z);
            self.open_earlier(z0, y0);
        } else {
            // The segment cannot even pass its first knot, so it ends at the step there.
            let first = self.pending.remove(0);
            self.drop_at(&first, fan, true, out);
        }
    }

    /// Ends the segment in front of the step at `e` and starts the next one behind it.
    ///
    /// Returns false if the segment cannot end there. A `fresh` segment always can: it starts at a
    /// storable value that is not below the tube, so it reaches a storable value in the tube in
    /// front of the next depth.
    fn drop_at(&mut self, e: &Knot<C>, fan: Fan<C, K>, fresh: bool, out: &mut Visibility) -> bool {
        let front = self.tube.front(e);
        let mut clipped = fan;
        clipped.clip(&front, e.z);
        let (k, high) = match clipped.best(&self.tube, e.z, &front.lo) {
            Some((k, first, last)) => {
                let mid = |c: usize| self.tube.grid.nearest((first[c] + last[c]) * 0.5);
                (k, std::array::from_fn(|c| mid(c).clamp(first[c], last[c])))
            }
            None if fresh => {
                debug_assert!(false, "no storable value in front of {e:?}");
                (0, std::array::from_fn(|c| fan.y[c][0]))
            }
            None => return false,
        };
        self.store(fan.z0[k], fan.value(k), out);
        self.store(e.z, high, out);
        if self.tube.tail(e) {
            self.store(e.z, self.tube.end, out);
            self.mode = Mode::Done;
        } else {
            self.fall(e, high);
        }
        true
    }

    /// Starts a segment just behind a depth, at a value of at most `high`.
    fn fall(&mut self, e: &Knot<C>, high: [f64; C]) {
        let w = self.tube.behind(e);
        let (mut first, mut last) = (high, high);
        for c in 0..C {
            if let Some((a, b)) = self.tube.grid.between(w.lo[c], w.hi[c].min(high[c])) {
                (first[c], last[c]) = (a, b);
            }
        }
        self.fan.spread(&self.tube, 0..K, e.z, &first, &last);
        (self.z0, self.z) = (e.z, e.z);
        self.since.clear();
        self.forgot = false;
    }

    /// Records a knot for [`Walk::open_earlier`].
    #[inline(always)]
    fn remember(&mut self, e: &Knot<C>) {
        if K > 1 {
            if self.since.len() == MEMORY * 4 {
                self.since.clear();
                self.forgot = true;
            }
            self.since.push(*e);
        }
    }

    /// Places the groups after the first at earlier ends of the segment from (`z0`, `y0`).
    ///
    /// Each group gets the last depth at which the segment reaches a range of values as long as the
    /// group's share in [`SHARES`].
    fn open_earlier(&mut self, z0: f64, y0: [f64; C]) {
        if K == 1 {
            return;
        }
        let end = self.since.partition_point(|e| e.z <= self.z);
        let begin = self.since.partition_point(|e| e.z <= z0);
        let mut segment = Fan::<C, 1>::NEW;
        segment.spread(&self.tube, 0..1, z0, &y0, &y0);
        let mut found = [(end, segment); SHARES.len()];
        if !self.forgot {
            for i in begin..end.saturating_sub(1) {
                let e = &self.since[i];
                let room = segment.clip(&self.tube.through(e), e.z);
                for (found, share) in found.iter_mut().zip(SHARES) {
                    if room >= self.tube.eps * share {
                        *found = (i, segment);
                    }
                }
            }
        }
        let mut earliest = end;
        for (g, (i, segment)) in found.into_iter().enumerate() {
            let lanes = (g + 1) * GROUP..(g + 2) * GROUP;
            let reached = self.since[..end].get(i).and_then(|e| {
                let low = self.tube.through(e).lo;
                Some((e.z, segment.reach(&self.tube, 0, e.z, &low)?))
            });
            let Some((from, (first, last))) = reached else {
                self.fan.close(lanes);
                continue;
            };
            self.fan
                .spread(&self.tube, lanes.clone(), from, &first, &last);
            earliest = earliest.min(i + 1);
            for e in &self.since[i + 1..end] {
                let through = self.tube.through(e);
                self.fan.clip_lanes(&through, e.z, lanes.clone());
            }
        }
        self.since.truncate(end);
        self.since.drain(..earliest);
        self.forgot = false;
    }

    fn store(&self, z: f64, v: [f64; C], out: &mut Visibility) {
        out.vertices.push(z as f32, &v.map(|v| v as f32));
    }
}
