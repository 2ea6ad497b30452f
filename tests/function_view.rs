//! `FunctionRef` against a scan over all vertices, at telling depths, for every type of values.

use crate::support::cases;
use deepshadow::raw::{Precision, TileBuilder};
use deepshadow::{Curve, FunctionRef, Visibility};
use proptest::prelude::*;

const LATTICE: u16 = 12;

/// Depths, and values as numerators on the lattice, channel by channel.
#[derive(Clone, Debug)]
struct Vertices {
    depths: Vec<f32>,
    numerators: Vec<Vec<u16>>,
}

impl Vertices {
    /// A visibility; a mono function has the same in every channel.
    fn value(&self, vertex: usize, channel: usize) -> f32 {
        let plane = &self.numerators[channel % self.numerators.len()];
        f32::from(plane[vertex]) / f32::from(LATTICE)
    }

    /// All values, plane by plane.
    fn planes<T>(&self, value: impl Fn(f32) -> T) -> Vec<Vec<T>> {
        let plane = |c| (0..self.depths.len()).map(move |i| self.value(i, c));
        (0..self.numerators.len())
            .map(|c| plane(c).map(&value).collect())
            .collect()
    }

    /// The function at `depth` or just behind it, by a scan over all vertices.
    fn naive(&self, depth: f32, behind: bool, channel: usize) -> f64 {
        let value = |i: usize| f64::from(self.value(i, channel));
        let is_before = |z: f32| z < depth || (behind && z == depth);
        let n = self.depths.len();
        let Some(last) = (0..n).rev().find(|&i| is_before(self.depths[i])) else {
            return 1.0;
        };
        if last + 1 == n || self.depths[last] == depth {
            return value(last);
        }
        if self.depths[last + 1] == depth {
            return value(last + 1); // at a step, the value in front of it
        }
        let [a, b] = [last, last + 1].map(|i| f64::from(self.depths[i]));
        value(last) + (value(last + 1) - value(last)) * ((f64::from(depth) - a) / (b - a))
    }

    /// Every vertex and the floats next to it, the middles, and depths outside.
    fn telling_depths(&self) -> Vec<f32> {
        let near = |z: &f32| [z.next_down(), *z, z.next_up()];
        let mut out: Vec<f32> = self.depths.iter().flat_map(near).collect();
        let pairs = self.depths.windows(2);
        out.extend(pairs.map(|pair| pair[0] / 2.0 + pair[1] / 2.0));
        out.extend([f32::NEG_INFINITY, f32::MIN, 0.0, f32::MAX, f32::INFINITY]);
        out
    }

    /// Compares every way to evaluate `f` with the scan.
    fn check(&self, f: FunctionRef<'_>, tolerance: f64) -> Result<(), TestCaseError> {
        for z in self.telling_depths() {
            for behind in [false, true] {
                let exact: [f64; 3] = std::array::from_fn(|c| self.naive(z, behind, c));
                let (mono, rgb) = match behind {
                    false => (f.visibility(z), f.visibility_rgb(z)),
                    true => (f.visibility_behind(z), f.visibility_behind_rgb(z)),
                };
                prop_assert_eq!(mono, rgb[0]);
                for c in 0..3 {
                    let one = f.channel(c);
                    let [own, same] = [one, f].map(|f| match behind {
                        false => f.visibility_rgb(z),
                        true => f.visibility_behind_rgb(z),
                    });
                    prop_assert_eq!(own, [same[c]; 3]);
                    let error = (rgb[c] - exact[c]).abs();
                    prop_assert!(error <= tolerance, "{z:e} {behind} {c}: {rgb:?} {exact:?}");
                }
            }
        }
        prop_assert_eq!(f.end_rgb(), f.visibility_rgb(f32::INFINITY));
        prop_assert_eq!(f.end(), f.end_rgb()[0]);
        prop_assert_eq!(f.visibility(f32::NAN), 1.0);
        Ok(())
    }
}

/// Lawful vertices with few depths and few values: steps, level pieces and equal channels are
/// frequent.
fn vertices() -> impl Strategy<Value = Vertices> {
    let depth = prop_oneof![
        -4i32..8,
        Just(i32::MIN), // the float after the previous depth
    ];
    let vertex = (depth, prop::bool::ANY, [0u16..4, 0u16..4, 0u16..4]);
    let all = prop::collection::vec(vertex, 0..9);
    (all, prop::bool::ANY, prop::bool::ANY).prop_map(|(all, coloured, equal)| {
        let mut out = Vertices {
            depths: Vec::new(),
            numerators: vec![Vec::new(); if coloured { 3 } else { 1 }],
        };
        let (mut z, mut k) = (-3.0f32, [LATTICE; 3]);
        for (depth, steps, falls) in all {
            let fall = |c: usize| falls[if equal { 0 } else { c }];
            let at_step = out.depths.len() >= 2 && !out.depths[..].ends_with(&[z, z]);
            if !(steps && at_step) {
                z = match depth {
                    i32::MIN => z.next_up(),
                    d => z + 0.5 * (d + 5) as f32,
                };
            }
            k = std::array::from_fn(|c| k[c].saturating_sub(fall(c)));
            out.depths.push(z);
            out.numerators
                .iter_mut()
                .zip(k)
                .for_each(|(plane, k)| plane.push(k));
        }
        out
    })
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn every_type_of_values_evaluates_as_a_scan_does(v in vertices()) {
        let curve = Curve::from_planes(v.depths.clone(), v.planes(f64::from)).unwrap();
        v.check(curve.function(), 1e-15)?;
        // The canonical form has other vertices, but it is the same function.
        let stored = Visibility::from_planes(v.depths.clone(), v.planes(|v| v)).unwrap();
        v.check(stored.function(), 1e-15)?;
        prop_assert_eq!(&curve.function().to_visibility(), &stored);
        prop_assert_eq!(stored.function().to_visibility(), stored.clone());
        let is_monochrome = curve.function().is_monochrome();
        prop_assert_eq!(is_monochrome, v.planes(|v| v).windows(2).all(|p| p[0] == p[1]));
        prop_assert!(stored.channels() == 1 || !is_monochrome);
        for precision in [Precision::F32, Precision::Lattice(LATTICE)] {
            let mut builder = TileBuilder::new(3, precision);
            builder.push(&Visibility::lit());
            builder.push(&stored);
            builder.push(&stored);
            let tile = builder.finish();
            prop_assert_eq!(tile.precision(), precision);
            for i in [1, 2] {
                v.check(tile.function(i), 1e-15)?;
                prop_assert_eq!(tile.function(i), stored.function());
                prop_assert_eq!(tile.function(i).to_visibility(), stored.clone());
            }
            prop_assert!(tile.function(0).is_empty());
            // The public planes hold the same values.
            let planes = tile.planes();
            let n = stored.len() as u32;
            prop_assert_eq!(planes.vertex_table, [0, 0, n, 2 * n]);
            prop_assert_eq!(&planes.depths[..stored.len()], stored.depths());
        }
    }
}

#[test]
fn planes_need_one_value_for_each_vertex() {
    let refused = Curve::from_planes(vec![1.0, 2.0], vec![vec![0.5]]).unwrap_err();
    assert!(refused.to_string().contains("1 values"), "{refused}");
    let two = Curve::from_planes(vec![1.0], vec![vec![0.5]; 2]).unwrap_err();
    assert!(two.to_string().contains("1 or 3 channels"), "{two}");
}
