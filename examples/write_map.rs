//! Writes a deep shadow map from a renderer's samples.
//!
//! `cargo run --release --example write_map light.dsm`
//!
//! The light looks down from a height of 10 at a ground plane. A ball of smoke hangs at a height of
//! 4, and 200 thin leaves float between them. Replace `trace` with your renderer's rays.

use deepshadow::*;

const SIZE: u32 = 256;
/// Each pixel has `GRID` x `GRID` rays.
const GRID: u32 = 4;
/// The light's camera stands at this height and spans `EXTENT` units of the ground.
const HEIGHT: f64 = 10.0;
const EXTENT: f64 = 8.0;

/// Adds all hits of the ray through (x, y) with their depths and opacities, in any order.
fn trace(x: f64, y: f64, ray: &mut Ray) -> Result<()> {
    // A leaf is a disc of radius 0.2. Where a ray meets several, their transparencies multiply.
    for leaf in 1..=200 {
        let scatter = |step: f64| (f64::from(leaf) * step).fract();
        let (cx, cy) = (scatter(0.7549) - 0.5, scatter(0.5698) - 0.5);
        if (x - EXTENT * cx).hypot(y - EXTENT * cy) < 0.2 {
            ray.surface((2.0 + 2.0 * scatter(0.618)) as f32, 0.6)?;
        }
    }
    // The ball of smoke has radius 1.5 and extinction 0.8 for each unit of depth.
    let half = (1.5 * 1.5 - x * x - y * y).max(0.0).sqrt(); // half of the ray inside the ball
    if half > 0.0 {
        let opacity = 1.0 - (-0.8 * 2.0 * half).exp();
        let [front, back] = [-half, half].map(|h| (HEIGHT - 4.0 + h) as f32);
        ray.thick(front, back, opacity as f32)?;
    }
    ray.surface(HEIGHT as f32, 1.0) // the ground
}

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or("light.dsm".into());

    // The camera maps points of the world to pixels, so renderers can look up world points.
    let (eye, target, up) = ([0.0, 0.0, HEIGHT], [0.0; 3], [0.0, 1.0, 0.0]);
    let header = MapHeader::new("key light", SIZE, SIZE)
        .channels(1)
        .depth_kind(DepthKind::Planar)
        .camera(Camera::orthographic(eye, target, up, [EXTENT, EXTENT])?);

    // No value of any stored function deviates from the exact one by more than this.
    let tolerance = 0.01;
    let mut writer = Writer::create(&path)?;
    let map = writer.add_map(header, Encoding::new(tolerance))?;

    let (mut sweep, mut curve) = (Sweep::new(), Curve::default());
    for y in 0..SIZE {
        for x in 0..SIZE {
            for sample in 0..GRID * GRID {
                let offset = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
                let across = (f64::from(x) + offset(sample % GRID)) / f64::from(SIZE);
                let down = (f64::from(y) + offset(sample / GRID)) / f64::from(SIZE);
                let mut ray = Ray::new();
                trace(EXTENT * (across - 0.5), EXTENT * (0.5 - down), &mut ray)?;
                // Smoke becomes chords that deviate by at most a sixteenth of the tolerance.
                sweep.add_ray(&ray, tolerance / 16.0, 1.0)?;
            }
            sweep.finish(&mut curve)?; // the average of the rays; the sweep is empty again
            writer.pixel(map, Pixel::new(x, y), &curve)?;
        }
    }

    // The writer also builds the coarser levels. The file gets its name once it is complete.
    let summary = writer.finish()?;
    println!("{path}: {} bytes", summary.bytes);
    Ok(())
}
