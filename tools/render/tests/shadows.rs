//! Shadows known from geometry: by rays, from deep maps and from plain maps.

use crate::support::*;
use deepshadow::Filter;
use deepshadow_render::compare::Differences;
use deepshadow_render::render::{Settings, Source};
use deepshadow_scene::demo::hairball::Hairball;
use deepshadow_scene::demo::shapes::ball;
use deepshadow_scene::geometry::Grid;
use deepshadow_scene::load::Loaded;
use deepshadow_scene::scene::{Light, LightKind, Object, PictureCamera, Scene, Shape, Volume};
use deepshadow_scene::transfer::TransferFunction;
use glam::{DAffine3, DVec3, Vec3};

/// A wall from the floor to y = 1 along the z axis. Light falls to the right at 45 degrees.
fn wall() -> Scene {
    let mesh = rectangle(Vec3::Y * 0.5, Vec3::Y * 0.5, Vec3::Z * 3.0);
    let wall = Object::new("wall", Shape::Mesh(mesh));
    let light = sun(DVec3::new(1.0, -1.0, 0.0));
    scene(vec![floor(), wall], light, from_above(100.0))
}

fn assert_wall(image: &deepshadow_render::image::Image, within: f64, what: &str) {
    for z in [-1.5, 0.0, 1.0] {
        for x in [-1.8, -0.9, -0.3, 1.3, 1.8] {
            assert_near(at(image, x, z), [1.0; 3], within, &format!("{what} at {x}"));
        }
        for x in [0.3, 0.5, 0.75] {
            assert_near(at(image, x, z), [0.0; 3], within, &format!("{what} at {x}"));
        }
    }
}

#[test]
fn a_wall_shadows_the_floor_as_far_as_it_is_high() {
    let scene = wall();
    let rays = |n: u32| fraction(&scene, Source::Rays(n), Settings::default());
    assert_wall(&rays(1), 0.0, "rays");
    assert_wall(&rays(9), 0.0, "filtered rays");
    // Wider pixels of higher levels slightly exceed the bias.
    let (deep, max_error) = fraction_from_map(&scene, Settings::default());
    assert_wall(&deep, max_error, "deep map");
}

#[test]
fn percentage_closer_filtering_agrees_with_rays_away_from_edges() {
    let plain = fraction(&wall(), Source::Plain(1024, 16), Settings::default());
    assert_wall(&plain, 0.0, "plain map");
}

#[test]
fn without_shadows_everything_is_lit() {
    let image = fraction(&wall(), Source::None, Settings::default());
    assert!(image.pixels.iter().all(|p| *p == [1.0; 3]));
}

#[test]
fn coloured_glass_transmits_the_light_it_does_not_absorb() {
    let pane = rectangle(Vec3::Y * 2.0, Vec3::X * 3.0, Vec3::Z * 3.0);
    let glass = Object {
        opacity: [0.5, 0.25, 0.0],
        ..Object::new("glass", Shape::Mesh(pane))
    };
    // The camera is under the glass.
    let scene = scene(vec![floor(), glass], sun(-DVec3::Y), from_above(1.5));
    let settings = || Settings {
        spp: 64,
        ..Settings::default()
    };
    let wanted = [0.5, 0.75, 1.0];
    let rays = fraction(&scene, Source::Rays(1), settings());
    assert_near(at(&rays, 0.0, 0.0), wanted, 1e-6, "rays");
    let (deep, max_error) = fraction_from_map(&scene, settings());
    assert_near(at(&deep, 0.0, 0.0), wanted, max_error, "deep map");
    // A plain map has one channel with random depths: the mean over many is the mean opacity.
    let plain = fraction(&scene, Source::Plain(1024, 64), settings());
    assert_near(at(&plain, 0.0, 0.0), [0.75; 3], 0.05, "plain map");
}

#[test]
fn a_floor_is_visible_through_glass() {
    let pane = rectangle(Vec3::Y * 2.0, Vec3::X * 3.0, Vec3::Z * 3.0);
    let glass = Object {
        opacity: [0.5, 0.25, 0.0],
        ..Object::new("glass", Shape::Mesh(pane))
    };
    let scene = scene(vec![floor(), glass], sun(-DVec3::Y), from_above(100.0));
    let image = fraction(&scene, Source::Rays(1), Settings::default());
    // The glass is lit. The light of the floor passes the glass.
    let wanted = [0.5 + 0.5 * 0.5, 0.25 + 0.75 * 0.75, 1.0];
    assert_near(at(&image, 0.3, 0.3), wanted, 1e-6, "behind glass");
}

#[test]
fn transmittance_of_fog_follows_its_thickness() {
    const EXTINCTION: f64 = 0.7;
    let grid = Grid {
        size: [5; 3],
        origin: Vec3::new(-3.0, 2.0, -3.0),
        spacing: Vec3::new(1.5, 0.25, 1.5),
        values: vec![1.0; 125],
    };
    let fog = Object::new(
        "fog",
        Shape::Volume(Volume {
            grid,
            transfer: TransferFunction::linear(0.0, 1.0).scaled(EXTINCTION as f32),
            step: 1.0,
        }),
    );
    let scene = scene(vec![floor(), fog], sun(-DVec3::Y), from_above(1.5));
    let wanted = [(-EXTINCTION).exp(); 3]; // a thickness of 1
    let rays = fraction(&scene, Source::Rays(1), Settings::default());
    assert_near(at(&rays, 0.5, -0.5), wanted, 1e-5, "rays");
    let (deep, max_error) = fraction_from_map(&scene, Settings::default());
    assert_near(at(&deep, 0.5, -0.5), wanted, max_error + 1e-5, "deep map");
    let settings = Settings {
        spp: 64,
        ..Settings::default()
    };
    let plain = fraction(&scene, Source::Plain(512, 64), settings);
    assert_near(at(&plain, 0.5, -0.5), wanted, 0.05, "plain map");
}

#[test]
fn fog_is_as_bright_as_the_light_that_reaches_it() {
    let grid = Grid {
        size: [2; 3],
        origin: Vec3::splat(-1.0),
        spacing: Vec3::splat(2.0),
        values: vec![1.0; 8],
    };
    let fog = Object::new(
        "fog",
        Shape::Volume(Volume {
            grid,
            transfer: TransferFunction::linear(0.0, 1.0),
            step: 0.02,
        }),
    );
    let scene = scene(vec![fog], sun(-DVec3::Y), from_above(100.0));
    // Light and eye are on the same side: the integral of e^-2y over a thickness of 2, plus the
    // white floor attenuated by the fog.
    let wanted = [(1.0 - f64::exp(-4.0)) / 2.0 + f64::exp(-2.0); 3];
    let rays = fraction(&scene, Source::Rays(1), Settings::default());
    assert_near(at(&rays, 0.0, 0.0), wanted, 2e-3, "rays");
    let (deep, max_error) = fraction_from_map(&scene, Settings::default());
    assert_near(at(&deep, 0.0, 0.0), wanted, max_error + 2e-3, "deep map");
}

#[test]
fn the_shadow_of_a_moving_ball_is_soft_along_its_path() {
    let mut moving = Object::new("ball", Shape::Mesh(ball(Vec3::Y * 2.0, 0.4, 4)));
    // The ball moves right by one unit while the shutter is open.
    moving.motion = [-0.5, 0.5]
        .map(|x| DAffine3::from_translation(DVec3::X * x))
        .to_vec();
    let scene = scene(vec![floor(), moving], sun(-DVec3::Y), from_above(1.0));
    let settings = || Settings {
        spp: 256,
        ..Settings::default()
    };
    let rays = fraction(&scene, Source::Rays(1), settings());
    let (deep, _) = fraction_from_map(&scene, settings());
    let plain = fraction(&scene, Source::Plain(1024, 16), settings());
    // A plain map has a single time for each of its pixels, so noise remains.
    for (image, more, what) in [
        (rays, 0.0, "rays"),
        (deep, 0.0, "deep map"),
        (plain, 0.04, "plain map"),
    ] {
        // The middle is covered for 0.8 of the time, points near the ends of the path for 0.45.
        assert_near(at(&image, 0.02, 0.02), [0.2; 3], 0.03 + more, what);
        assert_near(at(&image, -0.45, 0.02), [0.55; 3], 0.03 + more, what);
        assert_near(at(&image, 0.45, 0.02), [0.55; 3], 0.03 + more, what);
        assert_near(at(&image, 1.2, 0.02), [1.0; 3], 0.01, what);
        assert_near(at(&image, 0.02, 0.6), [1.0; 3], 0.01, what);
    }
}

#[test]
fn a_point_light_casts_shadows_to_all_sides() {
    // A box of walls around a lamp, with a half-opaque pane on each side of the lamp.
    let (mut objects, sides) = (Vec::new(), [Vec3::X, Vec3::Y, Vec3::Z]);
    for (i, axis) in sides.iter().enumerate() {
        let (a, b) = (sides[(i + 1) % 3], sides[(i + 2) % 3]);
        for sign in [-1.0, 1.0] {
            let wall = rectangle(*axis * sign * 3.0, a * 3.0, b * 3.0);
            objects.push(Object::new("wall", Shape::Mesh(wall)));
            let pane = rectangle(*axis * sign, a, b);
            objects.push(Object {
                opacity: [0.5; 3],
                ..Object::new("pane", Shape::Mesh(pane))
            });
        }
    }
    let light = Light {
        resolution: [64; 2],
        samples: 16,
        ..Light::new(
            "lamp",
            LightKind::Point {
                position: DVec3::ZERO,
            },
        )
    };
    // The camera is in a corner between the panes and the walls. The panes are lit, the walls
    // shadowed.
    let camera = PictureCamera {
        position: DVec3::new(2.0, 2.5, 2.2),
        target: DVec3::new(2.0, -2.5, -2.0),
        up: DVec3::Y,
        angle: 80.0,
        resolution: [40; 2],
    };
    let scene = scene(objects, light, camera);
    let settings = || Settings {
        spp: 16,
        ..Settings::default()
    };
    let rays = fraction(&scene, Source::Rays(16), settings());
    let (deep, _) = fraction_from_map(&scene, settings());
    let found = Differences::between(&rays, &deep).unwrap();
    assert!(found.rmse < 0.02, "{found}");
    assert!(rays.pixels.iter().any(|p| p[0] < 0.55));
}

#[test]
fn hair_in_a_deep_map_is_as_dark_as_with_rays_over_the_same_footprint() {
    let ball = Hairball {
        hairs: 3000,
        segments: 6,
        width: 0.004,
        ..Hairball::default()
    };
    let objects = ball.make().parts.into_iter().map(|part| {
        let shape = match part.geometry {
            Loaded::Mesh(mesh) => Shape::Mesh(mesh),
            Loaded::Curves(curves) => Shape::Curves { curves, width: 0.0 },
            _ => unreachable!("a hairball has no volume"),
        };
        Object::new(part.name, shape)
    });
    let light = Light {
        resolution: [128; 2],
        samples: 256,
        ..Light::new(
            "key",
            LightKind::Spot {
                position: DVec3::new(3.0, 4.0, 5.0),
                target: None,
                up: DVec3::Y,
                angle: None,
            },
        )
    };
    let camera = PictureCamera {
        position: DVec3::new(0.0, 0.6, 4.2),
        target: DVec3::ZERO,
        up: DVec3::Y,
        angle: 30.0,
        resolution: [64; 2],
    };
    let scene = scene(objects.collect(), light, camera);
    let settings = || Settings {
        filter: Filter::Box,
        ..Settings::default()
    };
    let rays = fraction(&scene, Source::Rays(64), settings());
    let (deep, max_error) = fraction_from_map(&scene, settings());
    let found = Differences::between(&rays, &deep).unwrap();
    assert!(found.rmse < 2.0 * max_error, "{found}");
    let unshadowed = fraction(&scene, Source::None, settings());
    assert!(Differences::between(&rays, &unshadowed).unwrap().rmse > 0.2);
}
