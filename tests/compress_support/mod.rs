//! Measures for the compressors: the exact error, the exact minimum of vertices, and scenes.
#![allow(dead_code, reason = "the tests and the bench use different parts")]

use crate::random::Random;
use deepshadow::raw::Precision;
use deepshadow::{Curve, Visibility};

/// The exact maximum of |output - input|.
///
/// Both are linear between the vertices of the two, so the maximum is at or just behind a vertex.
pub fn max_error(input: &Curve, output: &Visibility) -> f64 {
    let plane = |c| output.values(c).iter().map(|&v| f64::from(v)).collect();
    let planes = (0..output.channels()).map(plane).collect();
    let exact = Curve::from_planes(output.depths().to_vec(), planes).unwrap();
    let mut worst = 0.0f64;
    let mut compare = |z: f32| {
        for c in 0..input.channels().max(output.channels()) {
            worst = worst.max((input.visibility_rgb(z)[c] - exact.visibility_rgb(z)[c]).abs());
            worst = worst
                .max((input.visibility_behind_rgb(z)[c] - exact.visibility_behind_rgb(z)[c]).abs());
        }
    };
    input.depths().iter().for_each(|&z| compare(z));
    output.depths().iter().for_each(|&z| compare(z));
    worst
}

/// Whether `v` is a value of this precision.
pub fn storable(precision: Precision, v: f32) -> bool {
    match precision {
        Precision::F32 => true,
        Precision::Lattice(l) => (v * f32::from(l)).round() / f32::from(l) == v,
    }
}

/// The fewest vertices of any function within `eps` of a monochrome `input`.
///
/// Its values are on the lattice `l`, its depths are those of the input, and its end is the
/// lattice value nearest to the input's end. A table holds the cost for every depth and every
/// value behind it.
pub fn exact_minimum(input: &Curve, eps: f64, l: u16) -> usize {
    assert_eq!(input.channels(), 1);
    let value = |k: usize| f64::from(k as f32 / f32::from(l));
    let last = usize::from(l);
    let pin = (input.end() * f64::from(l)).round() as usize;
    if pin == last {
        return 0;
    }
    let end = value(pin);
    let mut depths = input.depths().to_vec();
    depths.dedup();
    // Depth, value in front, value behind.
    let events: Vec<(f64, f64, f64)> = depths
        .iter()
        .map(|&z| {
            (
                f64::from(z),
                input.visibility(z),
                input.visibility_behind(z),
            )
        })
        .collect();
    let low = |v: f64| (v - eps).max(end);
    let high = |v: f64| (v + eps).min(1.0);
    const ROUNDING: f64 = 1e-14;
    let inside = |v: f64, lo: f64, hi: f64| lo - ROUNDING <= v && v <= hi + ROUNDING;
    // The lattice values within [lo, hi].
    let among = |lo: f64, hi: f64| {
        let from = ((lo * f64::from(l)).floor() as usize).saturating_sub(1);
        let to = ((hi * f64::from(l)).ceil() as usize + 1).min(last);
        (from..=to).filter(move |&k| inside(value(k), lo, hi))
    };
    let mut best = vec![vec![usize::MAX; last + 1]; events.len()];
    for (i, &(_, front, behind)) in events.iter().enumerate() {
        if front + eps < 1.0 {
            break;
        }
        for k in among(low(behind), high(behind)) {
            best[i][k] = 1;
        }
        if behind + eps < 1.0 {
            break;
        }
    }
    let mut answer = usize::MAX;
    for i in 0..events.len() {
        let (z0, _, behind) = events[i];
        if behind - eps <= end {
            answer = answer.min(best[i][pin]);
        }
        for k in among(low(behind), high(behind)) {
            let cost = best[i][k];
            if cost >= answer {
                continue;
            }
            let y = value(k);
            let (mut lo, mut hi) = (f64::NEG_INFINITY, 0.0f64);
            for j in i + 1..events.len() {
                let (z, front, behind) = events[j];
                let dz = z - z0;
                // The segment ends in front of the step; another vertex follows behind it.
                let a = (y + lo * dz).max(low(front));
                let b = (y + hi * dz).min(high(front));
                if let Some(p) = among(a, b).next_back() {
                    for q in among(low(behind), high(behind)).filter(|&q| q <= p) {
                        best[j][q] = best[j][q].min(cost + 2);
                    }
                }
                // The segment passes.
                lo = lo.max((low(front) - y) / dz);
                hi = hi.min((high(behind) - y) / dz);
                if lo > hi {
                    break;
                }
                for k in among(y + lo * dz, y + hi * dz).filter(|&to| to <= k) {
                    best[j][k] = best[j][k].min(cost + 1);
                }
            }
        }
    }
    answer
}

/// The average of `n` rays, some of which hit an opaque surface.
///
/// A hit is a depth and its opacity in each channel.
fn average_of_hits(n: usize, mut hits: Vec<(f32, [f64; 3])>, channels: usize) -> Curve {
    hits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut z, mut v) = (Vec::new(), vec![Vec::new(); channels]);
    let mut blocked = [0.0; 3];
    let mut i = 0;
    while i < hits.len() {
        let depth = hits[i].0;
        let value = |blocked: &[f64; 3], c: usize| (1.0 - blocked[c] / n as f64).max(0.0);
        if i > 0 {
            z.push(depth);
            (0..channels).for_each(|c| v[c].push(value(&blocked, c)));
        }
        while i < hits.len() && hits[i].0 == depth {
            (0..3).for_each(|c| blocked[c] += hits[i].1[c]);
            i += 1;
        }
        z.push(depth);
        (0..channels).for_each(|c| v[c].push(value(&blocked, c)));
    }
    Curve::from_planes(z, v).unwrap()
}

/// The depths at which `n` x `n` rays of a pixel hit the first hair.
///
/// Rays that miss all hairs hit an opaque ball or the tilted ground behind.
fn hair_hits(n: usize, seed: u64) -> Vec<f32> {
    let r = &mut Random(seed);
    // The ball's slope in this pixel; hairs are long paths through a shell around the ball.
    let (gx, gy) = (r.range(-0.02, 0.02), r.range(-0.02, 0.02));
    let (ball, thick) = (r.range(3.0, 3.6), r.range(0.3, 0.9));
    let share = if r.unit() < 0.25 {
        r.range(0.0, 1.0)
    } else {
        1.0
    };
    let hairs: Vec<_> = (0..r.range(40.0, 160.0) as usize)
        .map(|_| {
            let angle = r.range(0.0, std::f64::consts::TAU);
            let depth = ball - thick * r.unit().sqrt();
            let place = r.range(-0.7, 0.7);
            let (half, slope) = (r.range(0.008, 0.025), r.range(-0.1, 0.1));
            (angle.cos(), angle.sin(), place, half, depth, slope)
        })
        .collect();
    let mut hits = Vec::with_capacity(n * n);
    for y in 0..n {
        for x in 0..n {
            let px = (x as f64 + r.unit()) / n as f64 - 0.5;
            let py = (y as f64 + r.unit()) / n as f64 - 0.5;
            let mut nearest = match px + 0.5 < share {
                true => ball + gx * px + gy * py,
                false => ball + 2.0 + 0.05 * px + 0.1 * py,
            };
            for &(cos, sin, place, half, depth, slope) in &hairs {
                let across = px * cos + py * sin - place;
                if across.abs() < half {
                    let along = py * cos - px * sin;
                    let round = half * 0.1 * (1.0 - (across / half).powi(2)).sqrt();
                    nearest = nearest.min(depth + slope * along - round);
                }
            }
            hits.push(nearest as f32);
        }
    }
    hits
}

/// A pixel of hair with `n` x `n` opaque samples.
pub fn hair(n: usize, seed: u64) -> Curve {
    let hits = hair_hits(n, seed).into_iter().map(|z| (z, [1.0; 3]));
    average_of_hits(n * n, hits.collect(), 1)
}

/// A pixel of hair whose samples let some green and blue light pass.
pub fn coloured_hair(n: usize, seed: u64) -> Curve {
    let r = &mut Random(!seed);
    let hits = hair_hits(n, seed)
        .into_iter()
        .map(|z| (z, [1.0, r.range(0.8, 1.0), r.range(0.5, 1.0)]));
    average_of_hits(n * n, hits.collect(), 3)
}

/// A pixel of a slanted opaque plane with `n` x `n` jittered samples.
pub fn plane(n: usize, seed: u64) -> Curve {
    let r = &mut Random(seed);
    let (gx, gy, z) = (r.range(-1.0, 1.0), r.range(-1.0, 1.0), r.range(2.0, 8.0));
    let mut hits = Vec::new();
    for y in 0..n {
        for x in 0..n {
            let px = (x as f64 + r.unit()) / n as f64;
            let py = (y as f64 + r.unit()) / n as f64;
            hits.push(((z + gx * px + gy * py) as f32, [1.0; 3]));
        }
    }
    average_of_hits(n * n, hits, 1)
}

/// A pixel of cloud: the transmittance of a smooth extinction at `n` depths.
pub fn cloud(n: usize, seed: u64) -> Curve {
    let r = &mut Random(seed);
    let puffs: Vec<_> = (0..3)
        .map(|_| (r.range(0.0, 1.0), r.range(0.05, 0.3), r.range(0.0, 3.0)))
        .collect();
    let (mut z, mut v) = (Vec::new(), Vec::new());
    let (start, mut depth) = (r.range(1.0, 5.0), 0.0);
    for i in 0..n {
        let t = i as f64 / n as f64;
        z.push((start + t) as f32);
        v.push(f64::exp(-depth));
        let density: f64 = puffs
            .iter()
            .map(|&(at, wide, much)| much * (1.0 - ((t - at) / wide).powi(2)).max(0.0))
            .sum();
        depth += density / n as f64;
    }
    Curve::mono(z, v).unwrap()
}

/// Hair in cloud: the product of the two at the depths of both.
pub fn mixed(n: usize, seed: u64) -> Curve {
    let (a, b) = (hair(n, seed), cloud(n * n / 2, !seed));
    let shift = a.depths()[0] - b.depths()[0];
    let b = Curve::mono(
        b.depths().iter().map(|z| z + shift - 0.2).collect(),
        b.values(0).to_vec(),
    )
    .unwrap();
    let mut depths: Vec<f32> = a.depths().iter().chain(b.depths()).copied().collect();
    depths.sort_by(f32::total_cmp);
    depths.dedup();
    let (mut z, mut v) = (Vec::new(), Vec::new());
    let mut last = 1.0f64;
    for (i, &d) in depths.iter().enumerate() {
        let front = (a.visibility(d) * b.visibility(d)).min(last);
        let behind = (a.visibility_behind(d) * b.visibility_behind(d)).min(front);
        if i > 0 && front != behind {
            z.push(d);
            v.push(front);
        }
        z.push(d);
        v.push(behind);
        last = behind;
    }
    Curve::mono(z, v).unwrap()
}
