//! Scenes for tests.

use deepshadow::Filter;
use deepshadow_scene::demo::cloud::Cloud;
use deepshadow_scene::demo::hairball::Hairball;
use deepshadow_scene::geometry::{Grid, Mesh};
use deepshadow_scene::load::Loaded;
use deepshadow_scene::scene::{Light, LightKind, Object, Scene, Shape, Volume};
use deepshadow_scene::transfer::TransferFunction;
use glam::{DAffine3, DVec3, Vec3};

/// Deterministic pseudo-random numbers (the generator of Numerical Recipes, upper half).
pub struct Dice(pub u64);

impl Dice {
    pub fn roll(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 32) as f64 / 4294967296.0
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.roll() * n as f64) as usize
    }
}

pub fn hair(hairs: u32, opacity: [f32; 3]) -> Vec<Object> {
    let ball = Hairball {
        hairs,
        ..Hairball::default()
    };
    let demo = ball.make();
    let object = |part: deepshadow_scene::demo::Part| {
        let (shape, own) = match part.geometry {
            Loaded::Mesh(mesh) => (Shape::Mesh(mesh), [1.0; 3]),
            Loaded::Curves(curves) => (
                Shape::Curves {
                    curves,
                    width: 0.01,
                },
                opacity,
            ),
            Loaded::Volume(_) => unreachable!("hair is no volume"),
        };
        Object {
            opacity: own,
            ..Object::new(part.name, shape)
        }
    };
    demo.parts.into_iter().map(object).collect()
}

pub fn cloud(extinction: [f32; 3], side: u32) -> Object {
    let grid = Cloud {
        size: [side; 3],
        ..Cloud::default()
    }
    .density();
    medium(grid, extinction)
}

pub fn medium(grid: Grid, extinction: [f32; 3]) -> Object {
    let transfer = TransferFunction::new(vec![(0.0, [0.0; 3]), (1.0, extinction)]).unwrap();
    Object::new(
        "medium",
        Shape::Volume(Volume {
            grid,
            transfer,
            step: 1.0,
        }),
    )
}

/// A square of side `side` around the origin, perpendicular to axis `axis` (0, 1 or 2), at `at`.
pub fn square(axis: usize, at: f32, side: f32, opacity: [f32; 3]) -> Object {
    let corner = |a: f32, b: f32| {
        let mut p = [0.0; 3];
        p[axis] = at;
        p[(axis + 1) % 3] = a * side / 2.0;
        p[(axis + 2) % 3] = b * side / 2.0;
        Vec3::from_array(p)
    };
    let positions = vec![
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ];
    Object {
        opacity,
        ..Object::new(
            "square",
            Shape::Mesh(Mesh::still(positions, vec![[0, 1, 2], [0, 2, 3]])),
        )
    }
}

pub fn spot(samples: u32, side: u32) -> Light {
    let kind = LightKind::Spot {
        position: DVec3::new(2.0, 5.0, 3.0),
        target: None,
        up: DVec3::Y,
        angle: None,
    };
    light(kind, samples, side)
}

pub fn distant(samples: u32, side: u32) -> Light {
    let kind = LightKind::Directional {
        direction: DVec3::new(-0.4, -1.0, -0.3),
        up: DVec3::Y,
        target: None,
        size: None,
    };
    light(kind, samples, side)
}

pub fn light(kind: LightKind, samples: u32, side: u32) -> Light {
    Light {
        samples,
        resolution: [side; 2],
        filter: Filter::Box,
        ..Light::new("light", kind)
    }
}

pub fn scene(objects: Vec<Object>, light: Light) -> Scene {
    Scene {
        objects,
        lights: vec![light],
        camera: None,
        seed: 1,
    }
}

/// Moves an object by `way` while the shutter is open.
pub fn moving(mut object: Object, way: DVec3) -> Object {
    let from = object.motion[0];
    object.motion = vec![from, DAffine3::from_translation(way) * from];
    object
}
