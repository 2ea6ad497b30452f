//! Shades a grid of points from many threads that share one tile cache.
//!
//! `cargo run --release --example shade light.dsm shadow.pgm`
//!
//! Run the example `write_map` first. The picture shows the light that reaches the ground.

use std::thread;

use deepshadow::*;

const SIZE: usize = 512;
const EXTENT: f64 = 8.0;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let map = arguments.next().unwrap_or("light.dsm".into());
    let picture = arguments.next().unwrap_or("shadow.pgm".into());

    // One cache serves all files and threads. It never holds more bytes than this.
    let cache = TileCache::new(64 << 20);
    let light = cache.add(DsmFile::open(map)?);

    let mut pixels = vec![0; SIZE * SIZE];
    let threads = thread::available_parallelism().map_or(1, |n| n.get());
    let rows = SIZE.div_ceil(threads);
    thread::scope(|scope| {
        let shade = |(i, band): (usize, &mut [u8])| shade_rows(&light, i * rows, band);
        let bands = pixels.chunks_mut(rows * SIZE).enumerate();
        let workers: Vec<_> = bands.map(|band| scope.spawn(move || shade(band))).collect();
        workers
            .into_iter()
            .try_for_each(|worker| worker.join().expect("a worker does not panic"))
    })?;

    let stats = cache.stats();
    println!(
        "{} tiles loaded, {} bytes in the cache",
        stats.loads, stats.bytes
    );
    let header = format!("P5 {SIZE} {SIZE} 255\n");
    Ok(std::fs::write(
        picture,
        [header.as_bytes(), &pixels].concat(),
    )?)
}

/// Shades some rows of the picture, from row `first` on.
fn shade_rows(light: &CachedFile, first: usize, pixels: &mut [u8]) -> Result<()> {
    // Make one sampler for each thread. It keeps the tiles of the last lookups at hand.
    let mut sampler = WorldSampler::new(light, MapId(0))?;
    let step = EXTENT / SIZE as f64;
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let (x, y) = (i % SIZE, first + i / SIZE);
        let along = |i: usize| EXTENT * ((i as f64 + 0.5) / SIZE as f64 - 0.5);
        let point = [along(x), -along(y), 0.0];
        // The lookup averages over the area of a pixel of the picture.
        let query = WorldQuery::new(point).width(step).bias(0.001);
        *pixel = (255.0 * sampler.visibility(&query)?).round() as u8;
    }
    Ok(())
}
