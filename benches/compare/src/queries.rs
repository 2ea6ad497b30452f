//! The queries of the comparison: kinds of lookups, and the orders of their points.

use crate::scene::Dice;

/// A filtered lookup, by the pixels that it touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Lookup {
    /// The pixel that holds the point.
    Pixel,
    /// 2 x 2 pixels of the base level: a triangle of one pixel.
    Bilinear,
    /// 2 x 2 pixels of each of two levels, blended: a triangle of 1.5 pixels.
    Trilinear,
    /// 4 x 4 pixels of the base level with weights exp(-2 d^2).
    Gaussian,
}

impl Lookup {
    /// All of them, cheapest first.
    pub const ALL: [Lookup; 4] = [
        Lookup::Pixel,
        Lookup::Bilinear,
        Lookup::Trilinear,
        Lookup::Gaussian,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Lookup::Pixel => "one pixel",
            Lookup::Bilinear => "bilinear 2x2",
            Lookup::Trilinear => "trilinear",
            Lookup::Gaussian => "4x4 Gaussian",
        }
    }

    /// Width of the footprint in pixels of the base level.
    pub fn width(self) -> f32 {
        match self {
            Lookup::Trilinear => 1.5,
            _ => 1.0,
        }
    }
}

/// The two levels that a footprint of `width` pixels lies between, and the weight of the second: as
/// far as the width is from one's pixels to the other's.
#[inline(always)]
pub fn levels_of(width: f32, levels: usize) -> (usize, usize, f64) {
    let width = width.max(1.0);
    // A float's exponent is its logarithm, rounded down.
    let fine = ((width.to_bits() >> 23) as usize - 127).min(levels - 1);
    if fine + 1 == levels {
        return (fine, fine, 0.0);
    }
    let blend = f64::from(width) / (1u64 << fine) as f64 - 1.0;
    (fine, fine + 1, blend)
}

/// The order of queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Access {
    /// A walk along the rows, one pixel a step, the depth a slow wave.
    Coherent,
    /// Uniform over the map and its depths.
    Random,
}

impl Access {
    /// Both orders.
    pub const ALL: [Access; 2] = [Access::Coherent, Access::Random];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Access::Coherent => "coherent",
            Access::Random => "random",
        }
    }
}

/// Points in the coordinates of the base level, as three arrays.
#[derive(Clone, Debug, Default)]
pub struct Queries {
    /// Columns.
    pub x: Vec<f32>,
    /// Rows.
    pub y: Vec<f32>,
    /// Depths.
    pub z: Vec<f32>,
}

impl Queries {
    /// `n` points over `width` x `height` pixels, at least `margin` from the border, depths in
    /// `depths`.
    pub fn new(
        access: Access,
        n: usize,
        (width, height): (u32, u32),
        margin: f32,
        depths: (f32, f32),
    ) -> Self {
        let (w, h) = (width as f32 - 2.0 * margin, height as f32 - 2.0 * margin);
        let mut dice = Dice::new(77);
        let mut out = Queries::default();
        for i in 0..n {
            let mut any = |to: f32| dice.range(0.0, f64::from(to)) as f32;
            let (x, y, z) = match access {
                Access::Random => (any(w), any(h), depths.0 + any(depths.1 - depths.0)),
                Access::Coherent => {
                    let (row, column) = ((i as f32 / w).floor(), i as f32 % w);
                    let wave = 0.5 + 0.45 * (0.011 * column).sin() * (0.017 * row).cos();
                    let z = depths.0 + (depths.1 - depths.0) * wave;
                    (column + 0.3, (row + 0.6) % h, z)
                }
            };
            out.x.push(margin + x.min(w * 0.999_999));
            out.y.push(margin + y.min(h * 0.999_999));
            out.z.push(z);
        }
        out
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// The points one by one.
    pub fn iter(&self) -> impl Iterator<Item = (f32, f32, f32)> + '_ {
        let xy = self.x.iter().zip(&self.y);
        xy.zip(&self.z).map(|((&x, &y), &z)| (x, y, z))
    }

    /// Every `step`th point.
    pub fn thinned(&self, step: usize) -> Queries {
        let thin = |v: &[f32]| v.iter().step_by(step).copied().collect();
        Queries {
            x: thin(&self.x),
            y: thin(&self.y),
            z: thin(&self.z),
        }
    }

    /// The same points in coordinates `factor` times as large.
    pub fn scaled(&self, factor: f32) -> Queries {
        let scale = |v: &[f32]| v.iter().map(|x| x * factor).collect();
        Queries {
            x: scale(&self.x),
            y: scale(&self.y),
            z: self.z.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_footprint_lies_between_two_levels() {
        assert_eq!(levels_of(1.0, 5), (0, 1, 0.0));
        assert_eq!(levels_of(4.0, 5), (2, 3, 0.0));
        let (fine, coarse, blend) = levels_of(3.0, 5);
        assert_eq!((fine, coarse), (1, 2));
        assert_eq!(blend, 0.5);
        assert_eq!(levels_of(1000.0, 5), (4, 4, 0.0));
    }

    #[test]
    fn queries_stay_inside_the_map() {
        for access in Access::ALL {
            let q = Queries::new(access, 5000, (64, 32), 2.0, (1.0, 2.0));
            assert!(q.iter().all(|(x, y, z)| (2.0..62.0).contains(&x)
                && (2.0..30.0).contains(&y)
                && (1.0..=2.0).contains(&z)));
        }
    }
}
