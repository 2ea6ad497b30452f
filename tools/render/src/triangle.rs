//! Intersects a ray with a triangle, without gaps or double hits at shared edges.

use glam::DVec3;

/// A hit of a ray on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// Distance along the ray, in multiples of its direction.
    pub t: f64,
    /// Barycentric coordinates. Their sum is 1.
    pub weights: [f64; 3],
}

/// Intersects the line through `origin` with the triangle, from either side.
///
/// The distance may be negative.
///
/// `names` are the indices of the corners. If a line passes exactly through the shared edge of two
/// triangles with the same orientation, the indices decide which one it hits. The volume spanned by
/// the line and the edge differs between the two triangles in its sign only, to the last bit, so
/// there are no gaps.
pub fn meet(origin: DVec3, way: DVec3, corners: [DVec3; 3], names: [u32; 3]) -> Option<Meeting> {
    let [a, b, c] = corners.map(|p| p - origin);
    let side = |p: DVec3, q: DVec3, i: u32, j: u32| {
        let volume = way.dot(p.cross(q));
        let left = if volume == 0.0 { i < j } else { volume > 0.0 };
        (volume, left)
    };
    let (u, u_left) = side(b, c, names[1], names[2]);
    let (v, v_left) = side(c, a, names[2], names[0]);
    let (w, w_left) = side(a, b, names[0], names[1]);
    if u_left != v_left || v_left != w_left {
        return None;
    }
    let normal = (b - a).cross(c - a);
    let t = a.dot(normal) / way.dot(normal);
    let sum = u + v + w;
    let weights = [u, v, w].map(|x| x / sum);
    (t.is_finite() && weights.iter().all(|x| x.is_finite())).then_some(Meeting { t, weights })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [DVec3; 4] = [
        DVec3::new(0.0, 0.0, 2.0),
        DVec3::new(1.0, 0.0, 2.0),
        DVec3::new(1.0, 1.0, 2.0),
        DVec3::new(0.0, 1.0, 2.0),
    ];

    fn hits(x: f64, y: f64) -> usize {
        let triangles = [[0u32, 1, 2], [0, 2, 3]];
        let meets = |t: &&[u32; 3]| {
            let corners = t.map(|i| SQUARE[i as usize]);
            meet(DVec3::new(x, y, 0.0), DVec3::Z, corners, **t).is_some()
        };
        triangles.iter().filter(meets).count()
    }

    #[test]
    fn a_ray_through_the_diagonal_of_a_square_meets_it_once() {
        for i in 1..100 {
            let at = f64::from(i) / 100.0;
            assert_eq!(hits(at, at), 1, "{at}");
            assert_eq!(hits(at, 0.37), 1, "{at}");
        }
        assert_eq!((hits(-0.1, 0.5), hits(0.5, 1.1)), (0, 0));
    }

    #[test]
    fn distance_and_weights_are_those_of_the_place() {
        let corners = [SQUARE[0], SQUARE[1], SQUARE[2]];
        let met = meet(
            DVec3::new(0.5, 0.25, 0.0),
            DVec3::Z * 2.0,
            corners,
            [0, 1, 2],
        )
        .unwrap();
        assert_eq!((met.t, met.weights), (1.0, [0.5, 0.25, 0.25]));
    }

    #[test]
    fn a_triangle_without_area_is_not_met() {
        let corners = [SQUARE[0], SQUARE[1], SQUARE[1]];
        assert_eq!(
            meet(DVec3::new(0.5, 0.0, 0.0), DVec3::Z, corners, [0, 1, 1]),
            None
        );
    }
}
