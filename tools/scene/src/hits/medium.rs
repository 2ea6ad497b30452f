//! Samples the extinction along a ray through a volume (LV00, section 3.2).

use deepshadow::Ray;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::triangles::{PixelBox, ProjectedBounds, project};
use crate::geometry::Grid;
use crate::scene::light::Line;
use crate::scene::{Object, Scene, Shape, View, Volume};
use crate::transfer::TransferFunction;

/// Side of a block of cells, in cells. A block without extinction is skipped.
const BLOCK_SIDE: usize = 8;

/// Optical depth at which the remaining light is below the precision of an f64 near 1.
const MAX_OPTICAL_DEPTH: f64 = 37.0;

/// A volume, prepared for ray marching.
#[derive(Debug)]
pub struct Medium<'a> {
    grid: &'a Grid,
    transfer: &'a TransferFunction,
    /// The transfer function, if it is a grey ramp.
    ramp: Option<Ramp>,
    coloured: bool,
    /// Transforms from cells to the world, at the keys of the shutter.
    motion: Vec<DAffine3>,
    /// Distance between samples, in cells. The number of samples along a ray is therefore bounded
    /// by the diagonal of the grid, however the object is scaled.
    step: f64,
    /// Number of blocks along each axis.
    blocks: [usize; 3],
    /// Whether each block has no extinction.
    empty: Vec<bool>,
}

/// Buffers for the samples of a march, kept for reuse.
#[derive(Debug, Default)]
pub struct March {
    mono: Vec<(f32, f32)>,
    rgb: Vec<(f32, [f32; 3])>,
}

impl<'a> Medium<'a> {
    /// The media of a scene that cast shadows.
    pub fn of(scene: &'a Scene) -> Vec<Self> {
        let volume = |object: &'a Object| match &object.shape {
            Shape::Volume(volume) if object.shadow => Some(Medium::new(object, volume)),
            _ => None,
        };
        scene.objects.iter().filter_map(volume).collect()
    }

    /// Prepares the volume of an object.
    pub fn new(object: &Object, volume: &'a Volume) -> Self {
        let grid = &volume.grid;
        let cells = DAffine3::from_scale_rotation_translation(
            grid.spacing.as_dvec3(),
            glam::DQuat::IDENTITY,
            grid.origin.as_dvec3(),
        );
        let motion: Vec<_> = object.motion.iter().map(|m| *m * cells).collect();
        let blocks = grid.size.map(|n| (n as usize - 1).div_ceil(BLOCK_SIDE));
        let all = blocks[0] * blocks[1] * blocks[2];
        let empty = (0..all).into_par_iter().map(|i| {
            let block = [
                i % blocks[0],
                i / blocks[0] % blocks[1],
                i / blocks[0] / blocks[1],
            ];
            let (lo, hi) = block_range(grid, block);
            volume.transfer.is_zero_between(lo, hi)
        });
        Medium {
            transfer: &volume.transfer,
            ramp: Ramp::of(&volume.transfer),
            coloured: volume.transfer.is_coloured(),
            step: volume.step,
            empty: empty.collect(),
            motion,
            blocks,
            grid,
        }
    }

    /// The pixels that the medium covers over the whole shutter, clipped to `within`.
    pub fn pixels(&self, view: &View, within: PixelBox) -> PixelBox {
        let end = DVec3::from_array(self.grid.size.map(|n| f64::from(n) - 1.0));
        let mut reach = ProjectedBounds::default();
        for key in &self.motion {
            for corner in 0..8 {
                let pick = |axis: usize| {
                    if corner >> axis & 1 == 1 {
                        end[axis]
                    } else {
                        0.0
                    }
                };
                let at = key.transform_point3(DVec3::new(pick(0), pick(1), pick(2)));
                reach.add(&project(view, at));
            }
        }
        reach.pixels(within)
    }

    /// Transform from the world to cells at a time of the shutter.
    fn cells_from_world(&self, time: f64) -> DAffine3 {
        let pieces = (self.motion.len() - 1) as f64;
        let low = (time * pieces).floor().clamp(0.0, (pieces - 1.0).max(0.0));
        let (a, t) = (self.motion[low as usize], time * pieces - low);
        if pieces == 0.0 || t == 0.0 {
            return a.inverse();
        }
        let b = self.motion[low as usize + 1];
        let mix = |a: DVec3, b: DVec3| a.lerp(b, t);
        let (p, q) = (a.matrix3, b.matrix3);
        DAffine3::from_cols(
            mix(p.x_axis, q.x_axis),
            mix(p.y_axis, q.y_axis),
            mix(p.z_axis, q.z_axis),
            mix(a.translation, b.translation),
        )
        .inverse()
    }

    /// Adds the extinction along `line` to `ray`, between the two depths of `range`.
    ///
    /// Samples lie at whole multiples of the step, and where the line enters and leaves the volume.
    ///
    /// # Errors
    /// As [`Ray::medium`].
    pub fn march(
        &self,
        (origin, way): Line,
        time: f64,
        range: (f64, f64),
        march: &mut March,
        ray: &mut Ray,
    ) -> deepshadow::Result<()> {
        let distance = way.length();
        if self.coloured {
            self.along((origin, way), time, range, &mut march.rgb);
            return ray.medium(&march.rgb, distance);
        }
        let line = self.in_cells((origin, way), time);
        let out = &mut march.mono;
        out.clear();
        match self.ramp {
            Some(ramp) => {
                let kappa = |v| ramp.at(v);
                self.samples(line, distance, range, f64::from, kappa, 0.0, out);
            }
            None => {
                let kappa = |v| self.transfer.at(v)[0];
                self.samples(line, distance, range, f64::from, kappa, 0.0, out);
            }
        }
        ray.medium(out, distance)
    }

    /// Computes the extinction along `line` for red, green and blue at the depths where
    /// [`Medium::march`] samples it; it is linear between them. Overwrites `out`.
    pub fn along(
        &self,
        (origin, way): Line,
        time: f64,
        range: (f64, f64),
        out: &mut Vec<(f32, [f32; 3])>,
    ) {
        out.clear();
        // Stop when even the least attenuated channel is dark.
        let least = |k: [f32; 3]| f64::from(k[0].min(k[1]).min(k[2]));
        let line = self.in_cells((origin, way), time);
        let kappa = |v| self.transfer.at(v);
        self.samples(line, way.length(), range, least, kappa, [0.0; 3], out);
    }

    /// Transforms a line from the world to cells.
    fn in_cells(&self, (origin, way): Line, time: f64) -> Line {
        let inverse = self.cells_from_world(time);
        (
            inverse.transform_point3(origin),
            inverse.transform_vector3(way),
        )
    }

    /// Distance between two samples of a line in direction `way`, as a multiple of `way`.
    pub fn step(&self, way: DVec3, time: f64) -> f64 {
        self.step / self.cells_from_world(time).transform_vector3(way).length()
    }

    /// Samples the extinction along a line in cell space.
    #[allow(clippy::too_many_arguments, reason = "mono and colour share it")]
    fn samples<K: Copy + PartialEq>(
        &self,
        (origin, way): Line,
        distance: f64,
        (near, far): (f64, f64),
        least: impl Fn(K) -> f64,
        extinction: impl Fn(f32) -> K,
        none: K,
        out: &mut Vec<(f32, K)>,
    ) {
        let end = DVec3::from_array(self.grid.size.map(|n| f64::from(n) - 1.0));
        let Some((enter, leave)) = inside(origin, way, end) else {
            return;
        };
        // Round to f32 depths inside the interval.
        let mut first = enter.max(near) as f32;
        let mut last = leave.min(far) as f32;
        if f64::from(first) < enter.max(near) {
            first = first.next_up();
        }
        if f64::from(last) > leave.min(far) {
            last = last.next_down();
        }
        if first >= last {
            return;
        }
        let step = self.step / way.length();
        let at = |z: f32| origin + way * f64::from(z);
        let take = |z: f32| extinction(self.value(at(z).clamp(DVec3::ZERO, end)));
        let mut before = (first, take(first));
        out.push(before);
        let mut depth = 0.0;
        let mut k = (f64::from(first) / step).floor() + 1.0;
        loop {
            let z = ((k * step) as f32).min(last);
            if z <= before.0 {
                // The step is below the precision of f32 here.
                if before.0 >= last {
                    return;
                }
                k = (f64::from(before.0.next_up()) / step).ceil().max(k + 1.0);
                continue;
            }
            let empty = z < last && self.is_empty(at(z));
            let kappa = if empty { none } else { take(z) };
            if kappa != none || before.1 != none {
                // After skipped samples, keep the last one without extinction.
                if before.1 == none && out.last().is_some_and(|l| l.0 != before.0) {
                    out.push(before);
                }
                out.push((z, kappa));
            }
            depth += (least(before.1) + least(kappa)) * 0.5 * f64::from(z - before.0) * distance;
            before = (z, kappa);
            if z == last || depth > MAX_OPTICAL_DEPTH {
                return;
            }
            k = match empty {
                true => self.step_after_block(origin, way, z, step).max(k + 1.0),
                false => k + 1.0,
            };
            if empty {
                // Continue from the last sample inside the block: the linear piece to the next
                // sample begins there.
                let z = ((k - 1.0) * step) as f32;
                if z > before.0 && z < last {
                    before = (z, none);
                }
            }
        }
    }

    /// Index of the first sample after the block of cells at depth `z`, as a multiple of the step.
    fn step_after_block(&self, origin: DVec3, way: DVec3, z: f32, step: f64) -> f64 {
        let at = origin + way * f64::from(z);
        let mut leave = f64::INFINITY;
        for axis in 0..3 {
            let block = (at[axis].max(0.0) / BLOCK_SIDE as f64)
                .floor()
                .min(self.blocks[axis] as f64 - 1.0);
            let side = if way[axis] > 0.0 { block + 1.0 } else { block } * BLOCK_SIDE as f64;
            if way[axis] != 0.0 {
                leave = leave.min((side - origin[axis]) / way[axis]);
            }
        }
        // Rounding may give the last sample inside the block instead, which is also correct.
        (leave / step).ceil()
    }

    fn is_empty(&self, at: DVec3) -> bool {
        let block =
            |axis: usize| ((at[axis].max(0.0) as usize) / BLOCK_SIDE).min(self.blocks[axis] - 1);
        self.empty[(block(2) * self.blocks[1] + block(1)) * self.blocks[0] + block(0)]
    }

    /// Trilinear interpolation between the eight samples of a cell.
    fn value(&self, at: DVec3) -> f32 {
        let [nx, ny, nz] = self.grid.size.map(|n| n as usize);
        let split = |v: f64, n: usize| {
            let cell = (v as usize).min(n - 2);
            (cell, (v - cell as f64) as f32)
        };
        let ((x, fx), (y, fy), (z, fz)) = (split(at.x, nx), split(at.y, ny), split(at.z, nz));
        let row = |y: usize, z: usize| {
            let first = (z * ny + y) * nx + x;
            let pair = &self.grid.values[first..first + 2];
            pair[0] + (pair[1] - pair[0]) * fx
        };
        let plane = |z: usize| {
            let (a, b) = (row(y, z), row(y + 1, z));
            a + (b - a) * fy
        };
        let (a, b) = (plane(z), plane(z + 1));
        a + (b - a) * fz
    }
}

/// A grey transfer function that is one ramp between two values.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    from: f32,
    /// The reciprocal of the distance between the two values.
    rate: f32,
    ends: [f32; 2],
}

impl Ramp {
    fn of(transfer: &TransferFunction) -> Option<Self> {
        match *transfer.points() {
            [(from, [a, ..]), (to, [b, ..])] if !transfer.is_coloured() => Some(Ramp {
                from,
                rate: 1.0 / (to - from),
                ends: [a, b],
            })
            .filter(|s| s.rate.is_normal()),
            _ => None,
        }
    }

    fn at(self, value: f32) -> f32 {
        let t = ((value - self.from) * self.rate).clamp(0.0, 1.0);
        self.ends[0] * (1.0 - t) + self.ends[1] * t
    }
}

/// The least and the greatest sample at the corners of a block's cells.
fn block_range(grid: &Grid, block: [usize; 3]) -> (f32, f32) {
    let n = grid.size.map(|n| n as usize);
    let span =
        |axis: usize| block[axis] * BLOCK_SIDE..((block[axis] + 1) * BLOCK_SIDE + 1).min(n[axis]);
    let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
    for z in span(2) {
        for y in span(1) {
            let row = (z * n[1] + y) * n[0];
            for &v in &grid.values[row + span(0).start..row + span(0).end] {
                (lo, hi) = (lo.min(v), hi.max(v));
            }
        }
    }
    (lo, hi)
}

/// The interval in which a line is inside the box from the origin to `end`.
fn inside(origin: DVec3, way: DVec3, end: DVec3) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        if way[axis] == 0.0 {
            if !(0.0..=end[axis]).contains(&origin[axis]) {
                return None;
            }
            continue;
        }
        let (a, b) = (
            -origin[axis] / way[axis],
            (end[axis] - origin[axis]) / way[axis],
        );
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    (enter < leave && enter.is_finite() && leave.is_finite()).then_some((enter, leave))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A grid of zeros with three lumps.
    fn lumps() -> Grid {
        let size = [41, 35, 50];
        let mut values = vec![0.0; 41 * 35 * 50];
        for (i, value) in values.iter_mut().enumerate() {
            let p = Vec3::new(
                (i % 41) as f32,
                (i / 41 % 35) as f32,
                (i / (41 * 35)) as f32,
            );
            for (centre, radius) in [
                ([10.0, 10.0, 10.0], 5.0),
                ([30.0, 20.0, 40.0], 8.0),
                ([20.0, 34.0, 25.0], 3.0),
            ] {
                *value += (radius - p.distance(Vec3::from_array(centre))).max(0.0);
            }
        }
        Grid {
            size,
            origin: Vec3::new(-1.0, 2.0, 0.5),
            spacing: Vec3::new(0.5, 1.0, 0.25),
            values,
        }
    }

    fn object(grid: Grid, transfer: TransferFunction, step: f64) -> Object {
        Object::new(
            "lumps",
            Shape::Volume(Volume {
                grid,
                transfer,
                step,
            }),
        )
    }

    /// Lines through the lumps from all sides.
    fn lines() -> impl Iterator<Item = Line> {
        let mut dice = 1u64;
        let mut roll = move || {
            dice = crate::samples::mix(dice + 1);
            (dice >> 11) as f64 / (1u64 << 53) as f64
        };
        let (lo, hi) = (DVec3::new(-1.0, 2.0, 0.5), DVec3::new(19.0, 36.0, 12.75));
        (0..300).map(move |i| {
            let mut inside = || lo + (hi - lo) * DVec3::new(roll(), roll(), roll());
            let (a, b) = (inside(), inside());
            let mut way = (b - a).normalize();
            if i % 10 == 0 {
                way = DVec3::AXES[i / 10 % 3]; // parallel to an axis, inside two of the slabs
            }
            (a - way * 60.0, way)
        })
    }

    #[test]
    fn skipping_empty_blocks_changes_nothing() {
        let grid = lumps();
        for (number, transfer) in [
            TransferFunction::linear(0.0, 4.0),
            TransferFunction::new(vec![(1.0, [0.0; 3]), (2.0, [0.5; 3]), (3.0, [0.1; 3])]).unwrap(),
            TransferFunction::new(vec![(1.0, [0.0; 3]), (4.0, [0.2, 0.3, 0.1])]).unwrap(),
        ]
        .into_iter()
        .enumerate()
        {
            let object = object(grid.clone(), transfer, 0.7);
            let Shape::Volume(volume) = &object.shape else {
                unreachable!("it is one")
            };
            let skipping = Medium::new(&object, volume);
            assert!(skipping.empty.iter().filter(|e| **e).count() > 50);
            let mut thorough = Medium::new(&object, volume);
            thorough.empty.fill(false);
            let (mut march, mut met) = (March::default(), 0);
            for line in lines() {
                let mut rays = [Ray::new(), Ray::new()];
                for (medium, ray) in [&skipping, &thorough].into_iter().zip(&mut rays) {
                    medium
                        .march(line, 0.0, (0.0, 1e9), &mut march, ray)
                        .unwrap();
                }
                for z in (0..1200).map(|i| i as f32 * 0.1) {
                    for c in 0..3 {
                        let [a, b] = [rays[0].visibility_rgb(z)[c], rays[1].visibility_rgb(z)[c]];
                        assert!(
                            (a - b).abs() < 1e-12,
                            "{a} {b} at {z} of {line:?}, transfer {number}"
                        );
                        met += usize::from(a < 1.0);
                    }
                }
            }
            assert!(met > 10_000, "{met}");
        }
    }

    #[test]
    fn a_march_in_small_steps_converges_to_the_integral() {
        let object = object(lumps(), TransferFunction::linear(0.0, 40.0), 0.05);
        let Shape::Volume(volume) = &object.shape else {
            unreachable!("it is one")
        };
        let medium = Medium::new(&object, volume);
        let inverse = medium.cells_from_world(0.0);
        let end = DVec3::new(40.0, 34.0, 49.0);
        for line in lines().take(40) {
            let mut ray = Ray::new();
            medium
                .march(line, 0.0, (0.0, 1e9), &mut March::default(), &mut ray)
                .unwrap();
            // The midpoint rule over the whole line.
            let (n, mut sum) = (40_000, 0.0);
            for i in 0..n {
                let z = (i as f64 + 0.5) * 130.0 / f64::from(n);
                let at = inverse.transform_point3(line.0 + line.1 * z);
                if at.cmpge(DVec3::ZERO).all() && at.cmple(end).all() {
                    sum += f64::from(medium.value(at)) / 40.0 * 130.0 / f64::from(n);
                }
            }
            let (is, should) = (ray.visibility_behind(1e6), (-sum).exp());
            assert!((is - should).abs() < 2e-3, "{is}, should be {should}");
        }
    }
}
