//! The visibility function of a pixel: a filter-weighted sum of many functions (LV00, section 5.1).

#![allow(
    clippy::needless_range_loop,
    reason = "loops over channels index several arrays alike"
)]

use super::ray::{Sum, Surface};
use super::{Curve, Ray, from_ordered_bits, ordered_bits};
use crate::{Error, Result};

/// Sums transmittance functions into the visibility function of a pixel, `sum of w V / sum of w`.
///
/// Call [`Sweep::add`] for each function with its filter weight, then [`Sweep::finish`]. A sweep
/// can be reused, and stops allocating once it has processed its largest pixel. Cost: n log n for n
/// vertices in all functions together, with a running value and slope. The order of the functions
/// changes the result by at most 1e-13. The end value is exactly the sum of the end values: 0 where
/// all functions are dark, 1 where nothing casts a shadow.
///
/// Weights may be negative if their sum is positive. The sum can then rise or leave 0 to 1; the
/// visibility function is the running minimum of the clamped sum. Where it has a kink between two
/// f32 depths, both become vertices, so it is exact at every f32 depth. LV00, sections 3.2 and 5.1;
/// colour as in 5.2: a mono function applies to all channels.
///
/// ```
/// use deepshadow::{Curve, Sweep};
/// let wall = Curve::mono(vec![5.0], vec![0.0]).unwrap();
/// let mut sweep = Sweep::new();
/// sweep.add(&wall, 1.0).unwrap();
/// sweep.add(&Curve::lit(1), 3.0).unwrap(); // a quarter of the pixel is behind the wall
/// let mut pixel = Curve::default();
/// sweep.finish(&mut pixel).unwrap();
/// assert_eq!((pixel.depths(), pixel.values(0)), (&[5.0][..], &[0.75][..]));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Sweep {
    /// One key per event: the ordered depth, then the kind and index of the event.
    keys: Vec<u64>,
    /// Weighted change of the value at each step.
    jumps: Vec<f64>,
    /// Weighted slopes in front of and behind each vertex where the slope changes.
    turns: Vec<f64>,
    /// Depths of `turns`.
    turn_depths: Vec<f32>,
    weight: f64,
    has_negative: bool,
    /// Weighted sum of the end values.
    end: [f64; 3],
    coloured: bool,
    error: f64,
    radix: Vec<u64>,
    curve: Curve,
    surfaces: Vec<Surface>,
}

/// Set in the key of a turn, clear in the key of a jump.
const TURN: u32 = 1 << 31;

/// The largest number of events of one kind.
const MOST_EVENTS: usize = 1 << 31;

/// Number of events from which the radix sort is faster than the comparison sort.
const RADIX_FROM: usize = 600;

impl Sweep {
    /// An empty sweep.
    pub fn new() -> Self {
        Self::default()
    }

    /// Removes all functions and keeps the memory.
    pub fn clear(&mut self) {
        self.keys.clear();
        self.jumps.clear();
        self.turns.clear();
        self.turn_depths.clear();
        self.weight = 0.0;
        self.has_negative = false;
        self.end = [0.0; 3];
        self.coloured = false;
        self.error = 0.0;
    }

    /// Adds a function with its filter weight.
    ///
    /// The function's own error contributes to the result's error with the factor `|weight|`.
    ///
    /// # Errors
    /// `Input` for a weight that is not finite or whose magnitude exceeds 1e200, `Limit` for more
    /// than 2^31 vertices in one pixel. The sweep stays as it was.
    pub fn add(&mut self, function: &Curve, weight: f64) -> Result<()> {
        self.check(function.len(), weight)?;
        if function.channels() == 3 {
            self.promote();
        }
        match self.coloured {
            false => self.add_vertices::<1>(function, weight),
            true => self.add_vertices::<3>(function, weight),
        }
        self.weigh(weight, function.error());
        for (sum, end) in self.end.iter_mut().zip(function.end_rgb()) {
            *sum += weight * end;
        }
        Ok(())
    }

    /// Adds the transmittance function of a ray.
    ///
    /// The result is the same as with [`Ray::flatten`] and [`Sweep::add`], but faster for a ray
    /// that meets only surfaces.
    ///
    /// # Errors
    /// As [`Sweep::add`].
    pub fn add_ray(&mut self, ray: &Ray, chord_tolerance: f64, weight: f64) -> Result<()> {
        if !ray.is_steps() || self.coloured != (ray.channels() == 3) {
            let mut curve = std::mem::take(&mut self.curve);
            ray.flatten(chord_tolerance, &mut curve);
            let added = self.add(&curve, weight);
            self.curve = curve;
            return added;
        }
        self.check(ray.surfaces.len(), weight)?;
        let mut scratch = std::mem::take(&mut self.surfaces);
        let surfaces = ray.surfaces_in_order(&mut scratch);
        match self.coloured {
            false => self.add_surfaces::<1>(surfaces, weight),
            true => self.add_surfaces::<3>(surfaces, weight),
        }
        self.surfaces = scratch;
        self.weigh(weight, 0.0);
        Ok(())
    }

    fn check(&self, events: usize, weight: f64) -> Result<()> {
        if !weight.is_finite() || weight.abs() > 1e200 {
            return Err(Error::input(format!(
                "filter weight {weight} is not in -1e200 to 1e200"
            )));
        }
        if self.keys.len() + 2 * events > MOST_EVENTS {
            return Err(Error::limit("a pixel has more than 2^31 vertices"));
        }
        Ok(())
    }

    fn weigh(&mut self, weight: f64, error: f64) {
        self.weight += weight;
        self.has_negative |= weight < 0.0;
        self.error += weight.abs() * error;
    }

    /// Converts the events so far from one channel to three.
    fn promote(&mut self) {
        if self.coloured {
            return;
        }
        self.coloured = true;
        // A turn is a pair: the slope in front, then the one behind. Each becomes a triple.
        for values in [&mut self.jumps, &mut self.turns] {
            let n = values.len();
            values.resize(3 * n, 0.0);
            for i in (0..n).rev() {
                let v = values[i];
                values[3 * i..3 * i + 3].fill(v);
            }
        }
    }

    #[inline]
    fn jump<const C: usize>(&mut self, z: f32, change: [f64; C]) {
        let index = (self.jumps.len() / C) as u64;
        self.keys.push(u64::from(ordered_bits(z)) << 32 | index);
        self.jumps.extend_from_slice(&change);
    }

    #[inline]
    fn turn<const C: usize>(&mut self, z: f32, front: [f64; C], behind: [f64; C]) {
        let index = self.turn_depths.len() as u64 | u64::from(TURN);
        self.keys.push(u64::from(ordered_bits(z)) << 32 | index);
        self.turn_depths.push(z);
        self.turns.extend_from_slice([front, behind].as_flattened());
    }

    fn add_vertices<const C: usize>(&mut self, function: &Curve, weight: f64) {
        let depths = function.depths();
        let planes = function.vertices.values::<C>();
        let planes = planes.map(|plane| &plane[..depths.len()]);
        let Some(&first) = depths.first() else {
            return;
        };
        let mut last = (first, [1.0; C]);
        let mut slope = [0.0; C];
        for (i, &z) in depths.iter().enumerate() {
            let v = planes.map(|plane| plane[i]);
            if z != last.0 {
                let next = if v == last.1 {
                    [0.0; C]
                } else {
                    let run = f64::from(z) - f64::from(last.0);
                    std::array::from_fn(|c| weight * (v[c] - last.1[c]) / run)
                };
                if next != slope {
                    self.turn(last.0, slope, next);
                    slope = next;
                }
            } else if v != last.1 {
                self.jump::<C>(z, std::array::from_fn(|c| weight * (v[c] - last.1[c])));
            }
            last = (z, v);
        }
        if slope != [0.0; C] {
            self.turn(last.0, slope, [0.0; C]);
        }
    }

    fn add_surfaces<const C: usize>(&mut self, surfaces: &[Surface], weight: f64) {
        let mut v = [1.0; C];
        for s in surfaces {
            let before = v;
            for c in 0..C {
                v[c] *= 1.0 - f64::from(s.opacity[c]);
            }
            if v != before {
                self.jump::<C>(s.z, std::array::from_fn(|c| weight * (v[c] - before[c])));
            }
        }
        for c in 0..3 {
            self.end[c] += weight * v[c % C];
        }
    }

    /// Writes the visibility function to `out` and clears the sweep.
    ///
    /// The error of `out` is the weighted error of the functions.
    ///
    /// # Errors
    /// `Input` if the sum of the weights is not positive: without functions, or if the negative
    /// weights outweigh the positive ones. The sweep is cleared in this case too.
    pub fn finish(&mut self, out: &mut Curve) -> Result<()> {
        if !(self.weight > 0.0 && self.weight.is_finite()) {
            let weight = self.weight;
            self.clear();
            return Err(Error::input(format!(
                "the filter weights sum to {weight}, not to a positive number"
            )));
        }
        sort(&mut self.keys, &mut self.radix);
        match self.coloured {
            false => self.sum::<1>(out),
            true => self.sum::<3>(out),
        }
        out.vertices.merge_equal_channels();
        out.error = self.error / self.weight;
        self.clear();
        Ok(())
    }

    fn sum<const C: usize>(&mut self, out: &mut Curve) {
        out.reset(C);
        let summer = Summer::<C> {
            events: self,
            jumps: self.jumps.as_chunks().0,
            turns: self.turns.as_chunks().0,
            sums: [Sum::new(self.weight); C],
            slopes: [Sum::default(); C],
            ramps: 0,
            v: [1.0; C],
            end: std::array::from_fn(|c| (self.end[c] / self.weight).clamp(0.0, 1.0)),
        };
        match self.turn_depths.is_empty() {
            true => summer.run::<true>(out),
            false => summer.run::<false>(out),
        }
    }
}

/// Sweeps over the events, with weights of either sign.
struct Summer<'a, const C: usize> {
    events: &'a Sweep,
    jumps: &'a [[f64; C]],
    /// The slopes in front of and behind each turn.
    turns: &'a [[f64; C]],
    /// The weighted sum at the current depth, and its slope.
    sums: [Sum; C],
    slopes: [Sum; C],
    /// Number of functions with a slope at the current depth.
    ramps: usize,
    /// The output value: the running minimum of the clamped sum.
    v: [f64; C],
    end: [f64; C],
}

/// Bound of the relative error of a sum of slopes. One addition errs by 2^-105 of the largest term;
/// 2^-90 leaves room for many additions.
const RESIDUE: f64 = 1.0 / (1u128 << 90) as f64;

impl<const C: usize> Summer<'_, C> {
    /// `STEPS` if no event is a turn: the sum is then level between events.
    fn run<const STEPS: bool>(mut self, out: &mut Curve) {
        let keys = &self.events.keys;
        out.reserve(2 * keys.len());
        let Some(last) = keys.last().map(|k| from_ordered_bits((k >> 32) as u32)) else {
            return;
        };
        let residue = 1e-15 * self.events.weight / RESIDUE;
        let mut i = 0;
        let mut z = last;
        while i < keys.len() {
            let before = z;
            let depth = keys[i] >> 32;
            z = from_ordered_bits(depth as u32);
            if !STEPS && i > 0 && self.ramps > 0 {
                self.advance(before, z, out);
            }
            let front = self.v;
            let (mut jumped, mut steepest) = (false, 0.0);
            while i < keys.len() && keys[i] >> 32 == depth {
                let event = keys[i] as u32;
                if STEPS || event & TURN == 0 {
                    self.jump(event as usize);
                    jumped = true;
                } else {
                    steepest = f64::max(steepest, self.turn((event & !TURN) as usize));
                }
                i += 1;
            }
            if STEPS {
                // No slope changes.
            } else if self.ramps == 0 {
                self.slopes = [Sum::default(); C];
            } else if steepest * (f64::from(last) - f64::from(z)) > residue {
                self.sum_slopes_anew(z);
            }
            if i == keys.len() {
                for c in 0..C {
                    self.v[c] = self.lower(c, self.events.end[c] / self.events.weight);
                }
            } else if jumped {
                for c in 0..C {
                    self.v[c] = self.lower(c, self.sums[c].value() / self.events.weight);
                }
            }
            out.push_depth(z, &front, &self.v);
        }
    }

    /// The next output value of channel `c` if its sum becomes `sum`.
    #[inline]
    fn lower(&self, c: usize, sum: f64) -> f64 {
        let least = if self.events.has_negative {
            0.0
        } else {
            self.end[c] // the sum never rises, so only rounding can take it lower
        };
        sum.max(least).min(self.v[c])
    }

    #[inline]
    fn jump(&mut self, index: usize) {
        for c in 0..C {
            self.sums[c].add(self.jumps[index][c]);
        }
    }

    /// Changes the slope. Returns the steepest slope that ends, over all channels.
    #[inline]
    fn turn(&mut self, index: usize) -> f64 {
        let (front, behind) = (&self.turns[2 * index], &self.turns[2 * index + 1]);
        let mut steepest: f64 = 0.0;
        for c in 0..C {
            // Two additions, because the rounded difference would lose the smaller slope.
            self.slopes[c].add(-front[c]);
            self.slopes[c].add(behind[c]);
            steepest = steepest.max(front[c].abs());
        }
        self.ramps += usize::from(*behind != [0.0; C]);
        self.ramps -= usize::from(*front != [0.0; C]);
        steepest
    }

    /// Recomputes the sum of the slopes just behind `z` without the rounding errors of ended
    /// slopes.
    fn sum_slopes_anew(&mut self, z: f32) {
        self.slopes = [Sum::default(); C];
        for (i, pair) in self.events.turn_depths.windows(2).enumerate() {
            // The last turn of a function has slope 0 behind it, so pairs across functions add 0.
            if pair[0] <= z && z < pair[1] {
                for c in 0..C {
                    self.slopes[c].add(self.turns[2 * i + 1][c]);
                }
            }
        }
    }

    /// The normalised sum of channel `c` at a distance `run` behind the current depth.
    fn value(&self, c: usize, run: f64) -> f64 {
        (self.sums[c].value() + self.slopes[c].value() * run) / self.events.weight
    }

    /// Moves from `front` to `back`. There must be no event between them.
    #[inline]
    fn advance(&mut self, front: f32, back: f32, out: &mut Curve) {
        if self.events.has_negative {
            self.kinks(front, back, out);
        }
        let run = f64::from(back) - f64::from(front);
        for c in 0..C {
            let change = self.slopes[c].value() * run;
            self.sums[c].add(change);
            self.v[c] = self.lower(c, self.sums[c].value() / self.events.weight);
        }
    }

    /// Adds vertices at the f32 depths on both sides of each kink between `front` and `back`.
    ///
    /// A kink is a depth at which the sum falls below its running minimum or below 0.
    fn kinks(&mut self, front: f32, back: f32, out: &mut Curve) {
        let run = f64::from(back) - f64::from(front);
        let mut depths = [f32::INFINITY; 12];
        let mut n = 0;
        for c in 0..C {
            let (start, stop) = (self.value(c, 0.0), self.value(c, run));
            for level in [self.v[c], 0.0] {
                if self.v[c] > 0.0 && start > level && level > stop {
                    let crossing = f64::from(front) + run * ((start - level) / (start - stop));
                    let near = crossing as f32;
                    let before = if f64::from(near) > crossing {
                        near.next_down()
                    } else {
                        near
                    };
                    for z in [before, before.next_up()] {
                        if front < z && z < back {
                            depths[n] = z;
                            n += 1;
                        }
                    }
                }
            }
        }
        depths[..n].sort_unstable_by(f32::total_cmp);
        for (i, &z) in depths[..n].iter().enumerate() {
            if i > 0 && depths[i - 1] == z {
                continue;
            }
            for c in 0..C {
                self.v[c] = self.lower(c, self.value(c, f64::from(z) - f64::from(front)));
            }
            out.push_unchecked(z, &self.v);
        }
    }
}

/// Sorts by depth. Equal depths stay in order of insertion per kind of event.
fn sort(keys: &mut Vec<u64>, scratch: &mut Vec<u64>) {
    if keys.len() < RADIX_FROM {
        keys.sort_unstable();
        return;
    }
    const BITS: u32 = 11;
    let mut counts = [[0u32; 1 << BITS]; 3];
    for key in keys.iter() {
        for (digit, counts) in counts.iter_mut().enumerate() {
            counts[digit_of(*key, digit)] += 1;
        }
    }
    fn digit_of(key: u64, digit: usize) -> usize {
        (key >> (32 + BITS as usize * digit)) as usize & ((1 << BITS) - 1)
    }
    scratch.resize(keys.len(), 0);
    for (digit, counts) in counts.iter_mut().enumerate() {
        if counts[digit_of(keys[0], digit)] as usize == keys.len() {
            continue;
        }
        let mut sum = 0;
        for count in counts.iter_mut() {
            sum += std::mem::replace(count, sum);
        }
        for key in keys.iter() {
            let place = &mut counts[digit_of(*key, digit)];
            scratch[*place as usize] = *key;
            *place += 1;
        }
        std::mem::swap(keys, scratch);
    }
}
