//! Compares maps with their own rays, summed one by one in double precision, and those rays with a
//! ray caster.

use std::collections::HashMap;

use crate::support::*;
use deepshadow::{Curve, DepthKind, DsmFile, Filter, MapId, Pixel, Ray};
use deepshadow_scene::build::{Settings, build};
use deepshadow_scene::hits::ribbon;
use deepshadow_scene::hits::triangles::Triangles;
use deepshadow_scene::pixels::{Pixels, Worker};
use deepshadow_scene::samples::{Pattern, Samples};
use deepshadow_scene::scene::{Light, Scene, Shape, View};
use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::builder::build_cwbvh;

/// Calls `look` with the data from which the pixels of a scene's first map are made.
fn with_pixels(scene: &Scene, look: impl FnOnce(&View, &Pixels<'_>, &[u32])) {
    let light = &scene.lights[0];
    let view = &light.views(scene).unwrap()[0];
    let triangles = Triangles::new(scene, view);
    let reach = light.margin();
    let [w, h] = view.size.map(|s| s as i32);
    let boxes = triangles.boxes([-reach, w - 1 + reach, -reach, h - 1 + reach]);
    let all: Vec<u32> = (0..triangles.indices.len() as u32).collect();
    look(
        view,
        &Pixels::new(scene, light, view, &triangles, &boxes),
        &all,
    );
}

/// The largest error of a built map, and its error bound. Checks `pixels` pixels at every depth of
/// all their rays, one float to either side, in the middle between two, and at `random` random
/// depths in all.
fn worst(scene: &Scene, pixels: usize, random: usize) -> (f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.dsm");
    build(scene, &path, &Settings::default(), |_, _| {}).unwrap();
    let file = DsmFile::open(&path).unwrap();
    let bound = file.maps()[0].levels[0].max_error;
    let mut most = 0.0f64;
    with_pixels(scene, |view, made, all| {
        let mut dice = Dice(7);
        let mut worker = Worker::default();
        let [w, h] = view.size;
        let mut seen = 0;
        while seen < pixels {
            let (x, y) = (dice.below(w as usize) as u32, dice.below(h as usize) as u32);
            let rays = made.rays(x as i32, y as i32, all, &mut worker).unwrap();
            let mut own: Vec<f32> = rays.iter().flat_map(|(_, r)| depths_of(r)).collect();
            own.sort_by(f32::total_cmp);
            own.dedup();
            let stored = file.function(MapId(0).level(0), Pixel::new(x, y)).unwrap();
            let (Some(&first), Some(&last)) = (own.first(), own.last()) else {
                assert!(stored.is_empty(), "light is lost at {x},{y}");
                continue;
            };
            seen += 1;
            let mut depths: Vec<f32> = own
                .iter()
                .flat_map(|z| [z.next_down(), *z, z.next_up()])
                .collect();
            depths.extend(own.windows(2).map(|d| d[0] + (d[1] - d[0]) * 0.5));
            depths.extend(
                (0..random / pixels)
                    .map(|_| first + (last - first) * (dice.roll() as f32 * 1.2 - 0.1)),
            );
            depths.sort_by(f32::total_cmp);
            depths.dedup();
            let mut exact = Curve::default();
            exact.assign(&stored, 0.0);
            let weight: f64 = rays.iter().map(|(w, _)| w).sum();
            for c in 0..3 {
                // Negative lobes of a filter can make the sum rise; the map stores its running
                // minimum.
                let mut least = 1.0f64;
                for &z in &depths {
                    let sum = rays
                        .iter()
                        .map(|(w, r)| w * r.visibility_rgb(z)[c])
                        .sum::<f64>()
                        / weight;
                    least = least.min(sum.max(0.0));
                    most = most.max((least - exact.visibility_rgb(z)[c]).abs());
                    let sum = rays
                        .iter()
                        .map(|(w, r)| w * r.visibility_behind_rgb(z)[c])
                        .sum::<f64>()
                        / weight;
                    least = least.min(sum.max(0.0));
                    most = most.max((least - exact.visibility_behind_rgb(z)[c]).abs());
                }
                if stored.channels() == 1 && rays.iter().all(|(_, r)| r.channels() == 1) {
                    break;
                }
            }
        }
    });
    (most, bound)
}

/// The depths of a ray's vertices.
fn depths_of(ray: &Ray) -> Vec<f32> {
    let mut curve = Curve::default();
    ray.flatten(1e-3, &mut curve);
    curve.depths().to_vec()
}

fn holds(scene: &Scene, pixels: usize, random: usize) {
    let (error, bound) = worst(scene, pixels, random);
    println!("error {error}, bound {bound}");
    assert!(error <= bound, "{error} exceeds the bound of {bound}");
    assert!(error > 0.0, "nothing was measured");
}

#[test]
fn a_map_of_hair_keeps_its_error_bound_at_every_hit_of_its_rays() {
    holds(&scene(hair(4000, [1.0; 3]), distant(64, 96)), 1000, 100_000);
}

#[test]
fn a_map_of_translucent_coloured_hair_from_a_spot_keeps_its_error_bound() {
    let mut light = spot(16, 64);
    light.depth = DepthKind::RayDistance;
    holds(&scene(hair(2000, [0.3, 0.5, 0.9]), light), 200, 5000);
}

#[test]
fn a_map_of_hair_in_a_cloud_keeps_its_error_bound() {
    let mut objects = hair(1000, [0.5; 3]);
    objects.push(cloud([3.0, 4.0, 8.0], 24));
    holds(&scene(objects, spot(4, 48)), 100, 3000);
}

#[test]
fn a_map_of_moving_hair_keeps_its_error_bound() {
    let objects = hair(1000, [0.7; 3])
        .into_iter()
        .map(|o| moving(o, DVec3::new(0.3, 0.1, 0.0)));
    holds(&scene(objects.collect(), spot(16, 48)), 100, 3000);
}

#[test]
fn every_filter_keeps_the_error_bound() {
    for (filter, width) in [
        (Filter::Box, 2.0),
        (Filter::Triangle, 1.0),
        (Filter::Gaussian, 0.75),
        (Filter::CatmullRom, 1.0),
    ] {
        let light = Light {
            filter,
            filter_width: width,
            ..distant(9, 48)
        };
        holds(&scene(hair(1500, [0.8; 3]), light), 60, 600);
    }
}

#[test]
fn a_pixel_is_the_same_alone_and_with_others_that_share_its_rays() {
    let mut light = spot(9, 48);
    light.filter = Filter::Gaussian;
    let mut objects = hair(1000, [0.5, 0.5, 0.8]);
    objects.push(cloud([3.0, 4.0, 8.0], 24));
    with_pixels(&scene(objects, light), |_, made, all| {
        let mut worker = Worker::default();
        let both = made.functions([20, 21, 24, 24], all, &mut worker).unwrap();
        assert!(both.iter().all(|f| f.len() > 10));
        for (x, beside) in (20..).zip(&both) {
            let alone = made.functions([x, x, 24, 24], all, &mut worker).unwrap();
            assert_eq!(alone[0].depths(), beside.depths());
            assert_eq!(alone[0].channels(), beside.channels());
            for c in 0..3 {
                let values = alone[0].values(c).iter().zip(beside.values(c));
                assert!(values.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
            }
        }
    });
}

/// A ray caster that returns the steps of a ray. Corners are in world space, hits in double
/// precision, and boxes come from a library.
fn cast(scene: &Scene, view: &View) -> impl Fn(DVec3, DVec3) -> Vec<(f64, f64)> + use<> {
    let mut triangles: Vec<([DVec3; 3], f64)> = Vec::new();
    for object in &scene.objects {
        let opacity = f64::from(object.opacity[0]);
        match &object.shape {
            Shape::Mesh(mesh) => {
                let at = |i: u32| mesh.positions[0][i as usize].as_dvec3();
                triangles.extend(mesh.triangles.iter().map(|t| (t.map(at), opacity)));
            }
            Shape::Curves { curves, width } => {
                for strand in curves.strands.windows(2) {
                    let range = strand[0] as usize..strand[1] as usize;
                    let points: Vec<_> = curves.points[0][range.clone()]
                        .iter()
                        .map(|p| p.as_dvec3())
                        .collect();
                    let wide =
                        |i: usize| f64::from(*curves.widths.get(range.start + i).unwrap_or(width));
                    let mut sides = Vec::new();
                    ribbon::borders(&points, wide, |p| view.eye.ray(p), |p| sides.push(p));
                    for q in sides.windows(4).step_by(2) {
                        triangles.push(([q[0], q[1], q[3]], opacity));
                        triangles.push(([q[0], q[3], q[2]], opacity));
                    }
                }
            }
            Shape::Volume(_) => unreachable!("surfaces only"),
        }
    }
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|(t, _)| {
            // Slightly larger, because the library's boxes are single precision.
            let [a, b, c] = t.map(|p| Vec3A::from(p.as_vec3()));
            Aabb::new(a.min(b).min(c) - 1e-5, a.max(b).max(c) + 1e-5)
        })
        .collect();
    let bvh = build_cwbvh(
        &boxes,
        BvhBuildParams::medium_build(),
        &mut std::time::Duration::default(),
    );
    move |origin, way| {
        let mut hits = Vec::new();
        let ray =
            obvhs::ray::Ray::new_inf(Vec3A::from(origin.as_vec3()), Vec3A::from(way.as_vec3()));
        bvh.ray_traverse_anyhit(ray, |_, id| {
            let ([a, b, c], opacity) = triangles[bvh.primitive_indices[id] as usize];
            // Möller and Trumbore 1997.
            let (ab, ac) = (b - a, c - a);
            let p = way.cross(ac);
            let volume = ab.dot(p);
            let s = origin - a;
            let u = s.dot(p) / volume;
            let q = s.cross(ab);
            let v = way.dot(q) / volume;
            let z = ac.dot(q) / volume;
            if volume != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && z > 0.0 {
                hits.push((z, opacity));
            }
        });
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut left = 1.0;
        let behind = |(z, opacity): (f64, f64)| {
            left *= 1.0 - opacity;
            (z, left)
        };
        let mut steps: Vec<_> = hits.into_iter().map(behind).collect();
        if let Some(dark) = steps.iter().position(|s| s.1 == 0.0) {
            steps.truncate(dark + 1);
        }
        steps
    }
}

#[test]
fn rays_have_the_hits_of_a_ray_caster() {
    for light in [distant(25, 64), spot(25, 64)] {
        let scene = scene(hair(20000, [0.5; 3]), light);
        with_pixels(&scene, |view, made, all| {
            let cast = cast(&scene, view);
            let pattern = Pattern::new(25, scene.seed, false);
            let (mut samples, mut worker) = (Samples::default(), Worker::default());
            let (mut rays, mut other, mut hits) = (0, 0, 0);
            for y in (0..64).step_by(3) {
                for x in (0..64).step_by(3) {
                    pattern.fill(x..x + 1, y..y + 1, &mut samples);
                    for (i, (_, ray)) in made
                        .rays(x, y, all, &mut worker)
                        .unwrap()
                        .iter()
                        .enumerate()
                    {
                        let [dx, dy] = samples.place(0, i).map(f64::from);
                        let (origin, way) = view
                            .eye
                            .line(f64::from(x) + 0.5 + dx, f64::from(y) + 0.5 + dy);
                        let expected = cast(origin, way);
                        let mut curve = Curve::default();
                        ray.flatten(1e-3, &mut curve);
                        let steps = steps_of(&curve);
                        let same = |(a, b): (&(f32, f64), &(f64, f64))| {
                            (f64::from(a.0) - b.0).abs() < 3e-6 * b.0 && (a.1 - b.1).abs() < 1e-6
                        };
                        let agree =
                            steps.len() == expected.len() && steps.iter().zip(&expected).all(same);
                        rays += 1;
                        hits += steps.len();
                        other += usize::from(!agree);
                    }
                }
            }
            println!("{other} of {rays} rays with {hits} hits are not the same");
            assert!(hits > rays / 4, "{hits} hits of {rays} rays");
            // Within rounding of an edge, either may be right.
            assert!(other * 1000 <= rays, "{other} of {rays} rays");
        });
    }
}

/// Depth of each step of a curve, and the value behind it.
fn steps_of(curve: &Curve) -> Vec<(f32, f64)> {
    let mut steps: HashMap<u32, (f32, f64)> = HashMap::new();
    for (z, v) in curve.depths().iter().zip(curve.values(0)) {
        steps.insert(z.to_bits(), (*z, *v));
    }
    let mut steps: Vec<_> = steps.into_values().collect();
    steps.sort_by(|a, b| a.0.total_cmp(&b.0));
    steps
}
