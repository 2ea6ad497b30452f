//! Measures how far a stored function is from the exact one (the bound of `spec/semantics.md`).
//!
//! This file shares no code with the makers of functions ([`Ray::flatten`], [`super::Sweep`]). It
//! computes exact values as plain products and sums over the samples, as [`Ray::visibility`] does.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over channels index several arrays alike"
)]

use super::ray::{Stretch, Thick};
use super::{Curve, FunctionRef, Ray, from_ordered_bits, ordered_bits};

/// The largest deviation of a stored function, and where it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// `|stored - exact|`.
    pub error: f64,
    /// Depth of the deviation.
    pub depth: f32,
    /// Whether the deviation is just behind `depth`, not at it.
    pub behind: bool,
    /// 0 for mono, else 0 to 2 for red, green and blue.
    pub channel: usize,
}

impl Curve {
    /// The largest deviation of `stored` from this function, over all f32 depths and both sides of
    /// every step.
    ///
    /// The result is exact. See [`Ray::deviation`] for its meaning. Cost: n log n.
    pub fn deviation<'a>(&self, stored: impl Into<FunctionRef<'a>>) -> Deviation {
        let (curve, stored) = (self.function(), stored.into());
        let mut worst = Deviation::default();
        let mut depths = [curve.depths(), stored.depths()].concat();
        depths.sort_by(f32::total_cmp);
        depths.dedup();
        for c in 0..curve.channels().max(stored.channels()) {
            for &z in &depths {
                let next = z.next_up();
                let at = |z| (value(stored, c, z, false) - value(curve, c, z, false)).abs();
                worst.see(at(z), z, false, c);
                let [is, exact] = [stored, curve].map(|f| value(f, c, z, true));
                let error = behind_error(is, exact, value(curve, c, next, false));
                worst.see(error, z, true, c);
                if next.is_finite() {
                    worst.see(at(next), next, false, c);
                }
            }
        }
        worst
    }
}

impl Ray {
    /// The largest deviation of `stored` from the ray's transmittance, over all f32 depths and both
    /// sides of every step.
    ///
    /// Only f32 depths count. Just behind a depth, any stored value is right that lies between the
    /// exact value there and the exact value at the next f32 depth. A step of the exact function
    /// must therefore be at its own depth in the stored one.
    ///
    /// Curved pieces that can hold the largest deviation are searched at 128 depths, and again
    /// around the worst of these. The result is exact to rounding for surfaces and thick samples,
    /// where the difference has a single extreme, and very nearly exact for media. Cost: n log n.
    ///
    /// ```
    /// use deepshadow::{Ray, Vertex, Visibility};
    /// let mut ray = Ray::new();
    /// ray.surface(1.0, 0.5).unwrap();
    /// ray.surface(2.0, 0.5).unwrap();
    /// let stored = Visibility::mono(vec![Vertex::new(1.0, 0.375)]).unwrap(); // one step for both
    /// let worst = ray.deviation(&stored);
    /// assert_eq!((worst.error, worst.depth), (0.125, 1.0));
    /// ```
    pub fn deviation<'a>(&self, stored: impl Into<FunctionRef<'a>>) -> Deviation {
        Deviation::of_average(&[(1.0, self)], stored)
    }
}

impl Deviation {
    /// The largest deviation of `stored` from a weighted average of rays: a filtered pixel, or a
    /// mip-level pixel over its source pixels.
    ///
    /// With negative weights the exact function is the running minimum of the clamped average. See
    /// [`Ray::deviation`] for the meaning of the result. Cost: proportional to the number of
    /// breakpoints times the number of rays.
    ///
    /// # Panics
    /// If the weights do not sum to a positive number.
    pub fn of_average<'a>(rays: &[(f64, &Ray)], stored: impl Into<FunctionRef<'a>>) -> Deviation {
        Average::new(rays, stored.into()).compare()
    }

    /// Becomes this deviation, if it is larger.
    fn see(&mut self, error: f64, depth: f32, behind: bool, channel: usize) {
        if error > self.error {
            *self = Deviation {
                error,
                depth,
                behind,
                channel,
            };
        }
    }
}

fn value(f: FunctionRef<'_>, c: usize, z: f32, behind: bool) -> f64 {
    let [v] = f.channel(c).evaluate(z, behind);
    v
}

/// Distance of `stored` from the interval between the exact values just behind a depth (`behind`)
/// and at the next float (`next`).
fn behind_error(stored: f64, behind: f64, next: f64) -> f64 {
    (stored - behind).max(next.min(behind) - stored).max(0.0)
}

/// An event of a ray at a depth.
#[derive(Clone, Copy)]
enum Change<'a> {
    Surface(&'a [f32; 3]),
    Front(Item<'a>),
    Back(Item<'a>),
}

#[derive(Clone, Copy)]
enum Item<'a> {
    Thick(&'a Thick),
    Medium(&'a Stretch),
}

impl Item<'_> {
    fn back(&self) -> f32 {
        match self {
            Item::Thick(t) => t.back,
            Item::Medium(m) => m.back,
        }
    }

    fn transmittance(&self, z: f64, c: usize) -> f64 {
        match self {
            Item::Thick(t) => t.transmittance(z, c),
            Item::Medium(m) => (-m.optical_depth(z, c)).exp(),
        }
    }
}

/// The state of one ray at the current depth.
struct State<'a> {
    weight: f64,
    /// Transmittance of all samples that end at or in front of the current depth.
    passed: [f64; 3],
    /// The samples that contain the current depth.
    inside: Vec<Item<'a>>,
}

struct Average<'a> {
    stored: FunctionRef<'a>,
    channels: usize,
    states: Vec<State<'a>>,
    /// Depth, index of the ray and event, sorted by depth.
    changes: Vec<(f32, usize, Change<'a>)>,
    depths: Vec<f32>,
    weight: f64,
    negative: bool,
    /// Weighted sum of the rays that are inside no sample.
    still: [f64; 3],
    /// Indices of the other rays.
    moving: Vec<usize>,
    /// Running minimum of the average, for negative weights.
    least: [f64; 3],
}

impl<'a> Average<'a> {
    fn new(rays: &[(f64, &'a Ray)], stored: FunctionRef<'a>) -> Self {
        let mut changes = Vec::new();
        for (k, &(_, ray)) in rays.iter().enumerate() {
            for s in &ray.surfaces {
                changes.push((s.z, k, Change::Surface(&s.opacity)));
            }
            for t in &ray.thick {
                changes.push((t.front, k, Change::Front(Item::Thick(t))));
                changes.push((t.back, k, Change::Back(Item::Thick(t))));
            }
            for m in &ray.media {
                changes.push((m.front, k, Change::Front(Item::Medium(m))));
                changes.push((m.back, k, Change::Back(Item::Medium(m))));
            }
        }
        changes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut depths: Vec<f32> = changes.iter().map(|e| e.0).collect();
        depths.extend_from_slice(stored.depths());
        depths.sort_by(f32::total_cmp);
        depths.dedup();
        let weight: f64 = rays.iter().map(|r| r.0).sum();
        assert!(weight > 0.0, "the weights of an average sum to {weight}");
        let channels = rays.iter().map(|r| r.1.channels()).max().unwrap_or(1);
        let state = |&(weight, _): &(f64, &Ray)| State {
            weight,
            passed: [1.0; 3],
            inside: Vec::new(),
        };
        let mut all = Average {
            stored,
            channels: channels.max(stored.channels()),
            states: rays.iter().map(state).collect(),
            changes,
            depths,
            weight,
            negative: rays.iter().any(|r| r.0 < 0.0),
            still: [0.0; 3],
            moving: Vec::new(),
            least: [1.0; 3],
        };
        all.add_up();
        all
    }

    fn add_up(&mut self) {
        self.still = [0.0; 3];
        self.moving.clear();
        for (k, ray) in self.states.iter().enumerate() {
            if ray.inside.is_empty() {
                for c in 0..3 {
                    self.still[c] += ray.weight * ray.passed[c];
                }
            } else {
                self.moving.push(k);
            }
        }
    }

    /// The average at depth `z`. No event may lie between the current depth and `z`.
    fn sum(&self, z: f64, c: usize) -> f64 {
        let ray = |&k: &usize| {
            let ray = &self.states[k];
            let inside: f64 = ray.inside.iter().map(|i| i.transmittance(z, c)).product();
            ray.weight * ray.passed[c] * inside
        };
        let sum = self.still[c] + self.moving.iter().map(ray).sum::<f64>();
        (sum / self.weight).clamp(0.0, 1.0)
    }

    /// The exact function. With negative weights, calls must be in order of depth.
    fn exact(&mut self, z: f64, c: usize) -> f64 {
        let sum = self.sum(z, c);
        if !self.negative {
            return sum;
        }
        self.least[c] = self.least[c].min(sum);
        self.least[c]
    }

    fn pass(&mut self, z: f32, next: &mut usize) {
        let first = *next;
        while let Some(&(depth, k, event)) = self.changes.get(*next)
            && depth == z
        {
            let ray = &mut self.states[k];
            for c in 0..3 {
                ray.passed[c] *= match event {
                    Change::Surface(opacity) => 1.0 - f64::from(opacity[c]),
                    Change::Back(item) => item.transmittance(f64::from(item.back()), c),
                    Change::Front(_) => 1.0,
                };
            }
            match event {
                Change::Front(item) => ray.inside.push(item),
                Change::Back(_) => ray.inside.retain(|item| item.back() > z),
                Change::Surface(_) => {}
            }
            *next += 1;
        }
        if *next > first {
            self.add_up();
        }
    }

    /// Compares at the breakpoints first, so that few pieces between them need a search.
    fn compare(mut self) -> Deviation {
        let mut worst = Deviation::default();
        self.walk(&mut worst, false);
        let is_curved = |e: &(f32, usize, Change)| matches!(e.2, Change::Front(_));
        if !self.negative && self.changes.iter().any(is_curved) {
            for ray in &mut self.states {
                ray.passed = [1.0; 3];
            }
            self.add_up();
            self.walk(&mut worst, true);
        }
        worst
    }

    fn walk(&mut self, worst: &mut Deviation, search: bool) {
        let depths = std::mem::take(&mut self.depths);
        let stored = self.stored;
        let mut next_change = 0;
        let mut behind = [1.0; 3];
        for (i, &z) in depths.iter().enumerate() {
            let mut at = [0.0; 3];
            for c in 0..self.channels {
                at[c] = self.exact(f64::from(z), c);
                let error = (value(stored, c, z, false) - at[c]).abs();
                worst.see(error, z, false, c);
            }
            if search && i > 0 && !self.moving.is_empty() {
                for c in 0..self.channels {
                    self.search(depths[i - 1], z, c, behind[c], at[c], worst);
                }
            }
            self.pass(z, &mut next_change);
            let back = depths.get(i + 1).copied();
            for c in 0..self.channels {
                behind[c] = self.exact(f64::from(z), c);
                let is = value(stored, c, z, true);
                if (is - behind[c]).abs() > worst.error {
                    let near = self.sum(f64::from(z.next_up().min(f32::MAX)), c);
                    worst.see(behind_error(is, behind[c], near), z, true, c);
                }
                // With negative weights, many depths up to the next breakpoint are compared.
                let dense = back.filter(|_| self.negative).map(|back| between(z, back));
                for z in dense.into_iter().flatten() {
                    let exact = self.exact(f64::from(z), c);
                    let error = (value(stored, c, z, false) - exact).abs();
                    worst.see(error, z, false, c);
                }
            }
        }
        self.depths = depths;
    }

    /// Searches between two breakpoints for a deviation larger than `worst`.
    ///
    /// `v0` and `v1` are the exact values at the ends. Returns early if the ends rule out a larger
    /// deviation.
    fn search(&self, front: f32, back: f32, c: usize, v0: f64, v1: f64, worst: &mut Deviation) {
        if back == front.next_up() {
            return;
        }
        let s0 = value(self.stored, c, front, true);
        let s1 = value(self.stored, c, back, false);
        // Neither function rises, so each stays between its end values. The exact function is
        // therefore no farther from its chord than it falls.
        let ends = (s0 - v0).abs().max((s1 - v1).abs()) + (v0 - v1);
        let most = (v0 - s1).max(s0 - v1).min(ends) + 1e-15;
        if most <= worst.error {
            return;
        }
        let (a, b) = (f64::from(front), f64::from(back));
        let difference = |z: f64| s0 + (s1 - s0) * ((z - a) / (b - a)) - self.sum(z, c);
        let depths = between(front, back);
        let differences: Vec<f64> = depths.iter().map(|&z| difference(f64::from(z))).collect();
        for sign in [1.0, -1.0] {
            let best = (0..depths.len())
                .max_by(|&i, &j| (sign * differences[i]).total_cmp(&(sign * differences[j])))
                .expect("there is a depth between");
            let low = if best > 0 { depths[best - 1] } else { front };
            let high = depths.get(best + 1).copied().unwrap_or(back);
            let g = |z: f64| sign * difference(z);
            let found = golden(f64::from(low), f64::from(high), &g) as f32;
            for z in [depths[best], found, found.next_down(), found.next_up()] {
                if front < z && z < back {
                    worst.see(g(f64::from(z)), z, false, c);
                }
            }
        }
    }
}

/// Up to 128 f32 depths inside an interval: those next to its ends, and others spaced evenly in
/// depth and in floating-point steps, because a fall can be short in either measure.
fn between(front: f32, back: f32) -> Vec<f32> {
    let (a, b) = (f64::from(front), f64::from(back));
    let (i, j) = (ordered_bits(front), ordered_bits(back));
    let steps = f64::from(j - i);
    let mut depths = vec![front.next_up(), back.next_down()];
    for k in 1..64 {
        let t = f64::from(k) / 64.0;
        depths.push((a + (b - a) * t) as f32);
        depths.push(from_ordered_bits(i + (steps * t) as u32));
    }
    depths.retain(|&z| front < z && z < back);
    depths.sort_by(f32::total_cmp);
    depths.dedup();
    depths
}

/// The depth of the maximum of `g` between `a` and `b`, by golden-section search. `g` must have a
/// single maximum there.
fn golden(mut a: f64, mut b: f64, g: &impl Fn(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut p, mut q) = (b - RATIO * (b - a), a + RATIO * (b - a));
    let (mut gp, mut gq) = (g(p), g(q));
    for _ in 0..48 {
        if gp > gq {
            (b, q, gq) = (q, p, gp);
            p = b - RATIO * (b - a);
            gp = g(p);
        } else {
            (a, p, gp) = (p, q, gq);
            q = a + RATIO * (b - a);
            gq = g(q);
        }
    }
    (a + b) / 2.0
}
