//! The filter kernels that producers and lookups share (LV00, sections 3.2 and 3.4).

use crate::names::names;

/// A filter kernel around a point, scaled to the footprint. Distances are in footprint widths.
///
/// | filter | weight at distance d | ends at |
/// |---|---|---|
/// | `Nearest` | 1 for the pixel that holds the point, else 0 | |
/// | `Box` | 1 | 1/2 |
/// | `Triangle` | 1 - d | 1 |
/// | `Gaussian` | exp(-2 d²) - exp(-8) | 2 |
/// | `CatmullRom` | the cubic that interpolates; negative between 1 and 2 | 2 |
///
/// In two dimensions the weight is the product of the weights of both axes. At a width of one
/// pixel, `Triangle` is bilinear interpolation. So is `Box`, because it weights each pixel by the
/// area that it covers of the pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Filter {
    /// No filter.
    Nearest,
    /// The same weight everywhere in the footprint.
    Box,
    /// Falls linearly to 0 at one width.
    #[default]
    Triangle,
    /// Smooth; falls to 0 at two widths.
    Gaussian,
    /// Sharper than the others, with negative lobes; a filtered value is clamped to 0..=1.
    CatmullRom,
}

names!(Filter, "filter" {
    Nearest = "nearest",
    Box = "box",
    Triangle = "triangle",
    Gaussian = "gaussian",
    CatmullRom = "catmull-rom",
});

impl Filter {
    /// Distance at which the kernel ends, in widths.
    pub fn radius(self) -> f32 {
        match self {
            Filter::Nearest => 0.0,
            Filter::Box => 0.5,
            Filter::Triangle => 1.0,
            Filter::Gaussian | Filter::CatmullRom => 2.0,
        }
    }

    /// Weight at distance `d` in widths, not normalised.
    ///
    /// ```
    /// use deepshadow::Filter;
    /// assert_eq!(Filter::Triangle.weight(0.25), 0.75);
    /// assert_eq!(Filter::CatmullRom.weight(1.0), 0.0);
    /// ```
    pub fn weight(self, d: f32) -> f32 {
        let d = d.abs();
        match self {
            Filter::Nearest | Filter::Box => f32::from(d <= 0.5),
            Filter::Triangle => (1.0 - d).max(0.0),
            Filter::Gaussian if d < 2.0 => (-2.0 * d * d).exp() - (-8f32).exp(),
            Filter::CatmullRom if d < 1.0 => (1.5 * d - 2.5) * d * d + 1.0,
            Filter::CatmullRom if d < 2.0 => ((2.5 - 0.5 * d) * d - 4.0) * d + 2.0,
            _ => 0.0,
        }
    }
}
