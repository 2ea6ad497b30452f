//! All surfaces of a scene as triangles in the plane of a view.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::ribbon;
use crate::scene::{Scene, Shape, View};

/// A corner as a view sees it: x and y in pixels times w, w, and the depth along the view's axis. A point of the view at pixel (x, y) is on the ray through
/// (x / w, y / w); w is the depth for perspective views, 1 for parallel rays.
pub type Corner = [f64; 4];

/// Triangles of all surfaces, in the order of the scene.
#[derive(Debug, Default)]
pub struct Triangles {
    /// Three corners of its part each.
    pub indices: Vec<[u32; 3]>,
    /// Which triangles belong to which object.
    pub parts: Vec<Part>,
    /// Whether rays meet in one point.
    pub perspective: bool,
}

/// The triangles of one object.
#[derive(Clone, Debug)]
pub struct Part {
    /// The object's place in the scene.
    pub object: usize,
    /// Its triangles.
    pub triangles: Range<usize>,
    /// Its corners at each of its keys, which divide the shutter evenly; one for what stands still.
    pub keys: Vec<Vec<Corner>>,
}

/// What a triangle covers: first and last pixel in x, then in y; empty if last < first.
pub type PixelBox = [i32; 4];

/// A pixel's border is not lost to rounding: what is nearer to a box counts as inside.
const BORDER: f64 = 1e-3;

impl Triangles {
    /// The triangles of everything that casts a shadow.
    pub fn new(scene: &Scene, view: &View) -> Self {
        let solid = |o: &&crate::scene::Object| o.shadow && !matches!(o.shape, Shape::Volume(_));
        let mut all = Triangles {
            perspective: view.space.is_perspective(),
            ..Triangles::default()
        };
        let facing = |p| view.eye.ray(p);
        let objects = scene.objects.iter().enumerate();
        for (number, object) in objects.filter(|(_, o)| solid(o)) {
            let first = all.indices.len();
            let key = |key| {
                let points = world_points(object, key, &facing);
                points.par_iter().map(|&p| project(view, p)).collect()
            };
            all.indices.extend(triangles(&object.shape));
            all.parts.push(Part {
                object: number,
                triangles: first..all.indices.len(),
                keys: (0..object.keys()).map(key).collect(),
            });
        }
        all
    }

    /// Every triangle's box over the whole shutter, cut off at `within`.
    pub fn boxes(&self, within: PixelBox) -> Vec<PixelBox> {
        let boxes = self.parts.par_iter().flat_map(|part| {
            let own = self.indices[part.triangles.clone()].par_iter();
            own.map(|triangle| {
                let mut all = Reach::default();
                for corners in &part.keys {
                    triangle.iter().for_each(|&i| all.add(&corners[i as usize]));
                }
                all.pixels(within)
            })
        });
        boxes.collect()
    }
}

/// How far some corners reach in the plane of a view.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    lo: [f64; 2],
    hi: [f64; 2],
    /// Whether some lie in front of the light and some behind it.
    front: bool,
    behind: bool,
}

impl Default for Reach {
    fn default() -> Self {
        Reach {
            lo: [f64::INFINITY; 2],
            hi: [f64::NEG_INFINITY; 2],
            front: false,
            behind: false,
        }
    }
}

impl Reach {
    /// How far some corners reach.
    pub fn of(corners: &[Corner]) -> Self {
        let mut reach = Reach::default();
        corners.iter().for_each(|c| reach.add(c));
        reach
    }

    /// Pixels along the longer side, as far as it can be told.
    pub fn size(&self) -> i64 {
        let axis = |a: usize| (self.hi[a] - self.lo[a]).clamp(0.0, 1e9) as i64 + 1;
        axis(0).max(axis(1))
    }

    /// Takes in a corner.
    pub fn add(&mut self, corner: &Corner) {
        if corner[2] > 0.0 {
            self.front = true;
            for axis in 0..2 {
                let at = corner[axis] / corner[2];
                self.lo[axis] = self.lo[axis].min(at);
                self.hi[axis] = self.hi[axis].max(at);
            }
        } else {
            self.behind = true;
        }
    }

    /// The pixels inside `within` that lie between the corners.
    pub fn pixels(&self, within: PixelBox) -> PixelBox {
        if !self.front {
            return [0, -1, 0, -1];
        }
        // What passes the plane of the light can be anywhere.
        if self.behind || !self.lo.iter().chain(&self.hi).all(|v| v.is_finite()) {
            return within;
        }
        let pixel = |v: f64| v.clamp(-1e9, 1e9).floor() as i32;
        let axis = |a: usize| {
            [
                pixel(self.lo[a] - BORDER).max(within[2 * a]),
                pixel(self.hi[a] + BORDER).min(within[2 * a + 1]),
            ]
        };
        let [[x0, x1], [y0, y1]] = [axis(0), axis(1)];
        [x0, x1, y0, y1]
    }
}

/// A point of the world as a view sees it.
pub fn project(view: &View, p: DVec3) -> Corner {
    let [camera, ndc] = [view.camera.camera_from_world, view.camera.ndc_from_world]
        .map(|m| m.expect("a view has both matrices"));
    let column = |m: &[f64; 16], c: usize| p.x * m[c] + p.y * m[4 + c] + p.z * m[8 + c] + m[12 + c];
    let [width, height] = view.size.map(f64::from);
    [
        column(&ndc, 0) * width,
        column(&ndc, 1) * height,
        column(&ndc, 3),
        column(&camera, 2),
    ]
}

/// The triangles of a shape, by index into its [`world_points`]: of a mesh its own, of strands two for each segment. With `a` and `b` the
/// first borders of the ribbon at a segment's ends, those are a, a + 1, b + 1 and a, b + 1, b.
pub fn triangles(shape: &Shape) -> Vec<[u32; 3]> {
    match shape {
        Shape::Mesh(mesh) => mesh.triangles.clone(),
        Shape::Curves { curves, .. } => {
            let segments = curves.strands.windows(2).flat_map(|s| s[0]..s[1] - 1);
            segments
                .flat_map(|i| {
                    let [a, b] = [2 * i, 2 * i + 2];
                    [[a, a + 1, b + 1], [a, b + 1, b]]
                })
                .collect()
        }
        Shape::Volume(_) => Vec::new(),
    }
}

/// Points of an object in the world at one of its keys: a mesh's, or both borders of a strand's ribbon, across which the rays of `facing` fall.
pub fn world_points(
    object: &crate::scene::Object,
    key: usize,
    facing: &(impl Fn(DVec3) -> DVec3 + Sync),
) -> Vec<DVec3> {
    let to_world = object.world_from_object(key);
    match &object.shape {
        Shape::Mesh(mesh) => {
            let set = &mesh.positions[key.min(mesh.positions.len() - 1)];
            set.par_iter()
                .map(|p| to_world.transform_point3(p.as_dvec3()))
                .collect()
        }
        Shape::Curves { curves, width } => {
            let set = &curves.points[key.min(curves.points.len() - 1)];
            let scale = to_world.matrix3.determinant().abs().cbrt();
            let strands = curves.strands.par_windows(2).flat_map_iter(|strand| {
                let (begin, end) = (strand[0] as usize, strand[1] as usize);
                let points: Vec<_> = set[begin..end]
                    .iter()
                    .map(|p| to_world.transform_point3(p.as_dvec3()))
                    .collect();
                let width = |i: usize| {
                    let own = curves.widths.get(begin + i);
                    f64::from(*own.unwrap_or(width)) * scale
                };
                let mut out = Vec::with_capacity(2 * points.len());
                ribbon::borders(&points, width, facing, |p| out.push(p));
                out
            });
            strands.collect()
        }
        Shape::Volume(_) => Vec::new(),
    }
}
