//! Chooses the levels of a footprint, and the kernel in each level.

use super::query::{Footprint, LevelChoice, SamplerOptions};
use crate::Filter;

/// Which levels a footprint uses, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FootprintPlan {
    /// The level, or the finer of two.
    pub level: usize,
    /// Weight of the next coarser level, 0 to 1.
    pub blend: f64,
    axes: Axes,
}

/// The kernel's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Axes {
    /// One pixel of the level along both axes.
    Unit,
    /// This many pixels of the level along both axes.
    Round(f32),
    /// Direction of the longer axis; lengths of the longer and shorter axis in pixels of the level.
    Long([f32; 2], [f32; 2]),
}

/// A kernel in the pixels of one level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kernel {
    filter: Filter,
    /// Direction of the first axis.
    pub direction: [f32; 2],
    /// Length of both axes in pixels.
    length: [f32; 2],
}

impl FootprintPlan {
    fn one(level: usize, axes: Axes) -> FootprintPlan {
        FootprintPlan {
            level,
            blend: 0.0,
            axes,
        }
    }

    /// Whether the kernel is one pixel wide, so that its window has a fixed size.
    #[inline(always)]
    pub fn is_unit(&self) -> bool {
        self.axes == Axes::Unit
    }

    /// The kernel in pixels of either level. No axis is longer than four times `side`, the longer
    /// side of the level in pixels.
    pub fn kernel(&self, filter: Filter, side: i32) -> Kernel {
        let (direction, length) = match self.axes {
            Axes::Unit => ([1.0, 0.0], [1.0; 2]),
            Axes::Round(u) => ([1.0, 0.0], [u; 2]),
            Axes::Long(direction, length) => (direction, length),
        };
        Kernel {
            filter,
            direction,
            length: length.map(|u| u.min(4.0 * side as f32)),
        }
    }

    /// The levels with weight, and their weights.
    pub fn levels(&self) -> impl Iterator<Item = (usize, f64)> + use<> {
        let shares = [(self.level, 1.0 - self.blend), (self.level + 1, self.blend)];
        shares.into_iter().filter(|&(_, share)| share > 0.0)
    }
}

impl Kernel {
    /// The largest distance along x and y, in pixels, from the kernel's centre to the centre of a
    /// pixel with weight.
    pub fn reach(&self) -> [f32; 2] {
        let edge = if self.filter == Filter::Box { 0.5 } else { 0.0 };
        let [a, b] = self.length.map(|u| self.filter.radius() * u + edge);
        let [x, y] = self.direction.map(f32::abs);
        [x * a + y * b, y * a + x * b]
    }

    /// Whether each weight is the product of a row weight and a column weight.
    pub fn is_separable(&self) -> bool {
        self.direction == [1.0, 0.0]
    }

    /// Weight along axis `k` at a distance of `d` pixels.
    pub fn along(&self, k: usize, d: f32) -> f32 {
        let u = self.length[k];
        match self.filter {
            // The part of the pixel that the box covers.
            Filter::Box => ((d + 0.5).min(u / 2.0) - (d - 0.5).max(-u / 2.0)).clamp(0.0, 1.0),
            filter => filter.weight(d / u),
        }
    }

    /// Weight of a pixel whose centre lies at `d` from the kernel's centre.
    pub fn weight(&self, d: [f32; 2]) -> f32 {
        let [x, y] = self.direction;
        self.along(0, d[0] * x + d[1] * y) * self.along(1, d[1] * x - d[0] * y)
    }
}

/// The plan of a finite footprint, for a map of `count` levels.
#[inline(always)]
pub(super) fn plan(footprint: &Footprint, options: &SamplerOptions, count: usize) -> FootprintPlan {
    match *footprint {
        Footprint::Width(width) if width <= 1.0 => FootprintPlan::one(0, Axes::Unit),
        Footprint::Width(width) => {
            let (level, rest) = split(width, options.levels, count);
            match options.levels {
                _ if rest == 1.0 => FootprintPlan::one(level, Axes::Unit),
                // The blend makes the weighted mean of both pixel widths equal to the footprint's.
                LevelChoice::Blend if level + 1 < count => FootprintPlan {
                    level,
                    blend: f64::from(rest) - 1.0,
                    axes: Axes::Unit,
                },
                _ => FootprintPlan::one(level, Axes::Round(rest)),
            }
        }
        Footprint::Ellipse { dx, dy } => ellipse(dx, dy, options, count),
    }
}

/// The coarsest level whose pixels are at most `width` wide, and the width in its pixels: 1 to 2,
/// or more in the last level.
#[inline(always)]
fn split(width: f32, levels: LevelChoice, count: usize) -> (usize, f32) {
    let last = if levels == LevelChoice::Base {
        0
    } else {
        count - 1
    };
    let level = ((width.to_bits() >> 23) as usize)
        .saturating_sub(127)
        .min(last);
    (level, width * power(level))
}

/// 2^-level, exactly.
#[inline(always)]
fn power(level: usize) -> f32 {
    f32::from_bits((127 - level as u32) << 23)
}

#[inline(never)]
fn ellipse(dx: [f32; 2], dy: [f32; 2], options: &SamplerOptions, count: usize) -> FootprintPlan {
    // The principal axes are the eigenvectors of J J^T. The columns of J are the two vectors.
    let [dx, dy] = [dx, dy].map(|v| v.map(f64::from));
    let (a, b, c) = (
        dx[0] * dx[0] + dy[0] * dy[0],
        dx[0] * dx[1] + dy[0] * dy[1],
        dx[1] * dx[1] + dy[1] * dy[1],
    );
    let (mean, radius) = ((a + c) / 2.0, ((a - c) / 2.0).hypot(b));
    let angle = 0.5 * (2.0 * b).atan2(a - c);
    let long = (mean + radius).sqrt().max(1.0);
    let short = (mean - radius)
        .max(0.0)
        .sqrt()
        .max(long / f64::from(options.anisotropy))
        .max(1.0);
    let round = plan(&Footprint::Width(short as f32), options, count);
    let ratio = (long / short) as f32;
    if ratio <= 1.0 {
        return round;
    }
    let unit = match round.axes {
        Axes::Round(u) => u,
        _ => 1.0,
    };
    FootprintPlan {
        axes: Axes::Long(
            [angle.cos() as f32, angle.sin() as f32],
            [ratio * unit, unit],
        ),
        ..round
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planned(footprint: Footprint, levels: LevelChoice) -> FootprintPlan {
        let options = SamplerOptions {
            levels,
            ..SamplerOptions::default()
        };
        plan(&footprint, &options, 5)
    }

    #[test]
    fn the_width_chooses_the_level() {
        let width = |w, levels| planned(Footprint::Width(w), levels);
        for (w, level, blend) in [
            (0.0, 0, 0.0),
            (1.0, 0, 0.0),
            (1.5, 0, 0.5),
            (2.0, 1, 0.0),
            (7.0, 2, 0.75),
            (16.0, 4, 0.0),
        ] {
            let plan = width(w, LevelChoice::Blend);
            assert_eq!(
                (plan.level, plan.blend, plan.axes),
                (level, blend, Axes::Unit),
                "{w}"
            );
        }
        assert_eq!(
            width(48.0, LevelChoice::Blend),
            FootprintPlan::one(4, Axes::Round(3.0))
        );
        assert_eq!(
            width(7.0, LevelChoice::One),
            FootprintPlan::one(2, Axes::Round(1.75))
        );
        assert_eq!(
            width(7.0, LevelChoice::Base),
            FootprintPlan::one(0, Axes::Round(7.0))
        );
        assert_eq!(width(f32::MAX, LevelChoice::Blend).level, 4);
    }

    #[test]
    fn an_ellipse_takes_its_level_from_the_shorter_axis() {
        let ellipse = |dx, dy| planned(Footprint::Ellipse { dx, dy }, LevelChoice::Blend);
        assert_eq!(
            ellipse([4.0, 0.0], [0.0, 4.0]),
            FootprintPlan::one(2, Axes::Unit)
        );
        let FootprintPlan { level, axes, .. } = ellipse([0.0, 12.0], [4.0, 0.0]);
        let Axes::Long([x, y], length) = axes else {
            panic!("{axes:?}")
        };
        assert!(level == 2 && x.abs() < 1e-6 && y == 1.0 && length == [3.0, 1.0]);
        // Thinner than a pixel, and longer than 16 : 1.
        let FootprintPlan { level, axes, .. } = ellipse([64.0, 0.0], [0.0, 0.1]);
        assert_eq!((level, axes), (2, Axes::Long([1.0, 0.0], [16.0, 1.0])));
        assert_eq!(
            ellipse([0.0; 2], [0.0; 2]),
            FootprintPlan::one(0, Axes::Unit)
        );
    }
}
