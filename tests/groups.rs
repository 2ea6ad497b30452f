//! Lookups in groups of maps: faces of a cube, and clusters.

use crate::random::Random;
use crate::world_support::*;
use deepshadow::*;

const SIDE: u32 = 8;

/// The depth of the wall in a pixel; it differs for every pixel of every face.
fn depth_of(face: usize, x: u32, y: u32) -> f32 {
    1.0 + (face as u32 * SIDE * SIDE + y * SIDE + x) as f32
}

/// The sampler of the only group of a file.
fn sampler(light: &CachedFile, options: SamplerOptions) -> Result<WorldSampler> {
    let group = light.file().find_group("all").unwrap();
    WorldSampler::of_group(light, group, options)
}

fn cube_file(position: [f64; 3]) -> CachedFile {
    let maps: Vec<_> = cube(position)
        .iter()
        .enumerate()
        .map(|(i, rig)| rig.header(&i.to_string(), [SIDE; 2], DepthKind::RayDistance))
        .collect();
    file(&maps, GroupRole::Faces, |face, x, y| {
        wall(depth_of(face, x, y))
    })
}

#[test]
fn every_direction_meets_one_face_of_a_cube_at_the_right_pixel() {
    let position = [10.0, -20.0, 30.0];
    let options = SamplerOptions::default().filter(Filter::Nearest);
    let light = cube_file(position);
    let mut group = sampler(&light, options).unwrap();
    let (mut random, mut seen) = (Random(6), [0; 6]);
    for _ in 0..5000 {
        let direction = random.point(1.0);
        let (face, at) = by_longest_axis(direction);
        let pixel = at.map(|c| (c * f64::from(SIDE)) as u32);
        let length = dot(direction, direction).sqrt();
        let wall = f64::from(depth_of(face, pixel[0], pixel[1]));
        let point =
            |distance: f64| [0, 1, 2].map(|i| position[i] + direction[i] / length * distance);

        assert_eq!(group.face_of(point(wall)), Some(face));
        let holding = group.maps().iter();
        let holding = holding.filter(|(_, space)| space.holds(point(wall)));
        assert_eq!(holding.count(), 1);
        // No other pixel has a wall at this depth.
        let front = WorldQuery::new(point(wall - 0.25));
        let behind = WorldQuery::new(point(wall + 0.25));
        assert_eq!(group.visibility(&front).unwrap(), 1.0, "{direction:?}");
        assert_eq!(group.visibility(&behind).unwrap(), 0.0, "{direction:?}");
        assert_eq!(group.visibility_rgb(&front).unwrap(), [1.0; 3]);
        assert_eq!(group.visibility_rgb(&behind).unwrap(), [0.0; 3]);
        seen[face] += 1;
    }
    assert!(seen.iter().all(|&n| n > 500), "{seen:?}");
    assert_eq!(group.face_of(position), None); // the light itself
    assert_eq!(group.visibility(&WorldQuery::new(position)).unwrap(), 1.0);
}

#[test]
fn on_an_edge_of_a_cube_the_first_face_is_used() {
    let light = cube_file([0.0; 3]);
    let group = sampler(&light, SamplerOptions::default()).unwrap();
    for (direction, face) in [
        ([1.0, 1.0, 0.0], 0),
        ([-1.0, 0.3, 1.0], 1),
        ([0.0, 1.0, -1.0], 2),
        ([0.5, -1.0, 1.0], 3),
        ([1.0, 1.0, 1.0], 0),
        ([-1.0, -1.0, -1.0], 1),
    ] {
        assert_eq!(group.face_of(direction), Some(face), "{direction:?}");
    }
}

#[test]
fn a_cube_with_rounded_matrices_has_no_gaps() {
    // A turned cube far from the origin, with matrices in f32 as in an OpenEXR file.
    let position = [1.0 / 3.0, 20.0 / 7.0, -3.3];
    let maps: Vec<_> = cube(position)
        .iter()
        .enumerate()
        .map(|(i, rig)| {
            // The whole cube turns, not each camera about its own axes.
            let (s, c) = 0.7f64.sin_cos();
            let turn = |v: [f64; 3]| {
                let v = [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]];
                [v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]]
            };
            let rig = Rig {
                right: turn(rig.right),
                up: turn(rig.up),
                forward: turn(rig.forward),
                ..*rig
            };
            let mut map = rig.header(&i.to_string(), [128; 2], DepthKind::RayDistance);
            for m in [
                &mut map.camera.camera_from_world,
                &mut map.camera.ndc_from_world,
            ] {
                *m = m.map(|m| m.map(|v| f64::from(v as f32)));
            }
            map
        })
        .collect();
    let light = file(&maps, GroupRole::Faces, |_, _, _| Curve::lit(1));
    let mut group = sampler(&light, SamplerOptions::default()).unwrap();
    let (mut random, mut gaps) = (Random(7), 0);
    let (s, c) = 0.7f64.sin_cos();
    for i in 0..20000 {
        // A point on one of the twelve edges, before the turn.
        let mut v = [1.0, [-1.0, 1.0][i % 2], random.range(-1.0, 1.0)];
        v[0] *= [-1.0, 1.0][i / 2 % 2];
        v.rotate_left(i % 3);
        let v = [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]];
        let v = [v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]];
        let point = [0, 1, 2].map(|k| position[k] + 5.0 * v[k]);
        gaps += usize::from(!group.maps().iter().any(|(_, space)| space.holds(point)));
        assert!(group.face_of(point).is_some(), "{point:?}");
    }
    assert!(
        gaps > 100,
        "only {gaps} points are in a gap between the faces"
    );
}

#[test]
fn no_light_leaks_through_the_edges_of_a_cube() {
    let maps: Vec<_> = cube([0.0; 3])
        .iter()
        .enumerate()
        .map(|(i, rig)| rig.header(&i.to_string(), [SIDE; 2], DepthKind::RayDistance))
        .collect();
    let light = file(&maps, GroupRole::Faces, |_, _, _| wall(1.0));
    for filter in [Filter::Nearest, Filter::Triangle, Filter::Gaussian] {
        let options = SamplerOptions::new(filter);
        let mut group = sampler(&light, options).unwrap();
        let mut random = Random(8);
        for _ in 0..2000 {
            let point = random
                .point(1.0)
                .map(|v| 10.0 * v.signum() * v.abs().sqrt());
            let query = WorldQuery::new(point).width(random.range(0.0, 10.0));
            assert_eq!(group.visibility(&query).unwrap(), 0.0, "{point:?}");
        }
    }
}

#[test]
fn a_point_outside_all_faces_is_lit() {
    // Four of six faces: none above, none below.
    let rigs = cube([0.0; 3]);
    let maps: Vec<_> = [0, 1, 4, 5]
        .iter()
        .map(|&i| rigs[i].header(&i.to_string(), [SIDE; 2], DepthKind::Planar))
        .collect();
    let light = file(&maps, GroupRole::Faces, |_, _, _| wall(1.0));
    let mut group = sampler(&light, SamplerOptions::default()).unwrap();
    let mut at = |point| group.visibility(&WorldQuery::new(point)).unwrap();
    assert_eq!((at([0.0, 5.0, 0.0]), at([1.0, -5.0, 2.0])), (1.0, 1.0));
    assert_eq!((at([5.0, 0.0, 0.0]), at([1.0, 2.0, -5.0])), (0.0, 0.0));
    assert_eq!(at([4.0, 4.1, 0.0]), 1.0);
    assert_eq!(at([4.1, 4.0, 0.0]), 0.0);
    assert_eq!(group.face_of([4.0, 4.1, 0.0]), None);
}

#[test]
fn clusters_multiply_and_are_lit_outside_their_frusta() {
    // Lights of different widths: from -x, from +y and from -z.
    let rigs = [
        Rig::orthographic([2.0, 2.0])
            .turned([0.0, std::f64::consts::FRAC_PI_2, 0.0])
            .moved([-10.0, 0.0, 0.0]),
        Rig::orthographic([1.0, 3.0])
            .turned([-std::f64::consts::FRAC_PI_2, 0.0, 0.0])
            .moved([0.5, 8.0, 0.0]),
        Rig::perspective([0.25, 0.25]).moved([0.0, 0.0, -6.0]),
    ];
    let maps: Vec<_> = rigs
        .iter()
        .enumerate()
        .map(|(i, rig)| rig.header(&i.to_string(), [16; 2], DepthKind::Planar))
        .collect();
    let light = file(&maps, GroupRole::Clusters, |map, x, y| {
        let v = |k: u32| 0.25 + 0.5 * f64::from((x * 3 + y * 5 + k) % 7) / 8.0;
        match map {
            0 => Curve::mono(vec![9.0], vec![v(0)]).unwrap(),
            1 => Curve::rgb(vec![7.5], vec![[v(1), v(2), v(3)]]).unwrap(),
            _ => Curve::mono(vec![5.0, 7.0], vec![1.0, v(4)]).unwrap(),
        }
    });
    let options = SamplerOptions::default().border(Border::Clamp);
    let mut group = sampler(&light, options).unwrap();
    let mut alone = [0, 1, 2].map(|i| WorldSampler::new(&light, MapId(i as u32)).unwrap());
    let (mut random, mut shared) = (Random(9), 0);
    for i in 0..2000 {
        let query = WorldQuery::new(random.point(3.0)).width(f64::from(i % 3) * 0.2);
        let (mut product, mut rgb, mut holding) = (1.0, [1.0; 3], 0);
        for sampler in &mut alone {
            let v = sampler.visibility(&query).unwrap();
            product *= f64::from(v);
            let own = sampler.visibility_rgb(&query).unwrap();
            rgb = [0, 1, 2].map(|c| rgb[c] * f64::from(own[c]));
            let space = &sampler.maps()[0].1;
            holding += usize::from(space.holds(query.point));
            // Far outside its window, a cluster is exactly lit.
            let at = space.light_from_world(query.point);
            let far = |c: f64| !(-4.0..20.0).contains(&c);
            if at.is_none_or(|at| far(at[0]) || far(at[1])) {
                assert_eq!(v, 1.0);
            }
        }
        assert_eq!(group.visibility(&query).unwrap(), product as f32);
        assert_eq!(group.visibility_rgb(&query).unwrap(), rgb.map(|v| v as f32));
        shared += usize::from(holding >= 2 && product < 0.6);
    }
    assert!(shared > 50, "{shared}");
}

#[test]
fn one_dark_cluster_makes_the_product_dark() {
    let rig = Rig::orthographic([1.0, 1.0]);
    let maps = ["a", "b", "c"].map(|name| rig.header(name, [4; 2], DepthKind::Planar));
    let light = file(&maps, GroupRole::Clusters, |map, _, _| {
        Curve::mono(vec![1.0], vec![[0.5, 0.0, 0.75][map]]).unwrap()
    });
    let mut group = sampler(&light, SamplerOptions::default()).unwrap();
    let query = WorldQuery::new([0.0, 0.0, 2.0]);
    assert_eq!(group.visibility(&query).unwrap(), 0.0);
    assert_eq!(group.visibility_rgb(&query).unwrap(), [0.0; 3]);
}

#[test]
fn a_group_that_the_file_lacks_is_refused() {
    let map = Rig::orthographic([1.0, 1.0]).header("m", [4; 2], DepthKind::Planar);
    let light = file(&[map], GroupRole::Clusters, |_, _, _| wall(1.0));
    assert_eq!(light.file().find_group("none"), None);
    let group = Group::new("of another file", GroupRole::Faces, vec![MapId(1)]);
    let e = WorldSampler::of_group(&light, &group, SamplerOptions::default()).unwrap_err();
    assert_eq!(
        (e.kind(), e.to_string().as_str()),
        (ErrorKind::Input, "no map 1 in a file of 1")
    );
}
