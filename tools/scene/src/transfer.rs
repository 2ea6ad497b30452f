//! Transfer functions: map a sample of a volume to extinction in each channel.

use crate::error::{Error, ErrorKind, Result};

/// Extinction as a function of a sample's value, for red, green and blue.
///
/// Linear between points, constant before the first and after the last. Two points with the same
/// value are a jump; at the jump itself, the second point applies.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    points: Vec<(f32, [f32; 3])>,
}

impl TransferFunction {
    /// A function through points, each a value and the extinction there.
    ///
    /// ```
    /// use deepshadow_scene::transfer::TransferFunction;
    /// let grey = |e| [e; 3];
    /// let points = vec![(100.0, grey(0.0)), (200.0, grey(1.0)), (200.0, grey(4.0))];
    /// let bone = TransferFunction::new(points)?;
    /// assert_eq!(bone.at(150.0), grey(0.5)); // half way up
    /// assert_eq!(bone.at(200.0), grey(4.0)); // after the jump
    /// assert!(bone.is_zero_between(0.0, 100.0));
    /// # Ok::<(), deepshadow_scene::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`ErrorKind::Scene`] without points, for values that are not finite or not ascending, for
    /// three points at the same value, and for extinction that is negative or not finite.
    pub fn new(points: Vec<(f32, [f32; 3])>) -> Result<Self> {
        for (i, point) in points.iter().enumerate() {
            fits(&points[i.saturating_sub(2)..i], point).map_err(|fault| {
                Error::new(ErrorKind::Scene, format!("point {}: {fault}", i + 1))
            })?;
        }
        if points.is_empty() {
            return Err(Error::new(
                ErrorKind::Scene,
                "a transfer function needs at least one point",
            ));
        }
        Ok(TransferFunction { points })
    }

    /// A ramp from 0 at `lo` to 1 at `hi`, the same in all channels. It falls if `lo > hi` and
    /// jumps if they are equal.
    ///
    /// # Panics
    /// If `lo` or `hi` is not finite.
    pub fn linear(lo: f32, hi: f32) -> Self {
        assert!(lo.is_finite() && hi.is_finite(), "from {lo} to {hi}");
        let mut points = vec![(lo, [0.0; 3]), (hi, [1.0; 3])];
        if lo > hi {
            points.reverse();
        }
        TransferFunction { points }
    }

    /// The function with all extinctions multiplied by `factor`.
    ///
    /// # Panics
    /// If `factor` is negative or not finite, or a product exceeds the greatest f32.
    pub fn scaled(&self, factor: f32) -> Self {
        assert!(factor >= 0.0 && factor.is_finite(), "times {factor}");
        let scaled = |&(v, e): &(f32, [f32; 3])| (v, e.map(|e| e * factor));
        let points: Vec<_> = self.points.iter().map(scaled).collect();
        assert!(
            points.iter().all(|(_, e)| e.iter().all(|e| e.is_finite())),
            "times {factor} overflows f32"
        );
        TransferFunction { points }
    }

    /// Extinction of a sample. Cost: one binary search.
    pub fn at(&self, value: f32) -> [f32; 3] {
        let after = self.points.partition_point(|&(v, _)| v <= value);
        let (Some(&(v0, e0)), Some(&(v1, e1))) = (
            self.points.get(after.wrapping_sub(1)),
            self.points.get(after),
        ) else {
            // Before the first point or after the last.
            return self.points[after.min(self.points.len() - 1)].1;
        };
        // In f64: the difference of two f32 values may overflow f32.
        let t = (f64::from(value) - f64::from(v0)) / (f64::from(v1) - f64::from(v0));
        let t = t as f32;
        std::array::from_fn(|c| e0[c] * (1.0 - t) + e1[c] * t)
    }

    /// Whether the channels differ anywhere.
    pub fn is_coloured(&self) -> bool {
        self.points
            .iter()
            .any(|(_, e)| e[0] != e[1] || e[1] != e[2])
    }

    /// The greatest extinction of samples from `lo` to `hi` inclusive, for each channel, up to
    /// rounding.
    ///
    /// Cost: two binary searches and the points between.
    pub fn max_between(&self, lo: f32, hi: f32) -> [f32; 3] {
        let mut max = self.at(lo);
        let mut raise = |e: [f32; 3]| max = std::array::from_fn(|c| max[c].max(e[c]));
        raise(self.at(hi));
        let first = self.points.partition_point(|&(v, _)| v <= lo);
        self.points[first..]
            .iter()
            .take_while(|&&(v, _)| v <= hi)
            .for_each(|&(_, e)| raise(e));
        max
    }

    /// Whether all samples from `lo` to `hi` inclusive have no extinction, so that the space can be
    /// skipped.
    pub fn is_zero_between(&self, lo: f32, hi: f32) -> bool {
        self.max_between(lo, hi) == [0.0; 3]
    }

    /// The points, in ascending order of values.
    pub fn points(&self) -> &[(f32, [f32; 3])] {
        &self.points
    }
}

/// Checks that a point may follow the points before it, and returns the reason otherwise. Only the
/// last two points of `before` matter.
pub(crate) fn fits(
    before: &[(f32, [f32; 3])],
    &(value, extinction): &(f32, [f32; 3]),
) -> std::result::Result<(), String> {
    if !value.is_finite() {
        return Err(format!("the value {value} is not a finite number"));
    }
    if let Some(e) = extinction.iter().find(|e| !(e.is_finite() && **e >= 0.0)) {
        return Err(format!("extinction {e} is not a finite number from 0 up"));
    }
    match *before {
        [.., (last, _)] if last > value => Err(format!(
            "the value {value} follows {last}: values must ascend"
        )),
        [.., (a, _), (b, _)] if a == value && b == value => Err(format!(
            "a third point at the value {value}: two make a jump"
        )),
        _ => Ok(()),
    }
}
