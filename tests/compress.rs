//! The guarantees of the compressors: error bound, end value, depths, laws, and few vertices.

use crate::compress_support::{
    cloud, coloured_hair, exact_minimum, hair, max_error, mixed, plane, storable,
};
use crate::random::Random;
use crate::support::{cases, polyline};
use deepshadow::raw::{Encoder, Precision};
use deepshadow::{Compressor, Curve, Encoding, ErrorKind, Visibility};
use proptest::prelude::*;

fn compress(input: &Curve, compressor: Compressor, precision: Precision, eps: f64) -> Visibility {
    let mut encoder = Encoder::new(compressor, precision, eps).unwrap();
    let mut out = Visibility::lit();
    encoder.compress(input, &mut out).unwrap();
    out
}

/// Compresses a curve and checks every guarantee of the result.
fn checked(input: &Curve, compressor: Compressor, precision: Precision, eps: f64) -> Visibility {
    let what = || format!("{compressor:?} {precision:?} {eps} on {input:?}");
    let mut encoder = Encoder::new(compressor, precision, eps).unwrap();
    let mut out = Visibility::lit();
    encoder.compress(input, &mut out).unwrap();

    let error = max_error(input, &out);
    assert!(
        error + input.error() <= encoder.tolerance(),
        "error {error}: {}",
        what()
    );
    for z in out.depths() {
        let known = input.depths().iter().any(|i| i.to_bits() == z.to_bits());
        assert!(known, "depth {z}: {}", what());
    }
    for &v in (0..out.channels()).flat_map(|c| out.values(c)) {
        assert!(storable(precision, v), "value {v}: {}", what());
    }
    // The laws and the canonical form.
    let again = Visibility::from_planes(
        out.depths().to_vec(),
        (0..out.channels())
            .map(|c| out.values(c).to_vec())
            .collect(),
    );
    assert_eq!(again.unwrap(), out, "{}", what());
    for c in 0..input.channels() {
        let (end, stored) = (input.end_rgb()[c], f64::from(out.end_rgb()[c]));
        if end == 0.0 || end == 1.0 {
            assert_eq!(stored, end, "{}", what());
        }
        let half = match precision {
            Precision::F32 => 1.0 / (1 << 25) as f64,
            Precision::Lattice(l) => 0.5 / f64::from(l) + 1e-7,
        };
        assert!(
            (stored - end).abs() <= half,
            "end {end} {stored}: {}",
            what()
        );
    }
    out
}

/// `n` opaque samples at depths 1 to `n`.
fn stairs(n: usize) -> Curve {
    let mut points = vec![(1.0, 1.0 - 1.0 / n as f64)];
    for i in 1..n {
        points.push((i as f32 + 1.0, 1.0 - i as f64 / n as f64));
        points.push((i as f32 + 1.0, 1.0 - (i + 1) as f64 / n as f64));
    }
    polyline(&points)
}

#[test]
fn the_end_value_is_exact_even_if_the_last_segment_finds_no_lattice_value() {
    // On these slopes the last window holds only the end value. A segment that starts late cannot
    // reach it and has to end earlier.
    let mut worst = 0.0f64;
    for seed in 0..400 {
        let r = &mut Random(seed);
        let eps = r.range(0.02, 0.1);
        let (mut z, mut v) = (0.0, 1.0);
        let mut points = vec![(0.0, 1.0)];
        let end = r.range(0.0, 0.6);
        while v > end {
            z += r.range(0.1, 2.0) as f32;
            v = (v - r.range(0.0, 1.9) * eps).max(end);
            points.push((z, v));
        }
        let input = polyline(&points);
        let l = (1.0 / eps).ceil() as u16;
        for compressor in Compressor::ALL.iter().copied() {
            for l in [l, l + 1, 2 * l + 1, 4 * l] {
                let out = checked(&input, compressor, Precision::Lattice(l), eps);
                worst = worst.max(max_error(&input, &out) / eps);
            }
        }
    }
    assert!(worst > 0.9 && worst <= 1.0, "{worst}"); // almost all of the bound is used
}

#[test]
fn no_vertex_is_stored_just_below_the_tube_where_the_next_segment_would_have_to_rise() {
    // For a tolerance of 1/4 the tube is narrowed by 1.25e-12. At these values it begins 5e-14
    // above 1/4, which is a lattice value. A segment from 1 to (2, 1/4) misses the tube by that
    // much only, but the tube at depth 3 requires more than 1/4.
    let v = 0.5 - 1.2e-12;
    let quarters = polyline(&[(0.0, 1.0), (1.0, v), (2.0, v), (3.0, v), (4.0, 0.0)]);
    // A tube that begins near 0 has many floats just below it. The blue channel leaves no choice,
    // so all origins behind depth 1 are equally good, and the compressor takes the lowest red.
    let (lit, red, both) = ([1.0; 3], [0.25, 1.0, 1.0], [0.25, 0.5, 1.0]);
    let colours = Curve::rgb(
        vec![0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0],
        vec![lit, lit, red, red, both, both, [0.0, 0.0, 1.0]],
    )
    .unwrap();
    for compressor in Compressor::ALL.iter().copied() {
        let out = checked(&quarters, compressor, Precision::Lattice(4), 0.25);
        assert_eq!(out.len(), 4, "{compressor:?}: {out:?}");
        let out = checked(&colours, compressor, Precision::F32, 0.25);
        assert!(out.len() <= 5, "{compressor:?}: {out:?}");
    }
}

#[test]
fn lit_pixels_have_no_vertices() {
    for compressor in Compressor::ALL.iter().copied() {
        for input in [
            Curve::lit(1),
            Curve::lit(3),
            polyline(&[(1.0, 1.0)]),
            polyline(&[(1.0, 1.0), (2.0, 1.0)]),
        ] {
            assert!(checked(&input, compressor, Precision::F32, 0.01).is_empty());
            assert!(checked(&input, compressor, Precision::Lattice(255), 0.01).is_empty());
        }
    }
}

#[test]
fn an_opaque_wall_is_one_vertex() {
    for compressor in Compressor::ALL.iter().copied() {
        for depth in [1.0, 0.0, -3.4e38, 3.4e38, 1e-45, f32::MIN_POSITIVE] {
            let wall = checked(&polyline(&[(depth, 0.0)]), compressor, Precision::F32, 0.01);
            assert_eq!((wall.depths(), wall.values(0)), (&[depth][..], &[0.0][..]));
        }
        let glass_then_wall = polyline(&[(1.0, 0.75), (2.0, 0.75), (2.0, 0.0)]);
        assert_eq!(
            checked(&glass_then_wall, compressor, Precision::F32, 0.01).len(),
            3
        );
    }
}

#[test]
fn steps_of_more_than_twice_the_tolerance_keep_their_depth() {
    let input = polyline(&[
        (1.0, 0.99),
        (1.5, 0.98),
        (2.0, 0.97),
        (2.0, 0.55),
        (2.5, 0.54),
        (3.0, 0.53),
        (3.0, 0.01),
    ]);
    for compressor in Compressor::ALL.iter().copied() {
        let out = checked(&input, compressor, Precision::F32, 0.1);
        for z in [2.0, 3.0] {
            assert!(
                out.visibility(z) - out.visibility_behind(z) > 0.2,
                "{compressor:?}: {out:?}"
            );
        }
    }
}

#[test]
fn steps_of_exactly_one_or_two_tolerances_keep_the_bound() {
    for n in [4usize, 16, 64, 256] {
        let input = stairs(n);
        let bare = 0.25 / (n as f64).sqrt();
        for compressor in Compressor::ALL.iter().copied() {
            let wide = checked(
                &input,
                compressor,
                Precision::F32,
                Encoding::default_tolerance(n as u32),
            );
            let tight = checked(&input, compressor, Precision::F32, bare);
            assert!(wide.len() <= tight.len(), "{compressor:?} {n}");
            // Each step is exactly twice the tolerance.
            checked(&input, compressor, Precision::F32, 0.5 / n as f64);
            checked(&input, compressor, Precision::for_tolerance(bare), bare);
        }
        // For n = 4: a slope and a step at the end, where visibility falls by a quarter, which is
        // twice the tolerance. For more: a slope.
        let fewest = compress(
            &input,
            Compressor::Minimal,
            Precision::F32,
            Encoding::default_tolerance(n as u32),
        );
        let expected = if n == 4 { 3 } else { 2 };
        assert_eq!(fewest.len(), expected, "{n}: {fewest:?}");
    }
}

#[test]
fn a_tolerance_of_one_or_more_keeps_the_end() {
    for eps in [1.0, 1.5, 100.0] {
        for compressor in Compressor::ALL.iter().copied() {
            let out = checked(&stairs(16), compressor, Precision::Lattice(1), eps);
            assert_eq!((out.len(), out.end_rgb()), (1, [0.0; 3]));
            checked(&hair(8, 1), compressor, Precision::F32, eps);
        }
    }
}

#[test]
fn tiny_tolerances_keep_every_vertex() {
    for compressor in Compressor::ALL.iter().copied() {
        for eps in [0.0, 1e-9, Encoding::MIN_TOLERANCE, 3e-6] {
            checked(&stairs(16), compressor, Precision::F32, eps);
            checked(&cloud(64, 3), compressor, Precision::F32, eps);
            checked(&coloured_hair(4, 3), compressor, Precision::F32, eps);
        }
        let out = compress(&stairs(16), compressor, Precision::F32, 0.0);
        assert_eq!(out.len(), 31);
    }
}

#[test]
fn extreme_depths_keep_the_bound() {
    let ladder = [
        f32::MIN,
        -1.0,
        -1e-38,
        -1e-45,
        0.0,
        1e-45,
        3e-45,
        1.0,
        1.0f32.next_up(),
        1.0f32.next_up().next_up(),
        1e30,
        f32::MAX.next_down(),
        f32::MAX,
    ];
    let n = ladder.len();
    for drop in [1.0, 0.3, 0.02] {
        let falling = |i: usize| 1.0 - drop * i as f64 / (n - 1) as f64;
        let slope: Vec<_> = (0..n).map(|i| (ladder[i], falling(i))).collect();
        let mut steps = vec![(ladder[0], falling(1))];
        for (i, &z) in ladder.iter().enumerate().take(n - 1).skip(1) {
            steps.push((z, falling(i)));
            steps.push((z, falling(i + 1)));
        }
        for input in [polyline(&slope), polyline(&steps)] {
            for compressor in Compressor::ALL.iter().copied() {
                for eps in [0.2, 0.05, 0.004] {
                    checked(&input, compressor, Precision::F32, eps);
                    checked(&input, compressor, Precision::for_tolerance(eps), eps);
                }
            }
        }
    }
}

#[test]
fn constant_runs_and_drops_across_many_floats_cost_few_vertices() {
    let mut points = vec![(0.0, 1.0)];
    points.extend((1..3000).map(|i| (i as f32, 0.5)));
    points.push((3000.0, 0.5));
    points.push((3000.0, 0.25));
    for compressor in Compressor::ALL.iter().copied() {
        let out = checked(&polyline(&points), compressor, Precision::F32, 0.01);
        assert!(out.len() <= 4, "{compressor:?}: {out:?}");
    }
    // Thousands of vertices one float apart.
    let n = 4000;
    let mut z = 1.0f32;
    let mut crowd = Vec::new();
    for i in 0..=n {
        crowd.push((z, 1.0 - f64::from(i) / f64::from(n)));
        z = z.next_up();
    }
    for compressor in Compressor::ALL.iter().copied() {
        let out = checked(&polyline(&crowd), compressor, Precision::F32, 0.01);
        assert!(out.len() <= 3, "{compressor:?}: {}", out.len());
    }
}

#[test]
fn equal_channels_compress_to_the_same_as_one_channel() {
    for seed in 0..20 {
        let one = mixed(8, seed);
        let three = one.values(0).iter().map(|&v| [v; 3]).collect();
        let three = Curve::rgb(one.depths().to_vec(), three).unwrap();
        for compressor in Compressor::ALL.iter().copied() {
            for precision in [Precision::F32, Precision::for_tolerance(0.03)] {
                let a = checked(&one, compressor, precision, 0.03);
                let b = checked(&three, compressor, precision, 0.03);
                assert_eq!(a, b);
            }
        }
    }
}

#[test]
fn each_of_three_unrelated_channels_keeps_the_bound() {
    for seed in 0..20 {
        let parts = [hair(6, seed), hair(6, seed + 100), cloud(40, seed)];
        let mut depths: Vec<f32> = parts.iter().flat_map(|p| p.depths().to_vec()).collect();
        depths.sort_by(f32::total_cmp);
        depths.dedup();
        let (mut z, mut v) = (Vec::new(), Vec::new());
        for (i, &d) in depths.iter().enumerate() {
            if i > 0 {
                z.push(d);
                v.push(std::array::from_fn(|c| parts[c].visibility(d)));
            }
            z.push(d);
            v.push(std::array::from_fn(|c| parts[c].visibility_behind(d)));
        }
        let mut low = [1.0f64; 3];
        for v in &mut v {
            low = std::array::from_fn(|c| low[c].min(v[c]));
            *v = low;
        }
        let input = Curve::rgb(z, v).unwrap();
        for compressor in Compressor::ALL.iter().copied() {
            for precision in [Precision::F32, Precision::Lattice(60)] {
                checked(&input, compressor, precision, 0.04);
            }
        }
        for compressor in Compressor::ALL.iter().copied() {
            checked(
                &coloured_hair(8, seed),
                compressor,
                Precision::for_tolerance(0.03),
                0.03,
            );
        }
    }
}

#[test]
fn on_scenes_each_compressor_needs_no_more_vertices_than_the_faster_one() {
    for make in [hair, |n: usize, s| cloud(n * n, s), plane, mixed] {
        let mut counts = [0; 4];
        for seed in 0..6 {
            let (input, eps) = (make(16, seed), Encoding::default_tolerance(256));
            counts[3] += exact_minimum(&input, eps, 255);
            for (i, compressor) in Compressor::ALL.iter().copied().enumerate() {
                checked(&input, compressor, Precision::F32, eps);
                counts[i] += checked(&input, compressor, Precision::Lattice(255), eps).len();
            }
        }
        let [croquet, lookahead, minimal, exact] = counts;
        assert!(
            exact <= minimal && minimal <= lookahead && lookahead <= croquet,
            "{counts:?}"
        );
        assert!(minimal as f64 <= 1.1 * exact as f64, "{counts:?}");
    }
}

#[test]
fn the_tolerance_includes_the_error_of_the_input() {
    let input = cloud(100, 7).with_error(0.006);
    for compressor in Compressor::ALL.iter().copied() {
        checked(&input, compressor, Precision::F32, 0.01);
        let mut encoder = Encoder::new(compressor, Precision::F32, 0.006).unwrap();
        let mut out = compress(&stairs(4), compressor, Precision::F32, 0.01);
        let before = out.clone();
        let error = encoder.compress(&input, &mut out).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        assert_eq!(out, before);
        let mut coarse = Encoder::new(compressor, Precision::Lattice(100), 0.01).unwrap();
        assert!(coarse.compress(&input, &mut out).is_err()); // only 0.004 is left
        assert!(encoder.compress(&cloud(100, 7), &mut out).is_ok());
    }
}

#[test]
fn settings_outside_their_domain_are_input_errors() {
    let lattice = Precision::Lattice;
    for (precision, eps) in [
        (Precision::F32, f64::NAN),
        (Precision::F32, -0.1),
        (Precision::F32, f64::INFINITY),
        (lattice(0), 0.1),
        (lattice(9), 0.1),
        (lattice(65535), 0.0),
    ] {
        let e = Encoder::new(Compressor::Croquet, precision, eps).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
    }
    assert!(Encoder::new(Compressor::Croquet, lattice(10), 0.1).is_ok());
}

#[test]
fn vertices_that_break_a_law_are_refused_by_its_name() {
    for (points, rule) in [
        (vec![(1.0, 0.5), (f32::NAN, 0.4)], "DEPTH-FINITE"),
        (vec![(2.0, 0.5), (1.0, 0.4)], "DEPTH-ORDER"),
        (vec![(1.0, 0.5), (1.0, 0.4)], "DEPTH-FIRST"),
        (
            vec![(0.0, 0.9), (1.0, 0.6), (1.0, 0.5), (1.0, 0.4)],
            "DEPTH-PAIR",
        ),
        (vec![(1.0, 1.5)], "VISIBILITY-RANGE"),
        (vec![(1.0, 0.5), (2.0, 0.6)], "VISIBILITY-RISE"),
    ] {
        let (depths, values) = points.into_iter().unzip();
        let e = Curve::mono(depths, values).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
        assert!(e.to_string().contains(rule), "{e}");
    }
}

#[test]
fn the_tolerance_decides_the_lattice_and_the_warning() {
    assert_eq!(
        Precision::for_tolerance(Encoding::default_tolerance(256)),
        Precision::Lattice(255)
    );
    assert_eq!(Precision::for_tolerance(7.0), Precision::Lattice(4));
    assert_eq!(
        Precision::for_tolerance(Encoding::MIN_TOLERANCE),
        Precision::F32
    );
    for i in 0..2000 {
        let eps = 10f64.powf(-f64::from(i) / 350.0);
        if let Precision::Lattice(l) = Precision::for_tolerance(eps) {
            assert!(1.0 / f64::from(l) <= 0.5 * eps, "{eps} {l}");
        }
    }
    for n in [1, 4, 16, 256, 4096] {
        assert!(
            Encoding::tolerance_warning(Encoding::default_tolerance(n), n).is_none(),
            "{n}"
        );
        assert!(
            Encoding::tolerance_warning(0.2 / f64::from(n), n).is_some(),
            "{n}"
        );
    }
    assert!(Encoding::tolerance_warning(0.6, 16).is_some());
}

/// Functions of steps, slopes and constant runs.
///
/// Depths repeat, are one float apart, or far apart. Drops are often exactly zero, one or two
/// tolerances.
fn functions(eps: f64) -> impl Strategy<Value = Curve> {
    let vertex = (
        prop_oneof![
            3 => Just(None),
            2 => Just(Some(0.0f32)),
            1 => Just(Some(f32::NAN)),
            4 => (0.01f32..3.0).prop_map(Some)
        ],
        prop_oneof![
            3 => Just(0.0),
            2 => Just(1.0),
            2 => Just(2.0),
            1 => Just(2.5),
            4 => 0.0..0.5f64,
            2 => 0.0..2.5f64
        ],
    );
    let ends = prop_oneof![Just(None), Just(Some(0.0)), Just(Some(1.0))];
    (prop::collection::vec(vertex, 0..60), ends).prop_map(move |(steps, end)| {
        let (mut z, mut v) = (1.0f32, 1.0f64);
        let mut points: Vec<(f32, f64)> = Vec::new();
        for (dz, dv) in steps {
            z = match dz {
                None => z,
                Some(dz) if dz.is_nan() => z.next_up(),
                Some(0.0) => z + 1.0,
                Some(dz) => z + dz,
            };
            v = (v - dv * eps).max(0.0);
            let n = points.len();
            let full = (n == 1 && points[0].0 == z) || (n >= 2 && points[n - 2].0 == z);
            if full {
                points[n - 1].1 = v;
            } else {
                points.push((z, v));
            }
        }
        match (end, points.last_mut()) {
            (Some(0.0), Some(last)) => last.1 = 0.0,
            (Some(_), _) => points
                .iter_mut()
                .for_each(|p| p.1 = 1.0 - (1.0 - p.1) * 1e-9),
            _ => {}
        }
        polyline(&points)
    })
}

fn tolerances() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.125),
        Just(1.0 / 64.0),
        Just(Encoding::default_tolerance(256)),
        Just(1.0),
        0.001..0.3f64,
    ]
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn every_output_keeps_every_guarantee(
        (eps, input) in tolerances().prop_flat_map(|eps| (Just(eps), functions(eps))),
        finer in 0u16..9,
    ) {
        let coarsest = (1.0 / eps).ceil() as u16;
        let lattices = [Precision::Lattice(coarsest + finer), Precision::for_tolerance(eps)];
        for precision in [Precision::F32].into_iter().chain(lattices) {
            for compressor in Compressor::ALL.iter().copied() {
                checked(&input, compressor, precision, eps);
            }
        }
    }

    #[test]
    fn coloured_outputs_keep_every_guarantee(
        (eps, a, b) in tolerances()
            .prop_flat_map(|eps| (Just(eps), functions(eps), functions(eps))),
    ) {
        // The second and third channel follow another function at the depths of the first.
        let n = a.len();
        let at = |i: usize| if b.is_empty() { 1.0 } else { b.values(0)[i * b.len() / n.max(1)] };
        let v = (0..n).map(|i| [a.values(0)[i], at(i), at(i).powi(2)]).collect();
        let input = Curve::rgb(a.depths().to_vec(), v).unwrap();
        for precision in [Precision::F32, Precision::for_tolerance(eps)] {
            for compressor in Compressor::ALL.iter().copied() {
                checked(&input, compressor, precision, eps);
            }
        }
    }

    #[test]
    fn the_minimal_compressor_comes_near_the_exact_minimum_and_none_beats_it(
        (eps, input) in (0.03..0.2f64).prop_flat_map(|eps| (Just(eps), functions(eps))),
    ) {
        let Precision::Lattice(l) = Precision::for_tolerance(eps) else { unreachable!() };
        let fewest = exact_minimum(&input, eps + 1e-9, l);
        for compressor in Compressor::ALL.iter().copied() {
            let n = compress(&input, compressor, Precision::Lattice(l), eps).len();
            prop_assert!(n >= fewest, "{compressor:?}: {n} below {fewest}");
        }
        let reachable = exact_minimum(&input, eps - 1e-9, l);
        let n = compress(&input, Compressor::Minimal, Precision::Lattice(l), eps).len();
        // Scenes come within a few per cent; these functions are made to mislead the compressor.
        prop_assert!(n <= 2 + 2 * reachable, "{n} against {reachable}");
    }
}
