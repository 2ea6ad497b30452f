//! Traces one camera ray: finds surfaces and media along it and adds up their light.

use std::time::{Duration, Instant};

use deepshadow_frame::Result;
use deepshadow_scene::demo::hash::Hash;
use deepshadow_scene::hits::medium::Medium;
use deepshadow_scene::scene::{Scene, Shape};
use glam::DVec3;

use crate::camera::Camera;
use crate::lamp::{Asked, Lamp};
use crate::shade::{self, AMBIENT};
use crate::shadow::{Asker, Shadows};
use crate::surfaces::{Hit, Surfaces};

/// Transmittance below which a ray ends.
const DARK: f64 = 1e-4;

/// A scene prepared for camera rays.
#[derive(Debug)]
pub struct World<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    surfaces: Surfaces<'a>,
    /// Media with the indices of their objects.
    media: Vec<(usize, Medium<'a>)>,
    lamps: &'a [Lamp<'a>],
    shadows: &'a Shadows<'a>,
    /// Whether to render the fraction of light that arrives instead of colours.
    shadow_only: bool,
}

/// Buffers and counters of one thread.
#[derive(Debug)]
pub struct Tracer {
    asker: Asker,
    hits: Vec<Hit>,
    slabs: Vec<Slab>,
    march: Vec<(f32, [f32; 3])>,
    /// Work done so far.
    pub work: Work,
    timed: bool,
}

/// Counts of rays and lookups, and time of lookups.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Camera rays.
    pub rays: u64,
    /// Shadow lookups.
    pub lookups: u64,
    /// Time spent in lookups.
    pub looking_up: Duration,
}

/// A piece of a ray in a medium, with linear extinction.
#[derive(Clone, Copy, Debug)]
struct Slab {
    from: f64,
    to: f64,
    extinction: [[f64; 3]; 2],
    object: usize,
}

impl Slab {
    /// Splits the piece at a distance.
    fn cut(&self, at: f64) -> (Slab, Slab) {
        let t = (at - self.from) / (self.to - self.from);
        let [a, b] = self.extinction;
        let middle = std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t);
        let (mut front, mut back) = (*self, *self);
        (front.to, front.extinction[1]) = (at, middle);
        (back.from, back.extinction[0]) = (at, middle);
        (front, back)
    }
}

/// Light and transmittance of a ray so far.
struct Gathered {
    colour: [f64; 3],
    /// Transmittance so far.
    left: [f64; 3],
}

impl Gathered {
    /// Composites a contribution of this colour with transmittance `through`.
    fn put(&mut self, colour: [f64; 3], through: [f64; 3]) {
        for c in 0..3 {
            self.colour[c] += self.left[c] * (1.0 - through[c]) * colour[c];
            self.left[c] *= through[c];
        }
    }

    fn is_dark(&self) -> bool {
        self.left.iter().all(|&v| v < DARK)
    }
}

/// A camera ray.
struct View {
    way: DVec3,
    time: f64,
    chance: Hash,
    /// Number of points shaded so far.
    asked: u64,
}

impl<'a> World<'a> {
    /// Prepares a scene for rays of a camera.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        lamps: &'a [Lamp<'a>],
        shadows: &'a Shadows<'a>,
        shadow_only: bool,
    ) -> Self {
        let eye = camera.position;
        let objects = scene.objects.iter().enumerate();
        let media = objects.filter_map(|(i, object)| match &object.shape {
            Shape::Volume(volume) => Some((i, Medium::new(object, volume))),
            _ => None,
        });
        World {
            surfaces: Surfaces::new(scene, |_| true, |p| p - eye),
            media: media.collect(),
            scene,
            camera,
            lamps,
            shadows,
            shadow_only,
        }
    }

    /// Makes the buffers of one thread. `timed` measures lookups, with two clock reads per lookup.
    ///
    /// # Errors
    /// As [`Shadows::asker`].
    pub fn tracer(&self, timed: bool) -> Result<Tracer> {
        Ok(Tracer {
            asker: self.shadows.asker()?,
            hits: Vec::new(),
            slabs: Vec::new(),
            march: Vec::new(),
            work: Work::default(),
            timed,
        })
    }

    /// Colour of a ray in direction `way`, of length 1, at a time of the shutter.
    ///
    /// All random numbers come from `chance`.
    ///
    /// Surfaces and pieces of media are composited from front to back. Overlapping pieces of media
    /// are composited in the order of their starts: their transmittance is exact, their brightness
    /// correct to within a piece.
    ///
    /// # Errors
    /// Those of lookups.
    pub fn colour(
        &self,
        way: DVec3,
        time: f64,
        chance: Hash,
        tracer: &mut Tracer,
    ) -> Result<[f64; 3]> {
        tracer.work.rays += 1;
        let mut view = View {
            way,
            time,
            chance,
            asked: 0,
        };
        self.meet(&view, tracer);
        let mut all = Gathered {
            colour: [0.0; 3],
            left: [1.0; 3],
        };
        let (hits, slabs) = (
            std::mem::take(&mut tracer.hits),
            std::mem::take(&mut tracer.slabs),
        );
        let mut next = 0;
        for slab in &slabs {
            let mut slab = *slab;
            while next < hits.len() && hits[next].t < slab.to && !all.is_dark() {
                if hits[next].t > slab.from {
                    let (front, back) = slab.cut(hits[next].t);
                    self.medium(&front, &mut view, &mut all, tracer)?;
                    slab = back;
                }
                self.surface(&hits[next], &mut view, &mut all, tracer)?;
                next += 1;
            }
            if all.is_dark() {
                break;
            }
            self.medium(&slab, &mut view, &mut all, tracer)?;
        }
        for hit in &hits[next..] {
            if all.is_dark() {
                break;
            }
            self.surface(hit, &mut view, &mut all, tracer)?;
        }
        (tracer.hits, tracer.slabs) = (hits, slabs);
        if self.shadow_only {
            // A ray that hits nothing is fully lit.
            all.put([1.0; 3], [0.0; 3]);
        }
        Ok(all.colour)
    }

    /// Finds surfaces up to the first opaque one, and the pieces of media in front of it.
    fn meet(&self, view: &View, tracer: &mut Tracer) {
        let (hits, slabs, march) = (&mut tracer.hits, &mut tracer.slabs, &mut tracer.march);
        hits.clear();
        slabs.clear();
        let eye = self.camera.position;
        let mut end = f64::INFINITY;
        self.surfaces
            .along(eye, view.way, view.time, f64::INFINITY, |hit| {
                hits.push(hit);
                let opaque = hit.opacity == [1.0; 3];
                if opaque {
                    end = end.min(hit.t);
                }
                opaque
            });
        hits.retain(|h| h.t <= end);
        hits.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.triangle.cmp(&b.triangle)));
        for (i, (object, medium)) in self.media.iter().enumerate() {
            // Each ray has its own sample offset, which turns banding into noise.
            let step = medium.step(view.way, view.time);
            let shift = step * f64::from(view.chance.at(1).unit(i as u64));
            let line = (eye - view.way * shift, view.way);
            medium.along(line, view.time, (shift, end + shift), march);
            slabs.extend(march.windows(2).filter_map(|pair| {
                let extinction = [pair[0].1, pair[1].1].map(|k| k.map(f64::from));
                (extinction != [[0.0; 3]; 2]).then_some(Slab {
                    from: f64::from(pair[0].0) - shift,
                    to: f64::from(pair[1].0) - shift,
                    extinction,
                    object: *object,
                })
            }));
        }
        if self.media.len() > 1 {
            slabs.sort_by(|a, b| a.from.total_cmp(&b.from));
        }
    }

    fn surface(
        &self,
        hit: &Hit,
        view: &mut View,
        all: &mut Gathered,
        tracer: &mut Tracer,
    ) -> Result<()> {
        let own = self.scene.objects[hit.object].color.map(f64::from);
        let through = hit.opacity.map(|o| 1.0 - f64::from(o));
        let reflects = |to_light: DVec3| match hit.strand {
            true => shade::strand(hit.way, to_light, -view.way),
            false => shade::lambert(hit.way, to_light, -view.way),
        };
        let mut colour = own.map(|v| v * AMBIENT);
        let mut fraction = [0.0; 3];
        for number in 0..self.lamps.len() {
            let lamp = &self.lamps[number];
            let point = self.camera.position + view.way * hit.t;
            let reflected = reflects(-lamp.way(point));
            if !self.shadow_only && reflected.own == 0.0 && reflected.plain == 0.0 {
                continue;
            }
            view.asked += 1;
            let light = self.light(number, hit.t, true, view, tracer)?;
            for c in 0..3 {
                let brightness = f64::from(light[c]) * f64::from(lamp.light.color[c]);
                colour[c] += brightness * (own[c] * reflected.own + reflected.plain);
                fraction[c] += f64::from(light[c]);
            }
        }
        all.put(self.shown(colour, fraction), through);
        Ok(())
    }

    /// Light that a piece of a medium scatters towards the eye: single, isotropic scattering.
    ///
    /// The medium scatters all light that it stops, in its own colour.
    fn medium(
        &self,
        slab: &Slab,
        view: &mut View,
        all: &mut Gathered,
        tracer: &mut Tracer,
    ) -> Result<()> {
        let length = slab.to - slab.from;
        let [a, b] = slab.extinction;
        let through = std::array::from_fn(|c| (-(a[c] + b[c]) / 2.0 * length).exp());
        if through == [1.0; 3] {
            return Ok(());
        }
        view.asked += 1;
        let place = f64::from(view.chance.at(2).unit(view.asked));
        let own = self.scene.objects[slab.object].color.map(f64::from);
        let mut colour = own.map(|v| v * AMBIENT);
        let mut fraction = [0.0; 3];
        for number in 0..self.lamps.len() {
            // A medium has no steps, so it needs no bias.
            let t = slab.from + length * place;
            let light = self.light(number, t, false, view, tracer)?;
            for c in 0..3 {
                let brightness = f64::from(self.lamps[number].light.color[c]);
                colour[c] += f64::from(light[c]) * brightness * own[c];
                fraction[c] += f64::from(light[c]);
            }
        }
        all.put(self.shown(colour, fraction), through);
        Ok(())
    }

    /// The colour, or the fraction of light averaged over all lights.
    fn shown(&self, colour: [f64; 3], fraction: [f64; 3]) -> [f64; 3] {
        match (self.shadow_only, self.lamps.len()) {
            (false, _) => colour,
            (true, 0) => [1.0; 3],
            (true, n) => fraction.map(|f| f / n as f64),
        }
    }

    /// Fraction of a light that reaches a point of a ray, on a surface or in a medium.
    fn light(
        &self,
        number: usize,
        t: f64,
        surface: bool,
        view: &View,
        tracer: &mut Tracer,
    ) -> Result<[f32; 3]> {
        let lamp = &self.lamps[number];
        let point = self.camera.position + view.way * t;
        let width = lamp.footprint(point, self.camera.width(view.way, t));
        let asked = Asked {
            point,
            width,
            bias: if surface { lamp.bias(width) } else { 0.0 },
            time: view.time,
            key: view.chance.at(3 + number as u64).at(view.asked).bits(),
        };
        tracer.work.lookups += 1;
        let started = tracer.timed.then(Instant::now);
        let light = self
            .shadows
            .light(&mut tracer.asker, lamp, number, &asked)?;
        if let Some(started) = started {
            tracer.work.looking_up += started.elapsed();
        }
        Ok(light)
    }
}
