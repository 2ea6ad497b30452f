//! Measures `Sweep` against a heap merge with running sums, in vertices per second.
//!
//! `cargo bench --bench sweep` prints a table and writes it to `benches/record/sweep.md`. It fails
//! if the answers of the two differ by 1e-11 or more.

use criterion::{BatchSize, Criterion, Throughput};
use deepshadow::{Curve, Ray, Sweep};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fmt::Write as _;
use std::hint::black_box;
use std::time::{Duration, Instant};

struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1);
        (self.0 >> 40) as f64 / (1u64 << 24) as f64
    }
}

/// A ray that hits two to four hairs. The last is opaque with a probability of 0.33.
fn hair(random: &mut Random) -> Ray {
    let mut ray = Ray::new();
    let n = 2 + (random.next() * 3.0) as usize;
    for i in 0..n {
        let opaque = i + 1 == n && random.next() < 0.33;
        let opacity = if opaque {
            1.0
        } else {
            0.3 + 0.4 * random.next()
        };
        let z = 10.0 + 4.0 * random.next();
        ray.surface(z as f32, opacity as f32).unwrap();
    }
    ray
}

/// A function of four vertices with three ramps between them.
fn ramps(random: &mut Random) -> Curve {
    let mut z = 10.0 + random.next();
    let mut v = 1.0;
    let (mut depths, mut values) = (Vec::new(), Vec::new());
    for _ in 0..4 {
        depths.push(z as f32);
        values.push(v);
        z += 0.1 + random.next();
        v *= 0.3 + 0.6 * random.next();
    }
    Curve::mono(depths, values).unwrap()
}

/// Sums functions by LV00's method, each with the same weight.
///
/// A heap holds the next vertex of every function. The value and slope of the sum are updated at
/// each vertex. `out` gets two vertices at each depth: in front of the depth and behind it.
fn heap_merge(functions: &[Curve], weight: f64, out: &mut (Vec<f32>, Vec<f64>)) {
    out.0.clear();
    out.1.clear();
    let key = |z: f32| Reverse(z.to_bits()); // these depths are positive
    let mut heap: BinaryHeap<_> = (0..functions.len())
        .filter(|&k| !functions[k].is_empty())
        .map(|k| (key(functions[k].depths()[0]), Reverse((k, 0usize))))
        .collect();
    let mut value = weight * functions.len() as f64;
    let mut slope = 0.0;
    let mut before = 0.0;
    let mut put = |z: f32, v: f64| {
        out.0.push(z);
        out.1.push(v);
    };
    while let Some(&(Reverse(bits), _)) = heap.peek() {
        let z = f32::from_bits(bits);
        value += slope * (f64::from(z) - before);
        before = f64::from(z);
        put(z, value);
        while let Some(&(Reverse(b), Reverse((k, i)))) = heap.peek()
            && b == bits
        {
            let (zs, vs) = (functions[k].depths(), functions[k].values(0));
            let in_front = if i == 0 { 1.0 } else { vs[i - 1] };
            if i == 0 || zs[i - 1] == z {
                value += weight * (vs[i] - in_front);
            } else {
                let run = f64::from(z) - f64::from(zs[i - 1]);
                slope -= weight * (vs[i] - in_front) / run;
            }
            if let Some(&next) = zs.get(i + 1) {
                if next != z {
                    slope += weight * (vs[i + 1] - vs[i]) / (f64::from(next) - f64::from(z));
                }
                heap.pop();
                heap.push((key(next), Reverse((k, i + 1))));
            } else {
                heap.pop();
            }
        }
        put(z, value);
    }
}

fn sweep_curves(sweep: &mut Sweep, functions: &[Curve], out: &mut Curve) {
    for f in functions {
        sweep.add(f, 1.0).unwrap();
    }
    sweep.finish(out).unwrap();
}

fn sweep_rays(sweep: &mut Sweep, rays: &[Ray], out: &mut Curve) {
    for ray in rays {
        sweep.add_ray(ray, 1e-3, 1.0).unwrap();
    }
    sweep.finish(out).unwrap();
}

/// Seconds of the fastest call of `run`, repeated for at least 400 ms.
fn least(mut run: impl FnMut()) -> f64 {
    let (start, mut best) = (Instant::now(), f64::MAX);
    while start.elapsed() < Duration::from_millis(400) {
        let one = Instant::now();
        run();
        best = best.min(one.elapsed().as_secs_f64());
    }
    best
}

fn main() {
    let mut table = String::from(
        "| functions | n | input vertices | heap merge, M vertices/s | sweep | sweep from rays \
         | sweep / heap | largest difference |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    let mut random = Random(7);
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(100))
        .measurement_time(Duration::from_millis(300))
        .configure_from_args();
    for kind in ["hair", "ramps"] {
        for n in [16, 256, 4096] {
            // Many different pixels, so that the branch predictor cannot learn a single one.
            let pixels = (1 << 16) / n;
            let rays: Vec<Vec<Ray>> = (0..pixels)
                .map(|_| (0..n).map(|_| hair(&mut random)).collect())
                .collect();
            let mut one = Curve::default();
            let functions: Vec<Vec<Curve>> = rays
                .iter()
                .map(|rays| {
                    let function = |ray: &Ray| {
                        if kind == "ramps" {
                            return ramps(&mut random);
                        }
                        ray.flatten(1e-3, &mut one);
                        one.clone()
                    };
                    rays.iter().map(function).collect()
                })
                .collect();
            let vertices: usize = functions.iter().flatten().map(Curve::len).sum();
            let (mut sweep, mut out) = (Sweep::new(), Curve::default());
            let mut merged = (Vec::new(), Vec::new());
            let mut difference: f64 = 0.0;
            for pixel in &functions {
                heap_merge(pixel, 1.0 / n as f64, &mut merged);
                sweep_curves(&mut sweep, pixel, &mut out);
                for (i, &z) in merged.0.iter().enumerate() {
                    let got = if i % 2 == 0 {
                        out.visibility(z)
                    } else {
                        out.visibility_behind(z)
                    };
                    difference = difference.max((got - merged.1[i]).abs());
                }
            }
            assert!(difference < 1e-11, "{kind} {n}: {difference}");
            let heap = least(|| {
                for pixel in &functions {
                    heap_merge(black_box(pixel), 1.0 / n as f64, &mut merged);
                }
            });
            let fast = least(|| {
                for pixel in &functions {
                    sweep_curves(&mut sweep, black_box(pixel), &mut out);
                }
            });
            let from_rays = least(|| {
                for pixel in &rays {
                    sweep_rays(&mut sweep, black_box(pixel), &mut out);
                }
            });
            let speed = |seconds: f64| vertices as f64 / seconds / 1e6;
            let from_rays = match kind {
                "hair" => format!("{:.0}", speed(from_rays)),
                _ => "-".into(),
            };
            writeln!(
                table,
                "| {kind} | {n} | {:.0} | {:.0} | {:.0} | {from_rays} | {:.1} | {difference:.0e} |",
                vertices as f64 / pixels as f64,
                speed(heap),
                speed(fast),
                heap / fast
            )
            .unwrap();
            let mut group = criterion.benchmark_group("sweep");
            group.throughput(Throughput::Elements(vertices as u64));
            group.bench_function(format!("{kind}/{n}"), |b| {
                b.iter_batched(
                    || (),
                    |()| {
                        for pixel in &functions {
                            sweep_curves(&mut sweep, black_box(pixel), &mut out);
                        }
                    },
                    BatchSize::PerIteration,
                );
            });
            group.finish();
        }
    }
    println!("{table}");
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/record");
    std::fs::create_dir_all(folder).unwrap();
    let text = format!(
        "# Sweep\n\n\
         Written by `cargo bench --bench sweep`: million input vertices per second on one thread,\n\
         fastest of many runs. The heap merge is LV00's: a heap of the next vertex of each\n\
         function, and running sums in f64 without compensation. All columns measure the same\n\
         pixels in the same run. Answers are compared on both sides of every vertex.\n\n{table}"
    );
    std::fs::write(format!("{folder}/sweep.md"), text).unwrap();
}
