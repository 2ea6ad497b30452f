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

pub use tolerance::{MIN_TOLERANCE, default_tolerance, lattice_for, tolerance_warning};

use super::{Broken, Curve, Visibility};
use crate::names::names;
use crate::{Error, Result};
use minimal::Search;
use tube::{Event, Grid, Tube};
use walk::{CANDIDATES, Walk};

/// How hard to try for few vertices. The error bound is the same for all.
///
/// The figures are for hair at 256 samples a pixel on the lattice of [`lattice_for`]: vertices against the exact minimum, and
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
/// assert_eq!(out.end(), [0.5; 3]);
/// assert!((out.at(2.0) - 0.875).abs() <= 0.126);
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
        let (z, v, built) = (curve.depths(), curve.values(), &mut self.built);
        built.reset(curve.channels());
        self.channels = 0;
        match curve.channels() {
            1 => self.mono.run(left, self.grid, z, v, built),
            _ => self.rgb.run(left, self.grid, z, v, built),
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

    /// Takes the next vertex, under the laws of [`Curve::from_parts`]; [`Encoder::finish`] reports one that breaks them.
    ///
    /// # Panics
    /// If `v` has another number of channels than the function begun, or none was begun.
    pub fn push(&mut self, z: f32, v: &[f64]) {
        assert!(
            self.channels != 0 && v.len() == self.channels,
            "{} values for a vertex of a function with {} channels",
            v.len(),
            self.channels
        );
        match self.channels {
            1 => self.mono.push(z, [v[0]], &mut self.built),
            _ => self.rgb.push(z, [v[0], v[1], v[2]], &mut self.built),
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
    held: Option<Event<C>>,
    /// Whether the depth held already has two vertices.
    full: bool,
    count: usize,
    broken: Option<Broken>,
}

// The variants differ in size, but there is one encoder a thread, not one a pixel.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
enum Method<const C: usize> {
    Croquet(Walk<C, 1>),
    Lookahead(Walk<C, CANDIDATES>),
    Minimal(Search<C>),
}

impl<const C: usize> Method<C> {
    fn begin(&mut self, tube: Tube<C>) {
        match self {
            Method::Croquet(walk) => walk.begin(tube),
            Method::Lookahead(walk) => walk.begin(tube),
            Method::Minimal(search) => search.begin(tube),
        }
    }

    fn event(&mut self, e: &Event<C>, out: &mut Visibility) {
        match self {
            Method::Croquet(walk) => walk.event(e, out),
            Method::Lookahead(walk) => walk.event(e, out),
            Method::Minimal(search) => search.event(e),
        }
    }

    /// Takes the last event.
    fn last(&mut self, e: &Event<C>, out: &mut Visibility) {
        match self {
            Method::Croquet(walk) => walk.last(e, out),
            Method::Lookahead(walk) => walk.last(e, out),
            Method::Minimal(search) => {
                search.event(e);
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
                Compressor::Minimal => Method::Minimal(Search::new(tube)),
            },
            end: [1.0; C],
            held: None,
            full: false,
            count: 0,
            broken: None,
        }
    }

    fn begin(&mut self, left: f64, grid: Grid, end: &[f64]) {
        self.end = std::array::from_fn(|c| end[c]);
        self.method.begin(Tube::new(left, self.end, grid));
        (self.held, self.full, self.count, self.broken) = (None, false, 0, None);
    }

    /// Compresses a function whose laws hold.
    fn run(&mut self, left: f64, grid: Grid, z: &[f32], v: &[f64], out: &mut Visibility) {
        let end = v.last_chunk::<C>().copied().unwrap_or([1.0; C]);
        self.begin(left, grid, &end);
        match &mut self.method {
            Method::Croquet(walk) => {
                let feed = |e: &Event<C>| {
                    walk.event(e, out);
                    !walk.done()
                };
                if let Some(e) = events(z, v, feed) {
                    walk.last(&e, out);
                }
            }
            Method::Lookahead(walk) => {
                let feed = |e: &Event<C>| {
                    walk.event(e, out);
                    !walk.done()
                };
                if let Some(e) = events(z, v, feed) {
                    walk.last(&e, out);
                }
            }
            Method::Minimal(search) => {
                let feed = |e: &Event<C>| {
                    search.event(e);
                    true
                };
                if let Some(e) = events(z, v, feed) {
                    search.event(&e);
                }
                search.finish(out);
            }
        }
    }

    fn push(&mut self, z: f32, v: [f64; C], out: &mut Visibility) {
        if self.broken.is_some() {
            return;
        }
        let z = z + 0.0;
        if let Err((rule, why)) = self.check(z, &v) {
            let vertex = self.count;
            self.broken = Some(Broken { rule, why, vertex });
            return;
        }
        self.count += 1;
        let v = std::array::from_fn(|c| v[c].max(self.end[c]));
        match &mut self.held {
            Some(e) if e.z == f64::from(z) => {
                e.behind = v;
                self.full = true;
            }
            Some(e) => {
                let next = Event {
                    z: f64::from(z),
                    front: v,
                    behind: v,
                };
                let e = std::mem::replace(e, next);
                self.full = false;
                self.method.event(&e, out);
            }
            None => {
                self.full = true; // the step from 1 at the first depth is implicit
                self.held = Some(Event {
                    z: f64::from(z),
                    front: [1.0; C],
                    behind: v,
                });
            }
        }
    }

    fn check(&self, z: f32, v: &[f64; C]) -> std::result::Result<(), (&'static str, &'static str)> {
        if !z.is_finite() {
            return Err(("DEPTH-FINITE", "a depth is not a finite number"));
        }
        if !v.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(("VISIBILITY-RANGE", "a visibility is outside 0 to 1"));
        }
        if (0..C).any(|c| v[c] < self.end[c] - END_SLACK) {
            return Err(("VISIBILITY-RISE", "a visibility is below the end value"));
        }
        let Some(e) = &self.held else {
            return Ok(());
        };
        if f64::from(z) < e.z {
            return Err(("DEPTH-ORDER", "a depth is less than the one before it"));
        }
        if f64::from(z) == e.z && self.count == 1 {
            return Err(("DEPTH-FIRST", "the first depth holds two vertices"));
        }
        if f64::from(z) == e.z && self.full {
            return Err(("DEPTH-PAIR", "three vertices share one depth"));
        }
        if (0..C).any(|c| v[c].max(self.end[c]) > e.behind[c]) {
            return Err(("VISIBILITY-RISE", "a visibility rises with depth"));
        }
        Ok(())
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
fn events<const C: usize>(
    z: &[f32],
    v: &[f64],
    mut feed: impl FnMut(&Event<C>) -> bool,
) -> Option<Event<C>> {
    let (v, _) = v.as_chunks::<C>();
    let n = z.len().min(v.len());
    if n == 0 {
        return None;
    }
    let mut front = [1.0; C];
    let mut i = 0;
    while i + 1 < n {
        let pair = i > 0 && z[i + 1] == z[i];
        if i > 0 {
            front = v[i];
        }
        let last = i + usize::from(pair);
        let e = Event {
            z: f64::from(z[i]),
            front,
            behind: v[last],
        };
        i = last + 1;
        if i == n {
            return Some(e);
        }
        if !feed(&e) {
            return None;
        }
    }
    Some(Event {
        z: f64::from(z[i]),
        front: if i == 0 { [1.0; C] } else { v[i] },
        behind: v[i],
    })
}
