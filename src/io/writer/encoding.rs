//! What the caller says of a map, gives for a tile, and is told in the end.

use crate::io::StoredTile;
#[allow(unused_imports)] // the documentation names it
use crate::lattice_for;
use crate::{Codec, Compressor, Curve, Precision, Visibility};

/// Which levels a map gets, and how they are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Mips {
    /// The base level alone.
    None,
    /// All levels down to one pixel, each within the same promise (from a more precise hidden chain).
    #[default]
    Full,
    /// All levels down to one pixel by the paper's schedule (LV00, section 5.3): each from the stored level below it, the
    /// tolerance halved each time, so that the promise grows to at most twice the first. For finished maps.
    Halved,
}

/// How the functions of a map are compressed and stored.
///
/// ```
/// let encoding = deepshadow::Encoding { tolerance: 1.0 / 64.0, ..Default::default() };
/// assert_eq!(encoding.mips, deepshadow::Mips::Full);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// The largest error of a stored function; 0 asks for the least possible, [`crate::MIN_TOLERANCE`]. Default 0.01.
    pub tolerance: f64,
    /// The same for the levels above the base; the tolerance itself if `None`. Levels keep no promise below 2^-15.
    pub mip_tolerance: Option<f64>,
    /// Which vertices are kept. Default [`Compressor::Lookahead`].
    pub compressor: Compressor,
    /// How visibilities are stored; chosen by the tolerance if `None` ([`crate::lattice_for`]).
    pub precision: Option<Precision>,
    /// How tiles are stored.
    pub codec: Codec,
    /// Which levels there are.
    pub mips: Mips,
    /// Promise of functions that come already compressed ([`Pixels::Functions`], [`Pixels::Stored`]): what they may be off.
    pub given_error: f64,
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
            given_error: 0.0,
        }
    }
}

/// The functions of a tile, row by row from its top left pixel.
#[derive(Clone, Debug)]
pub enum Pixels {
    /// Uncompressed: the writer compresses them within the tolerance, their own errors counted.
    Curves(Vec<Curve>),
    /// Already compressed, within [`Encoding::given_error`] of what they stand for: stored as they are.
    Functions(Vec<Visibility>),
    /// A tile of another file, within [`Encoding::given_error`] of what it stands for: its bytes are copied as they are, codec, transform
    /// and lattice included. It is decoded only if there are levels to be made from it.
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

/// A tile of the base level on its way into the file.
#[derive(Clone, Debug)]
pub struct TileInput {
    /// Column of the tile.
    pub tx: u32,
    /// Row of the tile.
    pub ty: u32,
    /// Its functions, as many as it has pixels: tiles at the border are cut off there.
    pub pixels: Pixels,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Length of the file.
    pub bytes: u64,
    /// Vertices of each level of each map.
    pub vertices: Vec<Vec<u64>>,
}
