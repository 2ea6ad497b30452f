//! The camera of a picture: where its rays go, and how wide they are.

use deepshadow_frame::{Failure, Result};
use deepshadow_scene::scene::{PictureCamera, Scene};
use glam::DVec3;

/// A pinhole: rays from one point through the pixels of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// The eye.
    pub position: DVec3,
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    /// Pixels: width and height.
    pub resolution: [u32; 2],
    /// Side of a pixel at a depth of 1.
    pixel: f64,
}

impl Camera {
    /// The camera of a scene, or one that sees all of it, a little from above.
    ///
    /// # Errors
    /// `Failed` for a camera that looks nowhere, or where there is neither camera nor object.
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
    /// `Failed` if it looks nowhere.
    pub fn new(picture: &PictureCamera) -> Result<Self> {
        let failed = |what: &str| Failure::Failed(format!("the camera {what}"));
        let forward = (picture.target - picture.position).normalize_or_zero();
        if forward == DVec3::ZERO || !picture.position.is_finite() {
            return Err(failed("stands where it looks"));
        }
        if !(picture.angle > 0.0 && picture.angle < 180.0) {
            return Err(failed(
                "sees an angle that is not between 0 and 180 degrees",
            ));
        }
        if picture.resolution.contains(&0) {
            return Err(failed("has a picture without pixels"));
        }
        let right = match forward.cross(picture.up).normalize_or_zero() {
            // Straight up or down: any side is as good.
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

    /// The direction, of length 1, of the ray through a place in the picture, in pixels from its upper left corner.
    pub fn way(&self, x: f64, y: f64) -> DVec3 {
        let [w, h] = self.resolution.map(f64::from);
        let (x, y) = ((x - w / 2.0) * self.pixel, (h / 2.0 - y) * self.pixel);
        (self.forward + self.right * x + self.up * y).normalize()
    }

    /// How wide a pixel is at a distance along a ray: its side in a plane across the camera's axis.
    pub fn width(&self, way: DVec3, distance: f64) -> f64 {
        distance * way.dot(self.forward) * self.pixel
    }
}

/// All objects just inside the picture.
fn framed(scene: &Scene) -> Result<PictureCamera> {
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for object in &scene.objects {
        object.points(|p| (lo, hi) = (lo.min(p), hi.max(p)));
    }
    if !lo.is_finite() || !hi.is_finite() {
        return Err(Failure::Failed(
            "there is nothing in the scene to see".into(),
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
    fn the_middle_is_straight_ahead_and_the_upper_border_half_the_angle_above() {
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
        // At a depth of 5 the picture is 10 high, a pixel 5.
        assert!((camera.width(upper, 5.0 * 2f64.sqrt()) - 5.0).abs() < 1e-12);
    }
}
