//! Tests of the demos: their parameters, the invariants of geometry, and bit-identical results.

use std::collections::HashMap;

use crate::load_support::laws;
use deepshadow_scene::demo::{
    self, Demo, cloud, fur, hairball, hash, papers, shapes, solids, trig,
};
use deepshadow_scene::geometry::{Curves, Grid, Mesh, bounds};
use deepshadow_scene::load::Loaded;
use glam::Vec3;

fn named(name: &str) -> Demo {
    demo::by_name(name, 1).unwrap()
}

fn curves(demo: &Demo, part: usize) -> &Curves {
    match &demo.parts[part].geometry {
        Loaded::Curves(curves) => curves,
        other => panic!("{other:?}"),
    }
}

fn mesh(demo: &Demo, part: usize) -> &Mesh {
    match &demo.parts[part].geometry {
        Loaded::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

fn grid(demo: &Demo, part: usize) -> &Grid {
    match &demo.parts[part].geometry {
        Loaded::Volume(grid) => grid,
        other => panic!("{other:?}"),
    }
}

/// A hash of all numbers of a demo.
fn fingerprint(demo: &Demo) -> u64 {
    let mut sum = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bits: u32| sum = (sum ^ u64::from(bits)).wrapping_mul(0x100_0000_01b3);
    for part in &demo.parts {
        let (points, indices, numbers) = match &part.geometry {
            Loaded::Mesh(m) => (&m.positions[..], m.triangles.concat(), m.uvs.concat()),
            Loaded::Curves(c) => (&c.points[..], c.strands.clone(), c.widths.clone()),
            Loaded::Volume(g) => (&[][..], g.size.to_vec(), g.values.clone()),
        };
        let points = points.iter().flatten().flat_map(|p| p.to_array());
        points.chain(numbers).for_each(|x| add(x.to_bits()));
        indices.into_iter().for_each(&mut add);
    }
    sum
}

#[test]
fn every_demo_is_valid_geometry() {
    for (name, what) in demo::names() {
        assert!(!what.is_empty() && !what.contains('\n'));
        for part in named(name).parts {
            println!("{name}: {}", part.name);
            laws::laws(&part.geometry);
            assert!(part.opacity > 0.0);
        }
    }
    assert!(demo::by_name("hairdo", 1).is_none());
}

#[test]
fn demos_are_bit_identical_on_every_machine() {
    let expected: &[(&str, u64)] = &[
        ("hairball", 0xdd0e67248644bb02),
        ("fur", 0x329cc31d0f3f428f),
        ("cloud", 0xf1bfb3e482a24f13),
        ("smoke", 0x433358810dce48c6),
        ("boxes", 0xf31e6aea28cfb5b9),
        ("spheres", 0x71d0e49f0272ac3f),
        ("ball", 0xeaf57162cc81bd8f),
        ("pipes", 0x718756bed70fd781),
        ("box", 0xb6adfce725089227),
        ("bucky", 0x5d343a9c50e727a4),
        ("rods", 0x68bd46050c6aac21),
    ];
    let found: Vec<(&str, u64)> = demo::names()
        .map(|(n, _)| (n, fingerprint(&named(n))))
        .collect();
    for (name, sum) in &found {
        println!("        (\"{name}\", 0x{sum:016x}),");
    }
    assert_eq!(found, expected);
}

#[test]
fn another_seed_makes_another_demo() {
    for name in [
        "hairball", "fur", "cloud", "smoke", "boxes", "spheres", "pipes",
    ] {
        assert_ne!(demo::by_name(name, 2).unwrap(), named(name), "{name}");
    }
}

#[test]
fn the_hairball_has_the_hairs_of_the_paper_all_around_its_ball() {
    let ball = hairball::Hairball::default();
    let demo = ball.make();
    assert_eq!(
        demo.parts.iter().map(|p| p.name).collect::<Vec<_>>(),
        ["ball", "hair"]
    );
    let hair = curves(&demo, 1);
    assert_eq!(hair.strands.len() - 1, 50_000);
    assert_eq!(hair.points[0].len(), 50_000 * 17);
    let mut octants = [0; 8];
    for strand in hair.strands.windows(2) {
        let strand = &hair.points[0][strand[0] as usize..strand[1] as usize];
        let root = strand[0];
        assert!((root.length() / ball.radius - 0.995).abs() < 1e-4, "{root}");
        let far = strand.iter().map(|p| p.length()).fold(0.0, f32::max);
        assert!(
            far > ball.radius * 1.02 && far < ball.radius + 2.0 * ball.length,
            "{far}"
        );
        octants[usize::from(root.x > 0.0)
            + 2 * usize::from(root.y > 0.0)
            + 4 * usize::from(root.z > 0.0)] += 1;
    }
    assert!(
        octants.iter().all(|n| (5_800..6_700).contains(n)),
        "{octants:?}"
    );
    // Much narrower than a pixel if 512 pixels cover the hairball.
    let (lo, hi) = bounds(&hair.points[0]).unwrap();
    let pixel = (hi - lo).max_element() / 512.0;
    assert!(
        hair.widths.iter().all(|w| *w > 0.0 && *w < pixel / 4.0),
        "{pixel}"
    );
}

#[test]
fn a_hairball_may_have_any_number_of_hairs() {
    let small = hairball::Hairball {
        hairs: 9,
        segments: 3,
        tufts: 0,
        curl: 0.0,
        ..Default::default()
    };
    let hair = small.hair();
    assert_eq!((hair.points[0].len(), hair.strands.len()), (36, 10));
    let none = hairball::Hairball { hairs: 0, ..small };
    assert_eq!(none.hair().strands, [0]);
}

#[test]
fn fur_grows_on_all_of_its_ground_and_is_short() {
    let patch = fur::Fur::default();
    let demo = patch.make();
    let fur = curves(&demo, 1);
    assert_eq!(fur.strands.len() - 1, 40_000);
    let mut quarters = [0; 4];
    for strand in fur.strands.windows(2) {
        let strand = &fur.points[0][strand[0] as usize..strand[1] as usize];
        let root = strand[0];
        assert!(root.y == 0.0 && root.abs().max_element() <= 0.5, "{root}");
        quarters[usize::from(root.x > 0.0) + 2 * usize::from(root.z > 0.0)] += 1;
        assert!(
            strand
                .iter()
                .all(|p| p.y >= 0.0 && p.distance(root) < 1.5 * patch.length)
        );
    }
    assert_eq!(quarters, [10_000; 4]);
    assert_eq!(mesh(&demo, 0).positions[0].len(), 17 * 17);
}

#[test]
fn densities_are_from_0_to_1_and_0_at_the_border() {
    for (name, size) in [
        ("cloud", [128, 128, 128]),
        ("smoke", [96, 192, 96]),
        ("box", [64, 64, 64]),
        ("bucky", [32, 32, 32]),
        ("rods", [64, 64, 64]),
    ] {
        let demo = named(name);
        let grid = grid(&demo, 0);
        assert_eq!(grid.size, size);
        let (lo, hi) = grid.range();
        assert!(lo == 0.0 && hi > 0.9 && hi <= 1.0, "{name}: {lo} to {hi}");
        let [nx, ny, nz] = size.map(|n| n as usize);
        for (i, v) in grid.values.iter().enumerate() {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let border = at.contains(&0) || at[0] + 1 == nx || at[1] + 1 == ny || at[2] + 1 == nz;
            assert!(!border || *v == 0.0, "{name} at {at:?}");
        }
        assert!(
            (grid.origin + grid.last()).length() < 1e-5,
            "{name} is not around the origin"
        );
    }
}

#[test]
fn a_cloud_may_have_any_size() {
    let cloud = cloud::Cloud {
        size: [40, 24, 12],
        ..Default::default()
    };
    let grid = cloud.density();
    assert_eq!(grid.values.len(), 40 * 24 * 12);
    assert_eq!(grid.origin.x, -1.0);
    assert!(grid.range().1 > 0.9);
    let least = cloud::Cloud {
        size: [2, 2, 2],
        ..Default::default()
    };
    assert_eq!(least.density().values, [0.0; 8]);
}

/// The sample nearest to a point.
fn near(grid: &Grid, p: Vec3) -> f32 {
    let at = ((p - grid.origin) / grid.spacing).round();
    let [x, y, z] = at.to_array().map(|n| n as usize);
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    grid.values[(z * ny + y) * nx + x]
}

#[test]
fn the_volumes_of_the_paper_are_dense_where_they_should_be() {
    let (cube, bucky, rods) = (papers::cube(65), papers::bucky(64), papers::rods(65));
    let cube = grid(&cube, 0);
    assert_eq!(near(cube, Vec3::ZERO), 1.0);
    assert!((near(cube, Vec3::new(0.5, 0.25, -0.25)) - 0.5).abs() < 1e-6);

    let atoms = papers::bucky_atoms();
    let bucky = grid(&bucky, 0);
    assert!(atoms.iter().all(|a| near(bucky, *a * 0.72) > 0.8));
    assert_eq!(near(bucky, Vec3::ZERO), 0.0);
    // Every atom of a bucky ball has three neighbours at the same distance.
    for a in atoms {
        let mut far: Vec<f32> = atoms.iter().map(|b| a.distance(*b)).collect();
        far.sort_by(f32::total_cmp);
        assert!(
            far[1] > 0.3 && far[3] < far[1] * 1.001 && far[4] > far[3] * 1.3,
            "{far:?}"
        );
    }

    let rods = grid(&rods, 0);
    let arms = [
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
        Vec3::ONE,
        Vec3::new(-1.0, 1.0, 1.0),
    ];
    for arm in arms {
        let arm = arm.normalize() * 0.65;
        assert!(near(rods, arm) > 0.9 && near(rods, -arm) > 0.9, "{arm}");
    }
    assert_eq!(near(rods, Vec3::new(0.6, 0.6, 0.0)), 0.0);
}

/// Checks that every edge occurs once in each direction, and that the triangles face outward.
fn closed(mesh: &Mesh) {
    let mut edges = HashMap::new();
    let mut volume = 0.0;
    for t in &mesh.triangles {
        for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *edges.entry((a, b)).or_insert(0) += 1;
        }
        let [a, b, c] = t.map(|i| mesh.positions[0][i as usize].as_dvec3());
        volume += a.dot(b.cross(c)) / 6.0;
    }
    assert!(
        edges
            .iter()
            .all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1))
    );
    assert!(volume > 0.0, "{volume}");
}

#[test]
fn solids_are_closed_and_face_outward() {
    for name in ["boxes", "spheres", "pipes"] {
        closed(mesh(&named(name), 0));
    }
    closed(mesh(&named("hairball"), 0));
    closed(&shapes::cuboid(Vec3::ONE, Vec3::new(1.0, 2.0, 3.0)));
    let ball = shapes::ball(Vec3::ONE, 2.0, 2);
    assert_eq!((ball.positions[0].len(), ball.triangles.len()), (162, 320));
    assert!(
        ball.positions[0]
            .iter()
            .all(|p| (p.distance(Vec3::ONE) - 2.0).abs() < 1e-5)
    );
    closed(&ball);
}

#[test]
fn there_are_as_many_boxes_spheres_and_pipes_as_asked_for() {
    assert_eq!(mesh(&named("boxes"), 0).triangles.len(), 36 * 12);
    let spheres = solids::Spheres::default();
    let places = spheres.places();
    assert_eq!(places.len(), 24);
    for (i, (a, r)) in places.iter().enumerate() {
        assert!((a.abs() + *r).max_element() <= spheres.reach + 1e-6);
        assert!(places[..i].iter().all(|(b, s)| a.distance(*b) > r + s));
    }
    let pipes = solids::Pipes {
        count: 3,
        rings: 10,
        corners: 5,
        ..Default::default()
    };
    assert_eq!(mesh(&pipes.make(), 0).positions[0].len(), 3 * (10 * 5 + 2));
}

#[test]
fn sines_are_right_to_a_few_millionths() {
    for i in -4000..4000 {
        let turns = i as f32 / 1000.0;
        let (sin, cos) = trig::sin_cos(turns);
        let (s, c) = (f64::from(turns) * std::f64::consts::TAU).sin_cos();
        assert!(
            (f64::from(sin) - s).abs() < 5e-6 && (f64::from(cos) - c).abs() < 5e-6,
            "{turns}"
        );
    }
}

#[test]
fn hashed_numbers_are_spread_evenly() {
    let hash = hash::Hash::new(7);
    let mut tenths = [0; 10];
    let mut mean = Vec3::ZERO;
    for i in 0..100_000 {
        tenths[(hash.unit(i) * 10.0) as usize] += 1;
        let direction = hash.direction(i);
        assert!((direction.length() - 1.0).abs() < 1e-5);
        mean += direction / 100_000.0;
    }
    assert!(
        tenths.iter().all(|n| (9_600..10_400).contains(n)),
        "{tenths:?}"
    );
    assert!(mean.length() < 0.01, "{mean}");
}
