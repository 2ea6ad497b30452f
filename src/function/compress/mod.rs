//! Compression with a guaranteed error (LV00, section 3.3).
//!
//! | module | contents |
//! |---|---|
//! | `tube` | the values that an output may take: storable values, and the tube around the input |
//! | `walk` | `Croquet`, the paper's greedy walk; `Lookahead`, the same from several origins |
//! | `minimal` | [`Compressor::Minimal`], a search for nearly the fewest vertices |
//! | `tolerance` | the least tolerance, and the lattice for a tolerance |
//!
//! All compressors keep the same rules:
//!
//! - An output depth is an input depth, bit for bit.
//! - A segment starts from the stored value, after rounding.
//! - The output stays in the *tube*: within the tolerance of the input, between the end value and
//!   1.
//!   Values are chosen inside the tube and never moved afterwards.
//! - The output never rises.
//! - The output ends at the storable value nearest to the end of the input: exactly, if that is 0
//!   or 1.

mod minimal;
mod tolerance;
mod tube;
mod walk;

pub use tolerance::{MIN_TOLERANCE, Precision};

use super::{Curve, Visibility};
use crate::names::names;
use crate::{Error, Result};
use minimal::MinimalSearch;
use tube::{Grid, Tube};
use walk::{CANDIDATES, Walk};

/// The effort to find few vertices. The error bound is the same for all.
///
/// The figures are for hair at 256 samples a pixel on the lattice of [`Precision::for_tolerance`]:
/// output vertices relative to the exact minimum, and input vertices a second on one core.
/// `benches/record/compress.md` has the figures of other scenes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Compressor {
    /// The paper's greedy walk: the longest segment from the current origin. 1.4 times the minimum,
    /// about 100 million a second.
    Croquet,
    /// The greedy walk from several candidate origins. It chooses the origin only when the next
    /// segment shows which candidate reaches furthest. 1.1 times the minimum, about 40 million a
    /// second. The default.
    #[default]
    Lookahead,
    /// A search over a few values at some depths. 1.01 times the minimum, about 6 million a second.
    /// It keeps the whole pixel in memory.
    Minimal,
}

names!(Compressor, "compressor" {
    Croquet = "croquet",
    Lookahead = "lookahead",
    Minimal = "minimal",
});

/// Compresses visibility functions, one after the other.
///
/// Allocates nothing once it has seen the largest function. Cost: O(n) for n input vertices. The
/// state is bounded for [`Compressor::Croquet`] and [`Compressor::Lookahead`];
/// [`Compressor::Minimal`] keeps the input. LV00, section 3.3; colour, section 5.2.
///
/// ```
/// use deepshadow::raw::{Encoder, Precision};
/// use deepshadow::{Compressor, Curve, Visibility};
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
    mono: Method<1>,
    rgb: Method<3>,
    built: Visibility,
}

impl Encoder {
    /// An encoder whose outputs are within `tolerance` of their inputs. A tolerance below
    /// `Encoding::MIN_TOLERANCE` counts as that.
    ///
    /// # Errors
    /// `Input` for a tolerance that is negative or not finite, and for a lattice that is coarser
    /// than the tolerance (`1/L > tolerance`) or has no steps (`L` = 0).
    pub fn new(compressor: Compressor, precision: Precision, tolerance: f64) -> Result<Self> {
        if !(tolerance.is_finite() && tolerance >= 0.0) {
            return Err(Error::input(format!("a tolerance of {tolerance}")));
        }
        if precision == Precision::Lattice(0) {
            return Err(Error::input("a lattice without steps"));
        }
        let tolerance = tolerance.max(MIN_TOLERANCE);
        let grid = Grid::new(precision);
        let encoder = Encoder {
            tolerance,
            grid,
            mono: Method::new(compressor, Tube::new(tolerance, [1.0], grid)),
            rgb: Method::new(compressor, Tube::new(tolerance, [1.0; 3], grid)),
            built: Visibility::lit(),
        };
        encoder.remaining_tolerance(0.0)?;
        Ok(encoder)
    }

    /// The tolerance in use.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// The tolerance that remains for an input that already carries `error`.
    fn remaining_tolerance(&self, error: f64) -> Result<f64> {
        let left = self.tolerance - error;
        if !(error >= 0.0 && left >= MIN_TOLERANCE / 8.0) {
            return Err(Error::input(format!(
                "an input with error {error} leaves nothing of the tolerance {}",
                self.tolerance
            )));
        }
        match self.grid.lattice {
            l @ 1.. if left * f64::from(l) < 1.0 => Err(Error::input(format!(
                "steps of 1/{l} are coarser than the tolerance {left}"
            ))),
            _ => Ok(left),
        }
    }

    /// Compresses `curve` into `out`. The error of the curve counts: the exact function is within
    /// the tolerance of `out`.
    ///
    /// # Errors
    /// `Input` if the curve's error leaves less of the tolerance than an eighth of
    /// `Encoding::MIN_TOLERANCE` or, with a lattice, less than one of its steps. `out` is unchanged
    /// then.
    pub fn compress(&mut self, curve: &Curve, out: &mut Visibility) -> Result<()> {
        let left = self.remaining_tolerance(curve.error())?;
        let built = &mut self.built;
        built.vertices.reset(curve.channels());
        match curve.channels() {
            1 => self.mono.compress(left, self.grid, curve, built),
            _ => self.rgb.compress(left, self.grid, curve, built),
        }
        self.built.canonicalise();
        std::mem::swap(&mut self.built, out);
        Ok(())
    }
}

/// The compressor of functions with `C` channels.
// The variants differ in size, but there is one encoder a thread, not one a pixel.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug)]
enum Method<const C: usize> {
    Croquet(Walk<C, 1>),
    Lookahead(Walk<C, CANDIDATES>),
    Minimal(MinimalSearch<C>),
}

impl<const C: usize> Method<C> {
    fn new(compressor: Compressor, tube: Tube<C>) -> Self {
        match compressor {
            Compressor::Croquet => Method::Croquet(Walk::new(tube)),
            Compressor::Lookahead => Method::Lookahead(Walk::new(tube)),
            Compressor::Minimal => Method::Minimal(MinimalSearch::new(tube)),
        }
    }

    fn compress(&mut self, tolerance: f64, grid: Grid, curve: &Curve, out: &mut Visibility) {
        let tube = Tube::new(tolerance, curve.function().last(), grid);
        match self {
            Method::Croquet(walk) => walk.compress(tube, curve, out),
            Method::Lookahead(walk) => walk.compress(tube, curve, out),
            Method::Minimal(search) => search.compress(tube, curve, out),
        }
    }
}
