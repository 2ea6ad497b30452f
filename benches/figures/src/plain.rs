//! A plain shadow map with percentage-closer filtering.
//!
//! Each pixel holds the nearest depth of one ray.

use deepshadow_frame::Result;
use deepshadow_scene::hits::bins::{Bins, TileGrid};
use deepshadow_scene::hits::raster::{Block, Opacity};
use deepshadow_scene::hits::triangles::Triangles;
use deepshadow_scene::samples::Pattern;
use deepshadow_scene::scene::{Light, Scene};
use rayon::prelude::*;

/// Square map of depths, row by row. A depth is infinite where the ray hits nothing.
#[derive(Debug)]
pub struct PlainMap {
    side: i32,
    depths: Vec<f32>,
}

/// Makes every surface opaque.
struct Opaque;

impl Opacity for Opaque {
    fn uniform(&self, part: usize) -> Option<u32> {
        Some(part as u32)
    }

    fn at(&self, _: usize, _: [u32; 3], _: [f64; 3]) -> [f32; 3] {
        [1.0; 3]
    }
}

/// Side in pixels of the blocks that are rasterised at a time.
const BLOCK: i32 = 64;

impl PlainMap {
    /// Rasterises the map of a scene's first light, `side` pixels wide and high.
    pub fn new(scene: &Scene, side: i32) -> Result<Self> {
        let light = Light {
            resolution: [side as u32; 2],
            ..scene.lights[0].clone()
        };
        let view = &light.views(scene)?[0];
        let triangles = Triangles::new(scene, view);
        let boxes = triangles.boxes([0, side - 1, 0, side - 1]);
        let blocks = side / BLOCK;
        let grid = TileGrid {
            tile: BLOCK,
            margin: 0,
            tiles: [0, blocks, 0, blocks],
        };
        let bins = Bins::new(grid, &boxes);
        let pattern = Pattern::new(1, scene.seed, false);
        let opaque = vec![[1.0; 3]; triangles.parts.len()];
        let mut depths = vec![f32::INFINITY; (side * side) as usize];
        let rows = depths.par_chunks_mut((side * BLOCK) as usize).enumerate();
        rows.for_each_init(Block::default, |block, (ty, rows)| {
            for tx in 0..blocks {
                let (x, y) = (tx * BLOCK, ty as i32 * BLOCK);
                block.pixels = [x, x + BLOCK - 1, y, y + BLOCK - 1];
                pattern.fill(x..x + BLOCK, y..y + BLOCK, &mut block.samples);
                block.clear(&opaque);
                block.rasterise(
                    &triangles,
                    &boxes,
                    bins.of(tx, ty as i32),
                    &Opaque,
                    usize::MAX,
                );
                for (from, to) in block
                    .nearest
                    .chunks(BLOCK as usize)
                    .zip(rows.chunks_mut(side as usize))
                {
                    to[x as usize..(x + BLOCK) as usize].copy_from_slice(from);
                }
            }
        });
        Ok(PlainMap { side, depths })
    }

    /// Sizes in bytes: uncompressed, and compressed by zstd at level 3.
    pub fn bytes(&self) -> Result<[u64; 2]> {
        let mut counted = Counter(0);
        let mut packed = zstd::Encoder::new(&mut counted, 3)?;
        for row in self.depths.chunks(self.side as usize) {
            let bytes: Vec<u8> = row.iter().flat_map(|z| z.to_le_bytes()).collect();
            std::io::Write::write_all(&mut packed, &bytes)?;
        }
        packed.finish()?;
        Ok([4 * self.depths.len() as u64, counted.0])
    }

    /// Fraction of light that reaches `depth` at pixel (x, y), by percentage-closer filtering.
    ///
    /// It is the fraction of taps whose stored depth is at least `depth`. A tap is an offset from
    /// -0.5 to 0.5 in units of `width` pixels.
    #[inline]
    pub fn light(&self, [x, y]: [f32; 2], depth: f32, width: f32, taps: &[[f32; 2]]) -> f32 {
        let most = (self.side - 1) as f32;
        let lit = taps.iter().filter(|[dx, dy]| {
            let column = (x + dx * width).clamp(0.0, most) as usize;
            let row = (y + dy * width).clamp(0.0, most) as usize;
            self.depths[row * self.side as usize + column] >= depth
        });
        lit.count() as f32 / taps.len() as f32
    }
}

/// Makes `sets` sets of `n` jittered taps, one tap for each cell of a grid.
pub fn jittered_taps(n: u32, sets: u32) -> Vec<Vec<[f32; 2]>> {
    let pattern = Pattern::new(n, 77, false);
    let mut samples = deepshadow_scene::samples::Samples::default();
    (0..sets as i32)
        .map(|set| {
            pattern.fill(set..set + 1, 0..1, &mut samples);
            (0..n as usize).map(|i| samples.place(0, i)).collect()
        })
        .collect()
}

/// Counts the bytes written to it.
struct Counter(u64);

impl std::io::Write for Counter {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
