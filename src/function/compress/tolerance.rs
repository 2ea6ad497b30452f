//! The smallest tolerance, and the value lattice for a tolerance.

/// The smallest tolerance. The rounding of f32 near 1 would use up a smaller one.
pub const MIN_TOLERANCE: f64 = 1.0 / (1 << 20) as f64;

/// The visibilities that an output may hold. 0 and 1 are always among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Any f32.
    F32,
    /// k/L for whole k, as the f32 nearest to it: `k as f32 / L as f32`.
    Lattice(u16),
}

impl Precision {
    /// The lattice for a tolerance: its steps are about a quarter of the tolerance, which gives the
    /// smallest files.
    ///
    /// Returns [`Precision::F32`] if 65535 steps are too few for steps of half the tolerance.
    ///
    /// ```
    /// use deepshadow::raw::Precision;
    /// use deepshadow::Encoding;
    /// let tolerance = Encoding::default_tolerance(256);
    /// assert_eq!(Precision::for_tolerance(tolerance), Precision::Lattice(255));
    /// ```
    pub fn for_tolerance(tolerance: f64) -> Precision {
        let steps = (4.0 / tolerance.max(MIN_TOLERANCE)).floor();
        match steps {
            s if s > 131_070.0 => Precision::F32,
            s => Precision::Lattice(s.clamp(4.0, 65_535.0) as u16),
        }
    }

    /// L of visibilities k / L, 0 for f32.
    pub(crate) fn lattice(self) -> u16 {
        match self {
            Precision::F32 => 0,
            Precision::Lattice(lattice) => lattice,
        }
    }
}
