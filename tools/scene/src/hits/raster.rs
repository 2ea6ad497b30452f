//! Intersects triangles with the rays of a block of pixels.
//!
//! A ray hits a triangle if three edge functions have the signs of its inside (Olano and Greer
//! 1997; in the plane of homogeneous pixels, so nothing is clipped at the light). An edge is always
//! computed from the same one of its two ends, so both adjacent triangles get the same number up to
//! its sign, and a ray that hits the edge exactly hits one of the two. Edges are computed in f64 at
//! the centre of a pixel, and in f32 from there; depths are computed in f64.
//!
//! Corners move in straight lines, so an edge function is a polynomial of second degree in time.

use std::ops::Range;

use wide::f32x8;

use super::triangles::{Corner, PixelBox, ProjectedBounds, Triangles};
use crate::samples::{LANES, Samples};

/// A hit of a ray on a translucent surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the ray: index of the pixel in the block times rays per pixel, plus the ray in the
    /// pixel.
    pub ray: u32,
    /// Depth along the view's axis.
    pub z: f32,
    /// Index of the surface's opacity in [`Block::opacities`].
    pub opacity: u32,
}

/// The rays of a block of pixels and their hits.
#[derive(Debug, Default)]
pub struct Block {
    /// First and last pixel in x, then in y.
    pub pixels: PixelBox,
    /// The rays.
    pub samples: Samples,
    /// Depth of the first opaque hit of each ray, or infinity.
    pub nearest: Vec<f32>,
    /// Hits on translucent surfaces, in the order of the triangles; some may lie behind the first
    /// opaque hit.
    pub hits: Vec<Hit>,
    /// Opacities: one for each part, then one for each stored hit on a textured surface.
    pub opacities: Vec<[f32; 3]>,
}

/// The opacity of surfaces.
pub trait Opacity {
    /// Index in [`Block::opacities`] of a part's opacity; `None` if it varies.
    fn uniform(&self, part: usize) -> Option<u32>;
    /// The opacity at a point of a triangle, given by the weights of its corners.
    fn at(&self, part: usize, corners: [u32; 3], weights: [f64; 3]) -> [f32; 3];
}

impl Block {
    /// Number of columns of pixels.
    pub fn columns(&self) -> usize {
        (self.pixels[1] - self.pixels[0] + 1) as usize
    }

    /// Removes all hits, and sets the opacities of the parts.
    pub fn clear(&mut self, uniform: &[[f32; 3]]) {
        let pixels = self.columns() * (self.pixels[3] - self.pixels[2] + 1) as usize;
        self.nearest.clear();
        self.nearest
            .resize(pixels * self.samples.count, f32::INFINITY);
        self.hits.clear();
        self.opacities.clear();
        self.opacities.extend_from_slice(uniform);
    }

    /// Index of a pixel in the block.
    pub fn number(&self, x: i32, y: i32) -> usize {
        (y - self.pixels[2]) as usize * self.columns() + (x - self.pixels[0]) as usize
    }

    /// Records the hit of a ray on a triangle, unless an opaque hit hides it.
    #[inline]
    fn record_hit<O: Opacity>(
        &mut self,
        ray: usize,
        z: f32,
        surface: &Surface<O>,
        corners: [&Corner; 3],
        place: [f64; 2],
    ) {
        let nearest = &mut self.nearest[ray];
        if z >= *nearest {
            return;
        }
        let number = surface.opacity.uniform(surface.part);
        let opacity = match number {
            Some(number) => self.opacities[number as usize],
            None => {
                let weights = weights(corners, place);
                surface.opacity.at(surface.part, surface.indices, weights)
            }
        };
        if opacity == [1.0; 3] {
            *nearest = z;
            return;
        }
        let opacity = number.unwrap_or_else(|| {
            self.opacities.push(opacity);
            self.opacities.len() as u32 - 1
        });
        self.hits.push(Hit {
            ray: ray as u32,
            z,
            opacity,
        });
    }

    /// Intersects the rays with the triangles in `list`, which are indices into `triangles`, in
    /// this order. Returns false, without finishing, if there are more than `most` hits.
    pub fn rasterise(
        &mut self,
        triangles: &Triangles,
        boxes: &[PixelBox],
        list: &[u32],
        opacity: &impl Opacity,
        most: usize,
    ) -> bool {
        let mut part = 0;
        for &index in list {
            let reach = boxes[index as usize];
            let [x0, x1, y0, y1] = self.pixels;
            let inside = [
                reach[0].max(x0),
                reach[1].min(x1),
                reach[2].max(y0),
                reach[3].min(y1),
            ];
            if inside[0] > inside[1] || inside[2] > inside[3] {
                continue;
            }
            while triangles.parts[part].triangles.end <= index as usize {
                part += 1;
            }
            let indices = triangles.indices[index as usize];
            let surface = Surface {
                part,
                indices,
                opacity,
                perspective: triangles.perspective,
            };
            if triangles.parts[part].keys.len() > 1 && !self.samples.time.is_empty() {
                self.rasterise_moving(&triangles.parts[part].keys, &surface, inside);
            } else {
                self.rasterise_static(
                    indices.map(|i| &triangles.parts[part].keys[0][i as usize]),
                    &surface,
                    inside,
                );
            }
            if self.hits.len() > most {
                return false;
            }
        }
        true
    }

    fn rasterise_static<O: Opacity>(
        &mut self,
        corners: [&Corner; 3],
        surface: &Surface<O>,
        inside: PixelBox,
    ) {
        let Some(plane) = Plane::new(corners, surface.perspective) else {
            return;
        };
        // Make all three edge functions positive inside. If an edge was reversed for that, its zero
        // is outside.
        let mut edges = [[0.0; 3]; 3];
        let mut least = [f32x8::ZERO; 3];
        for k in 0..3 {
            let (e, turned) = edge(corners[(k + 1) % 3], corners[(k + 2) % 3]);
            let turned = turned != plane.turned;
            let size = scale_to_one(&e) * if turned { -1.0 } else { 1.0 };
            edges[k] = e.map(|v| v * size);
            if turned {
                least[k] = f32x8::splat(f32::from_bits(1));
            }
        }
        let groups = self.samples.groups();
        let slopes = edges.map(|e| [e[0] as f32, e[1] as f32].map(f32x8::splat));
        for y in inside[2]..=inside[3] {
            for x in inside[0]..=inside[1] {
                let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                let at = edges.map(|e| e[0] * centre[0] + e[1] * centre[1] + e[2]);
                // The largest value of an edge function inside the pixel, rounding included.
                let out = |k: usize| {
                    let reach = 0.5 * (edges[k][0].abs() + edges[k][1].abs());
                    at[k] + reach * 1.0001 < 0.0
                };
                if out(0) || out(1) || out(2) {
                    continue;
                }
                let at = at.map(|v| f32x8::splat(v as f32));
                let pixel = self.number(x, y);
                for group in 0..groups {
                    let i = pixel * groups + group;
                    let (px, py) = (self.samples.x[i], self.samples.y[i]);
                    let side = |k: usize| {
                        (slopes[k][0] * px + slopes[k][1] * py + at[k]).simd_ge(least[k])
                    };
                    let mut mask = (side(0) & side(1) & side(2)).to_bitmask();
                    while mask != 0 {
                        let lane = mask.trailing_zeros() as usize;
                        mask &= mask - 1;
                        let local = [px, py].map(|p| f64::from(p.as_array()[lane]));
                        let place = [centre[0] + local[0], centre[1] + local[1]];
                        let ray = pixel * self.samples.count + group * LANES + lane;
                        if let Some(z) = plane.depth(place) {
                            self.record_hit(ray, z, surface, corners, place);
                        }
                    }
                }
            }
        }
    }

    /// As [`Block::rasterise_static`], for each interval between two keys.
    fn rasterise_moving<O: Opacity>(
        &mut self,
        path: &[Vec<Corner>],
        surface: &Surface<O>,
        inside: PixelBox,
    ) {
        let keys = path.len();
        let n = self.samples.count;
        let at = |key: usize| surface.indices.map(|i| &path[key][i as usize]);
        for key in 0..keys - 1 {
            let ends = [at(key), at(key + 1)];
            // Ray i of a pixel has its time in [i / n, (i + 1) / n).
            let piece = [key, key + 1].map(|k| k as f64 / (keys - 1) as f64);
            let rays = (piece[0] * n as f64).floor() as usize
                ..((piece[1] * n as f64).ceil() as usize).min(n);
            let [begin, end] = piece.map(|t| t as f32);
            let moving = Moving::new(ends, [begin, end, 1.0 / (end - begin)]);
            self.rasterise_interval(&moving, surface, inside, rays, &|ray| {
                ((ray as f64 / n as f64 - piece[0]) / (piece[1] - piece[0])).clamp(0.0, 1.0)
            });
        }
    }

    /// Halves an interval of the shutter until the triangle hardly moves within it, and skips
    /// intervals in which the triangle is outside the block.
    fn rasterise_interval<O: Opacity>(
        &mut self,
        moving: &Moving,
        surface: &Surface<O>,
        inside: PixelBox,
        rays: Range<usize>,
        time: &dyn Fn(usize) -> f64,
    ) {
        let ends = [rays.start, rays.end].map(|ray| moving.corners(time(ray)));
        let all = ProjectedBounds::of(ends.as_flattened());
        let here = all.pixels(inside);
        if here[0] > here[1] || here[2] > here[3] {
            return;
        }
        let middle = rays.start.midpoint(rays.end).next_multiple_of(LANES);
        if middle >= rays.end
            || all.size()
                <= 2 + 2 * ends
                    .map(|e| ProjectedBounds::of(&e).size())
                    .into_iter()
                    .max()
                    .unwrap_or(0)
        {
            return self.rasterise_slab(moving, surface, here, rays);
        }
        self.rasterise_interval(moving, surface, inside, rays.start..middle, time);
        self.rasterise_interval(moving, surface, inside, middle..rays.end, time);
    }

    fn rasterise_slab<O: Opacity>(
        &mut self,
        moving: &Moving,
        surface: &Surface<O>,
        inside: PixelBox,
        rays: Range<usize>,
    ) {
        let groups = self.samples.groups();
        let [begin, end, rate] = moving.interval.map(f32x8::splat);
        let slopes = moving
            .edges
            .map(|e| e.map(|e| [e[0] as f32, e[1] as f32].map(f32x8::splat)));
        for y in inside[2]..=inside[3] {
            for x in inside[0]..=inside[1] {
                let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                let at = moving.edges.map(|e| {
                    e.map(|e| f32x8::splat((e[0] * centre[0] + e[1] * centre[1] + e[2]) as f32))
                });
                let pixel = self.number(x, y);
                for group in rays.start / LANES..rays.end.div_ceil(LANES) {
                    let i = pixel * groups + group;
                    let (px, py) = (self.samples.x[i], self.samples.y[i]);
                    let time = self.samples.time[i];
                    let within = time.simd_ge(begin) & time.simd_lt(end);
                    let t = (time - begin) * rate;
                    let positive = |k: usize| {
                        let value = |order: usize| {
                            slopes[k][order][0] * px + slopes[k][order][1] * py + at[k][order]
                        };
                        ((value(2) * t + value(1)) * t + value(0))
                            .simd_ge(f32x8::ZERO)
                            .to_bitmask()
                    };
                    // A triangle may be seen from either side: all signs are those of the inside,
                    // or none.
                    let same = |k: usize| positive(k) ^ if moving.turned[k] { 0xff } else { 0 };
                    let (a, b, c) = (same(0), same(1), same(2));
                    let mut mask = (a & b & c | !(a | b | c)) & within.to_bitmask() & 0xff;
                    while mask != 0 {
                        let lane = mask.trailing_zeros() as usize;
                        mask &= mask - 1;
                        let number = group * LANES + lane;
                        if !rays.contains(&number) {
                            continue;
                        }
                        let local = [px, py].map(|p| f64::from(p.as_array()[lane]));
                        let place = [centre[0] + local[0], centre[1] + local[1]];
                        let now = moving.corners(f64::from(t.as_array()[lane]));
                        let now = [&now[0], &now[1], &now[2]];
                        let plane = Plane::new(now, surface.perspective);
                        if let Some(z) = plane.and_then(|p| p.depth(place)) {
                            let ray = pixel * self.samples.count + number;
                            self.record_hit(ray, z, surface, now, place);
                        }
                    }
                }
            }
        }
    }
}

/// A triangle's surface properties.
struct Surface<'a, O> {
    part: usize,
    indices: [u32; 3],
    opacity: &'a O,
    perspective: bool,
}

/// Barycentric weights of the corners at a point, in the plane of the triangle.
fn weights(corners: [&Corner; 3], [x, y]: [f64; 2]) -> [f64; 3] {
    let of = |k: usize| {
        let e = cross(corners[(k + 1) % 3], corners[(k + 2) % 3]);
        e[0] * x + e[1] * y + e[2]
    };
    let all = [of(0), of(1), of(2)];
    let sum = all[0] + all[1] + all[2];
    all.map(|w| {
        if sum == 0.0 {
            1.0 / 3.0
        } else {
            (w / sum).clamp(0.0, 1.0)
        }
    })
}

/// Depth as a function of the position in the view.
struct Plane {
    /// Coefficients of x, y and 1 of the depth, or of its reciprocal.
    linear: [f64; 3],
    reciprocal: bool,
    least: f64,
    most: f64,
    /// Whether the corners have the opposite orientation.
    turned: bool,
}

impl Plane {
    /// `None` for a triangle that is seen edge-on.
    fn new([a, b, c]: [&Corner; 3], perspective: bool) -> Option<Self> {
        let minus = |p: &Corner, q: &Corner| std::array::from_fn::<f64, 4, _>(|i| p[i] - q[i]);
        let (ab, ac) = (minus(b, a), minus(c, a));
        // The sum of the three edge functions, computed without cancellation.
        let sum = cross(&ab, &ac);
        let volume = a[0] * sum[0] + a[1] * sum[1] + a[2] * sum[2];
        if volume == 0.0 || !volume.is_finite() {
            return None;
        }
        let linear = if perspective {
            sum.map(|s| s / volume)
        } else {
            // z = a.z + p (x - a.x) + q (y - a.y), because all w are 1; the volume is twice the
            // area.
            let p = (ab[3] * ac[1] - ac[3] * ab[1]) / volume;
            let q = (ac[3] * ab[0] - ab[3] * ac[0]) / volume;
            [p, q, a[3] - p * a[0] - q * a[1]]
        };
        let depths = [a[3], b[3], c[3]];
        Some(Plane {
            linear,
            reciprocal: perspective,
            least: depths.into_iter().fold(f64::INFINITY, f64::min),
            most: depths.into_iter().fold(f64::NEG_INFINITY, f64::max),
            turned: volume < 0.0,
        })
    }

    /// Depth at a point, clamped to the depths of the corners. `None` behind the light, and if the
    /// depth is not finite in f32.
    #[inline]
    fn depth(&self, [x, y]: [f64; 2]) -> Option<f32> {
        let value = self.linear[0] * x + self.linear[1] * y + self.linear[2];
        if self.reciprocal && value <= 0.0 {
            return None;
        }
        let z = if self.reciprocal { 1.0 / value } else { value };
        let z = z.max(self.least).min(self.most) as f32;
        (z.is_finite() && (!self.reciprocal || z > 0.0)).then_some(z)
    }
}

/// A triangle in motion between two keys.
struct Moving {
    from: [Corner; 3],
    to: [Corner; 3],
    /// Edge functions: for each edge, the coefficients of time to the power of 0, 1 and 2.
    edges: [[[f64; 3]; 3]; 3],
    /// Whether each edge was reversed.
    turned: [bool; 3],
    /// Begin and end of the interval, and the reciprocal of its length.
    interval: [f32; 3],
}

impl Moving {
    fn new(ends: [[&Corner; 3]; 2], interval: [f32; 3]) -> Self {
        let mut edges = [[[0.0; 3]; 3]; 3];
        let mut turned = [false; 3];
        for k in 0..3 {
            let (mut i, mut j) = ((k + 1) % 3, (k + 2) % 3);
            turned[k] = [ends[0][i], ends[1][i]].partial_cmp(&[ends[0][j], ends[1][j]])
                == Some(std::cmp::Ordering::Greater);
            if turned[k] {
                std::mem::swap(&mut i, &mut j);
            }
            let (a, b) = (ends[0][i], ends[0][j]);
            let step =
                |k: usize| -> Corner { std::array::from_fn(|c| ends[1][k][c] - ends[0][k][c]) };
            let (da, db) = (step(i), step(j));
            let (first, second) = (cross(a, &db), cross(&da, b));
            let own = [
                cross(a, b),
                std::array::from_fn(|c| first[c] + second[c]),
                cross(&da, &db),
            ];
            let size = scale_to_one(own.as_flattened());
            edges[k] = own.map(|e| e.map(|v| v * size));
        }
        Moving {
            from: ends[0].map(|c| *c),
            to: ends[1].map(|c| *c),
            edges,
            turned,
            interval,
        }
    }

    fn corners(&self, t: f64) -> [Corner; 3] {
        std::array::from_fn(|k| between(&self.from[k], &self.to[k], t))
    }
}

fn between(a: &Corner, b: &Corner, t: f64) -> Corner {
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
}

/// The edge function from `a` to `b`, computed from the lesser of the two, and whether the edge was
/// reversed for that.
fn edge(a: &Corner, b: &Corner) -> ([f64; 3], bool) {
    match a.partial_cmp(b) {
        Some(std::cmp::Ordering::Greater) => (cross(b, a), true),
        _ => (cross(a, b), false),
    }
}

/// The power of two that scales the largest of some numbers to 1 or slightly above. Only the signs
/// of edge functions matter, so scaling lets f32 hold edges of any size; it changes no result that
/// f32 could hold without it.
fn scale_to_one(numbers: &[f64]) -> f64 {
    let most = numbers.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    if !most.is_normal() {
        return 1.0;
    }
    let exponent = most.to_bits() >> 52;
    f64::from_bits(2046u64.saturating_sub(exponent).max(1) << 52)
}

fn cross(a: &Corner, b: &Corner) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hits::triangles::Part;
    use crate::samples::Pattern;

    /// A texture of one colour.
    struct UniformTexture([f32; 3]);

    impl Opacity for UniformTexture {
        fn uniform(&self, _: usize) -> Option<u32> {
            None
        }

        fn at(&self, _: usize, _: [u32; 3], _: [f64; 3]) -> [f32; 3] {
            self.0
        }
    }

    #[test]
    fn only_stored_hits_on_a_texture_take_memory() {
        // Many layers over one pixel, the furthest first.
        let layers = 100u32;
        let corner = |i: u32| [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]][i as usize % 3];
        let corners = (0..3 * layers).map(|i| [corner(i)[0], corner(i)[1], 1.0, -f64::from(i / 3)]);
        let triangles = Triangles {
            indices: (0..layers).map(|t| [0, 1, 2].map(|k| 3 * t + k)).collect(),
            parts: vec![Part {
                object: 0,
                triangles: 0..layers as usize,
                keys: vec![corners.collect()],
            }],
            perspective: false,
        };
        let boxes = triangles.boxes([0, 0, 0, 0]);
        let list: Vec<_> = (0..layers).collect();
        let mut block = Block::default();
        Pattern::new(16, 0, false).fill(0..1, 0..1, &mut block.samples);
        for (opacity, kept) in [(1.0, 0), (0.5, 1600)] {
            block.clear(&[[0.0; 3]]);
            let surface = UniformTexture([opacity; 3]);
            block.rasterise(&triangles, &boxes, &list, &surface, usize::MAX);
            assert_eq!((block.opacities.len(), block.hits.len()), (kept + 1, kept));
        }
        block.clear(&[[0.0; 3]]);
        assert!(!block.rasterise(&triangles, &boxes, &list, &UniformTexture([0.5; 3]), 100));
    }

    #[test]
    fn numbers_of_any_size_are_scaled_to_one_or_slightly_above() {
        for most in [f64::MIN_POSITIVE, 1e-300, 1e-50, 0.3, 1.0, 7.0, 1e60, 1e300] {
            let near = most * scale_to_one(&[most / 3.0, -most, 0.0]);
            assert!((1.0..2.0).contains(&near), "{most} to {near}");
        }
        for none in [0.0, f64::INFINITY, f64::NAN] {
            assert_eq!(scale_to_one(&[none]), 1.0);
        }
    }
}
