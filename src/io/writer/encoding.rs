//! Encoding options, tile input and write summary.

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
    /// The largest error of a stored function; 0 asks for the least possible, [`crate::MIN_TOLERANCE`]. Default 0.01.
    pub tolerance: f64,
    /// The same for the levels above the base; the tolerance itself if `None`. No level has an error
    /// below 2^-15.
    pub mip_tolerance: Option<f64>,
    /// Which vertices are kept. Default [`Compressor::Lookahead`].
    pub compressor: Compressor,
    /// How visibilities are stored; chosen by the tolerance if `None` ([`crate::lattice_for`]).
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
