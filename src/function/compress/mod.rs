//! Compression with a guaranteed error (LV00, section 3.3).
//!
//! | module | what it holds |
//! |---|---|
//! | `tube` | what an output may be: storable values, and the tube around the input |
//! | `walk` | [`Compressor::Croquet`], the paper's greedy walk, and [`Compressor::Lookahead`], the same from several origins |
//! | `minimal` | [`Compressor::Minimal`], a search for nearly the fewest vertices |
//! | `tolerance` | which tolerance and which lattice to take |
//!
//! All of them keep to the same rules. An output depth is an input depth, bit for bit. A segment starts from the
//! value that is stored, after rounding. The output stays in the *tube*: within the tolerance of the input,
//! between the end value and 1; values are chosen inside it and never moved afterwards. The output never rises.
//! It ends at the storable value nearest to the input's end: exactly, where that is 0 or 1.

mod minimal;
mod tolerance;
mod tube;
mod walk;

pub use tolerance::MIN_TOLERANCE;

use super::view::Laws;
use super::{Broken, Curve, Visibility};
use crate::names::names;
use crate::{Error, Result};
use minimal::MinimalSearch;
use tube::{Grid, Knot, Tube};
use walk::{CANDIDATES, Walk};

/// How hard to try for few vertices. The error bound is the same for all.
///
/// The figures are for hair at 256 samples a pixel on the lattice of [`Precision::for_tolerance`]: vertices against the exact minimum, and
/// input vertices a second on one core. `benches/record/compress.md` has them for other scenes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Compressor {
    /// The paper's greedy walk: the longest segment from the origin at hand. 1.4 times the minimum; about 100 million.
    Croquet,
    /// The greedy walk with the next origin left open, in depth and value, until the next segment has shown which one
    /// reaches furthest. 1.1 times the minimum; about 40 million. The default.
    #[default]
    Lookahead,
    /// A search over a few values at some depths: 1.01 times the minimum, about 6 million. It holds the whole pixel.
    Minimal,
}

names!(Compressor, "compressor" {
    Croquet = "croquet",
    Lookahead = "lookahead",
    Minimal = "minimal",
});

/// The visibilities that an output may hold. 0 and 1 are always among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Any f32.
    F32,
    /// k/L for whole k, as the f32 nearest to it: `k as f32 / L as f32`.
    Lattice(u16),
}

/// Compresses visibility functions, one after the other; allocates nothing once it has seen the largest.
///
/// A function is given as a [`Curve`] to [`Encoder::compress`], or vertex by vertex: [`Encoder::begin`],
/// [`Encoder::push`], [`Encoder::finish`]. Both give the same output. Cost: O(n) for n input vertices; state
/// bounded for [`Compressor::Croquet`] and [`Compressor::Lookahead`], the input for [`Compressor::Minimal`].
/// LV00, section 3.3; colour, section 5.2.
///
/// ```
/// use deepshadow::{Compressor, Curve, Precision, Visibility, raw::Encoder};
/// // Four small steps of 1/8 are one slope within 1/8.
/// let steps = Curve::mono(
///     vec![1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0],
///     vec![0.875, 0.875, 0.75, 0.75, 0.625, 0.625, 0.5],
/// )?;
/// let mut encoder = Encoder::new(Compressor::Minimal, Precision::F32, 0.126)?;
/// let mut out = Visibility::lit();
/// encoder.compress(&steps, &mut out)?;
/// assert_eq!(out.len(), 2); // from 7
/// assert_eq!(out.end(), 0.5);
/// assert!((out.visibility(2.0) - 0.875).abs() <= 0.126);
/// # Ok::<(), deepshadow::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Encoder {
    tolerance: f64,
    grid: Grid,
    lattice: Option<u16>,
    /// Channels of the function under way, 0 if there is none.
    channels: usize,
    mono: Engine<1>,
    rgb: Engine<3>,
    built: Visibility,
}

impl Encoder {
    /// An encoder whose outputs are within `tolerance` of what they stand for. Tolerances below
    /// [`MIN_TOLERANCE`] are taken as that.
    ///
    /// # Errors
    /// `Input` for a tolerance that is negative or not finite, and for a lattice coarser than the tolerance
    /// (`1/L > tolerance`) or without steps (`L` = 0).
    pub fn new(compressor: Compressor, precision: Precision, tolerance: f64) -> Result<Self> {
        if !(tolerance.is_finite() && tolerance >= 0.0) {
            return Err(Error::input(format!("a tolerance of {tolerance}")));
        }
        let lattice = match precision {
            Precision::F32 => None,
            Precision::Lattice(0) => return Err(Error::input("a lattice without steps")),
            Precision::Lattice(l) => Some(l),
        };
        let tolerance = tolerance.max(MIN_TOLERANCE);
        let grid = Grid::new(precision);
        let encoder = Encoder {
            tolerance,
            grid,
            lattice,
            channels: 0,
            mono: Engine::new(compressor, Tube::new(tolerance, [1.0], grid)),
            rgb: Engine::new(compressor, Tube::new(tolerance, [1.0; 3], grid)),
            built: Visibility::lit(),
        };
        encoder.left(0.0)?;
        Ok(encoder)
    }

    /// The tolerance in use.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// What an input that carries `error` leaves of the tolerance.
    fn left(&self, error: f64) -> Result<f64> {
        let left = self.tolerance - error;
        if !(error >= 0.0 && left >= MIN_TOLERANCE / 8.0) {
            return Err(Error::input(format!(
                "an input with error {error} leaves nothing of the tolerance {}",
                self.tolerance
            )));
        }
        match self.lattice {
            Some(l) if left * f64::from(l) < 1.0 => Err(Error::input(format!(
                "steps of 1/{l} are coarser than the tolerance {left}"
            ))),
            _ => Ok(left),
        }
    }

    /// Compresses `curve` into `out`. The error that the curve already carries counts: what the curve stands for
    /// is within the tolerance of `out`.
    ///
    /// # Errors
    /// `Input` if the curve's error leaves less of the tolerance than an eighth of [`MIN_TOLERANCE`] or, with a
    /// lattice, less than one of its steps. `out` is unchanged then.
    pub fn compress(&mut self, curve: &Curve, out: &mut Visibility) -> Result<()> {
        let left = self.left(curve.error())?;
        let built = &mut self.built;
        built.reset(curve.channels());
        self.channels = 0;
        match curve.channels() {
            1 => self.mono.run(left, self.grid, curve, built),
            _ => self.rgb.run(left, self.grid, curve, built),
        }
        self.hand_over(out);
        Ok(())
    }

    /// Begins a function that ends at `end`: one value, or three for a coloured function. `error` is what its
    /// values may already be off.
    ///
    /// # Errors
    /// `Input` for end values outside 0 to 1, for other numbers of channels, and for errors as in
    /// [`Encoder::compress`].
    pub fn begin(&mut self, end: &[f64], error: f64) -> Result<()> {
        self.channels = 0;
        let left = self.left(error)?;
        super::check_channels(end.len())?;
        if !end.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(Error::input(format!("a function that ends at {end:?}")));
        }
        self.built.reset(end.len());
        match end.len() {
            1 => self.mono.begin(left, self.grid, end),
            _ => self.rgb.begin(left, self.grid, end),
        }
        self.channels = end.len();
        Ok(())
    }

    /// Takes the next vertex, under the laws of [`Curve::from_planes`]; [`Encoder::finish`] reports one that breaks them.
    ///
    /// # Panics
    /// If `v` has another number of channels than the function begun, or none was begun.
    pub fn push(&mut self, depth: f32, v: &[f64]) {
        assert!(
            self.channels != 0 && v.len() == self.channels,
            "{} values for a vertex of a function with {} channels",
            v.len(),
            self.channels
        );
        match self.channels {
            1 => self.mono.push(depth, [v[0]], &mut self.built),
            _ => self.rgb.push(depth, [v[0], v[1], v[2]], &mut self.built),
        }
    }

    /// Ends the function and puts its output into `out`.
    ///
    /// # Errors
    /// `Input`, naming the vertex, where a vertex broke a law, and if the last is not at the end value that was
    /// given. `out` is unchanged then.
    ///
    /// # Panics
    /// If no function was begun.
    pub fn finish(&mut self, out: &mut Visibility) -> Result<()> {
        let channels = std::mem::take(&mut self.channels);
        assert!(channels != 0, "no function was begun");
        match channels {
            1 => self.mono.finish(&mut self.built)?,
            _ => self.rgb.finish(&mut self.built)?,
        }
        self.hand_over(out);
        Ok(())
    }

    fn hand_over(&mut self, out: &mut Visibility) {
        self.built.canonicalise();
        std::mem::swap(&mut self.built, out);
    }
}

/// How far the last vertex may be from the end value announced: sums taken in another order.
const END_SLACK: f64 = 5e-13;

/// The compressor of functions with `C` channels, and the pushed function under way.
#[derive(Clone, Debug)]
struct Engine<const C: usize> {
    method: Method<C>,
    end: [f64; C],
    /// The last depth pushed: another vertex may follow at it.
    held: Option<Knot<C>>,
    laws: Laws<C>,
    broken: Option<Broken>,
}

// The variants differ in size, but there is one encoder a thread, not one a pixel.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
enum Method<const C: usize> {
    Croquet(Walk<C, 1>),
    Lookahead(Walk<C, CANDIDATES>),
    Minimal(MinimalSearch<C>),
}

impl<const C: usize> Method<C> {
    fn begin(&mut self, tube: Tube<C>) {
        match self {
            Method::Croquet(walk) => walk.begin(tube),
            Method::Lookahead(walk) => walk.begin(tube),
            Method::Minimal(search) => search.begin(tube),
        }
    }

    fn knot(&mut self, e: &Knot<C>, out: &mut Visibility) {
        match self {
            Method::Croquet(walk) => walk.knot(e, out),
            Method::Lookahead(walk) => walk.knot(e, out),
            Method::Minimal(search) => search.knot(e),
        }
    }

    /// Takes the last knot.
    fn last(&mut self, e: &Knot<C>, out: &mut Visibility) {
        match self {
            Method::Croquet(walk) => walk.last(e, out),
            Method::Lookahead(walk) => walk.last(e, out),
            Method::Minimal(search) => {
                search.knot(e);
                search.finish(out);
            }
        }
    }
}

impl<const C: usize> Engine<C> {
    fn new(compressor: Compressor, tube: Tube<C>) -> Self {
        Engine {
            method: match compressor {
                Compressor::Croquet => Method::Croquet(Walk::new(tube)),
                Compressor::Lookahead => Method::Lookahead(Walk::new(tube)),
                Compressor::Minimal => Method::Minimal(MinimalSearch::new(tube)),
            },
            end: [1.0; C],
            held: None,
            laws: Laws::NEW,
            broken: None,
        }
    }

    fn begin(&mut self, left: f64, grid: Grid, end: &[f64]) {
        self.end = std::array::from_fn(|c| end[c]);
        self.method.begin(Tube::new(left, self.end, grid));
        (self.held, self.laws, self.broken) = (None, Laws::NEW, None);
    }

    /// Compresses a function whose laws hold.
    fn run(&mut self, left: f64, grid: Grid, curve: &Curve, out: &mut Visibility) {
        self.begin(left, grid, &curve.function().last::<C>());
        match &mut self.method {
            Method::Croquet(walk) => {
                let feed = |e: &Knot<C>| {
                    walk.knot(e, out);
                    !walk.done()
                };
                if let Some(e) = knots(curve, feed) {
                    walk.last(&e, out);
                }
            }
            Method::Lookahead(walk) => {
                let feed = |e: &Knot<C>| {
                    walk.knot(e, out);
                    !walk.done()
                };
                if let Some(e) = knots(curve, feed) {
                    walk.last(&e, out);
                }
            }
            Method::Minimal(search) => {
                let feed = |e: &Knot<C>| {
                    search.knot(e);
                    true
                };
                if let Some(e) = knots(curve, feed) {
                    search.knot(&e);
                }
                search.finish(out);
            }
        }
    }

    fn push(&mut self, depth: f32, v: [f64; C], out: &mut Visibility) {
        if self.broken.is_some() {
            return;
        }
        let end = self.end;
        // Rounding may take a vertex a little below the end value.
        let near_end = |c: usize| ((end[c] - END_SLACK).max(0.0)..end[c]).contains(&v[c]);
        let v: [f64; C] = std::array::from_fn(|c| if near_end(c) { end[c] } else { v[c] });
        let below_end = Broken {
            rule: "VISIBILITY-RISE",
            why: "a visibility is below the end value",
            vertex: self.laws.vertices,
        };
        self.broken = match self.laws.push(depth, &v) {
            Ok(()) => (0..C).any(|c| v[c] < end[c]).then_some(below_end),
            Err(broken) => Some(broken),
        };
        if self.broken.is_some() {
            return;
        }
        let z = f64::from(depth + 0.0);
        match &mut self.held {
            Some(e) if e.z == z => e.behind = v,
            held => {
                // The step from 1 at the first depth is implicit.
                let front = if held.is_none() { [1.0; C] } else { v };
                let next = Knot {
                    z,
                    front,
                    behind: v,
                };
                if let Some(e) = held.replace(next) {
                    self.method.knot(&e, out);
                }
            }
        }
    }

    fn finish(&mut self, out: &mut Visibility) -> Result<()> {
        if let Some(broken) = self.broken {
            return Err(broken.input());
        }
        let behind = self.held.map_or([1.0; C], |e| e.behind);
        if (0..C).any(|c| (behind[c] - self.end[c]).abs() > END_SLACK) {
            return Err(Error::input(format!(
                "a function that ends at {behind:?}, not at {:?} as announced",
                self.end
            )));
        }
        if let Some(e) = self.held.take() {
            self.method.last(&e, out);
        }
        Ok(())
    }
}

/// Hands on the depths of a function, all but the last, which it returns, until `feed` says that it has enough.
#[inline(always)]
fn knots<const C: usize>(curve: &Curve, mut feed: impl FnMut(&Knot<C>) -> bool) -> Option<Knot<C>> {
    let z = curve.depths();
    let n = z.len();
    let planes = curve.planes::<C>().map(|plane| &plane[..n]);
    let v = |i: usize| planes.map(|plane| plane[i]);
    if n == 0 {
        return None;
    }
    let mut front = [1.0; C];
    let mut i = 0;
    while i + 1 < n {
        let pair = i > 0 && z[i + 1] == z[i];
        if i > 0 {
            front = v(i);
        }
        let last = i + usize::from(pair);
        let e = Knot {
            z: f64::from(z[i]),
            front,
            behind: v(last),
        };
        i = last + 1;
        if i == n {
            return Some(e);
        }
        if !feed(&e) {
            return None;
        }
    }
    Some(Knot {
        z: f64::from(z[i]),
        front: if i == 0 { [1.0; C] } else { v(i) },
        behind: v(i),
    })
}
