//! All surfaces of a scene, projected to a view as triangles.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::ribbon;
use crate::scene::{Scene, Shape, View};

/// A corner, projected to a view: x and y in pixels times w, w, and the depth along the view's
/// axis. The point lies on the ray through pixel (x / w, y / w). w is the depth for perspective
/// views, and 1 for parallel rays.
pub type Corner = [f64; 4];

/// The triangles of all surfaces, in the order of the scene.
#[derive(Debug, Default)]
pub struct Triangles {
    /// Three indices of corners in the triangle's part.
    pub indices: Vec<[u32; 3]>,
    /// The objects, each with its range of triangles.
    pub parts: Vec<Part>,
    /// Whether all rays start at one point.
    pub perspective: bool,
}

/// The triangles of one object.
#[derive(Clone, Debug)]
pub struct Part {
    /// Index of the object in the scene.
    pub object: usize,
    /// Its triangles.
    pub triangles: Range<usize>,
    /// Projected corners at each key. Keys divide the shutter evenly; a static object has one.
    pub keys: Vec<Vec<Corner>>,
}

/// A box of pixels: first and last pixel in x, then in y; empty if last < first.
pub type PixelBox = [i32; 4];

/// Tolerance for rounding at a box's border, in pixels.
const BORDER: f64 = 1e-3;

impl Triangles {
    /// Projects the surfaces of all objects that cast shadows.
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

    /// Box of each triangle over the whole shutter, clipped to `within`.
    pub fn boxes(&self, within: PixelBox) -> Vec<PixelBox> {
        let boxes = self.parts.par_iter().flat_map(|part| {
            let own = self.indices[part.triangles.clone()].par_iter();
            own.map(|triangle| {
                let mut all = ProjectedBounds::default();
                for corners in &part.keys {
                    triangle.iter().for_each(|&i| all.add(&corners[i as usize]));
                }
                all.pixels(within)
            })
        });
        boxes.collect()
    }
}

/// Bounding box of projected corners.
#[derive(Clone, Copy, Debug)]
pub struct ProjectedBounds {
    lo: [f64; 2],
    hi: [f64; 2],
    /// Whether some corners lie in front of the light, and some behind it.
    front: bool,
    behind: bool,
}

impl Default for ProjectedBounds {
    fn default() -> Self {
        ProjectedBounds {
            lo: [f64::INFINITY; 2],
            hi: [f64::NEG_INFINITY; 2],
            front: false,
            behind: false,
        }
    }
}

impl ProjectedBounds {
    /// Bounding box of some corners.
    pub fn of(corners: &[Corner]) -> Self {
        let mut reach = ProjectedBounds::default();
        corners.iter().for_each(|c| reach.add(c));
        reach
    }

    /// Pixels along the longer side, at most about 1e9. Ignores corners behind the light.
    pub fn size(&self) -> i64 {
        let axis = |a: usize| (self.hi[a] - self.lo[a]).clamp(0.0, 1e9) as i64 + 1;
        axis(0).max(axis(1))
    }

    /// Extends the box to a corner.
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

    /// The pixels of the box, clipped to `within`.
    pub fn pixels(&self, within: PixelBox) -> PixelBox {
        if !self.front {
            return [0, -1, 0, -1];
        }
        // A triangle that crosses the plane of the light may project to any pixel.
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

/// Projects a point of the world to a view.
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

/// The triangles of a shape, as indices into its [`world_points`].
///
/// A mesh has its own triangles, strands have two for each segment. If `a` and `b` are the indices
/// of the left border at the ends of a segment, they are (a, a + 1, b + 1) and (a, b + 1, b).
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

/// Points of an object in the world at one of its keys: the points of a mesh, or both borders of
/// each strand's ribbon. `facing` gives the direction of the light at a point.
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
