//! Checks the compressors on any legal curve, with any tolerance and any precision.
//!
//! The exact deviation must be within the tolerance, and the output must obey the laws. Its depths
//! must be input depths and its end values the input's. Pushing vertices one by one, or compressing
//! with a new encoder, must give the same function.

use deepshadow::raw::{Encoder, Precision};
use deepshadow::{Compressor, Visibility};

use super::bytes::Bytes;
use super::curves;

/// Rounding error of evaluating the two functions in f64.
const ROUNDING: f64 = 1e-12;

/// Checks one compressor on one input: a tolerance, a precision and two curves.
pub fn run(compressor: Compressor, data: &[u8]) {
    let mut b = Bytes(data);
    let tolerance = match b.u8() % 6 {
        0 => 0.0,
        1 => 1.0 / 64.0,
        2 => 0.25,
        3 => b.unit() * 0.5,
        4 => 2f64.powi(-i32::from(b.u8() % 20)),
        _ => f64::from(b.u8()) / 255.0,
    };
    let precision = match b.u8() % 4 {
        0 => Precision::F32,
        1 => Precision::for_tolerance(tolerance),
        2 => Precision::Lattice((1.0 / tolerance.max(1.0 / 65535.0)).ceil() as u16),
        _ => Precision::Lattice(b.u16()),
    };
    let Ok(mut encoder) = Encoder::new(compressor, precision, tolerance) else {
        return; // the lattice is too coarse for the tolerance
    };
    let mut out = Visibility::lit();
    // Two curves with one encoder: the first must not affect the second.
    for _ in 0..2 {
        let split = b.u8();
        let tolerance = encoder.tolerance();
        let carried = if split & 1 == 0 { 0.0 } else { tolerance / 4.0 };
        let curve = curves::curve(&mut b, tolerance - carried, 48).with_error(carried);
        if encoder.compress(&curve, &mut out).is_err() {
            assert!(carried > 0.0, "refused {curve:?}");
            continue;
        }
        check(&curve, &out, tolerance - carried, precision);
        let mut fresh = Visibility::lit();
        let mut other = Encoder::new(compressor, precision, tolerance).expect("as above");
        other.compress(&curve, &mut fresh).expect("as above");
        assert_eq!(fresh, out, "used and new encoder differ: {curve:?}");
    }
}

fn check(curve: &deepshadow::Curve, out: &Visibility, bound: f64, precision: Precision) {
    let worst = curve.deviation(out);
    assert!(
        worst.error <= bound + ROUNDING,
        "{worst:?} exceeds {bound}: {curve:?} became {out:?}"
    );
    let planes = (0..out.channels())
        .map(|c| out.values(c).to_vec())
        .collect();
    let again = Visibility::from_planes(out.depths().to_vec(), planes);
    assert_eq!(
        again.as_ref().ok(),
        Some(out),
        "the output breaks a law: {again:?}"
    );
    assert!(
        out.len() <= curve.len(),
        "{} vertices from {}: {curve:?} became {out:?}",
        out.len(),
        curve.len()
    );
    for &z in out.depths() {
        assert!(
            curve.depths().contains(&z),
            "depth {z} is not a depth of the input"
        );
    }
    for pair in out.depths().windows(2).filter(|p| p[0] == p[1]) {
        // The last vertex may step down to the end value.
        let last = out.depths().last() == Some(&pair[0]);
        let stepped = last
            || (0..3).any(|c| {
                curve.visibility_rgb(pair[0])[c] > curve.visibility_behind_rgb(pair[0])[c]
            });
        assert!(
            stepped,
            "a step at {} where the input has none: {curve:?} became {out:?}",
            pair[0]
        );
    }
    let half = match precision {
        Precision::F32 => 2f64.powi(-25),
        Precision::Lattice(l) => 0.5 / f64::from(l) + 2f64.powi(-25),
    };
    for c in 0..3 {
        let (exact, stored) = (curve.end_rgb()[c], f64::from(out.end_rgb()[c]));
        assert!(
            (exact - stored).abs() <= half,
            "ends at {stored} instead of {exact}: {curve:?}"
        );
        assert!(
            exact != 0.0 && exact != 1.0 || exact == stored,
            "ends at {stored} instead of {exact}"
        );
    }
    if let Precision::Lattice(l) = precision {
        for &v in (0..out.channels()).flat_map(|c| out.values(c)) {
            let k = (f64::from(v) * f64::from(l)).round() as f32;
            assert_eq!(k / f32::from(l), v, "the value is off the lattice {l}");
        }
    }
}
