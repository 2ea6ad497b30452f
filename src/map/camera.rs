//! The light's camera: the two matrices of a map, and constructors for them.

use crate::{Error, Result};

/// The light's camera: two 4 x 4 matrices in row order, for row vectors (`p' = p M`).
///
/// A matrix that is `None` is unknown; it is not the identity. The constructors make cameras for
/// right-handed worlds: for a camera that looks along -z with +y up, +x is to the right.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// // Ten above the ground, looking straight down: at 90 degrees it sees ten to each side there.
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
    /// World space to the display window, upper left (0,0), lower right (1,1); OpenEXR's
    /// `worldToNDC`.
    pub ndc_from_world: Option<[f64; 16]>,
}

impl Camera {
    /// A spot light at `position` that looks towards `target`.
    ///
    /// `up` points upwards in the picture; its component along the viewing direction is ignored.
    /// `field_of_view` is the angle that the display window spans in width and height, in degrees.
    ///
    /// # Errors
    /// `Input` for numbers that are not finite, a target at the position, and angles that are not
    /// strictly between 0 and 180.
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
        // The third coordinate, 1 / z, is not used; it makes the matrix invertible.
        #[rustfmt::skip]
        let ndc_from_camera = [
            x, 0.0, 0.0, 0.0,
            0.0, -y, 0.0, 0.0,
            0.5, 0.5, 0.0, 1.0,
            0.0, 0.0, 1.0, 0.0,
        ];
        Self::looking(position, target, up, ndc_from_camera)
    }

    /// A distant light: parallel rays from the plane through `position` towards `target`.
    ///
    /// The display window spans `extent`: width and height in world units. Depths are distances
    /// from the plane.
    ///
    /// # Errors
    /// `Input` for numbers that are not finite, a target at the position, and an extent that is not
    /// positive.
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

    /// The six cameras of a point light, in the order +x, -x, +y, -y, +z, -z.
    ///
    /// Each direction lies in exactly one of them; see [`crate::GroupRole::Faces`].
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
        // If `up` is parallel to `forward`, take the axis that is least parallel.
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

/// A distance that rounding does not lose when it is added to the position.
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

/// The vector scaled to length 1; `None` if it is zero or not finite.
fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let most = a.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let a = a.map(|v| v / most);
    let length = dot(a, a).sqrt();
    (most > 0.0 && length.is_finite()).then(|| a.map(|v| v / length))
}

fn product(a: &[f64; 16], b: &[f64; 16]) -> [f64; 16] {
    std::array::from_fn(|i| (0..4).map(|k| a[i / 4 * 4 + k] * b[k * 4 + i % 4]).sum())
}
