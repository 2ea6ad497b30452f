//! Converts strands to triangles: ribbons that face the light.
//!
//! A strand becomes a strip of quads. At each point, the strip is as wide as the strand; its width
//! is perpendicular to the ray and to the strand's direction there, the mean of its two segments'
//! directions. Neighbouring quads share a side, so light passes through a strand once and does not
//! leak between two segments.

use glam::DVec3;

/// The two borders of a strand's ribbon: for each point, the left border and then the right. `ray`
/// gives the direction of the light at a point.
pub fn borders(
    points: &[DVec3],
    width: impl Fn(usize) -> f64,
    ray: impl Fn(DVec3) -> DVec3,
    mut put: impl FnMut(DVec3),
) {
    let last = points.len() - 1;
    let mut along = DVec3::X;
    for (i, &point) in points.iter().enumerate() {
        let before = (point - points[i.saturating_sub(1)]).normalize_or_zero();
        let behind = (points[(i + 1).min(last)] - point).normalize_or_zero();
        let mean = (before + behind).normalize_or_zero();
        // Where the strand turns back on itself or repeats a point, keep the last direction.
        along = [mean, behind]
            .into_iter()
            .find(|d| *d != DVec3::ZERO)
            .unwrap_or(along);
        let ray = ray(point).normalize_or_zero();
        let across = along.cross(ray);
        let across = match across.length() {
            // The strand points at the light: any direction perpendicular to the ray will do.
            length if length < 1e-9 => ray.any_orthonormal_vector(),
            length => across / length,
        };
        let half = across * (width(i) / 2.0);
        put(point - half);
        put(point + half);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ribbon_is_as_wide_as_its_strand_and_faces_the_light() {
        let points = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 1.0],
            [2.0, 1.0, 1.0],
            [2.0, 1.0, 1.0],
        ]
        .map(DVec3::from);
        let mut borders_ = Vec::new();
        borders(
            &points,
            |i| 0.1 * (i + 1) as f64,
            |_| DVec3::Z,
            |p| borders_.push(p),
        );
        for (i, pair) in borders_.chunks(2).enumerate() {
            let across = pair[1] - pair[0];
            assert!((across.length() - 0.1 * (i + 1) as f64).abs() < 1e-12);
            assert!(across.z.abs() < 1e-12 && (pair[0] + pair[1]) / 2.0 == points[i]);
        }
    }

    #[test]
    fn a_strand_that_points_at_the_light_keeps_its_width() {
        let points = [DVec3::ZERO, DVec3::Z];
        let mut wide = Vec::new();
        borders(&points, |_| 1.0, |_| DVec3::Z, |p| wide.push(p));
        assert!(((wide[1] - wide[0]).length() - 1.0).abs() < 1e-12);
    }
}
