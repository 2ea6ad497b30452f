//! Encoding options, tile input and write summary.

use crate::function::compress::MIN_TOLERANCE;
use crate::io::StoredTile;
use crate::names::names;
use crate::{Codec, Compressor, Curve, Precision, Visibility};

/// Which levels a map gets, and how they are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Mips {
    /// The base level alone.
    None,
    /// All levels down to one pixel, each within the same error (from a more precise hidden chain).
    #[default]
    Full,
    /// All levels down to one pixel by the paper's schedule (LV00, section 5.3): each from the
    /// stored level below it, the tolerance halved each time, so that the error grows to at most
    /// twice the first. For finished maps.
    Halved,
}

names!(Mips, "way to make levels" {
    None = "none",
    Full = "full",
    Halved = "halved",
});

/// How the functions of a map are compressed and stored.
///
/// ```
/// use deepshadow::{Codec, Encoding, Mips};
/// let encoding = Encoding::new(1.0 / 64.0).codec(Codec::None);
/// assert_eq!((encoding.tolerance, encoding.mips), (1.0 / 64.0, Mips::Full));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Encoding {
    /// The largest error of a stored function; 0 asks for the least possible, [`Encoding::MIN_TOLERANCE`]. Default 0.01.
    pub tolerance: f64,
    /// The same for the levels above the base; the tolerance itself if `None`. No level has an error
    /// below 2^-15.
    pub mip_tolerance: Option<f64>,
    /// Which vertices are kept. Default [`Compressor::Lookahead`].
    pub compressor: Compressor,
    /// How visibilities are stored; chosen by the tolerance if `None` ([`crate::Precision::for_tolerance`]).
    pub precision: Option<Precision>,
    /// How tiles are stored.
    pub codec: Codec,
    /// Which levels there are.
    pub mips: Mips,
    /// The largest error of functions that come already compressed ([`Pixels::Functions`],
    /// [`Pixels::Stored`]).
    pub source_error: f64,
}

impl Default for Encoding {
    fn default() -> Self {
        Encoding {
            tolerance: 0.01,
            mip_tolerance: None,
            compressor: Compressor::Lookahead,
            precision: None,
            codec: Codec::default(),
            mips: Mips::default(),
            source_error: 0.0,
        }
    }
}

impl Encoding {
    /// The least tolerance, 2^-20: half the steps of f32 near 1 would use up a smaller one.
    pub const MIN_TOLERANCE: f64 = MIN_TOLERANCE;

    /// The tolerance for pixels of `samples_per_pixel` samples: `0.25 / sqrt(N)`, half of the noise
    /// that the samples themselves have (LV00, section 4), and a hair (2^-20) more.
    ///
    /// The hair: steps of 1/N make target windows that just touch at `0.25 / sqrt(N)`; rounding would
    /// decide whether a segment passes them. No samples count as one.
    ///
    /// ```
    /// let tolerance = deepshadow::Encoding::default_tolerance(256);
    /// assert!(tolerance > 1.0 / 64.0 && tolerance < 1.0001 / 64.0);
    /// ```
    pub fn default_tolerance(samples_per_pixel: u32) -> f64 {
        0.25 / f64::from(samples_per_pixel.max(1)).sqrt() + MIN_TOLERANCE
    }

    /// A warning, in one line, about a tolerance that does not suit pixels of so many samples.
    ///
    /// A step above twice the tolerance cannot be smoothed. Below `1 / (2 N)` that is every opaque
    /// sample: two vertices each, as many as came in. (The paper's own tolerance is below that for
    /// fewer than four samples; it is not warned of.)
    ///
    /// ```
    /// use deepshadow::Encoding;
    /// assert!(Encoding::tolerance_warning(0.01, 64).is_none());
    /// assert!(Encoding::tolerance_warning(0.01, 16).is_some()); // below 1/32
    /// ```
    pub fn tolerance_warning(tolerance: f64, samples_per_pixel: u32) -> Option<String> {
        let n = samples_per_pixel.max(1);
        let paper = 0.25 / f64::from(n).sqrt();
        let limit = 0.5 / f64::from(n);
        if tolerance < limit.min(paper) {
            return Some(format!(
                "at a tolerance of {tolerance} each of {n} opaque samples in a pixel costs two \
                 vertices, because it is below 1/(2 * {n}) = {limit:.4}; the paper's is {paper:.4}"
            ));
        }
        if tolerance >= 0.5 {
            return Some(format!(
                "a tolerance of {tolerance} allows shadows to be half gone"
            ));
        }
        None
    }

    /// The default encoding with another tolerance.
    pub fn new(tolerance: f64) -> Self {
        Encoding {
            tolerance,
            ..Encoding::default()
        }
    }

    /// Sets the largest error of a stored function.
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Sets the tolerance of the levels above the base.
    pub fn mip_tolerance(mut self, tolerance: impl Into<Option<f64>>) -> Self {
        self.mip_tolerance = tolerance.into();
        self
    }

    /// Sets how vertices are chosen.
    pub fn compressor(mut self, compressor: Compressor) -> Self {
        self.compressor = compressor;
        self
    }

    /// Sets how visibilities are stored.
    pub fn precision(mut self, precision: impl Into<Option<Precision>>) -> Self {
        self.precision = precision.into();
        self
    }

    /// Sets how tiles are stored.
    pub fn codec(mut self, codec: Codec) -> Self {
        self.codec = codec;
        self
    }

    /// Sets which levels there are.
    pub fn mips(mut self, mips: Mips) -> Self {
        self.mips = mips;
        self
    }

    /// Sets the largest error of functions that come already compressed.
    pub fn source_error(mut self, error: f64) -> Self {
        self.source_error = error;
        self
    }
}

/// The functions of a tile, row by row from its top left pixel, as many as it has pixels: tiles at
/// the border are cut off there.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// Uncompressed: the writer compresses them within the tolerance, their own errors counted.
    Curves(Vec<Curve>),
    /// Already compressed, within [`Encoding::source_error`] of the exact ones: stored as they are.
    Functions(Vec<Visibility>),
    /// A tile of another file, within [`Encoding::source_error`] of the exact functions: its bytes
    /// are copied as they are, codec, transform and lattice included. It is decoded only if there
    /// are levels to be made from it.
    Stored(StoredTile),
}

impl Pixels {
    pub(super) fn len(&self) -> usize {
        match self {
            Pixels::Curves(c) => c.len(),
            Pixels::Functions(f) => f.len(),
            Pixels::Stored(t) => (t.extent.0 * t.extent.1) as usize,
        }
    }

    pub(super) fn most_channels(&self) -> usize {
        let most = |n: &mut dyn Iterator<Item = usize>| n.max().unwrap_or(1);
        match self {
            Pixels::Curves(c) => most(&mut c.iter().map(Curve::channels)),
            Pixels::Functions(f) => most(&mut f.iter().map(Visibility::channels)),
            Pixels::Stored(t) if t.entry.coloured => 3,
            Pixels::Stored(_) => 1,
        }
    }
}

/// Sizes of a finished file.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// Length of the file.
    pub bytes: u64,
    /// Vertices of each level of each map.
    pub vertices: Vec<Vec<u64>>,
}
