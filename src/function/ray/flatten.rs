//! Turns the samples of a ray into a piecewise linear function (LV00, section 3.2).

#![allow(
    clippy::needless_range_loop,
    reason = "loops over channels index several arrays alike"
)]

use super::{Curve, Ray, Stretch, Sum, Surface};
use crate::function::{LEAST_CHORD_TOLERANCE, step_by};

impl Ray {
    /// Writes to `out` a piecewise linear function within `chord_tolerance` of the ray's
    /// transmittance at every f32 depth.
    ///
    /// Its depths are those of all samples, bit exact, and more f32 depths inside curved pieces.
    /// Their spacing follows the curvature: about `2 / sqrt(8 chord_tolerance)` depths for a fall
    /// from 1 to 0 of any shape. A ray of surfaces becomes the running products of `1 - opacity` in
    /// order of depth, without error. [`Curve::error`] is a true bound, often below the tolerance.
    /// A tolerance below 1e-9 counts as 1e-9. Cost: n log n, also if all samples overlap. LV00,
    /// section 3.2.
    pub fn flatten(&self, chord_tolerance: f64, out: &mut Curve) {
        match self.coloured {
            false => self.flatten_channels::<1>(chord_tolerance, out),
            true => self.flatten_channels::<3>(chord_tolerance, out),
        }
        out.vertices.merge_equal_channels();
    }

    fn flatten_channels<const C: usize>(&self, chord_tolerance: f64, out: &mut Curve) {
        out.reset(C);
        let mut sorted = Vec::new();
        let surfaces = self.surfaces_in_order(&mut sorted);
        if self.is_steps() {
            flatten_steps::<C>(surfaces, out);
        } else {
            let tolerance = chord_tolerance.max(LEAST_CHORD_TOLERANCE);
            Flattener::<C>::new(self, surfaces, tolerance).run(surfaces, out);
        }
    }
}

/// Writes the running products of `1 - opacity`. The surfaces must be in order of depth.
fn flatten_steps<const C: usize>(surfaces: &[Surface], out: &mut Curve) {
    let mut v = [1.0; C];
    for group in surfaces.chunk_by(|a, b| a.z == b.z) {
        let front = v;
        for s in group {
            for c in 0..C {
                v[c] *= 1.0 - f64::from(s.opacity[c]);
            }
        }
        out.push_depth(group[0].z, &front, &v);
        if v == [0.0; C] {
            break;
        }
    }
}

/// Extinction at the two ends of a depth interval, linear between them.
#[derive(Clone, Copy)]
struct Ends<const C: usize>([[f64; C]; 2]);

impl<const C: usize> Ends<C> {
    const NONE: Self = Ends([[0.0; C]; 2]);

    /// The extinction at the fraction `t` of the interval. Neither term is negative, so there is no
    /// cancellation.
    fn at(&self, t: f64) -> [f64; C] {
        std::array::from_fn(|c| self.0[0][c] * (1.0 - t) + self.0[1][c] * t)
    }

    fn add(&mut self, front: [f64; C], back: [f64; C]) {
        for c in 0..C {
            self.0[0][c] += front[c];
            self.0[1][c] += back[c];
        }
    }
}

fn fraction(z: f32, front: f32, back: f32) -> f64 {
    (f64::from(z) - f64::from(front)) / (f64::from(back) - f64::from(front))
}

/// Sweeps over the breakpoints of a ray with curved pieces.
///
/// A segment tree sums the extinction of all samples that cover an interval. It never subtracts, so
/// a sample one ulp thick leaves no residue when it ends.
struct Flattener<const C: usize> {
    tolerance: f64,
    /// The breakpoints.
    z: Vec<f32>,
    /// Extinction on the interval from each breakpoint to the next.
    kappa: Vec<Ends<C>>,
    error: f64,
}

impl<const C: usize> Flattener<C> {
    /// `surfaces` must be the ray's surfaces in order of depth.
    pub fn new(ray: &Ray, surfaces: &[Surface], tolerance: f64) -> Self {
        // Ray marching through a volume yields media that do not overlap, which need no sums.
        let apart = ray.media.is_sorted_by(|a, b| a.back <= b.front);
        let (z, kappa) = match apart && ray.thick.is_empty() {
            true => one_after_the_other(&ray.media, surfaces),
            false => sums_of_overlaps(ray),
        };
        Flattener {
            tolerance,
            z,
            kappa,
            error: 0.0,
        }
    }

    pub fn run(mut self, surfaces: &[Surface], out: &mut Curve) {
        let mut surfaces = surfaces.iter().peekable();
        let mut steps = [1.0; C];
        let mut optical = [Sum::default(); C];
        let mut v = [1.0; C];
        for i in 0..self.z.len() {
            let front = v;
            while let Some(s) = surfaces.next_if(|s| s.z == self.z[i]) {
                for c in 0..C {
                    steps[c] *= 1.0 - f64::from(s.opacity[c]);
                }
            }
            for c in 0..C {
                v[c] = f64::min(v[c], steps[c] * (-optical[c].value()).exp());
            }
            out.push_depth(self.z[i], &front, &v);
            if v == [0.0; C] || i + 1 == self.z.len() {
                break;
            }
            self.piece(i, &steps, &mut optical, &mut v, out);
        }
        // Bound of the rounding of exp and of f64 products.
        let rounding = if self.error > 0.0 { 1e-14 } else { 0.0 };
        out.error = self.error + rounding;
    }

    /// Moves from breakpoint `i` to the next. Appends vertices between them, and sets `v` and
    /// `optical` to their values at the next.
    fn piece(
        &mut self,
        i: usize,
        steps: &[f64; C],
        optical: &mut [Sum; C],
        v: &mut [f64; C],
        out: &mut Curve,
    ) {
        let (front, back) = (self.z[i], self.z[i + 1]);
        let ends = self.kappa[i];
        let length = f64::from(back) - f64::from(front);
        let mut slope = [0.0; C];
        for c in 0..C {
            slope[c] = (ends.0[1][c] - ends.0[0][c]).abs() / length;
        }
        let mut z = front;
        let mut k = ends.0[0];
        while z < back {
            // Bound of |V''| = V |kappa^2 - kappa'| from `z` to `z + h`. V falls, so it is at most
            // its value at `z`.
            let bend = |h: f64| {
                let k_h = ends.at(((f64::from(z) - f64::from(front) + h) / length).min(1.0));
                let channel = |c: usize| v[c] * (f64::max(k[c], k_h[c]).powi(2) + slope[c]);
                (0..C).map(channel).fold(0.0, f64::max)
            };
            let rest = f64::from(back) - f64::from(z);
            let next = if bend(rest) * rest * rest <= 8.0 * self.tolerance {
                back
            } else {
                let near = rest.min((8.0 * self.tolerance / bend(0.0)).sqrt());
                let h = near.min((8.0 * self.tolerance / bend(near)).sqrt());
                step_by(z, h, back)
            };
            let h = f64::from(next) - f64::from(z);
            let chord = bend(h) * h * h / 8.0;
            k = ends.at(fraction(next, front, back));
            let mut drop: f64 = 0.0;
            for c in 0..C {
                let piece = (f64::from(next) - f64::from(front)) * (ends.0[0][c] + k[c]) / 2.0;
                let mut depth = optical[c];
                depth.add(piece.min(1e5)); // exp(-1e5) is 0
                let value = f64::min(v[c], steps[c] * (-depth.value()).exp());
                drop = drop.max(v[c] - value);
                v[c] = value;
                if next == back {
                    optical[c] = depth;
                }
            }
            if next > z.next_up() {
                self.error = self.error.max(chord.min(drop));
            }
            z = next;
            if z < back {
                out.push_unchecked(z, &v[..]);
                if *v == [0.0; C] {
                    return;
                }
            }
        }
    }
}

/// The breakpoints of a ray whose samples may overlap, and the extinction between them.
fn sums_of_overlaps<const C: usize>(ray: &Ray) -> (Vec<f32>, Vec<Ends<C>>) {
    let take = |k: &[f64; 3]| -> [f64; C] { std::array::from_fn(|c| k[c]) };
    let mut z: Vec<f32> = ray.surfaces.iter().map(|s| s.z).collect();
    z.extend(ray.thick.iter().flat_map(|t| [t.front, t.back]));
    z.extend(ray.media.iter().flat_map(|m| [m.front, m.back]));
    z.sort_unstable_by(f32::total_cmp);
    z.dedup();
    let intervals = z.len() - 1;
    let leaves = intervals.next_power_of_two();
    let mut tree = vec![Ends::<C>::NONE; 2 * leaves];
    for t in &ray.thick {
        let k = take(&t.kappa());
        cover(&mut tree, &z, t.front, t.back, Ends([k, k]));
    }
    for m in &ray.media {
        let ends = Ends([take(&m.kappa[0]), take(&m.kappa[1])]);
        cover(&mut tree, &z, m.front, m.back, ends);
    }
    push_down(&mut tree, &z);
    tree.drain(..leaves);
    tree.truncate(intervals);
    (z, tree)
}

/// The breakpoints of surfaces and of media that do not overlap, and the extinction between them.
/// Both must be in order of depth.
fn one_after_the_other<const C: usize>(
    media: &[Stretch],
    surfaces: &[Surface],
) -> (Vec<f32>, Vec<Ends<C>>) {
    let mut z: Vec<f32> = Vec::with_capacity(2 * media.len() + surfaces.len());
    let mut kappa = Vec::with_capacity(z.capacity());
    let mut put = |at: f32, between: &dyn Fn(f32) -> Ends<C>| match z.last() {
        Some(&last) if last == at => {}
        Some(&last) => {
            kappa.push(between(last));
            z.push(at);
        }
        None => z.push(at),
    };
    let nothing = |_| Ends::NONE;
    let mut surfaces = surfaces.iter().map(|s| s.z).peekable();
    for m in media {
        let ends: [[f64; C]; 2] = m.kappa.map(|k| std::array::from_fn(|c| k[c]));
        while let Some(s) = surfaces.next_if(|s| *s < m.front) {
            put(s, &nothing);
        }
        put(m.front, &nothing);
        while let Some(s) = surfaces.next_if(|s| *s < m.back) {
            let at = |z: f32| Ends(ends).at(fraction(z, m.front, m.back));
            put(s, &|last| Ends([at(last), at(s)]));
        }
        put(m.back, &|last| match last == m.front {
            true => Ends(ends),
            false => Ends([Ends(ends).at(fraction(last, m.front, m.back)), ends[1]]),
        });
    }
    surfaces.for_each(|s| put(s, &nothing));
    (z, kappa)
}

/// Adds extinction that is linear from `front` to `back` to the nodes that cover that interval.
fn cover<const C: usize>(tree: &mut [Ends<C>], z: &[f32], front: f32, back: f32, kappa: Ends<C>) {
    let leaves = tree.len() / 2;
    let index = |depth: f32| z.partition_point(|&b| b < depth);
    let (mut l, mut r) = (index(front) + leaves, index(back) + leaves);
    let mut width = 1;
    let mut add = |node: usize, width: usize| {
        let first = node * width - leaves;
        let at = |i: usize| kappa.at(fraction(z[i], front, back));
        tree[node].add(at(first), at(first + width));
    };
    while l < r {
        if l % 2 == 1 {
            add(l, width);
            l += 1;
        }
        if r % 2 == 1 {
            r -= 1;
            add(r, width);
        }
        (l, r, width) = (l / 2, r / 2, width * 2);
    }
}

/// Adds the extinction of every inner node to its children, so that the leaves hold all of it.
fn push_down<const C: usize>(tree: &mut [Ends<C>], z: &[f32]) {
    let leaves = tree.len() / 2;
    for node in 1..leaves {
        let own = tree[node];
        let width = leaves >> node.ilog2();
        let first = node * width - leaves;
        if own.0 == [[0.0; C]; 2] {
            continue; // only a node with extinction surely lies within the breakpoints
        }
        let k = own.at(fraction(z[first + width / 2], z[first], z[first + width]));
        tree[2 * node].add(own.0[0], k);
        tree[2 * node + 1].add(k, own.0[1]);
    }
}
