//! `Ray::flatten` against the exact transmittance of the ray, at telling depths.

use crate::support::{assert_lawful, cases};
use deepshadow::{Curve, ErrorKind, Ray};
use proptest::prelude::*;

/// The flattened ray; checks its laws.
fn flat(ray: &Ray, tolerance: f64) -> Curve {
    let mut out = Curve::default();
    ray.flatten(tolerance, &mut out);
    assert_lawful(&out);
    out
}

/// Compares a curve with its ray at every vertex, the floats next to it, and depths between.
fn check(ray: &Ray, curve: &Curve) {
    let z = curve.depths();
    let mut depths = z.to_vec();
    for pair in z.windows(2) {
        let (a, b) = (f64::from(pair[0]), f64::from(pair[1]));
        depths.extend((1..8).map(|i| (a + (b - a) * f64::from(i) / 8.0) as f32));
    }
    let near = depths
        .iter()
        .flat_map(|&z| [z, z.next_up(), z.next_down(), z.next_up().next_up()])
        .filter(|z| z.is_finite())
        .collect::<Vec<_>>();
    let allowed = curve.error() + 2e-14;
    for z in near {
        for c in 0..3 {
            let (is, should) = (curve.visibility_rgb(z)[c], ray.visibility_rgb(z)[c]);
            assert!((is - should).abs() <= allowed, "at {z:e}: {is} {should}");
            let (is, should) = (
                curve.visibility_behind_rgb(z)[c],
                ray.visibility_behind_rgb(z)[c],
            );
            assert!(
                (is - should).abs() <= allowed,
                "behind {z:e}: {is} {should}"
            );
        }
    }
}

#[test]
fn surfaces_multiply_in_depth_order_bit_for_bit() {
    let mut ray = Ray::new();
    for (z, o) in [
        (3.0, 0.3f32),
        (1.0, 0.1),
        (2.0, 0.7),
        (1.0, 0.2),
        (9.0, 0.0),
    ] {
        ray.surface(z, o).unwrap();
    }
    let curve = flat(&ray, 0.0);
    let keep = |o: f32| 1.0 - f64::from(o);
    let first = 1.0 * keep(0.1) * keep(0.2);
    let second = first * keep(0.7);
    assert_eq!(curve.depths(), [1.0, 2.0, 2.0, 3.0, 3.0]);
    let values = [first, first, second, second, second * keep(0.3)];
    assert_eq!((curve.values(0), curve.error()), (&values[..], 0.0));
}

#[test]
fn nothing_follows_an_opaque_surface() {
    let mut ray = Ray::new();
    ray.surface(-0.0, 1.0).unwrap();
    ray.surface(1.0, 0.5).unwrap();
    ray.thick(2.0, 3.0, 0.5).unwrap();
    let curve = flat(&ray, 1e-3);
    assert_eq!((curve.depths(), curve.values(0)), (&[0.0][..], &[0.0][..]));
    assert!(curve.depths()[0].is_sign_positive());
    assert_eq!(
        (curve.visibility(0.0), curve.visibility_behind(0.0)),
        (1.0, 0.0)
    );
}

#[test]
fn an_opaque_thick_sample_is_a_step_at_its_front() {
    let mut ray = Ray::new();
    ray.thick(2.0, 2.0, 0.25).unwrap();
    ray.thick(3.0, 1.5, 0.5).unwrap();
    ray.thick(4.0, 8.0, 1.0).unwrap();
    let curve = flat(&ray, 1e-3);
    assert_eq!(curve.depths(), [2.0, 3.0, 3.0, 4.0, 4.0]);
    assert_eq!(curve.values(0), [0.75, 0.75, 0.375, 0.375, 0.0]);
    let mut tinted = Ray::new();
    tinted.thick(4.0, 8.0, [1.0, 0.5, 0.0]).unwrap();
    assert_eq!(tinted.visibility_behind(4.0), 0.0);
    assert_eq!(
        (tinted.visibility_rgb(8.0)[1], tinted.visibility_rgb(8.0)[2]),
        (0.5, 1.0)
    );
    check(&tinted, &flat(&tinted, 1e-3));
}

#[test]
fn a_thick_sample_of_one_ulp_is_not_subdivided_and_leaves_no_residue() {
    for z in [0.0f32, -1e-45, 1e-45, 1.0, -1.0, 3e38, -3e38] {
        let mut ray = Ray::new();
        ray.thick(z, z.next_up(), 0.999_999).unwrap();
        let far = if z.abs() > 1e38 {
            f32::MAX
        } else {
            z.abs() * 4.0 + 8.0
        };
        ray.thick(z, far, 0.5).unwrap();
        let curve = flat(&ray, 1e-3);
        check(&ray, &curve);
        assert!((curve.end() - ray.visibility(far)).abs() < 1e-15);
    }
}

#[test]
fn equal_channels_become_one() {
    let mut ray = Ray::new();
    ray.surface(1.0, [0.5; 3]).unwrap();
    ray.medium(&[(0.0, [1.0; 3]), (4.0, [0.0; 3])], 1.5)
        .unwrap();
    assert_eq!(ray.channels(), 1);
    ray.surface(0.5, [1.0; 3]).unwrap();
    ray.surface(2.0, [0.1, 0.2, 0.3]).unwrap(); // behind an opaque sample
    assert_eq!((ray.channels(), flat(&ray, 1e-3).channels()), (3, 1));
}

#[test]
fn an_invalid_sample_is_named_and_changes_nothing() {
    let mut ray = Ray::new();
    ray.surface(1.0, 0.5).unwrap();
    let errors = [
        ray.surface(f32::NAN, 0.5),
        ray.surface(1.0, -0.1),
        ray.surface(1.0, [0.5, f32::NAN, 0.5]),
        ray.thick(1.0, f32::INFINITY, 0.5),
        ray.thick(1.0, 2.0, 1.5),
        ray.medium(&[(0.0, 1.0), (1.0, -1.0)], 1.0),
        ray.medium(&[(1.0, 1.0), (0.0, 1.0)], 1.0),
        ray.medium(&[(0.0, 1.0), (f32::NAN, 1.0)], 1.0),
        ray.medium(&[(0.0, 1.0), (1.0, f32::INFINITY)], 1.0),
    ];
    for e in errors {
        let e = e.unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
        assert!(e.to_string().contains("sample 1"), "{e}");
    }
    assert!(ray.medium(&[(0.0, 1.0)], 0.0).is_err());
    assert_eq!(flat(&ray, 1e-3).len(), 1);
    ray.clear();
    assert!(flat(&ray, 1e-3).is_empty());
}

#[test]
fn a_medium_transmits_the_exponential_of_its_integrated_extinction() {
    let mut ray = Ray::new();
    let samples = [
        (-1.0, 0.0),
        (1.0, 2.0),
        (1.0, 0.5),
        (3.0, 0.5),
        (3.0, 0.0),
        (4.0, 8.0),
    ];
    ray.medium(&samples, 2.0).unwrap();
    for (z, integral) in [(-2.0, 0.0), (0.0, 1.0), (1.0, 4.0), (3.0, 6.0), (9.0, 14.0)] {
        assert!((ray.visibility(z) - f64::exp(-integral)).abs() < 1e-15);
    }
    for tolerance in [1e-2, 1e-4, 1e-6] {
        let curve = flat(&ray, tolerance);
        assert!(curve.error() <= tolerance * 1.001 + 1e-14);
        check(&ray, &curve);
    }
}

#[test]
fn an_exponential_needs_no_more_vertices_than_the_bound_for_its_tolerance() {
    for (kappa, length) in [(1.0f32, 60.0f32), (1e30, 1.0), (1e-30, 1e32), (1e38, 1e38)] {
        let mut ray = Ray::new();
        ray.medium(&[(0.0, kappa), (length, kappa)], 1.0).unwrap();
        let curve = flat(&ray, 1e-4);
        let promised = 2.0 / (8.0f64 * 1e-4).sqrt();
        assert!(
            (curve.len() as f64) < promised * 1.2 + 4.0,
            "{}",
            curve.len()
        );
        check(&ray, &curve);
        ray.flatten(0.0, &mut Curve::default()); // a tolerance of 0 terminates, too
    }
}

#[test]
fn the_sum_of_20000_overlapping_samples_does_not_drift() {
    let mut ray = Ray::new();
    let n = 20_000;
    for i in 0..n {
        let front = (i * 7919 % n) as f32;
        ray.thick(front, front + n as f32, 1e-4).unwrap();
    }
    let curve = flat(&ray, 1e-3);
    for z in [1.0, 5_000.0, 20_000.0, 39_999.0] {
        assert!((curve.visibility(z) - ray.visibility(z)).abs() <= curve.error() + 1e-13);
    }
    let exact = (f64::from(-1e-4f32).ln_1p() * f64::from(n)).exp();
    assert!((curve.end() - exact).abs() < 1e-14);
}

#[derive(Clone, Debug)]
enum Sample {
    Surface(f32, [f32; 3]),
    Thick(f32, f32, [f32; 3]),
    Medium(Vec<(f32, [f32; 3])>, f64),
}

/// Depths that often coincide, and extreme ones.
fn depth() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => (-8i32..8).prop_map(|i| i as f32 * 0.5),
        2 => -4.0f32..4.0,
        1 => Just(-0.0f32),
        1 => Just(1.0f32.next_up()),
        1 => (0u32..4).prop_map(f32::from_bits),
        1 => prop_oneof![Just(1e30f32), Just(-3e38f32), Just(3e38f32)],
    ]
}

/// An opacity or an extinction.
fn number() -> impl Strategy<Value = f32> {
    prop_oneof![
        Just(0.0f32),
        Just(1.0f32),
        Just(0.5f32),
        0.0f32..1.0,
        Just(1e-9f32),
        Just(0.999_999_94f32)
    ]
}

fn colour() -> impl Strategy<Value = [f32; 3]> {
    prop_oneof![2 => number().prop_map(|o| [o; 3]), 1 => [number(), number(), number()]]
}

fn sample() -> impl Strategy<Value = Sample> {
    let medium = (
        prop::collection::vec((depth(), colour()), 1..5),
        prop_oneof![Just(1.0), Just(1.7), Just(1e5)],
    );
    prop_oneof![
        (depth(), colour()).prop_map(|(z, o)| Sample::Surface(z, o)),
        (depth(), depth(), colour()).prop_map(|(a, b, o)| Sample::Thick(a, b, o)),
        (depth(), colour()).prop_map(|(a, o)| Sample::Thick(a, a.next_up(), o)),
        medium.prop_map(|(mut m, d)| {
            m.sort_by(|a, b| a.0.total_cmp(&b.0));
            Sample::Medium(m, d)
        }),
    ]
}

proptest! {
    #![proptest_config(cases(1500))]

    #[test]
    fn the_error_of_any_ray_is_at_most_the_stated_error_and_that_the_tolerance(
        samples in prop::collection::vec(sample(), 0..7),
        tolerance in prop_oneof![Just(0.1), Just(1e-2), Just(1e-3)],
    ) {
        let mut ray = Ray::new();
        let mut depths = Vec::new();
        for s in &samples {
            match s {
                Sample::Surface(z, o) => {
                    ray.surface(*z, *o).unwrap();
                    if *o != [0.0; 3] {
                        depths.push(*z);
                    }
                }
                Sample::Thick(a, b, o) => ray.thick(*a, *b, *o).unwrap(),
                Sample::Medium(m, d) => ray.medium(m, *d).unwrap(),
            }
        }
        let curve = flat(&ray, tolerance);
        prop_assert!(curve.error() <= tolerance * (1.0 + 1e-9) + 2e-14);
        check(&ray, &curve);
        for z in depths {
            prop_assert!((curve.visibility_behind(z) - ray.visibility_behind(z)).abs() < 1e-13);
            prop_assert!((curve.visibility(z) - ray.visibility(z)).abs() < 1e-13);
        }
    }
}
