//! Map headers, shapes of levels, and cameras.

use crate::random::Random;
use deepshadow::raw::LevelShape;
use deepshadow::{Camera, DepthKind, Encoding, LightSpace, MapHeader, TileId, Writer};

#[test]
fn each_level_halves_the_size_and_rounds_up() {
    let map = MapHeader::new("m", 5, 7);
    let sizes: Vec<_> = (0..4)
        .map(|l| LevelShape::of(&map, l))
        .map(|s| (s.width, s.height))
        .collect();
    assert_eq!(sizes, [(5, 7), (3, 4), (2, 2), (1, 1)]);
    assert_eq!(map.full_level_count(), 4);
    for (w, h, n) in [(1, 1, 1), (2, 1, 2), (3, 3, 3), (4, 4, 3), (1 << 20, 1, 21)] {
        assert_eq!(MapHeader::new("m", w, h).full_level_count(), n);
    }
}

#[test]
fn the_writer_refuses_a_header_of_impossible_size() {
    for side in [0, 1 << 31, u32::MAX] {
        let header = MapHeader::new("m", side, 1);
        let error = Writer::in_memory().add_map(header, Encoding::default());
        let text = error.unwrap_err().to_string();
        assert!(text.ends_with("(MAP-SIZE)"), "{text}");
    }
}

#[test]
fn tiles_at_the_border_are_cut_to_the_level() {
    let shape = LevelShape {
        width: 40,
        height: 33,
        tile_size: 32,
    };
    assert_eq!(
        (shape.tiles(), shape.tile_extent(TileId::new(1, 1))),
        (4, (8, 1))
    );
}

fn space(camera: Camera) -> LightSpace {
    let map = MapHeader::new("m", 8, 4);
    LightSpace::of(&map.depth_kind(DepthKind::Planar).camera(camera)).unwrap()
}

fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
}

#[test]
fn a_camera_looks_along_its_direction_with_right_and_up_not_mirrored() {
    let camera =
        Camera::orthographic([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [8.0, 4.0]).unwrap();
    let at = space(camera).light_from_world([1.0, 0.5, -3.0]).unwrap();
    assert!(near(at, [5.0, 1.5, 3.0]), "{at:?}");
}

#[test]
fn a_camera_sees_its_target_in_the_middle() {
    let (position, target) = ([3.0, -2.0, 7.0], [-1.0, 4.0, 2.5]);
    let camera = Camera::perspective(position, target, [0.0, 1.0, 0.0], [60.0, 30.0]).unwrap();
    let light = space(camera);
    let at = light.light_from_world(target).unwrap();
    let distance = (16.0f64 + 36.0 + 20.25).sqrt();
    assert!(near(at, [4.0, 2.0, distance]), "{at:?}");
}

#[test]
fn a_camera_that_looks_along_its_up_vector_ignores_it() {
    for up in [[0.0, 1.0, 0.0], [0.0, -2.0, 0.0], [0.0; 3], [f64::NAN; 3]] {
        let camera = Camera::orthographic([0.0; 3], [0.0, 5.0, 0.0], up, [8.0, 4.0]).unwrap();
        let at = space(camera).light_from_world([0.0, 2.0, 0.0]).unwrap();
        assert!(near(at, [4.0, 2.0, 2.0]));
    }
}

#[test]
fn every_point_is_inside_exactly_one_face_of_a_cube() {
    let faces = Camera::faces([1.0, 2.0, 3.0]).unwrap().map(space);
    let mut random = Random(7);
    for _ in 0..1000 {
        let p = [1.0, 2.0, 3.0].map(|centre| centre + random.range(-1.0, 1.0));
        let inside = |l: &LightSpace| {
            l.light_from_world(p)
                .is_some_and(|[x, y, _]| (0.0..8.0).contains(&x) && (0.0..4.0).contains(&y))
        };
        assert_eq!(faces.iter().filter(|l| inside(l)).count(), 1, "{p:?}");
    }
    // An axis meets its face in the centre.
    let at = faces[3].light_from_world([1.0, -5.0, 3.0]).unwrap();
    assert!(near(at, [4.0, 2.0, 7.0]));
}

#[test]
fn impossible_cameras_are_refused() {
    let up = [0.0, 1.0, 0.0];
    assert!(Camera::perspective([1.0; 3], [1.0; 3], up, [90.0; 2]).is_err());
    assert!(Camera::perspective([f64::NAN; 3], [1.0; 3], up, [90.0; 2]).is_err());
    assert!(Camera::perspective([0.0; 3], [1.0; 3], up, [180.0, 90.0]).is_err());
    assert!(Camera::orthographic([0.0; 3], [1.0; 3], up, [0.0, 1.0]).is_err());
    assert!(Camera::faces([f64::INFINITY, 0.0, 0.0]).is_err());
}
