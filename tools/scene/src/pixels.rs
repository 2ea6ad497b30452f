//! Computes the visibility functions of pixels from the hits of rays. A pixel is the sum of the
//! rays around it, weighted by the filter (LV00, section 3.2).

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use deepshadow::{Curve, DepthKind, Filter, Ray, Result, Sweep};

use crate::hits::medium::{March, Medium};
use crate::hits::raster::{Block, Opacity};
use crate::hits::triangles::{PixelBox, Triangles};
use crate::samples::Pattern;
use crate::scene::{Light, Object, Scene, Shape, View};

/// Most rays of a block, unless a single pixel and its filter need more.
const RAYS: usize = 1 << 16;
/// Most hits of a block before it is split into smaller ones.
const HITS: usize = 1 << 22;

/// Everything needed to compute the functions of any pixel of a view.
#[derive(Debug)]
pub struct Pixels<'a> {
    view: &'a View,
    /// The surfaces.
    pub triangles: &'a Triangles,
    /// The box of each triangle, by index.
    pub boxes: &'a [PixelBox],
    media: Vec<Medium<'a>>,
    surfaces: Surfaces<'a>,
    pattern: Pattern,
    filter: Filter,
    width: f32,
    /// Reach of the filter beyond a pixel's border, in whole pixels.
    margin: i32,
    /// Largest error of a transmittance function that is flattened to a curve.
    chord: f64,
    /// Statistics of the work so far.
    pub work: Work,
}

/// Counts and times, summed over all threads.
#[derive(Debug, Default)]
pub struct Work {
    /// Rays shot, counted once for each block they contribute to.
    pub rays: AtomicU64,
    /// Hits on surfaces, not counting hits behind opaque ones.
    pub hits: AtomicU64,
    /// Vertices of the functions.
    pub vertices: AtomicU64,
    /// Nanoseconds spent on rays and their intersections.
    pub shooting: AtomicU64,
    /// Nanoseconds spent on transmittance functions and their sums.
    pub summing: AtomicU64,
}

/// Buffers of one thread, reused for every block.
#[derive(Debug, Default)]
pub struct Worker {
    block: Block,
    begins: Vec<u32>,
    order: Vec<u32>,
    march: March,
    ray: Ray,
    sweep: Sweep,
    functions: Vec<Curve>,
}

impl<'a> Pixels<'a> {
    /// Prepares the pixels of a view.
    pub fn new(
        scene: &'a Scene,
        light: &Light,
        view: &'a View,
        triangles: &'a Triangles,
        boxes: &'a [PixelBox],
    ) -> Self {
        Pixels {
            media: Medium::of(scene),
            surfaces: Surfaces::new(scene, triangles),
            pattern: Pattern::new(light.samples, scene.seed, scene.moves()),
            filter: light.filter,
            width: light.filter_width,
            margin: light.margin(),
            chord: light.tolerance() / 32.0,
            view,
            triangles,
            boxes,
            work: Work::default(),
        }
    }

    /// The box of each medium, clipped to `within`.
    pub fn media_boxes(&self, within: PixelBox) -> Vec<PixelBox> {
        self.media
            .iter()
            .map(|m| m.pixels(self.view, within))
            .collect()
    }

    /// Side of the square blocks that divide a tile of side `tile`.
    pub fn block_side(&self, tile: i32) -> i32 {
        let fits = |side: i32| {
            let side = (side + 2 * self.margin) as usize;
            side * side * self.pattern.count() <= RAYS
        };
        let mut side = tile;
        while side > 1 && !fits(side) {
            side /= 2;
        }
        side
    }

    /// The visibility functions of the pixels in a box, row by row.
    ///
    /// `list` must contain every triangle that these pixels and the filter's margin see; it may
    /// contain more.
    ///
    /// # Errors
    /// As [`Ray`] and [`Sweep`].
    pub fn functions(
        &self,
        pixels: PixelBox,
        list: &[u32],
        worker: &mut Worker,
    ) -> Result<Vec<Curve>> {
        let [x0, x1, y0, y1] = pixels;
        let single = x0 == x1 && y0 == y1;
        // A single pixel cannot be split, however many hits it has.
        let most = if single { usize::MAX } else { HITS };
        if !self.shoot(pixels, list, most, worker) {
            return self.split(pixels, list, worker);
        }
        self.work
            .rays
            .fetch_add(worker.block.nearest.len() as u64, Ordering::Relaxed);
        let started = Instant::now();
        worker.sort();
        let opaque = worker.block.nearest.iter().filter(|z| z.is_finite());
        let hits = worker.order.len() + opaque.count();
        self.work.hits.fetch_add(hits as u64, Ordering::Relaxed);
        let functions = self.sums(pixels, worker)?;
        let vertices = functions.iter().map(|f| f.len() as u64).sum();
        self.work.vertices.fetch_add(vertices, Ordering::Relaxed);
        self.work
            .summing
            .fetch_add(nanoseconds(started), Ordering::Relaxed);
        Ok(functions)
    }

    /// Intersects the rays of some pixels and their margin with surfaces. Returns false if there
    /// are more than `most` hits.
    fn shoot(
        &self,
        [x0, x1, y0, y1]: PixelBox,
        list: &[u32],
        most: usize,
        worker: &mut Worker,
    ) -> bool {
        let m = self.margin;
        let started = Instant::now();
        let block = &mut worker.block;
        block.pixels = [x0 - m, x1 + m, y0 - m, y1 + m];
        self.pattern
            .fill(x0 - m..x1 + m + 1, y0 - m..y1 + m + 1, &mut block.samples);
        block.clear(&self.surfaces.uniform);
        let fits = block.rasterise(self.triangles, self.boxes, list, &self.surfaces, most);
        self.work
            .shooting
            .fetch_add(nanoseconds(started), Ordering::Relaxed);
        fits
    }

    /// The rays that [`Pixels::functions`] sums for a pixel, with their weights; for tests. `list`
    /// as for [`Pixels::functions`].
    ///
    /// # Errors
    /// As [`Ray`].
    pub fn rays(
        &self,
        x: i32,
        y: i32,
        list: &[u32],
        worker: &mut Worker,
    ) -> Result<Vec<(f64, Ray)>> {
        self.shoot([x, x, y, y], list, usize::MAX, worker);
        worker.sort();
        let m = self.margin;
        let mut out = Vec::new();
        for dy in -m..=m {
            for dx in -m..=m {
                let first = worker.block.number(x + dx, y + dy) * self.pattern.count();
                for ray in first..first + self.pattern.count() {
                    let weight = self.weight(&worker.block, ray, dx, dy);
                    if weight != 0.0 {
                        self.ray(ray, worker)?;
                        out.push((weight, worker.ray.clone()));
                    }
                }
            }
        }
        Ok(out)
    }

    /// As [`Pixels::functions`], but in two halves, because the whole has too many hits.
    fn split(
        &self,
        [x0, x1, y0, y1]: PixelBox,
        list: &[u32],
        worker: &mut Worker,
    ) -> Result<Vec<Curve>> {
        if y0 < y1 {
            let middle = y0 + (y1 - y0) / 2;
            let mut all = self.functions([x0, x1, y0, middle], list, worker)?;
            all.extend(self.functions([x0, x1, middle + 1, y1], list, worker)?);
            return Ok(all);
        }
        let middle = x0 + (x1 - x0) / 2;
        let mut all = self.functions([x0, middle, y0, y1], list, worker)?;
        all.extend(self.functions([middle + 1, x1, y0, y1], list, worker)?);
        Ok(all)
    }

    fn sums(&self, [x0, x1, y0, y1]: PixelBox, worker: &mut Worker) -> Result<Vec<Curve>> {
        // Compute functions that several pixels share once. Do not keep those of a single pixel: it
        // may have many millions.
        let shared = self.margin > 0 && (x0, y0) != (x1, y1);
        if shared {
            let all = worker.block.nearest.len();
            worker
                .functions
                .resize_with(worker.functions.len().max(all), Curve::default);
            for ray in 0..all {
                self.ray(ray, worker)?;
                worker.ray.flatten(self.chord, &mut worker.functions[ray]);
            }
        }
        let mut out = Vec::with_capacity(((x1 - x0 + 1) * (y1 - y0 + 1)) as usize);
        for y in y0..=y1 {
            for x in x0..=x1 {
                self.sum_around(x, y, shared, worker)?;
                let mut function = Curve::default();
                worker.sweep.finish(&mut function)?;
                out.push(function);
            }
        }
        Ok(out)
    }

    /// Sums the rays within reach of a pixel's filter. If `shared`, their functions are already
    /// computed.
    fn sum_around(&self, x: i32, y: i32, shared: bool, worker: &mut Worker) -> Result<()> {
        let m = self.margin;
        let rays = self.pattern.count();
        for dy in -m..=m {
            for dx in -m..=m {
                let first = worker.block.number(x + dx, y + dy) * rays;
                for ray in first..first + rays {
                    let weight = self.weight(&worker.block, ray, dx, dy);
                    if weight == 0.0 {
                        continue;
                    }
                    if shared {
                        worker.sweep.add(&worker.functions[ray], weight)?;
                    } else {
                        self.ray(ray, worker)?;
                        worker.sweep.add_ray(&worker.ray, self.chord, weight)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Weight of a ray in a pixel whose own pixel is at offset (dx, dy) from it.
    fn weight(&self, block: &Block, ray: usize, dx: i32, dy: i32) -> f64 {
        let rays = self.pattern.count();
        if self.filter == Filter::Nearest || self.filter == Filter::Box && self.width == 1.0 {
            return if (dx, dy) == (0, 0) { 1.0 } else { 0.0 };
        }
        let [x, y] = block.samples.place(ray / rays, ray % rays);
        let at = |p: f32, d: i32| f64::from(self.filter.weight((p + d as f32) / self.width));
        at(x, dx) * at(y, dy)
    }

    /// Computes the transmittance function of a ray from everything it intersects.
    fn ray(&self, ray: usize, worker: &mut Worker) -> Result<()> {
        let block = &worker.block;
        let out = &mut worker.ray;
        out.clear();
        let first = worker.begins[ray] as usize..worker.begins[ray + 1] as usize;
        let nearest = block.nearest[ray];
        if self.media.is_empty() && first.is_empty() && nearest == f32::INFINITY {
            return Ok(());
        }
        let distance = self.view.depth == DepthKind::RayDistance && self.triangles.perspective;
        let (mut line, mut longer) = (None, 1.0);
        if distance || !self.media.is_empty() {
            let (origin, way) = self.line(block, ray);
            longer = if distance { way.length() } else { 1.0 };
            line = Some((origin, way / longer));
        }
        let depth = |z: f32| {
            if distance {
                ((f64::from(z) * longer) as f32).min(f32::MAX)
            } else {
                z
            }
        };
        for &hit in &worker.order[first] {
            let hit = block.hits[hit as usize];
            let opacity = block.opacities[hit.opacity as usize];
            match opacity {
                [r, g, b] if r == g && g == b => out.surface(depth(hit.z), r)?,
                opacity => out.surface(depth(hit.z), opacity)?,
            }
        }
        if nearest < f32::INFINITY {
            out.surface(depth(nearest), 1.0)?;
        }
        if let Some(line) = line {
            let (place, number) = (ray / self.pattern.count(), ray % self.pattern.count());
            let time = f64::from(block.samples.moment(place, number));
            let near = if self.triangles.perspective {
                f64::MIN_POSITIVE
            } else {
                f64::MIN
            };
            let range = (near, f64::from(depth(nearest)));
            for medium in &self.media {
                medium.march(line, time, range, &mut worker.march, out)?;
            }
        }
        Ok(())
    }

    fn line(&self, block: &Block, ray: usize) -> crate::scene::light::Line {
        let (pixel, number) = (ray / self.pattern.count(), ray % self.pattern.count());
        let [dx, dy] = block.samples.place(pixel, number);
        let (column, row) = (pixel % block.columns(), pixel / block.columns());
        let x = f64::from(block.pixels[0] + column as i32) + 0.5 + f64::from(dx);
        let y = f64::from(block.pixels[2] + row as i32) + 0.5 + f64::from(dy);
        self.view.eye.line(x, y)
    }
}

impl Worker {
    /// Sorts the hits by ray, keeping their order, and drops hits behind an opaque surface.
    fn sort(&mut self) {
        let Block { nearest, hits, .. } = &self.block;
        let visible = |hit: &crate::hits::raster::Hit| hit.z < nearest[hit.ray as usize];
        self.begins.clear();
        self.begins.resize(nearest.len() + 1, 0);
        for hit in hits.iter().filter(|h| visible(h)) {
            self.begins[hit.ray as usize + 1] += 1;
        }
        for ray in 0..nearest.len() {
            self.begins[ray + 1] += self.begins[ray];
        }
        self.order.clear();
        self.order.resize(self.begins[nearest.len()] as usize, 0);
        for (i, hit) in hits.iter().enumerate().filter(|(_, h)| visible(h)) {
            let next = &mut self.begins[hit.ray as usize];
            self.order[*next as usize] = i as u32;
            *next += 1;
        }
        // Each entry has advanced to the beginning of the next one.
        self.begins.rotate_right(1);
        self.begins[0] = 0;
    }
}

fn nanoseconds(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// The opacities of a scene's surfaces.
#[derive(Debug)]
struct Surfaces<'a> {
    objects: Vec<&'a Object>,
    uniform: Vec<[f32; 3]>,
}

impl<'a> Surfaces<'a> {
    fn new(scene: &'a Scene, triangles: &Triangles) -> Self {
        let objects: Vec<_> = triangles
            .parts
            .iter()
            .map(|p| &scene.objects[p.object])
            .collect();
        Surfaces {
            uniform: objects.iter().map(|o| o.opacity).collect(),
            objects,
        }
    }
}

impl Opacity for Surfaces<'_> {
    fn uniform(&self, part: usize) -> Option<u32> {
        let textured = match &self.objects[part].shape {
            Shape::Mesh(mesh) => self.objects[part].texture.is_some() && !mesh.uvs.is_empty(),
            _ => false,
        };
        (!textured).then_some(part as u32)
    }

    fn at(&self, part: usize, corners: [u32; 3], weights: [f64; 3]) -> [f32; 3] {
        let object = self.objects[part];
        let (Shape::Mesh(mesh), Some(texture)) = (&object.shape, &object.texture) else {
            return object.opacity;
        };
        let mut uv = [0.0f32; 2];
        for (corner, weight) in corners.into_iter().zip(weights) {
            let own = mesh.uvs[corner as usize];
            uv = [0, 1].map(|i| uv[i] + own[i] * weight as f32);
        }
        let texture = texture.at(uv);
        std::array::from_fn(|c| object.opacity[c] * texture[c])
    }
}
