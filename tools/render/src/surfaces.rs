//! Surfaces of a scene in a bounding volume hierarchy: meshes, and strands as ribbons.
//!
//! Ribbons face the origin of the rays.

use deepshadow_scene::hits::triangles::{triangles, world_points};
use deepshadow_scene::scene::{Object, Scene, Shape};
use glam::DVec3;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};

use crate::triangle::meet;

/// Triangles in a hierarchy of boxes, each of which bounds its triangles over the whole shutter.
#[derive(Debug)]
pub struct Surfaces<'a> {
    parts: Vec<Part<'a>>,
    /// Part and corner indices of each triangle, in the order of the hierarchy.
    triangles: Vec<(u32, [u32; 3])>,
    bvh: CwBvh,
    /// Origin of the boxes, which are single precision: precision is best near the origin.
    centre: DVec3,
}

/// The triangles of one object.
#[derive(Debug)]
struct Part<'a> {
    object: &'a Object,
    /// Index of the object in the scene.
    number: usize,
    /// Corners relative to the centre, for each key of the shutter.
    keys: Vec<Vec<DVec3>>,
}

/// A hit of a ray on a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Distance from the ray's origin.
    pub t: f64,
    /// Index of the object in the scene.
    pub object: usize,
    /// Opacity of the surface at the hit.
    pub opacity: [f32; 3],
    /// Unit vector: the normal of a mesh, on either side, or the direction of a strand.
    pub way: DVec3,
    /// Whether the surface is a strand.
    pub strand: bool,
    /// Index of the triangle, to seed its random numbers.
    pub triangle: u32,
}

impl<'a> Surfaces<'a> {
    /// Collects the objects of a scene for which `takes` returns true.
    ///
    /// `facing` gives the direction of the rays at a point, of any length.
    pub fn new(
        scene: &'a Scene,
        takes: impl Fn(&Object) -> bool,
        facing: impl Fn(DVec3) -> DVec3 + Sync,
    ) -> Self {
        let objects = || scene.objects.iter().enumerate().filter(|(_, o)| takes(o));
        let solid = || objects().filter(|(_, o)| !matches!(o.shape, Shape::Volume(_)));
        let mut all: Option<(DVec3, DVec3)> = None;
        for (_, object) in solid() {
            object.points(|p| {
                let (lo, hi) = all.unwrap_or((p, p));
                all = Some((lo.min(p), hi.max(p)));
            });
        }
        let centre = all.map_or(DVec3::ZERO, |(lo, hi)| (lo + hi) / 2.0);
        let mut parts = Vec::new();
        let (mut list, mut boxes) = (Vec::new(), Vec::new());
        for (number, object) in solid() {
            let points = |key| {
                let mut points = world_points(object, key, &facing);
                points.iter_mut().for_each(|p| *p -= centre);
                points
            };
            let keys: Vec<_> = (0..object.keys()).map(points).collect();
            for triangle in triangles(&object.shape) {
                boxes.push(bounds(&keys, triangle));
                list.push((parts.len() as u32, triangle));
            }
            parts.push(Part {
                object,
                number,
                keys,
            });
        }
        let bvh = match list.is_empty() {
            true => CwBvh::default(),
            false => build_cwbvh(
                &boxes,
                BvhBuildParams::fast_build(),
                &mut Default::default(),
            ),
        };
        let order = bvh.primitive_indices.iter();
        Surfaces {
            triangles: order.map(|&i| list[i as usize]).collect(),
            parts,
            bvh,
            centre,
        }
    }

    /// Bytes of memory used.
    pub fn bytes(&self) -> usize {
        let corners: usize = self.parts.iter().flat_map(|p| &p.keys).map(Vec::len).sum();
        corners * size_of::<DVec3>()
            + self.triangles.len() * size_of::<(u32, [u32; 3])>()
            + self.bvh.nodes.len() * 80
            + self.bvh.primitive_indices.len() * 4
    }

    /// Calls `see` for the surfaces along a ray nearer than `far`, in any order.
    ///
    /// `time` is a time of the shutter. `way` has length 1. If `see` says that a surface ends the
    /// ray, calls for farther surfaces may or may not follow.
    pub fn along(
        &self,
        origin: DVec3,
        way: DVec3,
        time: f64,
        far: f64,
        mut see: impl FnMut(Hit) -> bool,
    ) {
        let mut nearest = far;
        self.rays(origin, way, time, far, |ray, t, hit| {
            if t >= nearest || !see(hit()) {
                return f32::INFINITY;
            }
            nearest = t;
            // Rounded up, so that boxes of hits at the same distance are still visited.
            (t as f32).next_up().min(ray.tmax.next_down())
        });
    }

    /// Transmittance of all surfaces along a ray that are nearer than `far`.
    ///
    /// `time` is a time of the shutter. `way` has length 1.
    pub fn transmittance(&self, origin: DVec3, way: DVec3, time: f64, far: f64) -> [f64; 3] {
        let mut light = [1.0; 3];
        if self.triangles.is_empty() {
            return light;
        }
        let start = origin - self.centre;
        self.bvh.ray_traverse_miss(ray(start, way, far), |_, i| {
            if let Some((t, weights)) = self.meets(i, start, way, time)
                && t >= 0.0
                && t < far
            {
                let opacity = self.opacity(i, weights);
                (0..3).for_each(|c| light[c] *= 1.0 - f64::from(opacity[c]));
                if light == [0.0; 3] {
                    return f32::NEG_INFINITY;
                }
            }
            f32::INFINITY
        });
        light
    }

    fn rays(
        &self,
        origin: DVec3,
        way: DVec3,
        time: f64,
        far: f64,
        mut each: impl FnMut(&Ray, f64, &dyn Fn() -> Hit) -> f32,
    ) {
        if self.triangles.is_empty() {
            return;
        }
        let start = origin - self.centre;
        let mut nearest = RayHit::none();
        self.bvh
            .ray_traverse(ray(start, way, far), &mut nearest, |ray, i| {
                match self.meets(i, start, way, time) {
                    Some((t, weights)) if t >= 0.0 && t < far => {
                        each(ray, t, &|| self.hit(i, t, weights, time))
                    }
                    _ => f32::INFINITY,
                }
            });
    }

    fn meets(&self, i: usize, start: DVec3, way: DVec3, time: f64) -> Option<(f64, [f64; 3])> {
        let (part, names) = self.triangles[i];
        let corners = corners(&self.parts[part as usize].keys, names, time);
        meet(start, way, corners, names).map(|m| (m.t, m.weights))
    }

    fn opacity(&self, i: usize, weights: [f64; 3]) -> [f32; 3] {
        let (part, names) = self.triangles[i];
        let object = self.parts[part as usize].object;
        let (Some(texture), Shape::Mesh(mesh)) = (&object.texture, &object.shape) else {
            return object.opacity;
        };
        if mesh.uvs.is_empty() {
            return object.opacity;
        }
        let uvs = names.map(|i| mesh.uvs[i as usize]);
        let at = [0, 1].map(|k| {
            let sum: f64 = (0..3).map(|c| weights[c] * f64::from(uvs[c][k])).sum();
            sum as f32
        });
        let texture = texture.at(at);
        std::array::from_fn(|c| object.opacity[c] * texture[c])
    }

    fn hit(&self, i: usize, t: f64, weights: [f64; 3], time: f64) -> Hit {
        let (number, names) = self.triangles[i];
        let part = &self.parts[number as usize];
        let strand = matches!(part.object.shape, Shape::Curves { .. });
        let way = if strand {
            // Both triangles of a segment contain its first corner and a corner of its end.
            let [a, b] = [names[0], names[2] & !1];
            let [a0, a1, b0] = corners(&part.keys, [a, a + 1, b], time);
            let [b1, ..] = corners(&part.keys, [b + 1; 3], time);
            b0 + b1 - a0 - a1
        } else {
            let [a, b, c] = corners(&part.keys, names, time);
            (b - a).cross(c - a)
        };
        Hit {
            t,
            object: part.number,
            opacity: self.opacity(i, weights),
            way: way.normalize_or_zero(),
            strand,
            triangle: i as u32,
        }
    }
}

fn ray(start: DVec3, way: DVec3, far: f64) -> Ray {
    // The hierarchy treats -0 as positive, but its inverse as negative. Adding 0 makes it +0.
    let single = |v: DVec3| (v.as_vec3() + 0.0).to_array().into();
    Ray::new(single(start), single(way), 0.0, (far as f32).next_up())
}

/// Corners at a time, interpolated linearly between evenly spaced keys of the shutter.
fn corners(keys: &[Vec<DVec3>], names: [u32; 3], time: f64) -> [DVec3; 3] {
    let at = |key: usize| names.map(|i| keys[key][i as usize]);
    if keys.len() == 1 {
        return at(0);
    }
    let place = time.clamp(0.0, 1.0) * (keys.len() - 1) as f64;
    let low = (place as usize).min(keys.len() - 2);
    let (a, b, t) = (at(low), at(low + 1), place - low as f64);
    std::array::from_fn(|c| a[c].lerp(b[c], t))
}

/// Bounding box of a triangle over the whole shutter, enlarged for single-precision rounding.
fn bounds(keys: &[Vec<DVec3>], triangle: [u32; 3]) -> Aabb {
    let points = || keys.iter().flat_map(|k| triangle.map(|i| k[i as usize]));
    let (lo, hi) = points().fold(
        (DVec3::INFINITY, DVec3::NEG_INFINITY),
        |(lo, hi), p: DVec3| (lo.min(p), hi.max(p)),
    );
    let more = 1e-6 * (lo.abs().max(hi.abs())).max_element().max(1e-30);
    let single = |v: DVec3| v.as_vec3().to_array().into();
    Aabb::new(single(lo - more), single(hi + more))
}

#[cfg(test)]
mod tests {
    use deepshadow_scene::geometry::{Curves, Mesh};
    use deepshadow_scene::scene::Texture;
    use glam::Vec3;

    use super::*;

    /// Two panes across z, at 1 and 2. The second moves right by 10 while the shutter is open.
    fn panes() -> Scene {
        let pane = |z: f32, x: f32| {
            let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
            corners
                .map(|[a, b]: [f32; 2]| Vec3::new(a + x, b, z))
                .to_vec()
        };
        let of = |sets: Vec<Vec<Vec3>>, opacity: [f32; 3]| Object {
            opacity,
            ..Object::new(
                "pane",
                Shape::Mesh(Mesh {
                    positions: sets,
                    triangles: vec![[0, 1, 2], [0, 2, 3]],
                    uvs: Vec::new(),
                }),
            )
        };
        let first = of(vec![pane(1.0, 0.0)], [0.5, 0.25, 1.0]);
        let second = of(vec![pane(2.0, 0.0), pane(2.0, 10.0)], [0.5; 3]);
        Scene {
            objects: vec![first, second],
            ..Scene::default()
        }
    }

    #[test]
    fn light_through_panes_is_the_product_of_what_each_lets_through_at_the_moment() {
        let scene = panes();
        let surfaces = Surfaces::new(&scene, |_| true, |_| DVec3::Z);
        let light = |time, far| surfaces.transmittance(DVec3::ZERO, DVec3::Z, time, far);
        assert_eq!(light(0.0, 9.0), [0.25, 0.375, 0.0]);
        // The second pane does not shadow itself.
        assert_eq!(light(0.0, 2.0), [0.5, 0.75, 0.0]);
        assert_eq!(light(0.0, 1.0), [1.0; 3]);
        assert_eq!(light(1.0, 9.0), [0.5, 0.75, 0.0]); // the second pane has moved away
    }

    #[test]
    fn a_texture_multiplies_opacity_where_it_lies() {
        let mut scene = panes();
        let pane = &mut scene.objects[0];
        pane.texture = Some(Texture {
            width: 2,
            height: 1,
            values: vec![[0.0; 3], [0.5; 3]], // transparent on the left
        });
        let Shape::Mesh(mesh) = &mut pane.shape else {
            unreachable!("a pane is a mesh");
        };
        mesh.uvs = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let surfaces = Surfaces::new(&scene, |_| true, |_| DVec3::Z);
        let light = |x: f64| surfaces.transmittance(DVec3::new(x, 0.1, 0.0), DVec3::Z, 0.0, 1.5);
        assert_eq!(light(-0.5), [1.0; 3]);
        assert_eq!(light(0.5), [0.75, 0.875, 0.5]);
    }

    #[test]
    fn a_surface_that_ends_the_ray_hides_what_is_behind_it() {
        let scene = panes();
        let surfaces = Surfaces::new(&scene, |_| true, |_| DVec3::Z);
        let mut seen = Vec::new();
        surfaces.along(DVec3::new(0.3, 0.1, 5.0), -DVec3::Z, 0.0, 9.0, |hit| {
            seen.push((hit.t, hit.object));
            true
        });
        let nearest = seen.iter().min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        assert_eq!(*nearest, (3.0, 1));
    }

    #[test]
    fn a_strand_is_met_over_its_width_and_says_where_it_goes() {
        let curves = Curves {
            points: vec![vec![Vec3::new(-1.0, 0.0, 3.0), Vec3::new(1.0, 0.0, 3.0)]],
            strands: vec![0, 2],
            widths: Vec::new(),
        };
        let hair = Object::new("hair", Shape::Curves { curves, width: 0.2 });
        let scene = Scene {
            objects: vec![hair],
            ..Scene::default()
        };
        let surfaces = Surfaces::new(&scene, |_| true, |p| p);
        let count = |y: f64| {
            let mut ways = Vec::new();
            surfaces.along(DVec3::new(0.1, y, 0.0), DVec3::Z, 0.0, 9.0, |hit| {
                ways.push(hit.way);
                true
            });
            ways
        };
        assert_eq!(count(0.09), [DVec3::X]);
        assert_eq!(count(-0.09), [DVec3::X]);
        assert!(count(0.11).is_empty());
    }
}
