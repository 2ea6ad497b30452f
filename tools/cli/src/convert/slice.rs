//! The light that reaches one depth, filtered as in a renderer.

use deepshadow::{Border, DsmFile, Filter, Footprint, MapId, Sampler, SamplerOptions, TileCache};
use rayon::prelude::*;

use super::level::Level;
use super::picture::Picture;
use deepshadow_frame::Result;
use deepshadow_frame::args::Region;
use deepshadow_frame::console::Console;

/// A picture of the light at one depth.
#[derive(Clone, Copy, Debug)]
pub struct Slice {
    /// The depth.
    pub depth: f32,
    /// Width of the footprint in pixels.
    pub width: f32,
    /// The filter over the footprint.
    pub filter: Filter,
    /// Pixels of level 0 whose centres are looked up.
    pub region: Region,
}

impl Slice {
    /// Returns the visibilities.
    ///
    /// The pixels at the border repeat outside the map, so that no light comes from there. Memory:
    /// the picture, a row of tiles of its values, and decoded tiles within a quarter of the limits.
    /// Runs on all cores.
    ///
    /// # Errors
    /// `Failed` for a damaged tile, and for images beyond the limits.
    pub fn picture(&self, file: DsmFile, map: MapId, console: Console) -> Result<Picture> {
        file.check_layout()?;
        let limits = file.limits();
        let light = TileCache::new((limits.memory / 4) as usize).add(file);
        let level = Level::new(light.file(), map.level(0))?;
        let shape = level.shape;
        let [left, top, width, height] = self.region;
        let mut picture = Picture::new(width, height, level.is_coloured()?, limits)?;
        let options = SamplerOptions::new(self.filter).border(Border::Clamp);
        let footprint = Footprint::Width(self.width);
        let side = shape.tile_size;
        let columns: Vec<u32> = (0..width).step_by(side as usize).collect();
        let mut bar = console.bar("looking up");
        for y in (0..height).step_by(side as usize) {
            let rows = side.min(height - y);
            // Tile by tile, so that a wide map does not evict its own tiles from the cache.
            let blocks = columns.par_iter().map_init(
                || Sampler::with_options(&light, map, options),
                |sampler, &x| {
                    let sampler = sampler.as_mut().map_err(|e| e.clone())?;
                    let across = side.min(width - x);
                    let mut block = vec![[0.0; 3]; (across * rows) as usize];
                    let (x, y) = (left + x, top + y);
                    let (columns, rows) = (x..x + across, y..y + rows);
                    sampler
                        .visibility_rgb_slice(self.depth, footprint, columns, rows, &mut block)?;
                    Ok(block)
                },
            );
            let blocks: Vec<Vec<[f32; 3]>> = blocks.collect::<deepshadow::Result<_>>()?;
            for j in 0..rows as usize {
                for block in &blocks {
                    let across = block.len() / rows as usize;
                    picture.extend(block[j * across..][..across].iter().copied());
                }
            }
            bar.set(u64::from(y + rows), height.into());
        }
        Ok(picture)
    }
}
