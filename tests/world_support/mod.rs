//! Lights for tests of world-space lookups: cameras, cubes, and points that a camera sees.
//!
//! Computes the points from a camera's axes, not from its matrices.

use crate::random::Random;
use crate::support;
use deepshadow::*;

/// A camera by its axes in world space.
#[derive(Clone, Copy, Debug)]
pub struct Rig {
    pub position: [f64; 3],
    pub right: [f64; 3],
    pub up: [f64; 3],
    pub forward: [f64; 3],
    /// Half the size of the display window; for a perspective camera, at distance 1.
    pub half: [f64; 2],
    pub perspective: bool,
}

pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn multiplied(a: &[f64; 16], b: &[f64; 16]) -> [f64; 16] {
    std::array::from_fn(|i| (0..4).map(|k| a[i / 4 * 4 + k] * b[k * 4 + i % 4]).sum())
}

impl Rig {
    /// A camera at the origin that looks along +z; +x is right and +y is up.
    pub fn perspective(half: [f64; 2]) -> Rig {
        Rig {
            position: [0.0; 3],
            right: [1.0, 0.0, 0.0],
            up: [0.0, 1.0, 0.0],
            forward: [0.0, 0.0, 1.0],
            half,
            perspective: true,
        }
    }

    pub fn orthographic(half: [f64; 2]) -> Rig {
        Rig {
            perspective: false,
            ..Rig::perspective(half)
        }
    }

    pub fn moved(self, position: [f64; 3]) -> Rig {
        Rig { position, ..self }
    }

    /// Turns the camera about its own axes: right, then up, then forward.
    pub fn turned(mut self, angles: [f64; 3]) -> Rig {
        let turn = |a: &mut [f64; 3], b: &mut [f64; 3], angle: f64| {
            let (s, c) = angle.sin_cos();
            let (p, q) = (*a, *b);
            *a = [0, 1, 2].map(|i| c * p[i] + s * q[i]);
            *b = [0, 1, 2].map(|i| c * q[i] - s * p[i]);
        };
        turn(&mut self.up, &mut self.forward, angles[0]);
        turn(&mut self.forward, &mut self.right, angles[1]);
        turn(&mut self.right, &mut self.up, angles[2]);
        self
    }

    /// Converts a point from camera space to world space.
    pub fn point(&self, c: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| {
            self.position[i] + c[0] * self.right[i] + c[1] * self.up[i] + c[2] * self.forward[i]
        })
    }

    /// The point in world space that is seen at (x, y) in a display window of this size.
    ///
    /// (x, y) is in pixels from the window's corner; `z` is the planar depth.
    pub fn seen_at(&self, [x, y]: [f64; 2], [width, height]: [f64; 2], z: f64) -> [f64; 3] {
        let spread = if self.perspective { z } else { 1.0 };
        let across = (2.0 * x / width - 1.0) * self.half[0] * spread;
        let upward = (1.0 - 2.0 * y / height) * self.half[1] * spread;
        self.point([across, upward, z])
    }

    pub fn camera(&self) -> Camera {
        let mut camera_from_world = [0.0; 16];
        for (i, axis) in [self.right, self.up, self.forward].into_iter().enumerate() {
            for k in 0..3 {
                camera_from_world[4 * k + i] = axis[k];
            }
            camera_from_world[12 + i] = -dot(self.position, axis);
        }
        camera_from_world[15] = 1.0;
        let [w, h] = self.half.map(|half| 0.5 / half);
        #[rustfmt::skip]
        let ndc_from_camera = if self.perspective {
            [
                w, 0.0, 0.0, 0.0,
                0.0, -h, 0.0, 0.0,
                0.5, 0.5, 1.0, 1.0,
                0.0, 0.0, -0.1, 0.0,
            ]
        } else {
            [
                w, 0.0, 0.0, 0.0,
                0.0, -h, 0.0, 0.0,
                0.0, 0.0, 1.0, 0.0,
                0.5, 0.5, 0.0, 1.0,
            ]
        };
        Camera {
            camera_from_world: Some(camera_from_world),
            ndc_from_world: Some(multiplied(&camera_from_world, &ndc_from_camera)),
        }
    }

    pub fn header(&self, name: &str, [width, height]: [u32; 2], kind: DepthKind) -> MapHeader {
        let mut map = MapHeader::new(name, width, height);
        map.depth_kind = kind;
        map.camera = self.camera();
        map
    }
}

/// Right, up and forward of the six faces of a cube: +x, -x, +y, -y, +z, -z.
pub const FACES: [[[f64; 3]; 3]; 6] = [
    [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
];

/// The faces of a cube around a point.
pub fn cube(position: [f64; 3]) -> [Rig; 6] {
    FACES.map(|[right, up, forward]| Rig {
        right,
        up,
        forward,
        ..Rig::perspective([1.0, 1.0]).moved(position)
    })
}

/// The face of a cube that a direction meets, and the place on it from 0 to 1.
///
/// The longest axis decides, as in cube maps.
pub fn by_longest_axis([x, y, z]: [f64; 3]) -> (usize, [f64; 2]) {
    let longest = x.abs().max(y.abs()).max(z.abs());
    let (face, across, down) = if x.abs() == longest {
        (if x > 0.0 { 0 } else { 1 }, -z * x.signum(), -y)
    } else if y.abs() == longest {
        (if y > 0.0 { 2 } else { 3 }, x, z * y.signum())
    } else {
        (if z > 0.0 { 4 } else { 5 }, x * z.signum(), -y)
    };
    (face, [across, down].map(|c| 0.5 + 0.5 * c / longest))
}

impl Random {
    /// A point with coordinates between `-reach` and `reach`.
    pub fn point(&mut self, reach: f64) -> [f64; 3] {
        [0; 3].map(|_| self.range(-reach, reach))
    }
}

/// A file of these maps and one group of all of them.
///
/// `pixel` yields the function of each pixel from the index of the map, x and y.
pub fn file(
    maps: &[MapHeader],
    role: GroupRole,
    mut pixel: impl FnMut(usize, u32, u32) -> Curve,
) -> CachedFile {
    let file = support::file(|w| {
        for (m, header) in maps.iter().enumerate() {
            let map = w.add_map(header.clone(), Encoding::default()).unwrap();
            for y in 0..header.height {
                for x in 0..header.width {
                    w.pixel(map, Pixel::new(x, y), &pixel(m, x, y)).unwrap();
                }
            }
        }
        let ids = (0..maps.len() as u32).map(MapId).collect();
        w.add_group(Group::new("all", role, ids));
    });
    TileCache::new(64 << 20).add(file)
}

/// A curve of one opaque surface.
pub fn wall(depth: f32) -> Curve {
    Curve::mono(vec![depth], vec![0.0]).unwrap()
}
