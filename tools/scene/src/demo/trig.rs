//! Sine and cosine that are the same to the last bit on every machine, which those of the platform are not.

use glam::Vec3;

/// Sine and cosine of so many whole turns; right to a few millionths.
pub fn sin_cos(turns: f32) -> (f32, f32) {
    let turns = f64::from(turns);
    (sine(turns) as f32, sine(turns + 0.25) as f32)
}

/// In each quarter of a turn, the first terms of the series.
fn sine(turns: f64) -> f64 {
    let t = turns - (turns + 0.25).floor();
    // From -1/4 to 3/4; the second half mirrors the first.
    let t = if t > 0.25 { 0.5 - t } else { t };
    let x = t * std::f64::consts::TAU;
    let x2 = x * x;
    let terms = [1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    x * terms.into_iter().fold(0.0, |sum, term| sum * x2 + term)
}

/// Two directions across this one, which has length 1: of length 1, and across each other.
pub fn across(axis: Vec3) -> (Vec3, Vec3) {
    let other = if axis.y.abs() < 0.9 { Vec3::Y } else { Vec3::X };
    let u = axis.cross(other).normalize();
    (u, axis.cross(u))
}
