//! Lights as a picture needs them: which of a light's views a point is in, how large a pixel of its map is there.

use deepshadow::{DepthKind, Footprint};
use deepshadow_frame::Result;
use deepshadow_scene::scene::{Light, LightKind, Scene, View};
use glam::DVec3;

/// How many widths of its footprint a lookup's depth is moved towards the light, unless the caller says otherwise.
///
/// A triangle as wide as a pixel over the pixel's own box ends 1.5 pixels from its middle: so much of a surface that leans by 45 degrees is nearer to the light
/// than the point that is shaded (LV00, section 4).
pub const BIAS: f64 = 1.5;

/// A light, ready to be looked up.
#[derive(Debug)]
pub struct Lamp<'a> {
    /// What the scene says of it.
    pub light: &'a Light,
    /// Its view, or six of a point light.
    pub views: Vec<View>,
    /// Taken off depths, in units of depth; [`BIAS`] footprints if absent.
    bias: Option<f64>,
    /// Footprints are this many times wider than the camera's rays, and at least as many pixels of the map.
    blur: f64,
}

/// A question for a shadow: how much of a light reaches this?
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The point.
    pub point: DVec3,
    /// What is averaged around it: a ball of this width.
    pub width: f64,
    /// Taken off its depth.
    pub bias: f64,
    /// The moment of the camera's ray.
    pub time: f64,
    /// Another one, other jitter.
    pub key: u64,
}

impl<'a> Lamp<'a> {
    /// A light of a scene. What is taken off depths is the same for every kind of shadow: `bias`, in units of depth, or else [`BIAS`] footprints.
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

    /// The direction of its rays at a point, of length 1.
    pub fn way(&self, point: DVec3) -> DVec3 {
        self.views[0].eye.ray(point).normalize_or_zero()
    }

    /// What is averaged around a point that a ray of the camera meets, `width` wide there.
    pub fn footprint(&self, point: DVec3, width: f64) -> f64 {
        (width * self.blur).max(self.least_width(point))
    }

    /// What is taken off the depth of a surface where the footprint is `width` wide.
    pub fn bias(&self, width: f64) -> f64 {
        self.bias.unwrap_or(BIAS * width)
    }

    /// The width of `blur` pixels of its map at a point; 0 where the map has no pixels.
    fn least_width(&self, point: DVec3) -> f64 {
        let view = &self.views[face(self, point)];
        match view.space.footprint_of_width(point.to_array(), 1.0) {
            Some(Footprint::Width(pixels)) if pixels > 0.0 => self.blur / f64::from(pixels),
            _ => 0.0,
        }
    }

    /// Which of its views a point is in, and where; `None` where no view is, where no shadow falls.
    pub fn seen(&self, point: DVec3) -> Option<(usize, [f64; 3])> {
        let face = face(self, point);
        let view = &self.views[face];
        let at = view.space.light_from_world(point.to_array())?;
        // A point that rounding puts beside its face of a cube is at its border.
        let inside = self.views.len() > 1 || view.space.holds(point.to_array());
        inside.then_some((face, at))
    }
}

/// Which view looks towards a point.
fn face(lamp: &Lamp<'_>, point: DVec3) -> usize {
    let LightKind::Point { position } = lamp.light.kind else {
        return 0;
    };
    let way = point - position;
    let axis = (0..3).fold(0, |a, b| if way[b].abs() > way[a].abs() { b } else { a });
    2 * axis + usize::from(way[axis] < 0.0)
}

/// The ray of a view through a place in it, in pixels: a point, and the way that it goes for one of the view's depth.
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
            // The line through that place leads to the point.
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
