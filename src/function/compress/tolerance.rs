//! Which tolerance and which lattice to take.

use super::Precision;

/// The least tolerance: half the steps of f32 near 1 would use up a smaller one.
pub const MIN_TOLERANCE: f64 = 1.0 / (1 << 20) as f64;

/// The tolerance for pixels of `samples_per_pixel` samples: `0.25 / sqrt(N)`, half of the noise that the samples
/// themselves have (LV00, section 4), and a hair (2^-20) more.
///
/// The hair: steps of 1/N make target windows that just touch at `0.25 / sqrt(N)`; rounding would decide
/// whether a segment passes them. No samples count as one.
/// ```
/// let eps = deepshadow::default_tolerance(256);
/// assert!(eps > 1.0 / 64.0 && eps < 1.0001 / 64.0);
/// ```
pub fn default_tolerance(samples_per_pixel: u32) -> f64 {
    0.25 / f64::from(samples_per_pixel.max(1)).sqrt() + MIN_TOLERANCE
}

/// What is wrong with a tolerance for pixels of so many samples, if anything: one line for a user.
///
/// A step above twice the tolerance cannot be smoothed. Below `1 / (2 N)` that is every opaque sample: two vertices
/// each, as many as came in. (The paper's own tolerance is below that for fewer than four samples; it is not warned of.)
/// ```
/// use deepshadow::tolerance_warning;
/// assert!(tolerance_warning(0.01, 64).is_none());
/// assert!(tolerance_warning(0.01, 16).is_some()); // below 1/32
/// ```
pub fn tolerance_warning(tolerance: f64, samples_per_pixel: u32) -> Option<String> {
    let n = samples_per_pixel.max(1);
    let paper = 0.25 / f64::from(n).sqrt();
    let limit = 0.5 / f64::from(n);
    if tolerance < limit.min(paper) {
        return Some(format!(
            "at a tolerance of {tolerance} each of {n} opaque samples in a pixel costs two vertices, because it \
             is below 1/(2 * {n}) = {limit:.4}; the paper's is {paper:.4}"
        ));
    }
    if tolerance >= 0.5 {
        return Some(format!(
            "a tolerance of {tolerance} allows shadows to be half gone"
        ));
    }
    None
}

/// The lattice for a tolerance: steps of about a quarter of it, which give the smallest files.
///
/// Tolerances too small for 65535 steps of at most half of them get [`Precision::F32`].
/// ```
/// use deepshadow::{Precision, default_tolerance, lattice_for};
/// assert_eq!(lattice_for(default_tolerance(256)), Precision::Lattice(255));
/// ```
pub fn lattice_for(tolerance: f64) -> Precision {
    let steps = (4.0 / tolerance.max(MIN_TOLERANCE)).floor();
    match steps {
        s if s > 131_070.0 => Precision::F32,
        s => Precision::Lattice(s.clamp(4.0, 65_535.0) as u16),
    }
}
