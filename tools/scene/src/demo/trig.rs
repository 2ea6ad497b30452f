//! Sine and cosine that are bit-identical on every machine, unlike those of the platform.

use glam::Vec3;

/// Sine and cosine of an angle in whole turns, with an error of a few millionths.
pub fn sin_cos(turns: f32) -> (f32, f32) {
    let turns = f64::from(turns);
    (sine(turns) as f32, sine(turns + 0.25) as f32)
}

/// Sine by the first terms of its series, in each quarter of a turn.
fn sine(turns: f64) -> f64 {
    let t = turns - (turns + 0.25).floor();
    // From -1/4 to 3/4; the second half mirrors the first.
    let t = if t > 0.25 { 0.5 - t } else { t };
    let x = t * std::f64::consts::TAU;
    let x2 = x * x;
    let terms = [1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    x * terms.into_iter().fold(0.0, |sum, term| sum * x2 + term)
}

/// Two unit vectors perpendicular to `axis`, which has length 1, and to each other.
pub fn across(axis: Vec3) -> (Vec3, Vec3) {
    let other = if axis.y.abs() < 0.9 { Vec3::Y } else { Vec3::X };
    let u = axis.cross(other).normalize();
    (u, axis.cross(u))
}
