//! Small scenes with known shadows, and functions that render them.

use deepshadow_render::image::Image;
use deepshadow_render::render::{Settings, Source, render};
use deepshadow_scene::build::{Settings as MapSettings, build};
use deepshadow_scene::geometry::Mesh;
use deepshadow_scene::scene::{Light, LightKind, Object, PictureCamera, Scene, Shape};
use glam::{DVec3, Vec3};

/// A rectangle with the given middle and half sides.
pub fn rectangle(middle: Vec3, a: Vec3, b: Vec3) -> Mesh {
    let corners = vec![
        middle - a - b,
        middle + a - b,
        middle + a + b,
        middle - a + b,
    ];
    Mesh::still(corners, vec![[0, 1, 2], [0, 2, 3]])
}

/// A floor at y = 0, from -4 to 4.
pub fn floor() -> Object {
    Object::new(
        "floor",
        Shape::Mesh(rectangle(Vec3::ZERO, Vec3::X * 4.0, Vec3::Z * 4.0)),
    )
}

/// A directional light. Its map covers 8 x 8 units of the world with 256 x 256 pixels.
pub fn sun(direction: DVec3) -> Light {
    Light {
        resolution: [256; 2],
        samples: 64,
        ..Light::new(
            "sun",
            LightKind::Directional {
                direction,
                up: DVec3::Z,
                target: Some(DVec3::ZERO),
                size: Some(8.0),
            },
        )
    }
}

/// A camera that looks straight down from `height`, with x to the right and z down.
///
/// Its 40 x 40 pixels cover 4 x 4 units of the floor.
pub fn from_above(height: f64) -> PictureCamera {
    PictureCamera {
        position: DVec3::Y * height,
        target: DVec3::ZERO,
        up: -DVec3::Z,
        angle: 2.0 * (2.0 / height).atan().to_degrees(),
        resolution: [40; 2],
    }
}

pub fn scene(objects: Vec<Object>, light: Light, camera: PictureCamera) -> Scene {
    Scene {
        objects,
        lights: vec![light],
        camera: Some(camera),
        seed: 5,
    }
}

/// Renders the fraction of light with these shadows.
pub fn fraction(scene: &Scene, shadows: Source, settings: Settings) -> Image {
    let settings = Settings {
        shadows,
        shadow_only: true,
        ..settings
    };
    render(scene, &settings, |_, _, _| {}).unwrap().0
}

/// Builds a deep shadow map and renders with it. Also returns the error bound of its base level.
pub fn fraction_from_map(scene: &Scene, settings: Settings) -> (Image, f64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.dsm");
    build(scene, &path, &MapSettings::default(), |_, _| {}).unwrap();
    let promise = scene.lights[0].tolerance();
    (
        fraction(scene, Source::Map(path, 64 << 20), settings),
        promise,
    )
}

/// The pixel of the floor at (x, z) in a picture by [`from_above`].
pub fn at(image: &Image, x: f64, z: f64) -> [f32; 3] {
    let pixel = |v: f64| ((v + 2.0) * 10.0) as usize;
    image.pixels[pixel(z) * 40 + pixel(x)]
}

pub fn assert_near(found: [f32; 3], wanted: [f64; 3], within: f64, what: &str) {
    for c in 0..3 {
        assert!(
            (f64::from(found[c]) - wanted[c]).abs() <= within,
            "{what}: {found:?}, not {wanted:?}"
        );
    }
}
