//! Lights for rendering: the view that holds a point, its footprint and its bias.

use deepshadow::{DepthKind, Footprint};
use deepshadow_frame::Result;
use deepshadow_scene::scene::{Light, LightKind, Scene, View};
use glam::DVec3;

/// Default bias of a lookup, in widths of its footprint: its depth moves towards the light.
///
/// A triangle filter with the width of a pixel, over the box of the pixel itself, ends 1.5 pixels
/// from its middle. Within that radius, a surface at 45 degrees is up to 1.5 pixels nearer to the
/// light than the shaded point (LV00, section 4).
pub const BIAS: f64 = 1.5;

/// A light of a scene with its views.
#[derive(Debug)]
pub struct Lamp<'a> {
    /// The scene's description.
    pub light: &'a Light,
    /// One view, or six for a point light.
    pub views: Vec<View>,
    /// Bias in units of depth. `None` is [`BIAS`] footprints.
    bias: Option<f64>,
    /// Ratio of footprint width to camera ray width; also the least width in pixels of the map.
    blur: f64,
}

/// A query for the fraction of a light that reaches a point.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Point in world space.
    pub point: DVec3,
    /// Width of the ball around the point to average over.
    pub width: f64,
    /// Bias, subtracted from the depth of the point.
    pub bias: f64,
    /// Time of the camera ray.
    pub time: f64,
    /// Seed of the jitter.
    pub key: u64,
}

impl<'a> Lamp<'a> {
    /// A light of a scene.
    ///
    /// `bias`, in units of depth, applies to every kind of shadow. `None` is [`BIAS`] footprints.
    ///
    /// # Errors
    /// As [`Light::views`].
    pub fn new(light: &'a Light, scene: &Scene, blur: f64, bias: Option<f64>) -> Result<Self> {
        Ok(Lamp {
            light,
            views: light.views(scene)?,
            bias,
            blur,
        })
    }

    /// Unit direction of the light's rays at a point.
    pub fn way(&self, point: DVec3) -> DVec3 {
        self.views[0].eye.ray(point).normalize_or_zero()
    }

    /// Width of the footprint at a point hit by a camera ray that is `width` wide there.
    pub fn footprint(&self, point: DVec3, width: f64) -> f64 {
        (width * self.blur).max(self.least_width(point))
    }

    /// Bias on a surface for a footprint of this width, in units of depth.
    pub fn bias(&self, width: f64) -> f64 {
        self.bias.unwrap_or(BIAS * width)
    }

    /// Width of `blur` pixels of the map at a point. 0 where the map has no pixels.
    fn least_width(&self, point: DVec3) -> f64 {
        let view = &self.views[face(self, point)];
        match view.space.footprint_of_width(point.to_array(), 1.0) {
            Some(Footprint::Width(pixels)) if pixels > 0.0 => self.blur / f64::from(pixels),
            _ => 0.0,
        }
    }

    /// The view that holds a point, and the point in light space.
    ///
    /// `None` outside of all views, where nothing is in shadow.
    pub fn seen(&self, point: DVec3) -> Option<(usize, [f64; 3])> {
        let face = face(self, point);
        let view = &self.views[face];
        let at = view.space.light_from_world(point.to_array())?;
        // Rounding may put a point on the border of a cube face slightly outside of it.
        let inside = self.views.len() > 1 || view.space.holds(point.to_array());
        inside.then_some((face, at))
    }
}

/// Index of the view that looks towards a point.
fn face(lamp: &Lamp<'_>, point: DVec3) -> usize {
    let LightKind::Point { position } = lamp.light.kind else {
        return 0;
    };
    let way = point - position;
    let axis = (0..3).fold(0, |a, b| if way[b].abs() > way[a].abs() { b } else { a });
    2 * axis + usize::from(way[axis] < 0.0)
}

/// Ray of a view through pixel coordinates (x, y): its origin, and its step per unit of depth.
pub fn line(view: &View, x: f64, y: f64) -> (DVec3, DVec3) {
    let (origin, way) = view.eye.line(x, y);
    match view.depth {
        DepthKind::RayDistance => (origin, way.normalize()),
        _ => (origin, way),
    }
}

#[cfg(test)]
mod tests {
    use deepshadow_scene::geometry::Mesh;
    use deepshadow_scene::scene::{Object, Shape};
    use glam::Vec3;

    use super::*;

    /// A triangle around the origin.
    fn scene() -> Scene {
        let corners = vec![Vec3::splat(-2.0), Vec3::splat(2.0), Vec3::ZERO];
        let mesh = Mesh::still(corners, vec![[0, 1, 2]]);
        Scene {
            objects: vec![Object::new("triangle", Shape::Mesh(mesh))],
            ..Scene::default()
        }
    }

    #[test]
    fn every_point_is_in_the_face_of_a_point_light_that_looks_at_it() {
        let kind = LightKind::Point {
            position: DVec3::new(0.5, 0.0, 0.0),
        };
        let light = Light::new("lamp", kind);
        let lamp = Lamp::new(&light, &scene(), 1.0, None).unwrap();
        for i in 0..600 {
            let at = |k: f64| (f64::from(i) * k).sin() * 3.0;
            let point = DVec3::new(at(1.1), at(2.3), at(3.7));
            let (face, found) = lamp.seen(point).unwrap();
            assert!(lamp.views[face].space.holds(point.to_array()), "{point}");
            // The ray through these coordinates leads to the point.
            let (origin, way) = line(&lamp.views[face], found[0], found[1]);
            assert!((origin + way * found[2] - point).length() < 1e-9);
        }
    }

    #[test]
    fn a_footprint_is_at_least_a_pixel_of_the_map() {
        let kind = LightKind::Directional {
            direction: -DVec3::Y,
            up: DVec3::Z,
            target: None,
            size: Some(512.0),
        };
        let light = Light::new("sun", kind);
        for blur in [1.0, 4.0] {
            let lamp = Lamp::new(&light, &scene(), blur, None).unwrap();
            assert!((lamp.footprint(DVec3::ZERO, 0.01) - blur).abs() < 1e-6);
            assert!((lamp.footprint(DVec3::ZERO, 8.0) - 8.0 * blur).abs() < 1e-6);
        }
    }
}
