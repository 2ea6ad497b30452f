//! Samples of a deep image that stand for a function.

use deepshadow::raw::DeepSample;
use deepshadow::{Vertex, Visibility};

/// The nearest half float below 1, in units of its last place.
fn half(opacity: f64) -> f32 {
    let exponent = opacity.log2().floor().max(-14.0);
    let unit = (exponent - 10.0).exp2();
    ((opacity / unit).round_ties_even() * unit).min(1.0 - 0.5f64.powi(11)) as f32
}

fn mono(points: &[(f32, f32)]) -> Visibility {
    Visibility::mono(points.iter().map(|&(z, v)| Vertex::new(z, v)).collect()).unwrap()
}

#[test]
fn steps_become_thin_samples() {
    let f = mono(&[(1.0, 0.5), (2.0, 0.5), (2.0, 0.0)]);
    let sample = |depth, opacity| DeepSample {
        depth,
        depth_back: depth,
        opacity: [opacity; 3],
    };
    assert_eq!(
        f.function().deep_samples(0.001, half).unwrap(),
        [sample(1.0, 0.5), sample(2.0, 1.0)]
    );
}

#[test]
fn a_ramp_to_nothing_ends_in_an_opaque_thin_sample() {
    for (points, most) in [
        (vec![(1.0, 1.0), (3.0, 0.0)], 25),
        (vec![(1.0, 0.003), (3.0, 0.0)], 3),
        (vec![(1.0, 1.0), (1.0f32.next_up(), 0.0)], 3),
        (vec![(-5.0, 0.75), (-4.0, 0.25), (8.0, 0.0)], 25),
    ] {
        let f = mono(&points);
        let samples = f.function().deep_samples(0.002, half).unwrap();
        let last = samples.last().unwrap();
        let depth = points.last().unwrap().0;
        assert_eq!((last.depth, last.depth_back), (depth, depth));
        assert_eq!(last.opacity, [1.0; 3]);
        assert!(samples.len() <= most, "{} samples", samples.len());
    }
}

#[test]
fn rounding_errors_do_not_add_up() {
    let points: Vec<_> = (0..500)
        .flat_map(|i| {
            let v = |i: i32| 1.0 - i as f32 / 600.0;
            let z = 1.0 + i as f32;
            if i == 0 {
                vec![(z, v(1))]
            } else {
                vec![(z, v(i)), (z, v(i + 1))]
            }
        })
        .collect();
    let f = mono(&points);
    assert!(f.function().deep_samples(0.0005, half).is_ok());
    assert!(f.function().deep_samples(1e-6, |o| o as f32).is_ok());
}

#[test]
fn opacities_that_are_too_coarse_are_an_error() {
    let f = mono(&[(1.0, 0.3)]);
    let refused = f
        .function()
        .deep_samples(1e-6, half)
        .unwrap_err()
        .to_string();
    let (_, rest) = refused.split_once("within ").unwrap();
    let least: f64 = rest.split_once(' ').unwrap().0.parse().unwrap();
    assert!(least > 1e-6 && least < 1e-3, "{refused}");
}

#[test]
fn colours_go_dark_one_by_one() {
    let f = Visibility::rgb(vec![
        Vertex::new(1.0, [1.0, 0.5, 1.0]),
        Vertex::new(2.0, [0.0, 0.25, 0.75]),
        Vertex::new(2.0, [0.0, 0.25, 0.5]),
        Vertex::new(4.0, [0.0, 0.0, 0.5]),
    ])
    .unwrap();
    let samples = f.function().deep_samples(0.002, half).unwrap();
    let left = |c: usize| -> f64 {
        let through = samples.iter().map(|s| 1.0 - f64::from(s.opacity[c]));
        through.product()
    };
    assert_eq!([left(0), left(1)], [0.0, 0.0]);
    assert!((left(2) - 0.5).abs() < 0.001);
}
