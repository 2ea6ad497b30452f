//! The camera of a picture: directions and widths of its rays.

use deepshadow_frame::{Failure, Result};
use deepshadow_scene::scene::{PictureCamera, Scene};
use glam::DVec3;

/// A pinhole camera.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Origin of all rays.
    pub position: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Width and height in pixels.
    pub resolution: [u32; 2],
    /// Side of a pixel at depth 1.
    pixel: f64,
}

impl Camera {
    /// The camera of a scene. Without one, a camera that sees the whole scene, slightly from above.
    ///
    /// `resolution` replaces the resolution of the scene's camera.
    ///
    /// # Errors
    /// `Failed` for an invalid camera (see [`Camera::new`]), or if the scene has neither a camera
    /// nor objects.
    pub fn of(scene: &Scene, resolution: Option<[u32; 2]>) -> Result<Self> {
        let mut picture = match scene.camera {
            Some(camera) => camera,
            None => framed(scene)?,
        };
        if let Some(resolution) = resolution {
            picture.resolution = resolution;
        }
        Self::new(&picture)
    }

    /// A camera.
    ///
    /// # Errors
    /// `Failed` if position and target coincide, the angle is not between 0 and 180 degrees, or the
    /// resolution is 0.
    pub fn new(picture: &PictureCamera) -> Result<Self> {
        let failed = |what: &str| Failure::Failed(format!("the camera {what}"));
        let forward = (picture.target - picture.position).normalize_or_zero();
        if forward == DVec3::ZERO || !picture.position.is_finite() {
            return Err(failed("has the same position and target"));
        }
        if !(picture.angle > 0.0 && picture.angle < 180.0) {
            return Err(failed("has an angle that is not between 0 and 180 degrees"));
        }
        if picture.resolution.contains(&0) {
            return Err(failed("has a resolution of 0"));
        }
        let right = match forward.cross(picture.up).normalize_or_zero() {
            // The camera looks straight up or down: any right vector will do.
            DVec3::ZERO => forward.any_orthonormal_vector(),
            right => right,
        };
        Ok(Camera {
            position: picture.position,
            forward,
            right,
            up: right.cross(forward),
            resolution: picture.resolution,
            pixel: 2.0 * (picture.angle.to_radians() / 2.0).tan()
                / f64::from(picture.resolution[1]),
        })
    }

    /// Unit direction of the ray through (x, y), in pixels from the upper left corner.
    pub fn way(&self, x: f64, y: f64) -> DVec3 {
        let [w, h] = self.resolution.map(f64::from);
        let (x, y) = ((x - w / 2.0) * self.pixel, (h / 2.0 - y) * self.pixel);
        (self.forward + self.right * x + self.up * y).normalize()
    }

    /// Side of a pixel at a distance along a ray, in a plane perpendicular to the camera's axis.
    pub fn width(&self, way: DVec3, distance: f64) -> f64 {
        distance * way.dot(self.forward) * self.pixel
    }
}

/// A camera that frames all objects.
fn framed(scene: &Scene) -> Result<PictureCamera> {
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for object in &scene.objects {
        object.points(|p| (lo, hi) = (lo.min(p), hi.max(p)));
    }
    if !lo.is_finite() || !hi.is_finite() {
        return Err(Failure::Failed(
            "the scene has neither a camera nor objects".into(),
        ));
    }
    const ANGLE: f64 = 35.0;
    let radius = ((hi - lo).length() / 2.0).max(1e-6);
    let distance = radius / (ANGLE.to_radians() / 2.0).sin();
    let target = (lo + hi) / 2.0;
    Ok(PictureCamera {
        position: target + DVec3::new(0.35, 0.4, 1.0).normalize() * distance,
        target,
        up: DVec3::Y,
        angle: ANGLE,
        resolution: [640, 480],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_central_ray_goes_straight_ahead_and_the_top_ray_half_the_angle_above() {
        let camera = Camera::new(&PictureCamera {
            position: DVec3::new(0.0, 0.0, 5.0),
            target: DVec3::ZERO,
            up: DVec3::Y,
            angle: 90.0,
            resolution: [4, 2],
        })
        .unwrap();
        assert_eq!(camera.way(2.0, 1.0), -DVec3::Z);
        let upper = camera.way(2.0, 0.0);
        assert!((upper - DVec3::new(0.0, 0.5f64.sqrt(), -(0.5f64.sqrt()))).length() < 1e-12);
        assert!(camera.way(4.0, 1.0).x > 0.0);
        // At depth 5 the picture is 10 units high, and a pixel 5.
        assert!((camera.width(upper, 5.0 * 2f64.sqrt()) - 5.0).abs() < 1e-12);
    }
}
