//! `Sweep` against a naive weighted sum, at every vertex and one float either side of it.

use crate::support::{assert_lawful, cases, polyline};
use deepshadow::{Curve, Ray, Sweep};
use proptest::prelude::*;

/// The weighted average of channel `c` at `z` or just behind it: evaluates every function.
fn naive(parts: &[(Curve, f64)], z: f32, c: usize, behind: bool) -> f64 {
    let value = |f: &Curve| {
        if behind {
            f.visibility_behind_rgb(z)[c]
        } else {
            f.visibility_rgb(z)[c]
        }
    };
    let weight: f64 = parts.iter().map(|p| p.1).sum();
    parts.iter().map(|(f, w)| w * value(f)).sum::<f64>() / weight
}

/// The weighted average by `Sweep`; checks its laws.
fn swept(parts: &[(Curve, f64)]) -> Curve {
    let mut sweep = Sweep::new();
    let mut out = Curve::default();
    for (f, w) in parts {
        sweep.add(f, *w).unwrap();
    }
    sweep.finish(&mut out).unwrap();
    assert_lawful(&out);
    out
}

/// Every vertex, the floats next to it, and a depth half way between neighbours.
fn telling_depths(parts: &[(Curve, f64)], out: &Curve) -> Vec<f32> {
    let vertices = parts.iter().flat_map(|p| p.0.depths()).chain(out.depths());
    let mut depths: Vec<f32> = vertices
        .flat_map(|&z| [z, z.next_up(), z.next_down()])
        .filter(|z| z.is_finite())
        .collect();
    depths.sort_by(f32::total_cmp);
    depths.dedup();
    let middles = depths.windows(2).map(|p| p[0] / 2.0 + p[1] / 2.0);
    let middles: Vec<f32> = middles.collect();
    depths.extend(middles);
    depths.sort_by(f32::total_cmp);
    depths.dedup();
    depths
}

/// Compares the sweep with the naive sum at the telling depths, between which the sum is linear.
///
/// With negative weights, compares it with the running minimum of the sum.
fn check(parts: &[(Curve, f64)], tolerance: f64) -> Curve {
    let out = swept(parts);
    let negative = parts.iter().any(|p| p.1 < 0.0);
    for c in 0..3 {
        let mut least = 1.0f64;
        for &z in &telling_depths(parts, &out) {
            let mut lower = |v: f64| {
                least = least.min(v.clamp(0.0, 1.0));
                if negative { least } else { v }
            };
            let should = lower(naive(parts, z, c, false));
            let is = out.visibility_rgb(z)[c];
            assert!(
                (is - should).abs() <= tolerance,
                "at {z:e}: {is} {should} {parts:?}"
            );
            let should = lower(naive(parts, z, c, true));
            let is = out.visibility_behind_rgb(z)[c];
            // In a ramp to the next float, or where the sum bends before that float, only the
            // values at the floats count.
            let next = naive(parts, z.next_up(), c, false);
            let steps = parts
                .iter()
                .any(|(f, _)| f.visibility_rgb(z)[c] != f.visibility_behind_rgb(z)[c]);
            if !negative || (steps && next >= should) {
                assert!(
                    (is - should).abs() <= tolerance,
                    "behind {z:e}: {is} {should} {parts:?}"
                );
            }
        }
    }
    out
}

/// A staircase: visibility falls to each value at its depth.
fn steps(points: &[(f32, f64)]) -> Curve {
    let (mut z, mut v, mut last) = (vec![], vec![], 1.0);
    for (i, &(depth, value)) in points.iter().enumerate() {
        if i > 0 {
            z.push(depth);
            v.push(last);
        }
        z.push(depth);
        v.push(value);
        last = value;
    }
    Curve::mono(z, v).unwrap()
}

#[test]
fn the_end_is_exactly_zero_or_one_if_every_end_is() {
    let walls: Vec<_> = (1..100)
        .map(|i| (steps(&[(0.1, 0.3), (i as f32, 0.0)]), 0.1 / f64::from(i)))
        .collect();
    assert_eq!(swept(&walls).end(), 0.0);
    let lit: Vec<_> = (1..100)
        .map(|i| (Curve::lit(1), 0.1 / f64::from(i)))
        .collect();
    assert!(swept(&lit).is_empty());
    let clear: Vec<_> = (1..100)
        .map(|i| (polyline(&[(0.0, 1.0), (i as f32, 1.0)]), 0.1 / f64::from(i)))
        .collect();
    assert_eq!(swept(&clear).end(), 1.0);
}

#[test]
fn steps_at_the_same_depth_become_one_step() {
    let out = check(
        &[
            (steps(&[(1.0, 0.5), (2.0, 0.0)]), 1.0),
            (steps(&[(1.0, 0.0)]), 1.0),
        ],
        1e-15,
    );
    assert_eq!(
        (out.depths(), out.values(0)),
        (&[1.0, 2.0, 2.0][..], &[0.25, 0.25, 0.0][..])
    );
}

#[test]
fn steep_ramps_leave_no_rounding_residue() {
    let tiny = f32::from_bits(1);
    let mut parts = vec![
        (
            polyline(&[(0.0, 1.0), (tiny, 0.5), (1e-30, 0.4), (1.0, 0.0)]),
            1.0,
        ),
        (polyline(&[(-3e38, 1.0), (3e38, 0.0)]), 1.0),
        (
            polyline(&[(-3e38, 1.0), ((-3e38f32).next_up(), 0.25), (3e38, 0.0)]),
            1.0,
        ),
        (
            polyline(&[
                (1.0, 1.0),
                (1.0f32.next_up(), 0.1),
                (1e30, 0.05),
                (2e38, 0.0),
            ]),
            0.5,
        ),
        (
            polyline(&[
                (-tiny, 1.0),
                (0.0, 0.9),
                (3e38, 0.1),
                (3e38f32.next_up(), 0.0),
            ]),
            2.0,
        ),
    ];
    check(&parts, 1e-14);
    for i in 0..200 {
        let z = f32::from_bits(i * 3_000_017);
        parts.push((
            polyline(&[(z, 1.0), (z.next_up(), 0.5), (f32::MAX, 0.25)]),
            1.0,
        ));
    }
    let out = check(&parts, 1e-13);
    assert_eq!(out.depths().iter().copied().fold(0.0, f32::max), f32::MAX);
}

#[test]
fn a_negative_weight_yields_the_running_minimum_exact_at_every_float() {
    // The sum starts at 1.25 - 0.25 = 1. It falls to 0.25, rises to 0.5 while the negative part
    // falls, and ends at 0.
    let main = steps(&[(1.0, 0.4), (4.0, 0.0)]);
    let negative = polyline(&[(2.0, 1.0), (3.0, 0.0)]);
    let out = check(&[(main, 1.25), (negative, -0.25)], 1e-15);
    assert!(
        (out.visibility(2.0) - 0.25).abs() < 1e-15 && out.visibility(4.0) == out.visibility(2.0)
    );
    assert_eq!(out.end(), 0.0);
    // The sum bends between two floats: it rises and falls again through the minimum.
    let rise = polyline(&[(1.0, 1.0), (2.0, 0.0)]);
    let fall = polyline(&[(1.0, 0.9), (2.0, 0.9), (5.1, 0.0)]);
    let out = check(&[(fall, 1.25), (rise, -0.25)], 1e-15);
    assert!(out.depths().windows(2).any(|p| p[0].next_up() == p[1]));
}

#[test]
fn mono_curves_count_for_all_channels_and_equal_channels_become_one() {
    let red = Curve::rgb(vec![1.0, 3.0], vec![[1.0; 3], [0.0, 1.0, 1.0]]).unwrap();
    let blue = Curve::rgb(vec![2.0], vec![[1.0, 1.0, 0.5]]).unwrap();
    let grey = polyline(&[(0.0, 0.9), (2.0, 0.5)]);
    for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
        let all = [
            (red.clone(), 1.0),
            (blue.clone(), 0.5),
            (grey.clone(), 0.75),
        ];
        let out = check(&order.map(|i| all[i].clone()), 1e-15);
        assert_eq!(out.channels(), 3);
    }
    let grey = Curve::rgb(vec![1.0], vec![[0.5; 3]]).unwrap();
    assert_eq!(swept(&[(grey, 1.0)]).channels(), 1);
}

#[test]
fn errors_add_up_by_the_magnitudes_of_their_weights() {
    let f = steps(&[(1.0, 0.5)]).with_error(0.01);
    assert!((swept(&[(f.clone(), 1.0), (f.clone(), 3.0)]).error() - 0.01).abs() < 1e-17);
    assert!((swept(&[(f.clone(), 3.0), (f, -1.0)]).error() - 0.02).abs() < 1e-17);
}

#[test]
fn a_sweep_refuses_a_sum_of_weights_that_is_not_positive_and_goes_on() {
    let (mut sweep, mut out) = (Sweep::new(), Curve::default());
    assert!(sweep.finish(&mut out).is_err());
    let f = steps(&[(1.0, 0.5)]);
    assert!(sweep.add(&f, f64::NAN).is_err());
    sweep.add(&f, -1.0).unwrap();
    assert!(sweep.finish(&mut out).is_err());
    sweep.add(&f, 2.0).unwrap();
    sweep.finish(&mut out).unwrap();
    assert_eq!(out.values(0), [0.5]);
}

#[test]
fn adding_a_ray_equals_adding_its_curve() {
    let mut rays = Vec::new();
    for i in 0..60u32 {
        let mut ray = Ray::new();
        for j in 0..4 {
            let z = ((i * 31 + j * 17) % 23) as f32 - 11.0;
            if i % 7 == 3 {
                ray.surface(z, [0.1, 0.5, 1.0]).unwrap();
            } else if i % 5 == 2 {
                ray.thick(z, z + 1.5, 0.6).unwrap();
            } else {
                ray.surface(z, 0.4).unwrap();
            }
        }
        rays.push(ray);
    }
    let (mut a, mut b) = (Sweep::new(), Sweep::new());
    let (mut curve, mut out_a, mut out_b) = (Curve::default(), Curve::default(), Curve::default());
    for some in [&rays[..3], &rays[..], &rays[20..30]] {
        for ray in some {
            ray.flatten(1e-3, &mut curve);
            a.add(&curve, 1.0).unwrap();
            b.add_ray(ray, 1e-3, 1.0).unwrap();
        }
        a.finish(&mut out_a).unwrap();
        b.finish(&mut out_b).unwrap();
        assert_eq!(out_a, out_b);
    }
}

#[test]
fn a_sum_large_enough_for_the_radix_sort_is_the_naive_sum() {
    let parts: Vec<_> = (0..1200u32)
        .map(|i| {
            let z = |k: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(k) >> 9) as f32 - 4e6;
            let f = if i % 2 == 0 {
                steps(&[(z(0).min(z(1 << 20)), 0.5)])
            } else {
                polyline(&[(z(0), 1.0), (z(0) + 7.5, 0.25)])
            };
            (f, 1.0)
        })
        .collect();
    let out = swept(&parts);
    for z in out.depths().iter().step_by(37) {
        for z in [*z, z.next_up(), z.next_down()] {
            assert!((out.visibility(z) - naive(&parts, z, 0, false)).abs() < 1e-13);
        }
    }
}

/// Depths that often coincide, and extreme ones.
fn depth() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => (-8i32..8).prop_map(|i| i as f32 * 0.5),
        3 => -4.0f32..4.0,
        1 => Just(1.0f32.next_up()),
        1 => (0u32..4).prop_map(f32::from_bits),
        1 => prop_oneof![Just(1e30f32), Just(-3e38f32), Just(3e38f32), Just(3e38f32.next_up())],
    ]
}

/// A function of one or three channels, steps and ramps mixed.
fn function() -> impl Strategy<Value = Curve> {
    let vertex = (
        depth(),
        prop::bool::ANY,
        prop::bool::ANY,
        [0.0f64..1.0, 0.0..1.0, 0.0..1.0],
        0u8..8,
    );
    (prop::collection::vec(vertex, 0..6), 0u8..4).prop_map(|(mut vertices, coloured)| {
        vertices.sort_by(|a, b| a.0.total_cmp(&b.0));
        vertices.dedup_by_key(|v| v.0 + 0.0);
        let channels = if coloured == 0 { 3 } else { 1 };
        let mut last = [1.0; 3];
        let (mut z, mut v) = (Vec::new(), vec![Vec::new(); channels]);
        for (i, (depth, step, held, fall, dark)) in vertices.into_iter().enumerate() {
            if !held {
                last = std::array::from_fn(|c| last[c] * fall[c]);
            }
            z.push(depth);
            (0..channels).for_each(|c| v[c].push(last[c]));
            if step && i > 0 {
                last = std::array::from_fn(|c| {
                    if dark == 0 {
                        0.0
                    } else {
                        last[c] * fall[2 - c]
                    }
                });
                z.push(depth);
                (0..channels).for_each(|c| v[c].push(last[c]));
            }
        }
        Curve::from_planes(z, v).unwrap()
    })
}

proptest! {
    #![proptest_config(cases(1500))]

    #[test]
    fn the_sweep_is_the_naive_sum(
        parts in prop::collection::vec((function(), prop_oneof![Just(1.0), 1e-3..10.0f64]), 1..12)
    ) {
        let out = check(&parts, 1e-13);
        let reversed: Vec<_> = parts.iter().rev().cloned().collect();
        let again = swept(&reversed);
        for &z in out.depths() {
            prop_assert!((out.visibility(z) - again.visibility(z)).abs() < 1e-13);
            prop_assert!((out.visibility_behind(z) - again.visibility_behind(z)).abs() < 1e-13);
        }
    }

    #[test]
    fn a_sweep_with_negative_weights_is_the_running_minimum_of_the_sum(
        mut parts in prop::collection::vec((function(), -0.3..1.0f64), 1..8)
    ) {
        let sum: f64 = parts.iter().map(|p| p.1).sum();
        parts[0].1 += (0.25 - sum).max(0.0);
        check(&parts, 1e-12);
    }
}
