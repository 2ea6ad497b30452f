//! Pictures: independence of threads and crop, brightness, camera and choice of light.

use crate::support::*;
use deepshadow_render::image::Image;
use deepshadow_render::render::{Settings, Source, render};
use deepshadow_render::shade::AMBIENT;
use deepshadow_scene::demo::shapes::ball;
use deepshadow_scene::scene::{Object, Scene, Shape};
use glam::{DVec3, Vec3};

fn balls() -> Scene {
    let glass = Object {
        opacity: [0.6, 0.3, 0.1],
        ..Object::new("glass", Shape::Mesh(ball(Vec3::new(0.6, 1.5, 0.0), 0.6, 2)))
    };
    let solid = Object::new(
        "solid",
        Shape::Mesh(ball(Vec3::new(-0.6, 1.0, 0.2), 0.5, 2)),
    );
    let light = sun(DVec3::new(0.3, -1.0, 0.2));
    scene(vec![floor(), glass, solid], light, from_above(6.0))
}

fn picture(scene: &Scene, shadows: Source, crop: Option<[u32; 4]>) -> Image {
    let settings = Settings {
        shadows,
        crop,
        spp: 9,
        ..Settings::default()
    };
    render(scene, &settings, |_, _, _| {}).unwrap().0
}

fn with_threads(n: usize, work: impl FnOnce() -> Image + Send) -> Image {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n);
    pool.build().unwrap().install(work)
}

#[test]
fn a_picture_does_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.dsm");
    let settings = deepshadow_scene::build::Settings::default();
    deepshadow_scene::build::build(&balls(), &path, &settings, |_, _| {}).unwrap();
    for shadows in [
        Source::None,
        Source::Rays(1),
        Source::Rays(4),
        Source::Plain(256, 4),
        Source::Map(path, 1 << 20),
    ] {
        let scene = balls();
        let one = with_threads(1, || picture(&scene, shadows.clone(), None));
        let three = with_threads(3, || picture(&scene, shadows.clone(), None));
        assert!(one == three, "{shadows:?}");
    }
}

#[test]
fn a_crop_equals_the_same_part_of_the_whole_picture() {
    let whole = picture(&balls(), Source::Rays(1), None);
    let part = picture(&balls(), Source::Rays(1), Some([7, 12, 20, 9]));
    assert_eq!((part.width, part.height), (20, 9));
    for y in 0..9 {
        let row = &whole.pixels[(12 + y) * 40 + 7..][..20];
        assert_eq!(row, &part.pixels[y * 20..][..20]);
    }
}

#[test]
fn a_floor_that_faces_the_light_has_its_own_colour() {
    let mut floor = floor();
    floor.color = [0.8, 0.4, 0.1];
    let scene = scene(vec![floor], sun(-DVec3::Y), from_above(10.0));
    let image = picture(&scene, Source::Rays(1), None);
    let wanted = [0.8, 0.4, 0.1].map(|v| v * (1.0 + AMBIENT));
    assert_near(at(&image, 0.3, -0.7), wanted, 1e-5, "floor");
}

#[test]
fn without_a_camera_the_whole_scene_is_in_view() {
    let scene = Scene {
        camera: None,
        objects: vec![Object::new("ball", Shape::Mesh(ball(Vec3::ONE, 0.5, 3)))],
        ..balls()
    };
    let settings = Settings {
        resolution: Some([40, 30]),
        spp: 1,
        ..Settings::default()
    };
    let image = render(&scene, &settings, |_, _, _| {}).unwrap().0;
    let bright = |x: usize, y: usize| image.pixels[y * 40 + x][0] > 0.0;
    assert!(bright(20, 15));
    let border = (0..40).map(|x| (x, 0)).chain((0..30).map(|y| (0, y)));
    assert!(border.clone().all(|(x, y)| !bright(x, y)));
}

#[test]
fn only_light_selects_one_light() {
    let mut scene = balls();
    let mut second = sun(-DVec3::Y);
    second.name = "second".into();
    scene.lights.push(second);
    let of = |name: &str| {
        let settings = Settings {
            only_light: Some(name.into()),
            spp: 1,
            ..Settings::default()
        };
        render(&scene, &settings, |_, _, _| {})
    };
    assert_ne!(of("sun").unwrap().0, of("second").unwrap().0);
    assert!(of("third").unwrap_err().to_string().contains("\"second\""));
}
