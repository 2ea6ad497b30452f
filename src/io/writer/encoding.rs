//! Encoding options, tile input and write summary.

use crate::function::compress::MIN_TOLERANCE;
use crate::function::compress::Precision;
use crate::io::StoredTile;
use crate::names::names;
use crate::{Codec, Compressor, Curve, Visibility};

/// The levels that a map gets, and how they are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Mips {
    /// The base level alone.
    None,
    /// All levels down to one pixel, with the same largest error, from more precise hidden
    /// functions.
    #[default]
    Full,
    /// All levels down to one pixel by the schedule of LV00, section 5.3: each from the stored
    /// level below it, with half its tolerance. The error grows to at most twice that of the base.
    /// Suits functions that are already compressed.
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
    /// Largest error of a stored function, default 0.01. 0 means [`Encoding::MIN_TOLERANCE`].
    pub tolerance: f64,
    /// The same for the levels above the base; `None` for the tolerance itself. These levels have
    /// an error of at least 2^-15.
    pub mip_tolerance: Option<f64>,
    /// How vertices are chosen. Default [`Compressor::Lookahead`].
    pub compressor: Compressor,
    /// How visibilities are stored; `None` for [`crate::raw::Precision::for_tolerance`].
    pub precision: Option<Precision>,
    /// How tiles are stored.
    pub codec: Codec,
    /// Which levels there are.
    pub mips: Mips,
    /// Largest error of functions that are already compressed ([`Pixels::Functions`],
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
    /// The least tolerance, 2^-20. Rounding to f32 near 1 would use up a smaller one.
    pub const MIN_TOLERANCE: f64 = MIN_TOLERANCE;

    /// The tolerance for pixels of N samples: `0.25 / sqrt(N)`, half of the noise of the samples
    /// (LV00, section 4), plus 2^-20. 0 samples count as one.
    ///
    /// At exactly `0.25 / sqrt(N)`, steps of 1/N make target windows that just touch, and rounding
    /// would decide whether a segment passes through them. The 2^-20 prevents that.
    ///
    /// ```
    /// let tolerance = deepshadow::Encoding::default_tolerance(256);
    /// assert!(tolerance > 1.0 / 64.0 && tolerance < 1.0001 / 64.0);
    /// ```
    pub fn default_tolerance(samples_per_pixel: u32) -> f64 {
        0.25 / f64::from(samples_per_pixel.max(1)).sqrt() + MIN_TOLERANCE
    }

    /// A warning, in one line, if the tolerance does not suit pixels of N samples.
    ///
    /// Compression cannot remove a step above twice the tolerance. Below `1 / (2 N)` every opaque
    /// sample is such a step and keeps its two vertices. There is no warning for the tolerance of
    /// LV00, which is below that limit for fewer than four samples.
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

    /// Sets the largest error of functions that are already compressed.
    pub fn source_error(mut self, error: f64) -> Self {
        self.source_error = error;
        self
    }
}

/// The functions of a tile, one per pixel, row by row from its upper left pixel. The border of the
/// map cuts tiles off.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// Uncompressed functions. The writer compresses them within the tolerance, which includes
    /// their own errors.
    Curves(Vec<Curve>),
    /// Compressed functions, within [`Encoding::source_error`] of the exact ones. The writer stores
    /// them unchanged.
    Functions(Vec<Visibility>),
    /// A tile of another file, within [`Encoding::source_error`] of the exact functions. The writer
    /// copies its bytes: codec, transform and lattice stay. It decodes the tile only to build the
    /// levels above.
    Stored(StoredTile),
}

/// The properties of a tile that a map checks before it takes the tile.
pub(super) struct TileInput {
    /// Functions in a row, if the tile says.
    pub(super) width: Option<u32>,
    pub(super) pixels: usize,
    pub(super) coloured: bool,
}

impl Pixels {
    pub(super) fn input(&self) -> TileInput {
        let (pixels, coloured) = match self {
            Pixels::Curves(c) => (c.len(), c.iter().any(|f| f.channels() > 1)),
            Pixels::Functions(f) => (f.len(), f.iter().any(|f| f.channels() > 1)),
            Pixels::Stored(tile) => return tile.input(),
        };
        TileInput {
            width: None,
            pixels,
            coloured,
        }
    }
}

impl StoredTile {
    pub(super) fn input(&self) -> TileInput {
        let (width, height) = self.extent;
        TileInput {
            width: Some(width),
            pixels: (width * height) as usize,
            coloured: self.entry.coloured,
        }
    }
}

/// Sizes of a written file.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Summary {
    /// Length of the file.
    pub bytes: u64,
    /// Vertices of each level of each map.
    pub vertices: Vec<Vec<u64>>,
}
