//! Lookups in world space: cameras and footprints.

use crate::random::Random;
use crate::world_support::*;
use deepshadow::*;

/// Cameras of both kinds in many places; each with a map that fills its display window and with one
/// that does not.
fn scenes() -> Vec<(Rig, MapHeader)> {
    let mut scenes = Vec::new();
    for kind in [DepthKind::Planar, DepthKind::RayDistance] {
        for rig in [
            Rig::perspective([1.0, 1.0]),
            Rig::perspective([0.2, 0.35])
                .moved([3.0, -4.0, 50.0])
                .turned([0.3, -2.0, 1.0]),
            Rig::orthographic([6.0, 2.5]),
            Rig::orthographic([0.5, 80.0])
                .turned([-1.0, 0.1, 3.0])
                .moved([-7.0, 2.0, 0.5]),
        ] {
            let plain = rig.header("plain", [40, 30], kind);
            let mut window = rig.header("window", [40, 30], kind);
            window.display_window = [-5, 12, 94, 61]; // 100 x 50
            window.data_origin = [-20, 31];
            scenes.extend([(rig, plain), (rig, window)]);
        }
    }
    scenes
}

#[test]
fn light_from_world_finds_the_pixel_and_depth_of_any_point() {
    let mut random = Random(1);
    for (rig, map) in scenes() {
        let light = LightSpace::of(&map).unwrap();
        assert_eq!(light.is_perspective(), rig.perspective);
        let [x0, y0, x1, y1] = map.display_window.map(f64::from);
        let size = [x1 - x0 + 1.0, y1 - y0 + 1.0];
        for _ in 0..200 {
            // A place inside or outside the map, in pixels of the map.
            let at = [random.range(-30.0, 70.0), random.range(-30.0, 60.0)];
            let z = random.range(0.01, 100.0);
            let seen = [
                at[0] + f64::from(map.data_origin[0]) - x0,
                at[1] + f64::from(map.data_origin[1]) - y0,
            ];
            let point = rig.seen_at(seen, size, z);
            let found = light.light_from_world(point).unwrap();
            let from_light = [0, 1, 2].map(|i| point[i] - rig.position[i]);
            let depth = if rig.perspective && map.depth_kind == DepthKind::RayDistance {
                dot(from_light, from_light).sqrt()
            } else {
                z
            };
            // Both lose digits if a point is near the light and far from the origin.
            let close = |a: f64, b: f64| (a - b).abs() < 1e-9 * (100.0 + b.abs()) / z.min(1.0);
            assert!(
                close(found[0], at[0]) && close(found[1], at[1]) && close(found[2], depth),
                "{found:?} is not {at:?} at {depth} of {rig:?}"
            );
            let [x, y] = at;
            let inside = (0.0..=40.0).contains(&x) && (0.0..=30.0).contains(&y);
            assert_eq!(light.holds(point), inside);
        }
    }
}

#[test]
fn the_corners_of_the_display_window_are_the_outer_corners_of_its_pixels() {
    let map = Rig::perspective([1.0, 1.0]).header("m", [8, 8], DepthKind::Planar);
    let light = LightSpace::of(&map).unwrap();
    let at = |point| light.light_from_world(point).unwrap();
    // Right is +x and up is +y: the upper left corner is at -x, +y.
    let upper_left = at([-2.0, 2.0, 2.0]);
    assert_eq!((upper_left[0], upper_left[1]), (0.0, 0.0));
    let lower_right = at([2.0, -2.0, 2.0]);
    assert_eq!((lower_right[0], lower_right[1]), (8.0, 8.0));
    let first_centre = at([-1.75, 1.75, 2.0]);
    assert_eq!((first_centre[0], first_centre[1]), (0.5, 0.5));
}

#[test]
fn planar_depth_and_ray_distance_differ_in_the_corner() {
    let corner = [5.0, -5.0, 5.0];
    let depth = |rig: Rig, kind| {
        let light = LightSpace::of(&rig.header("m", [8, 8], kind)).unwrap();
        light.light_from_world(corner).unwrap()[2]
    };
    let perspective = Rig::perspective([1.0, 1.0]);
    assert_eq!(depth(perspective, DepthKind::Planar), 5.0);
    assert_eq!(depth(perspective, DepthKind::RayDistance), 75.0f64.sqrt());
    // The rays of an orthographic light start on the plane of the camera.
    let orthographic = Rig::orthographic([8.0, 8.0]);
    assert_eq!(depth(orthographic, DepthKind::Planar), 5.0);
    assert_eq!(depth(orthographic, DepthKind::RayDistance), 5.0);
}

#[test]
fn points_behind_a_perspective_light_are_lit() {
    let dark = || Curve::mono(vec![-1000.0], vec![0.0]).unwrap();
    for kind in [DepthKind::Planar, DepthKind::RayDistance] {
        let map = Rig::perspective([1.0, 1.0]).header("m", [8, 8], kind);
        let light = file(&[map], GroupRole::Faces, |_, _, _| dark());
        for border in [Border::Lit, Border::Clamp] {
            let options = SamplerOptions::default().border(border);
            let mut sampler = WorldSampler::with_options(&light, MapId(0), options).unwrap();
            let mut at = |point| sampler.visibility(&WorldQuery::new(point)).unwrap();
            assert_eq!(at([0.1, 0.1, 1.0]), 0.0);
            assert_eq!(at([0.1, 0.1, -1.0]), 1.0);
            assert_eq!(at([0.1, 0.1, 0.0]), 1.0); // in the plane of the light
            assert_eq!(at([0.0; 3]), 1.0); // at the light
            assert_eq!(at([1e300, -1e300, -1e300]), 1.0);
            let mut rgb = |point| sampler.visibility_rgb(&WorldQuery::new(point)).unwrap();
            assert_eq!(rgb([0.1, 0.1, 1.0]), [0.0; 3]);
            assert_eq!(rgb([0.1, 0.1, -1.0]), [1.0; 3]);
        }
    }
}

#[test]
fn an_orthographic_light_has_negative_depths() {
    let map = Rig::orthographic([4.0, 4.0]).header("m", [8, 8], DepthKind::RayDistance);
    let light = file(&[map], GroupRole::Faces, |_, _, _| wall(-3.0));
    let mut sampler = WorldSampler::new(&light, MapId(0)).unwrap();
    let mut at = |z| sampler.visibility(&WorldQuery::new([0.5, 0.5, z])).unwrap();
    assert_eq!(
        (at(-4.0), at(-3.0), at(-2.0), at(2.0)),
        (1.0, 1.0, 0.0, 0.0)
    );
}

#[test]
fn a_matrix_and_its_multiples_give_the_same_projection() {
    let mut map =
        Rig::perspective([1.0, 0.5])
            .turned([0.4, 0.5, 0.6])
            .header("m", [8, 8], DepthKind::Planar);
    let light = LightSpace::of(&map).unwrap();
    map.camera.ndc_from_world = map.camera.ndc_from_world.map(|m| m.map(|v| -2.0 * v));
    map.camera.camera_from_world = map.camera.camera_from_world.map(|m| m.map(|v| -4.0 * v));
    let other = LightSpace::of(&map).unwrap();
    let mut random = Random(2);
    for _ in 0..100 {
        let point = random.point(10.0);
        assert_eq!(light.light_from_world(point), other.light_from_world(point));
        assert_eq!(
            light.footprint_of_width(point, 3.0),
            other.footprint_of_width(point, 3.0)
        );
    }
}

#[test]
fn world_lookups_need_matrices_and_a_depth_kind() {
    let good = Rig::perspective([1.0, 1.0]).header("sun", [8, 8], DepthKind::Planar);
    let refused = |change: fn(&mut MapHeader), word: &str| {
        let mut map = good.clone();
        change(&mut map);
        let e = LightSpace::of(&map).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
        assert!(e.to_string().contains(word), "{e}");
    };
    refused(|m| m.camera.camera_from_world = None, "worldToCamera");
    refused(|m| m.camera.ndc_from_world = None, "worldToNDC");
    refused(|m| m.depth_kind = DepthKind::Unspecified, "depth kind");
    refused(
        |m| m.camera.ndc_from_world = Some([0.0; 16]),
        "a worldToNDC whose fourth coordinate is not 0",
    );
    refused(
        |m| m.camera.camera_from_world = Some([f64::NAN; 16]),
        "MAP-CAMERA",
    );
    refused(|m| m.display_window = [5, 0, 3, 7], "MAP-WINDOW");

    // For a map of a file, the error names the map.
    let other = MapHeader::new("moon", 8, 8);
    let light = file(&[good, other], GroupRole::Clusters, |_, _, _| wall(1.0));
    assert!(WorldSampler::new(&light, MapId(0)).is_ok());
    let e = WorldSampler::new(&light, MapId(1)).unwrap_err();
    assert_eq!(
        e.to_string(),
        "world-space lookups need a depth kind, which map \"moon\" does not have (map 1)"
    );
    let group = &light.file().groups()[0];
    let e = WorldSampler::of_group(&light, group, SamplerOptions::default()).unwrap_err();
    assert_eq!(
        (e.kind(), e.place().map),
        (ErrorKind::Input, Some(MapId(1)))
    );
    assert!(WorldSampler::new(&light, MapId(2)).is_err());
}

#[test]
fn queries_that_are_not_finite_are_refused_wherever_the_point_is() {
    let rigs = [
        Rig::perspective([1.0, 1.0]),
        Rig::perspective([1.0, 1.0]).turned([0.0, 3.0, 0.0]),
    ];
    let maps = [
        rigs[0].header("a", [8, 8], DepthKind::Planar),
        rigs[1].header("b", [8, 8], DepthKind::Planar),
    ];
    let light = file(&maps, GroupRole::Faces, |_, _, _| wall(1.0));
    let mut one = WorldSampler::new(&light, MapId(0)).unwrap();
    let group = &light.file().groups()[0];
    let mut group = WorldSampler::of_group(&light, group, SamplerOptions::default()).unwrap();
    for z in [4.0, -4.0, 0.0] {
        let good = WorldQuery::new([30.0, 0.0, z]);
        assert!(one.visibility(&good).is_ok() && group.visibility(&good).is_ok());
        for bad in [
            WorldQuery::new([f64::NAN, 0.0, z]),
            WorldQuery::new([0.0, f64::INFINITY, z]),
            good.bias(f32::NAN),
            good.width(-1.0),
            good.width(f64::INFINITY),
            good.steps([0.0, f64::NAN, 0.0], [0.0; 3]),
        ] {
            for e in [
                one.visibility(&bad).unwrap_err(),
                one.visibility_rgb(&bad).unwrap_err(),
                group.visibility(&bad).unwrap_err(),
                group.visibility_rgb(&bad).unwrap_err(),
            ] {
                assert_eq!(e.kind(), ErrorKind::Input, "{bad:?}");
            }
        }
    }
}

#[test]
fn far_points_and_wide_footprints_have_answers() {
    let map = Rig::perspective([1.0, 1.0]).header("m", [8, 8], DepthKind::RayDistance);
    let light = file(&[map], GroupRole::Clusters, |_, _, _| wall(1.0));
    let mut sampler = WorldSampler::new(&light, MapId(0)).unwrap();
    let mut at = |query: WorldQuery| sampler.visibility(&query).unwrap();
    assert_eq!(at(WorldQuery::new([1e300, 0.0, 1e-300])), 1.0);
    assert_eq!(at(WorldQuery::new([1e30, 0.0, 1.0])), 1.0);
    // The depth exceeds the largest f32, so the point is behind everything.
    assert_eq!(at(WorldQuery::new([0.0, 0.0, 1e100])), 0.0);
    for query in [
        WorldQuery::new([0.0, 0.0, 2.0]).width(1e200),
        WorldQuery::new([0.0, 0.0, 2.0]).steps([1e200, 0.0, 0.0], [0.0, 1e200, 0.0]),
        WorldQuery::new([1e-9, 0.0, 1e-9]).width(1.0),
        WorldQuery::new([0.0, 0.0, 1e-320]).width(1.0),
        WorldQuery::new([0.0, 0.0, 1e-320]).steps([1.0, 0.0, 0.0], [0.0; 3]),
    ] {
        assert!((0.0..=1.0).contains(&at(query)), "{query:?}");
    }
}

#[test]
fn the_ellipse_of_a_footprint_is_the_derivative_of_the_projection() {
    let mut random = Random(3);
    for (rig, map) in scenes() {
        let light = LightSpace::of(&map).unwrap();
        for _ in 0..50 {
            let point = rig.seen_at(
                [random.range(0.0, 40.0), random.range(0.0, 30.0)],
                [40.0, 30.0],
                random.range(1.0, 50.0),
            );
            let (dx, dy) = (random.point(1.0), random.point(1.0));
            let Some(Footprint::Ellipse { dx: u, dy: v }) = light.footprint(point, dx, dy) else {
                panic!("{point:?}")
            };
            for (step, found) in [(dx, u), (dy, v)] {
                let h = 1e-4;
                let side = |h: f64| {
                    let moved = [0, 1, 2].map(|i| point[i] + h * step[i]);
                    light.light_from_world(moved).unwrap()
                };
                let (a, b) = (side(-h), side(h));
                let slope = [(b[0] - a[0]) / (2.0 * h), (b[1] - a[1]) / (2.0 * h)];
                for (slope, found) in slope.into_iter().zip(found) {
                    assert!(
                        (slope - f64::from(found)).abs() < 1e-3 + 1e-5 * slope.abs(),
                        "{found} is not {slope}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_width_of_a_ball_squared_is_the_area_of_the_ellipse_that_it_covers() {
    let mut random = Random(4);
    for (rig, map) in scenes() {
        let light = LightSpace::of(&map).unwrap();
        for _ in 0..50 {
            let z = random.range(1.0, 50.0);
            let seen = [random.range(0.0, 40.0), random.range(0.0, 30.0)];
            let point = rig.seen_at(seen, [40.0, 30.0], z);
            // A disc across the line of sight covers the same area as the ball. Its two radii are
            // the ellipse's vectors.
            let sight = if rig.perspective {
                [0, 1, 2].map(|i| point[i] - rig.position[i])
            } else {
                rig.forward
            };
            let cross = |a: [f64; 3], b: [f64; 3]| {
                [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i] * b[j] - a[j] * b[i])
            };
            let unit = |a: [f64; 3]| a.map(|v| v / dot(a, a).sqrt());
            let first = unit(cross(sight, rig.up));
            let second = unit(cross(sight, first));
            let width = 0.75;
            let [dx, dy] = [first, second].map(|v| v.map(|v| v * width));
            let Some(Footprint::Ellipse { dx, dy }) = light.footprint(point, dx, dy) else {
                panic!("{point:?}")
            };
            let Some(Footprint::Width(found)) = light.footprint_of_width(point, width) else {
                panic!("{point:?}")
            };
            let area = f64::from(dx[0] * dy[1] - dx[1] * dy[0]).abs();
            assert!(
                (f64::from(found).powi(2) - area).abs() < 1e-4 * area,
                "{found} of {area}"
            );
        }
    }
}

#[test]
fn a_world_lookup_is_the_lookup_of_the_projected_query() {
    let rig = Rig::perspective([0.7, 0.4])
        .moved([2.0, 3.0, -4.0])
        .turned([0.5, 0.2, -0.7]);
    let mut map = rig.header("m", [32, 32], DepthKind::RayDistance);
    map.display_window = [0, 0, 47, 39];
    map.data_origin = [7, 3];
    let mut random = Random(5);
    let light = file(&[map], GroupRole::Faces, |_, x, y| {
        let first = 5.0 + (x * 7 % 5) as f32;
        Curve::rgb(
            vec![first, first + (y % 4) as f32 + 1.0],
            vec![[0.75, 0.5, 1.0], [0.25, 0.0, 0.125 * f64::from(x % 8)]],
        )
        .unwrap()
    });
    let mut world = WorldSampler::new(&light, MapId(0)).unwrap();
    let mut plain = Sampler::new(&light, MapId(0)).unwrap();
    let mut grey = 0;
    for i in 0..500 {
        let seen = [random.range(0.0, 45.0), random.range(0.0, 40.0)];
        let point = rig.seen_at(seen, [48.0, 40.0], random.range(4.0, 12.0));
        let query = WorldQuery::new(point).bias(0.125);
        let query = match i % 3 {
            0 => query,
            1 => query.width(random.range(0.0, 2.0)),
            _ => query.steps(random.point(0.5), random.point(0.5)),
        };
        let same = world.maps()[0].1.query_from_world(&query).unwrap();
        let same = same.unwrap();
        assert!((f64::from(same.x) - (seen[0] - 7.0)).abs() < 1e-5);
        assert!((f64::from(same.y) - (seen[1] - 3.0)).abs() < 1e-5);
        assert_eq!(same.bias, 0.125);
        let v = world.visibility(&query).unwrap();
        assert_eq!(v, plain.visibility(&same).unwrap());
        assert_eq!(
            world.visibility_rgb(&query).unwrap(),
            plain.visibility_rgb(&same).unwrap()
        );
        assert_eq!(world.maps()[0].0.visibility(&same).unwrap(), v);
        grey += usize::from(v > 0.0 && v < 1.0);
    }
    assert!(grey > 250, "{grey}");
}

#[test]
fn a_surface_in_world_space_does_not_shadow_itself() {
    // The stored depth is the f32 nearest to the depth that the lookup computes.
    let rig = Rig::perspective([1.0, 1.0])
        .moved([0.1, 0.2, 0.3])
        .turned([0.7, 0.8, 0.9]);
    let map = rig.header("m", [16, 16], DepthKind::RayDistance);
    let space = LightSpace::of(&map).unwrap();
    let centre = |x: u32, y: u32| {
        let seen = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        rig.seen_at(seen, [16.0, 16.0], 3.0 + f64::from(x * y) / 7.0)
    };
    let light = file(&[map], GroupRole::Faces, |_, x, y| {
        wall(space.light_from_world(centre(x, y)).unwrap()[2] as f32)
    });
    let options = SamplerOptions::default().filter(Filter::Nearest);
    let mut sampler = WorldSampler::with_options(&light, MapId(0), options).unwrap();
    for (x, y) in (0..256).map(|i| (i % 16, i / 16)) {
        let query = WorldQuery::new(centre(x, y));
        assert_eq!(sampler.visibility(&query).unwrap(), 1.0);
        assert_eq!(sampler.visibility(&query.bias(-1e-3)).unwrap(), 0.0);
    }
}
