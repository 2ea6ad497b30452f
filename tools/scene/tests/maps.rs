//! Tests maps of scenes with known shadows, and that they do not depend on how they are built.

use std::path::Path;

use crate::support::*;
use deepshadow::{DepthKind, DsmFile, Filter, GroupRole, MapId, Pixel, TileId};
use deepshadow_scene::build::{Report, Settings, build};
use deepshadow_scene::geometry::{Curves, Grid};
use deepshadow_scene::scene::{Light, LightKind, Object, Scene, Shape, Texture};
use glam::{DAffine3, DVec3, Vec3};

/// Builds a scene and opens the file.
fn made(scene: &Scene, settings: &Settings) -> (DsmFile, Report) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.dsm");
    let report = build(scene, &path, settings, |_, _| {}).unwrap();
    (
        DsmFile::from_bytes(std::fs::read(&path).unwrap()).unwrap(),
        report,
    )
}

fn small() -> Settings {
    Settings {
        tile: 16,
        ..Settings::default()
    }
}

/// A light that looks down from 10 above the origin, and sees 5 to each side.
fn down(samples: u32, side: u32) -> Light {
    let kind = LightKind::Directional {
        direction: -DVec3::Y,
        up: -DVec3::Z,
        target: Some(DVec3::ZERO),
        size: Some(10.0),
    };
    fine(light(kind, samples, side))
}

/// The light with a tolerance that keeps five digits.
fn fine(light: Light) -> Light {
    Light {
        tolerance: Some(1e-5),
        ..light
    }
}

/// Whether two numbers are equal up to the rounding of such a map.
fn same(a: f32, b: f32) -> bool {
    (a - b).abs() <= 1e-5
}

/// Whether a pixel is empty.
fn lit(file: &DsmFile, x: u32, y: u32) -> bool {
    file.function(MapId(0).level(0), Pixel::new(x, y))
        .unwrap()
        .is_empty()
}

/// The depth of a point of the world in a directional map.
fn depth(file: &DsmFile, p: [f64; 3]) -> f32 {
    let space = deepshadow::LightSpace::of(&file.maps()[0].header).unwrap();
    space.light_from_world(p).unwrap()[2] as f32
}

fn mixed(filter: Filter) -> Scene {
    let mut objects = hair(800, [0.4, 0.6, 0.8]);
    objects.push(cloud([2.0, 2.0, 4.0], 20));
    objects[1] = moving(objects[1].clone(), DVec3::new(0.2, 0.1, 0.0));
    let mut light = spot(5, 1);
    light.resolution = [75, 52];
    light.filter = filter;
    scene(objects, light)
}

#[test]
fn a_map_built_in_parts_equals_the_map_built_at_once() {
    for filter in [Filter::Box, Filter::Gaussian] {
        let scene = mixed(filter);
        let (whole, _) = made(&scene, &small());
        let shape = whole.maps()[0].levels[0].shape;
        for region in [
            [0, 0, 48, 32],
            [48, 0, 27, 32],
            [0, 32, 75, 20],
            [32, 16, 16, 16],
        ] {
            let [x, y, w, h] = region;
            let settings = Settings {
                region: Some(region),
                ..small()
            };
            let (part, _) = made(&scene, &settings);
            let header = &part.maps()[0].header;
            assert_eq!((header.width, header.height), (w, h));
            assert_eq!(header.data_origin, [x as i32, y as i32]);
            assert_eq!(header.display_window, whole.maps()[0].header.display_window);
            let own = part.maps()[0].levels[0].shape;
            let mut data = 0;
            for ty in 0..own.tiles_y() {
                for tx in 0..own.tiles_x() {
                    let (wx, wy) = (tx + x / 16, ty + y / 16);
                    assert_eq!(
                        own.tile_extent(TileId::new(tx, ty)),
                        shape.tile_extent(TileId::new(wx, wy))
                    );
                    let a = part.tile_bytes(tx, ty);
                    assert_eq!(a, whole.tile_bytes(wx, wy), "tile {wx},{wy}");
                    data += usize::from(!a.is_empty());
                }
            }
            assert!(data > 0, "{region:?} sees nothing");
        }
    }
}

trait Bytes {
    fn tile_bytes(&self, tx: u32, ty: u32) -> Vec<u8>;
}

impl Bytes for DsmFile {
    /// The payload of a tile of the base level; empty if the tile is.
    fn tile_bytes(&self, tx: u32, ty: u32) -> Vec<u8> {
        self.payload(MapId(0).level(0), TileId::new(tx, ty))
            .unwrap()
            .1
            .to_vec()
    }
}

#[test]
fn a_file_depends_on_the_seed_but_not_on_threads() {
    let mut scene = mixed(Filter::Triangle);
    let bytes = |scene: &Scene, threads| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.dsm");
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| build(scene, &path, &small(), |_, _| {}))
            .unwrap();
        std::fs::read(Path::new(&path)).unwrap()
    };
    let one = bytes(&scene, 1);
    assert!(one == bytes(&scene, 3) && one == bytes(&scene, 1));
    scene.seed = 2;
    assert!(one != bytes(&scene, 1));
}

#[test]
fn a_pane_of_glass_tints_the_light_behind_it_and_no_other() {
    let pane = square(1, 0.0, 5.0, [0.25, 0.5, 1.0]);
    let (file, _) = made(&scene(vec![pane], down(16, 20)), &small());
    let z = depth(&file, [0.0, 0.0, 0.0]);
    let inside = file
        .function(MapId(0).level(0), Pixel::new(10, 10))
        .unwrap();
    assert_eq!(
        (inside.visibility_rgb(z), inside.visibility_behind_rgb(z)),
        ([1.0; 3], [0.75, 0.5, 0.0])
    );
    // From 5 to 15 of 20 pixels.
    assert!(
        file.function(MapId(0).level(0), Pixel::new(4, 10))
            .unwrap()
            .is_empty()
    );
    assert!(
        !file
            .function(MapId(0).level(0), Pixel::new(5, 14))
            .unwrap()
            .is_empty()
    );
    assert!(
        file.function(MapId(0).level(0), Pixel::new(10, 15))
            .unwrap()
            .is_empty()
    );
}

#[test]
fn every_ray_through_a_closed_surface_hits_it_twice() {
    // Half opaque on the way in and out, so 1/4 is left on every ray, however small the triangles.
    // A ray that slips between two triangles would leave more, one that hits both less.
    for (times, size) in [(1, 0.9), (4, 1.0), (6, 1.0)] {
        let ball = deepshadow_scene::demo::shapes::ball(Vec3::ZERO, 4.0, times);
        let object = Object {
            opacity: [0.5; 3],
            ..Object::new("ball", Shape::Mesh(ball))
        };
        let mut turned = object;
        turned.motion = vec![DAffine3::from_axis_angle(
            DVec3::new(1.0, 2.0, 3.0).normalize(),
            1.0,
        )];
        for light in [down(64, 64), spot_above(64, 64)] {
            let (file, _) = made(&scene(vec![turned.clone()], light), &small());
            let mut seen = 0;
            for y in 0..64 {
                for x in 0..64 {
                    let (dx, dy) = (x as f64 - 31.5, y as f64 - 31.5);
                    // Well inside: the border is at 4/5.
                    if dx.hypot(dy) < 0.6 * 32.0 * size {
                        let left = file
                            .function(MapId(0).level(0), Pixel::new(x, y))
                            .unwrap()
                            .end();
                        assert!(same(left, 0.25), "{left} at {x},{y}");
                        seen += 1;
                    }
                }
            }
            assert!(seen > 500);
        }
    }
}

fn spot_above(samples: u32, side: u32) -> Light {
    let kind = LightKind::Spot {
        position: DVec3::new(0.0, 20.0, 0.0),
        target: Some(DVec3::ZERO),
        up: DVec3::X,
        angle: Some(28.0),
    };
    fine(light(kind, samples, side))
}

#[test]
fn a_strand_blocks_the_fraction_of_a_pixel_that_it_covers() {
    // Straight along x, a quarter of a pixel wide, through the middle of a row of pixels.
    let strand = Curves {
        points: vec![
            (0..=20)
                .map(|i| Vec3::new(i as f32 * 0.4 - 4.0, 0.0, 0.25))
                .collect(),
        ],
        strands: vec![0, 21],
        widths: Vec::new(),
    };
    let object = Object::new(
        "strand",
        Shape::Curves {
            curves: strand,
            width: 0.125,
        },
    );
    let (file, _) = made(&scene(vec![object], down(1024, 20)), &small());
    for x in 3..17 {
        // z = 0.25 is the middle of row 10.
        let left = file
            .function(MapId(0).level(0), Pixel::new(x, 10))
            .unwrap()
            .end();
        assert!((left - 0.75).abs() < 0.012, "{left} is left at {x}");
        assert!(
            file.function(MapId(0).level(0), Pixel::new(x, 9))
                .unwrap()
                .is_empty()
        );
    }
}

#[test]
fn fog_attenuates_by_its_thickness_along_oblique_rays_too() {
    let grid = Grid {
        size: [5; 3],
        origin: Vec3::splat(-2.0),
        spacing: Vec3::ONE,
        values: vec![1.0; 125],
    };
    for depth_kind in [DepthKind::Planar, DepthKind::RayDistance] {
        let fog = medium(grid.clone(), [0.5; 3]);
        let mut light = spot_above(4, 32);
        light.depth = depth_kind;
        light.tolerance = Some(1e-4);
        let (file, _) = made(&scene(vec![fog], light), &small());
        let space = deepshadow::LightSpace::of(&file.maps()[0].header).unwrap();
        for (x, y) in [(16, 16), (13, 20), (20, 12)] {
            let f = file.function(MapId(0).level(0), Pixel::new(x, y)).unwrap();
            // Length of the ray through the middle of the pixel, per unit of distance downwards.
            let tan = 14.0f64.to_radians().tan() / 16.0;
            let (a, b) = ((f64::from(x) - 15.5) * tan, (f64::from(y) - 15.5) * tan);
            let longer = (1.0 + a * a + b * b).sqrt();
            for below in [18.0, 19.0, 20.5, 22.0, 30.0] {
                let z = if depth_kind == DepthKind::Planar {
                    below
                } else {
                    below * longer
                };
                let inside = (f64::min(below, 22.0) - 18.0) * longer;
                let (is, should) = (f64::from(f.visibility(z as f32)), (-0.5 * inside).exp());
                assert!(
                    (is - should).abs() < 2e-3,
                    "{is} at {below}, should be {should} ({depth_kind:?})"
                );
            }
        }
        assert!(space.is_perspective());
    }
}

#[test]
fn a_volume_scaled_along_one_axis_needs_no_more_rays_or_samples() {
    let grid = Grid {
        size: [2; 3],
        origin: Vec3::ZERO,
        spacing: Vec3::ONE,
        values: vec![1.0; 8],
    };
    let mut fog = medium(grid, [1e-5; 3]);
    fog.motion = vec![DAffine3::from_scale(DVec3::new(1e5, 1e-3, 1e-3))];
    let kind = LightKind::Directional {
        direction: DVec3::X,
        up: DVec3::Y,
        target: None,
        size: None,
    };
    let (file, _) = made(&scene(vec![fog], fine(light(kind, 4, 8))), &small());
    let left = file
        .function(MapId(0).level(0), Pixel::new(4, 4))
        .unwrap()
        .end();
    assert!((left - (-1f32).exp()).abs() < 1e-3, "{left}");
}

#[test]
fn a_moving_object_blocks_light_while_it_covers_a_point() {
    // A square of 4 by 4 moves by 4 to the right. A point is dark for the fraction of time that the
    // square covers it.
    let pane = moving(square(1, 0.0, 4.0, [1.0; 3]), DVec3::new(4.0, 0.0, 0.0));
    let (file, _) = made(&scene(vec![pane], down(256, 20)), &small());
    for x in 0..20u32 {
        let place = f64::from(x) * 0.5 - 5.0 + 0.25;
        // Covered from the arrival of the right side until the left side leaves.
        let (comes, goes) = ((place - 2.0) / 4.0, (place + 2.0) / 4.0);
        let dark = goes.clamp(0.0, 1.0) - comes.clamp(0.0, 1.0);
        let left = f64::from(
            file.function(MapId(0).level(0), Pixel::new(x, 10))
                .unwrap()
                .end(),
        );
        assert!(
            (left - (1.0 - dark)).abs() < 0.02,
            "{left} is left at {x}, should be {}",
            1.0 - dark
        );
    }
}

#[test]
fn keys_divide_the_shutter_evenly_for_each_object() {
    // One square moves there and back over three keys, another is static: the first is 4 to the
    // right at half the time.
    let mut pane = square(1, 0.0, 4.0, [1.0; 3]);
    let there = DAffine3::from_translation(DVec3::new(4.0, 0.0, 0.0));
    pane.motion = vec![DAffine3::IDENTITY, there, DAffine3::IDENTITY];
    let other = moving(square(1, -1.0, 1.0, [0.5; 3]), DVec3::ZERO);
    let (file, _) = made(&scene(vec![pane, other], down(256, 20)), &small());
    for x in [2u32, 8, 10, 12, 15, 18] {
        let place = f64::from(x) * 0.5 - 5.0 + 0.25;
        let (comes, goes) = ((place - 2.0) / 4.0, (place + 2.0) / 4.0);
        let dark = goes.clamp(0.0, 1.0) - comes.clamp(0.0, 1.0);
        let left = f64::from(
            file.function(MapId(0).level(0), Pixel::new(x, 3))
                .unwrap()
                .end(),
        );
        assert_eq!(left, 1.0, "nothing is there");
        let z = depth(&file, [0.0, -0.5, 0.0]);
        let left = f64::from(
            file.function(MapId(0).level(0), Pixel::new(x, 10))
                .unwrap()
                .visibility(z),
        );
        assert!(
            (left - (1.0 - dark)).abs() < 0.02,
            "{left} at {x}, should be {}",
            1.0 - dark
        );
    }
}

#[test]
fn an_object_moves_independently_of_the_keys_of_others() {
    // Far to the right at half the time, together with an object of four keys, which has no key at
    // that time.
    let mut pane = square(1, 0.0, 4.0, [1.0; 3]);
    let there = DAffine3::from_translation(DVec3::new(4.0, 0.0, 0.0));
    pane.motion = vec![DAffine3::IDENTITY, there, DAffine3::IDENTITY];
    let end = |others: Vec<Object>| {
        let mut objects = vec![pane.clone()];
        objects.extend(others);
        let (file, _) = made(&scene(objects, down(256, 20)), &small());
        (0..20)
            .map(|x| {
                file.function(MapId(0).level(0), Pixel::new(x, 10))
                    .unwrap()
                    .end()
            })
            .collect::<Vec<_>>()
    };
    let mut other = square(1, -1.0, 0.5, [1.0; 3]);
    other.motion = vec![DAffine3::from_translation(DVec3::new(0.0, 0.0, 4.0)); 4];
    let (alone, beside) = (end(Vec::new()), end(vec![other]));
    assert_eq!(alone, beside);
    assert!(alone.iter().any(|v| *v > 0.0 && *v < 1.0));
}

#[test]
fn every_ray_through_a_moving_closed_surface_hits_it_twice() {
    let ball = deepshadow_scene::demo::shapes::ball(Vec3::ZERO, 3.0, 4);
    let object = Object {
        opacity: [0.5; 3],
        ..Object::new("ball", Shape::Mesh(ball))
    };
    let mut object = moving(object, DVec3::new(0.5, 0.3, 0.2));
    object.motion[1] *= DAffine3::from_rotation_y(0.8);
    for light in [down(64, 64), spot_above(64, 64)] {
        let (file, _) = made(&scene(vec![object.clone()], light), &small());
        for y in 26..38 {
            for x in 26..38 {
                let left = file
                    .function(MapId(0).level(0), Pixel::new(x, y))
                    .unwrap()
                    .end();
                assert!(same(left, 0.25), "{left} at {x},{y}");
            }
        }
    }
}

#[test]
fn a_texture_multiplies_the_opacity_of_a_mesh() {
    let mut leaf = square(1, 0.0, 10.0, [1.0; 3]);
    let Shape::Mesh(mesh) = &mut leaf.shape else {
        unreachable!("it is a mesh")
    };
    // Corners in the order of `square`: axis 1 is flat, so its sides are z and x.
    mesh.uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    leaf.texture = Some(Texture {
        width: 2,
        height: 1,
        values: vec![[1.0; 3], [0.0, 0.5, 0.0]],
    });
    let (file, _) = made(&scene(vec![leaf], down(4, 16)), &small());
    // u runs along z, downwards in the map. The centres of the two pixels are at 1/4 and 3/4.
    let near = |y: u32| {
        file.function(MapId(0).level(0), Pixel::new(8, y))
            .unwrap()
            .end_rgb()
    };
    assert!(
        near(3)[0] < 0.1 && near(12)[0] > 0.9 && near(12)[1] < 0.6,
        "{:?} {:?}",
        near(3),
        near(12)
    );
}

#[test]
fn a_point_light_has_six_faces_and_each_sees_its_side() {
    let point = Light {
        name: "lamp".into(),
        ..fine(light(
            LightKind::Point {
                position: DVec3::ZERO,
            },
            4,
            32,
        ))
    };
    let objects = vec![
        square(0, 2.0, 2.0, [1.0; 3]),
        square(1, -2.0, 2.0, [0.5; 3]),
    ];
    let (file, _) = made(&scene(objects, point), &small());
    let names: Vec<_> = file.maps().iter().map(|m| m.header.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "lamp.+x", "lamp.-x", "lamp.+y", "lamp.-y", "lamp.+z", "lamp.-z"
        ]
    );
    let group = &file.groups()[0];
    assert_eq!(
        (group.name.as_str(), group.role, group.maps.as_slice()),
        ("lamp", GroupRole::Faces, &[0, 1, 2, 3, 4, 5].map(MapId)[..])
    );
    let left = [0, 1, 2, 3, 4, 5].map(|m| {
        file.function(MapId(m as u32).level(0), Pixel::new(16, 16))
            .unwrap()
            .end()
    });
    assert!(
        left.iter()
            .zip([0.0, 1.0, 1.0, 0.5, 1.0, 1.0])
            .all(|(a, b)| same(*a, b)),
        "{left:?}"
    );
}

#[test]
fn a_triangle_that_crosses_the_plane_of_the_light_is_seen_in_front_of_it() {
    // A long floor that begins behind the light: its triangles cross the plane of the light.
    let mut floor = square(1, 0.0, 100.0, [1.0; 3]);
    floor.motion = vec![DAffine3::from_translation(DVec3::new(0.0, -1.0, 0.0))];
    let kind = LightKind::Spot {
        position: DVec3::ZERO,
        target: Some(DVec3::new(1.0, 0.0, 0.0)),
        up: DVec3::Y,
        angle: Some(90.0),
    };
    let (file, _) = made(&scene(vec![floor], light(kind, 16, 32)), &small());
    // 45 degrees down is the lower border; the floor is at a depth of 1 / tan there.
    for y in [17u32, 24, 31] {
        let f = file.function(MapId(0).level(0), Pixel::new(16, y)).unwrap();
        assert_eq!(f.end(), 0.0);
        let (near, far) = [0.0, 1.0]
            .map(|d| 16.0 / (f64::from(y) - 16.0 + 1.0 - d))
            .into();
        assert!(
            f64::from(f.depths()[0]) >= near - 1e-3,
            "{} at {y}",
            f.depths()[0]
        );
        assert!(f64::from(*f.depths().last().unwrap()) <= far + 1e-3);
    }
    assert!(
        file.function(MapId(0).level(0), Pixel::new(16, 14))
            .unwrap()
            .is_empty()
    );
}

#[test]
fn a_light_frames_a_scene_of_any_size() {
    let shape = |size: f64, key: f64| {
        let mut square = square(1, 0.0, 2.0, [1.0; 3]);
        let at = |x: f64| DAffine3::from_translation(DVec3::X * x * size);
        square.motion = vec![at(-key), at(key)];
        let grow = |m: &mut DAffine3| *m *= DAffine3::from_scale(DVec3::splat(size));
        square.motion.iter_mut().for_each(grow);
        if key == 0.0 {
            square.motion.truncate(1);
        }
        square
    };
    for key in [0.0, 0.01] {
        for size in [1e-25, 1e-9, 1.0, 1e12, 1e25] {
            let spot = LightKind::Spot {
                position: DVec3::new(0.5, 3.0, 0.25) * size,
                target: None,
                up: DVec3::Z,
                angle: None,
            };
            let kinds = [
                (spot, shape(size, key)),
                (distant(4, 16).kind, shape(size, key)),
            ];
            for (kind, object) in kinds {
                let name = format!("{kind:?}, moving by {key}");
                let (file, _) = made(&scene(vec![object], light(kind, 4, 16)), &small());
                let left = file
                    .function(MapId(0).level(0), Pixel::new(8, 8))
                    .unwrap()
                    .end();
                assert_eq!(left, 0.0, "{name}");
                let covered = (0..256).filter(|i| !lit(&file, i % 16, i / 16)).count();
                assert!(covered > 90, "{covered} pixels: {name}");
            }
        }
    }
}

#[test]
fn a_distant_spot_frames_only_the_scene() {
    for distance in [1e3, 1e6, 1e9] {
        let kind = LightKind::Spot {
            position: DVec3::Y * distance,
            target: None,
            up: DVec3::Z,
            angle: None,
        };
        let square = square(1, 0.0, 2.0, [1.0; 3]);
        let (file, _) = made(&scene(vec![square], light(kind, 4, 16)), &small());
        for (x, y) in [(0, 0), (15, 0), (0, 15), (15, 15), (8, 8)] {
            assert!(!lit(&file, x, y), "{distance}: {x},{y}");
        }
    }
}

#[test]
fn tiles_that_see_nothing_cost_nothing() {
    let (file, report) = made(
        &scene(vec![square(1, 0.0, 0.2, [1.0; 3])], down(16, 4096)),
        &Settings::default(),
    );
    assert_eq!(report.tiles[0], 128 * 128);
    assert!(report.tiles[1] <= 16, "{:?}", report.tiles);
    assert!(file.length() < 100_000, "{}", file.length());
}

#[test]
fn a_scene_without_light_or_shadow_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.dsm");
    let mut dark = scene(vec![square(1, 0.0, 1.0, [1.0; 3])], down(4, 16));
    dark.objects[0].shadow = false;
    dark.lights[0] = distant(4, 16);
    for (scene, says) in [
        (dark, "nothing in the scene casts a shadow"),
        (Scene::default(), "no light"),
    ] {
        let failure = build(&scene, &path, &small(), |_, _| {})
            .unwrap_err()
            .to_string();
        assert!(failure.contains(says), "{failure}");
        assert!(!path.exists());
    }
}
