//! `Deviation` against brute force over every float, and products of curves.

use crate::support::cases;
use crate::vectors_support::mono;
use deepshadow::raw::Deviation;
use deepshadow::{Curve, Ray, Vertex, Visibility};
use proptest::prelude::*;

/// The visibility at a depth and just behind it.
fn both_sides(f: &Visibility, z: f32) -> [[f64; 3]; 2] {
    [f.visibility_rgb(z), f.visibility_behind_rgb(z)].map(|v| v.map(f64::from))
}

/// The largest deviation over all `depths`, on both sides of each step of the exact function.
fn brute_force(exact: impl Fn(f32, usize, bool) -> f64, f: &Visibility, depths: &[f32]) -> f64 {
    let mut worst: f64 = 0.0;
    for &z in depths {
        for c in 0..3 {
            let [at, behind] = both_sides(f, z);
            let (e, b) = (exact(z, c, false), exact(z, c, true));
            worst = worst.max((at[c] - e).abs());
            if e - b > 1e-12 {
                let next = exact(z.next_up(), c, false).min(b);
                worst = worst.max(behind[c] - b).max(next - behind[c]);
            }
        }
    }
    worst
}

/// The weighted average of channel `c` of the rays at `z` or just behind it.
fn average(rays: &[(f64, &Ray)], z: f32, c: usize, behind: bool) -> f64 {
    let value = |r: &Ray| match behind {
        false => r.visibility_rgb(z)[c],
        true => r.visibility_behind_rgb(z)[c],
    };
    let sum: f64 = rays.iter().map(|(w, r)| w * value(r)).sum();
    sum / rays.iter().map(|r| r.0).sum::<f64>()
}

/// Checks that the deviation occurs where it is reported and that brute force finds no larger one.
fn checked_deviation(rays: &[(f64, &Ray)], f: &Visibility, depths: &[f32]) -> Deviation {
    let found = Deviation::of_average(rays, f);
    let most = brute_force(|z, c, behind| average(rays, z, c, behind), f, depths);
    assert!(
        most <= found.error + 2e-7,
        "{most} {found:?} {rays:?} {f:?}"
    );
    let side = usize::from(found.behind);
    let (is, c) = (
        both_sides(f, found.depth)[side][found.channel],
        found.channel,
    );
    let behind = average(rays, found.depth, c, found.behind);
    let next = average(rays, found.depth.next_up(), c, false);
    let there = (is - behind)
        .abs()
        .min(if side == 1 { (is - next).abs() } else { 1.0 });
    assert!((there - found.error).abs() < 2e-7, "{there} {found:?}");
    found
}

#[test]
fn a_missing_or_shifted_step_is_a_deviation_of_its_height() {
    let mut ray = Ray::new();
    ray.surface(2.0, 0.5).unwrap();
    let worst = ray.deviation(&Visibility::lit());
    let expected = Deviation {
        error: 0.5,
        depth: 2.0,
        behind: true,
        channel: 0,
    };
    assert_eq!(worst, expected);
    let exact = ray.deviation(&mono(&[(2.0, 0.5)]));
    assert_eq!(exact.error, 0.0);
    let late = mono(&[(2.0f32.next_up(), 0.5)]);
    assert_eq!(ray.deviation(&late).error, 0.5);
    let early = mono(&[(2.0f32.next_down(), 0.5)]);
    assert_eq!(ray.deviation(&early).error, 0.5); // the surface shadows itself
}

#[test]
fn a_step_may_replace_a_ramp_to_the_next_float_but_not_the_reverse() {
    let next = 2.0f32.next_up();
    let ramp = Curve::mono(vec![2.0, next], vec![1.0, 0.5]).unwrap();
    let step = mono(&[(2.0, 0.5)]);
    assert_eq!(ramp.deviation(&step).error, 0.0);
    let mut thick = Ray::new();
    thick.thick(2.0, next, 0.5).unwrap();
    assert_eq!(thick.deviation(&step).error, 0.0);
    let step = Curve::mono(vec![2.0], vec![0.5]).unwrap();
    let ramp = mono(&[(2.0, 1.0), (next, 0.5)]);
    assert_eq!(step.deviation(&ramp).error, 0.5);
}

#[test]
fn the_deviation_of_a_chord_is_its_largest_gap_to_the_exponential() {
    let mut ray = Ray::new();
    ray.thick(0.0, 1.0, 0.75).unwrap();
    let line = mono(&[(0.0, 1.0), (1.0, 0.25)]);
    // At t, (1/4)^t has the slope -3/4: t = ln(ln 4 / 0.75) / ln 4.
    let t = (4.0f64.ln() / 0.75).ln() / 4.0f64.ln();
    let belly = 1.0 - 0.75 * t - 0.25f64.powf(t);
    let worst = ray.deviation(&line);
    assert!((worst.error - belly).abs() < 1e-12, "{worst:?} {belly}");
    assert!((f64::from(worst.depth) - t).abs() < 1e-4);
}

#[test]
fn a_sharp_drop_at_the_front_of_a_very_thick_medium_is_found() {
    let mut ray = Ray::new();
    ray.medium(&[(0.0, 1e20), (1e30, 1e20)], 1.0).unwrap();
    let line = mono(&[(0.0, 1.0), (1e30, 0.0)]);
    assert!(ray.deviation(&line).error > 1.0 - 1e-7);
}

#[test]
fn the_deviation_of_an_average_of_1024_rays_is_exact() {
    let rays: Vec<Ray> = (0..1024u32)
        .map(|i| {
            let mut ray = Ray::new();
            for j in 0..3 {
                let z = (i.wrapping_mul(2_654_435_761).wrapping_add(j * 7_919_777) >> 8) as f32;
                if j == 2 && i % 16 == 0 {
                    ray.thick(z, z + 1e6, 0.5).unwrap();
                } else {
                    ray.surface(z, 0.3).unwrap();
                }
            }
            ray
        })
        .collect();
    let all: Vec<_> = rays.iter().map(|r| (1.0, r)).collect();
    let line = mono(&[(0.0, 1.0), (8e6, 0.8), (1.7e7, 0.35)]);
    let depths: Vec<f32> = (0..200).map(|i| i as f32 * 1e5).collect();
    checked_deviation(&all, &line, &depths);
    let mut sweep = deepshadow::Sweep::new();
    for ray in &rays {
        sweep.add_ray(ray, 1e-6, 1.0).unwrap();
    }
    let mut pixel = Curve::default();
    sweep.finish(&mut pixel).unwrap();
    let values = pixel.values(0).iter().map(|&v| v as f32).collect();
    let pixel = Visibility::from_planes(pixel.depths().to_vec(), vec![values]).unwrap();
    let start = std::time::Instant::now();
    let worst = Deviation::of_average(&all, &pixel);
    println!(
        "{} vertices in {:?}: {worst:?}",
        pixel.len(),
        start.elapsed()
    );
    assert!(worst.error < 1e-6 + 1e-7);
}

#[test]
fn an_average_with_negative_weights_is_its_running_minimum() {
    let (mut near, mut far) = (Ray::new(), Ray::new());
    near.surface(1.0, 0.5).unwrap();
    far.surface(2.0, 1.0).unwrap();
    let rays = [(1.5, &near), (-0.5, &far)]; // the sum is 1, 0.25, 0.75
    let f = mono(&[(1.0, 0.25)]);
    assert_eq!(Deviation::of_average(&rays, &f).error, 0.0);
}

#[test]
fn each_channel_is_compared_separately() {
    let mut ray = Ray::new();
    ray.surface(1.0, [0.5, 0.25, 0.0]).unwrap();
    let f = Visibility::rgb(vec![Vertex::new(1.0, [0.5, 0.75, 0.875])]).unwrap();
    let worst = ray.deviation(&f);
    assert_eq!((worst.error, worst.channel), (0.125, 2));
    let grey = Curve::mono(vec![1.0], vec![0.5]).unwrap();
    let worst = grey.deviation(&f);
    assert_eq!((worst.error, worst.channel), (0.375, 2));
}

/// The `i`-th float after 1.5: with such depths, brute force can visit every float.
fn near(i: u32) -> f32 {
    f32::from_bits(1.5f32.to_bits() + i)
}

fn opacity() -> impl Strategy<Value = f32> {
    prop_oneof![Just(0.5f32), Just(1.0f32), 0.0f32..1.0]
}

fn ray() -> impl Strategy<Value = Ray> {
    let index = || 0u32..400;
    let surface = (index(), opacity());
    let thick = (
        index(),
        1u32..100,
        [opacity(), opacity(), opacity()],
        prop::bool::ANY,
    );
    let medium = (index(), 0u32..60, 0.0f32..1e5, 0.0f32..1e5);
    (
        prop::collection::vec(surface, 0..3),
        prop::collection::vec(thick, 0..3),
        prop::collection::vec(medium, 0..2),
    )
        .prop_map(|(surfaces, thick, media)| {
            let mut ray = Ray::new();
            for (i, o) in surfaces {
                ray.surface(near(i), o).unwrap();
            }
            for (i, n, o, mono) in thick {
                let o = if mono { [o[0]; 3] } else { o };
                ray.thick(near(i), near(i + n), o).unwrap();
            }
            for (i, n, k0, k1) in media {
                ray.medium(&[(near(i), k0), (near(i + n), k1)], 1.0)
                    .unwrap();
            }
            ray
        })
}

fn function() -> impl Strategy<Value = Visibility> {
    prop::collection::vec((0u32..500, 0.0f32..1.0, prop::bool::ANY), 0..6).prop_map(|mut all| {
        all.sort_by_key(|v| v.0);
        all.dedup_by_key(|v| v.0);
        let (mut points, mut v) = (Vec::new(), 1.0);
        for (i, fall, step) in all {
            if step && !points.is_empty() {
                points.push((near(i), v));
            }
            v *= fall;
            points.push((near(i), v));
        }
        mono(&points)
    })
}

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn the_deviation_of_an_average_is_that_of_brute_force_over_every_float(
        rays in prop::collection::vec((ray(), 0.1f64..2.0), 1..4),
        f in function(),
    ) {
        let rays: Vec<_> = rays.iter().map(|(r, w)| (*w, r)).collect();
        let depths: Vec<f32> = (0..510).map(near).collect();
        checked_deviation(&rays, &f, &depths);
    }

    #[test]
    fn curves_and_their_products_match_brute_force_over_every_float(
        a in function(),
        b in function(),
        f in function(),
        tolerance in prop_oneof![Just(0.1), Just(1e-3)],
    ) {
        let (mut ca, mut cb, mut ab) = (Curve::default(), Curve::default(), Curve::default());
        ca.assign(&a, 0.0);
        cb.assign(&b, 0.0);
        let depths: Vec<f32> = (0..510).map(near).collect();
        let value = |curve: &Curve, z, c: usize, behind| match behind {
            false => curve.visibility_rgb(z)[c],
            true => curve.visibility_behind_rgb(z)[c],
        };
        let most = brute_force(|z, c, behind| value(&ca, z, c, behind), &f, &depths);
        let found = ca.deviation(&f);
        prop_assert!(most <= found.error + 2e-7, "{} {:?}", most, found);
        ca.product(&cb, tolerance, &mut ab);
        prop_assert!(ab.error() <= tolerance * 1.000_001);
        prop_assert!(Curve::mono(ab.depths().to_vec(), ab.values(0).to_vec()).is_ok());
        for z in depths {
            let exact = ca.visibility(z) * cb.visibility(z);
            prop_assert!((ab.visibility(z) - exact).abs() <= ab.error() + 1e-14);
            let is_step = |f: &Curve| f.visibility(z) != f.visibility_behind(z);
            if is_step(&ca) || is_step(&cb) {
                let exact = ca.visibility_behind(z) * cb.visibility_behind(z);
                prop_assert!((ab.visibility_behind(z) - exact).abs() <= ab.error() + 1e-14);
            }
        }
    }
}

#[test]
fn a_product_is_within_its_tolerance_and_adds_the_errors_of_its_factors() {
    let a = Curve::mono(vec![0.0, 1.0], vec![1.0, 0.0])
        .unwrap()
        .with_error(0.01);
    let b = Curve::rgb(vec![0.0, 1.0], vec![[1.0; 3], [0.0, 0.5, 1.0]])
        .unwrap()
        .with_error(0.02);
    let mut out = Curve::default();
    a.product(&b, 1e-3, &mut out);
    assert_eq!(out.channels(), 3);
    let bound = 0.01 + 0.02;
    assert!(out.error() > bound && out.error() <= bound + 1e-3);
    for i in 0..=1000 {
        let z = i as f32 / 1000.0;
        for c in 0..3 {
            assert!(
                (out.visibility_rgb(z)[c] - a.visibility_rgb(z)[c] * b.visibility_rgb(z)[c]).abs()
                    <= 1e-3
            );
        }
    }
    assert!(out.len() <= 2 + 17); // 1 / (2 sqrt(tolerance)) = 15.8
    Curve::lit(1).product(&Curve::lit(3), 0.0, &mut out);
    assert!(out.is_empty() && out.error() == 0.0);
}
