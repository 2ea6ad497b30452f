//! The light's camera: the two matrices of a map, and how producers make them.

use crate::{Error, Result};

/// The light's camera: two 4 x 4 matrices by rows, for row vectors (`p' = p M`). A matrix that is
/// absent is unknown; it is not the identity.
///
/// The constructors make cameras for right-handed worlds, as those of most scene files: looking along -z with +y up, +x is to the right.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// // Ten above the ground, looking straight down; 90 degrees, so that it sees ten to each side there.
/// let camera = Camera::perspective([0.0, 10.0, 0.0], [0.0; 3], [0.0, 0.0, -1.0], [90.0; 2])?;
/// let map = MapHeader::new("spot", 100, 100).depth_kind(DepthKind::Planar).camera(camera);
/// let light = LightSpace::of(&map)?;
/// let [x, y, depth] = light.light_from_world([5.0, 0.0, 0.0]).unwrap();
/// assert!((x - 75.0).abs() < 1e-9 && (y - 50.0).abs() < 1e-9 && (depth - 10.0).abs() < 1e-9);
/// # Ok(()) }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Camera {
    /// World space to camera space: +x right, +y up, +z forward; OpenEXR's `worldToCamera`.
    pub camera_from_world: Option<[f64; 16]>,
    /// World space to (0,0) upper left .. (1,1) lower right of the display window; OpenEXR's `worldToNDC`.
    pub ndc_from_world: Option<[f64; 16]>,
}

impl Camera {
    /// A camera at `position` that looks towards `target`: a spot light. `up` is upwards in the picture as far as it is not forward;
    /// `field_of_view` is the whole angle in degrees that the display window spans, in width and height.
    ///
    /// # Errors
    /// `Input` for numbers that are not finite, a target at the position, angles outside 0 to 180, both exclusive.
    pub fn perspective(
        position: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        field_of_view: [f64; 2],
    ) -> Result<Camera> {
        if !field_of_view.iter().all(|a| *a > 0.0 && *a < 180.0) {
            return Err(Error::input(format!(
                "a field of view of {field_of_view:?} degrees"
            )));
        }
        let [x, y] = field_of_view.map(|angle| 0.5 / (angle.to_radians() / 2.0).tan());
        // The third number is 1 / z: it means nothing, but so the matrix can be inverted.
        #[rustfmt::skip]
        let ndc_from_camera = [
            x, 0.0, 0.0, 0.0,
            0.0, -y, 0.0, 0.0,
            0.5, 0.5, 0.0, 1.0,
            0.0, 0.0, 1.0, 0.0,
        ];
        Self::looking(position, target, up, ndc_from_camera)
    }

    /// A camera with parallel rays, from the plane through `position` towards `target`: a distant light. The display window spans `extent`, width
    /// and height in the units of the world; depths are distances from that plane.
    ///
    /// # Errors
    /// `Input` for numbers that are not finite, a target at the position, an extent that is not positive.
    pub fn orthographic(
        position: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        extent: [f64; 2],
    ) -> Result<Camera> {
        if !extent.iter().all(|e| *e > 0.0 && e.is_finite()) {
            return Err(Error::input(format!("an extent of {extent:?}")));
        }
        let [x, y] = extent.map(|e| 1.0 / e);
        #[rustfmt::skip]
        let ndc_from_camera = [
            x, 0.0, 0.0, 0.0,
            0.0, -y, 0.0, 0.0,
            0.0, 0.0, 1.0, 0.0,
            0.5, 0.5, 0.0, 1.0,
        ];
        Self::looking(position, target, up, ndc_from_camera)
    }

    /// The six cameras around a point light, in the order +x, -x, +y, -y, +z, -z; together they see everything once
    /// ([`crate::GroupRole::Faces`]).
    ///
    /// # Errors
    /// `Input` for a position that is not finite.
    pub fn faces(position: [f64; 3]) -> Result<[Camera; 6]> {
        let mut cameras = [Camera::default(); 6];
        for (face, camera) in cameras.iter_mut().enumerate() {
            let mut target = position;
            target[face / 2] += [1.0, -1.0][face % 2] * reach(position);
            let up = if face / 2 == 1 {
                [0.0, 0.0, 1.0]
            } else {
                [0.0, 1.0, 0.0]
            };
            *camera = Self::perspective(position, target, up, [90.0; 2])?;
        }
        Ok(cameras)
    }

    fn looking(
        position: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        ndc_from_camera: [f64; 16],
    ) -> Result<Camera> {
        let towards: [f64; 3] = std::array::from_fn(|i| target[i] - position[i]);
        let forward = unit(towards).ok_or_else(|| {
            Error::input(format!(
                "a camera at {position:?} cannot look at {target:?}"
            ))
        })?;
        // Where `up` is forward, any other direction will do: the axis least so.
        let least = (0..3).min_by(|&a, &b| forward[a].abs().total_cmp(&forward[b].abs()));
        let axis: [f64; 3] = std::array::from_fn(|i| if Some(i) == least { 1.0 } else { 0.0 });
        let right = unit(up)
            .map(|up| cross(forward, up))
            .filter(|r| dot(*r, *r) > 1e-12)
            .unwrap_or_else(|| cross(forward, axis));
        let right = unit(right).ok_or_else(|| Error::input(format!("an up of {up:?}")))?;
        let up = cross(right, forward);
        let [r, u, f] = [right, up, forward];
        #[rustfmt::skip]
        let camera_from_world = [
            r[0], u[0], f[0], 0.0,
            r[1], u[1], f[1], 0.0,
            r[2], u[2], f[2], 0.0,
            -dot(r, position), -dot(u, position), -dot(f, position), 1.0,
        ];
        Ok(Camera {
            camera_from_world: Some(camera_from_world),
            ndc_from_world: Some(product(&camera_from_world, &ndc_from_camera)),
        })
    }
}

/// A distance that is not lost beside the position.
fn reach(position: [f64; 3]) -> f64 {
    position.iter().fold(1.0, |most, p| most.max(p.abs()))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The vector with length 1; `None` if it has none or is not finite.
fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let most = a.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let a = a.map(|v| v / most);
    let length = dot(a, a).sqrt();
    (most > 0.0 && length.is_finite()).then(|| a.map(|v| v / length))
}

fn product(a: &[f64; 16], b: &[f64; 16]) -> [f64; 16] {
    std::array::from_fn(|i| (0..4).map(|k| a[i / 4 * 4 + k] * b[k * 4 + i % 4]).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DepthKind, LightSpace, MapHeader};

    fn space(camera: Camera) -> LightSpace {
        let map = MapHeader::new("m", 8, 4);
        LightSpace::of(&map.depth_kind(DepthKind::Planar).camera(camera)).unwrap()
    }

    fn near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    #[test]
    fn right_is_right_and_up_is_up_in_a_right_handed_world() {
        let camera =
            Camera::orthographic([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [8.0, 4.0]).unwrap();
        let at = space(camera).light_from_world([1.0, 0.5, -3.0]).unwrap();
        assert!(near(at, [5.0, 1.5, 3.0]), "{at:?}");
    }

    #[test]
    fn a_camera_sees_its_target_in_the_middle_and_the_corner_at_the_angle() {
        let (position, target) = ([3.0, -2.0, 7.0], [-1.0, 4.0, 2.5]);
        let camera = Camera::perspective(position, target, [0.0, 1.0, 0.0], [60.0, 30.0]).unwrap();
        let light = space(camera);
        let at = light.light_from_world(target).unwrap();
        let distance = (16.0f64 + 36.0 + 20.25).sqrt();
        assert!(near(at, [4.0, 2.0, distance]), "{at:?}");
    }

    #[test]
    fn a_camera_that_looks_up_does_not_need_to_know_where_up_is() {
        for up in [[0.0, 1.0, 0.0], [0.0, -2.0, 0.0], [0.0; 3], [f64::NAN; 3]] {
            let camera = Camera::orthographic([0.0; 3], [0.0, 5.0, 0.0], up, [8.0, 4.0]).unwrap();
            let at = space(camera).light_from_world([0.0, 2.0, 0.0]).unwrap();
            assert!(near(at, [4.0, 2.0, 2.0]));
        }
    }

    #[test]
    fn every_direction_lies_in_one_face() {
        let faces = Camera::faces([1.0, 2.0, 3.0]).unwrap().map(space);
        let mut dice = 7u64;
        for _ in 0..1000 {
            let p: [f64; 3] = std::array::from_fn(|i| {
                dice = dice
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                (dice >> 40) as f64 / (1u64 << 23) as f64 - 1.0 + [1.0, 2.0, 3.0][i]
            });
            let inside = |l: &LightSpace| {
                l.light_from_world(p)
                    .is_some_and(|[x, y, _]| (0.0..8.0).contains(&x) && (0.0..4.0).contains(&y))
            };
            assert_eq!(faces.iter().filter(|l| inside(l)).count(), 1, "{p:?}");
        }
        // The axes are the centres.
        let at = faces[3].light_from_world([1.0, -5.0, 3.0]).unwrap();
        assert!(near(at, [4.0, 2.0, 7.0]));
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let up = [0.0, 1.0, 0.0];
        assert!(Camera::perspective([1.0; 3], [1.0; 3], up, [90.0; 2]).is_err());
        assert!(Camera::perspective([f64::NAN; 3], [1.0; 3], up, [90.0; 2]).is_err());
        assert!(Camera::perspective([0.0; 3], [1.0; 3], up, [180.0, 90.0]).is_err());
        assert!(Camera::orthographic([0.0; 3], [1.0; 3], up, [0.0, 1.0]).is_err());
        assert!(Camera::faces([f64::INFINITY, 0.0, 0.0]).is_err());
    }
}
