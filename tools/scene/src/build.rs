//! Builds the file of a scene tile by tile, in parallel and in bounded memory.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::error::{Error, ErrorKind, InFile, Result};
use deepshadow::{
    Attribute, Curve, Encoding, Group, GroupRole, Interpretation, MapHeader, MapId,
    Pixels as TilePixels, TileId, Writer,
};
use rayon::prelude::*;

use crate::hits::bins::{Bins, TileGrid};
use crate::hits::triangles::{PixelBox, Triangles};
use crate::pixels::{Pixels, Worker};
use crate::scene::{Light, LightKind, Object, Scene, Shape, View};

/// Target size of a band's bins, in items of 4 bytes.
const BIN_ITEMS: usize = 1 << 26;
/// Target size in bytes of the uncompressed functions of a batch of tiles. Small enough that they
/// are still in a cache when they are compressed.
const BATCH_BYTES: usize = 56 << 20;
/// Number of tiles in the first batch, and the most in any batch.
const BATCH_TILES: [usize; 2] = [8, 64];

/// A rectangle of pixels: x, y, width, height.
pub type Region = [u32; 4];

/// How maps are stored.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Side of a tile in pixels.
    pub tile: u32,
    /// How functions, levels and tiles are stored. Each light sets its own tolerance.
    pub encoding: Encoding,
    /// The part of the map to build; `None` builds all of it. It consists of whole tiles, except at
    /// the border of the map.
    pub region: Option<Region>,
    /// Bytes of levels that wait in memory; further ones wait in a temporary file.
    pub waiting: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            tile: 32,
            encoding: Encoding::default(),
            region: None,
            waiting: 512 << 20,
        }
    }
}

/// Statistics of a build.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The writer's summary.
    pub summary: deepshadow::raw::Summary,
    /// Triangles, summed over the views of all maps.
    pub triangles: u64,
    /// All tiles, and the tiles that an object covers.
    pub tiles: [u64; 2],
    /// Rays shot. A ray that contributes to several blocks counts once for each.
    pub rays: u64,
    /// Hits of rays on surfaces, not counting hits behind an opaque surface.
    pub hits: u64,
    /// Vertices of the functions before compression.
    pub vertices: u64,
    /// Names of the lights whose maps have no vertices, and why: all points are lit.
    pub lit: Vec<(String, &'static str)>,
    /// Time for rays and their intersections, summed over all threads.
    pub shooting: Duration,
    /// Time for transmittance functions and their sums, summed over all threads.
    pub summing: Duration,
    /// Wall-clock time for compression, levels and writing, which may use all threads.
    pub writing: Duration,
    /// Wall-clock time for projecting triangles and sorting them into tiles.
    pub placing: Duration,
}

/// Builds the maps of all lights of a scene into the file at `path`. On an error, no file appears.
///
/// The file depends only on the scene and the settings, not on the number of threads. A tile of the
/// base level is the same whether it is built as part of a region or of the whole map. `progress`
/// gets the number of finished tiles and of all tiles.
///
/// Memory: the scene as each view sees it (about 50 bytes a corner and 30 a triangle), the tiles in
/// progress, and the buffers of the [`Writer`].
///
/// # Errors
/// [`ErrorKind::Scene`] for a scene without lights or shadows, or a light that sees nothing;
/// [`ErrorKind::Setting`] for a region that cuts tiles or lies outside the map; [`ErrorKind::Map`]
/// for an error of the [`Writer`].
pub fn build(
    scene: &Scene,
    path: &Path,
    settings: &Settings,
    mut progress: impl FnMut(u64, u64),
) -> Result<Report> {
    if scene.lights.is_empty() {
        return Err(Error::new(ErrorKind::Scene, "the scene has no light"));
    }
    let mut writer = Writer::create(path).in_file(path)?;
    writer.set_budget(settings.waiting);
    writer.add_attribute("Software", concat!("dsm-build ", env!("CARGO_PKG_VERSION")));
    let mut maps = Vec::new();
    for light in &scene.lights {
        let views = light.views(scene)?;
        let region = region(settings, &views)?;
        let first = maps.len();
        for view in views {
            let id = writer
                .add_map(
                    header(scene, light, &view, settings, region),
                    encoding(light, settings),
                )
                .in_file(path)?;
            maps.push((light, view, region, id));
        }
        if matches!(light.kind, LightKind::Point { .. }) {
            writer.add_group(Group::new(
                light.name.clone(),
                GroupRole::Faces,
                maps[first..].iter().map(|map| map.3).collect(),
            ));
        }
    }
    let side = u64::from(settings.tile);
    let tiles = |[_, _, w, h]: Region| u64::from(w).div_ceil(side) * u64::from(h).div_ceil(side);
    let total = maps.iter().map(|m| tiles(m.2)).sum();
    let mut report = Report::default();
    report.tiles[0] = total;
    let mut done = 0;
    let mut before = [0; 2];
    for (i, (light, view, region, id)) in maps.iter().enumerate() {
        let map = Map {
            scene,
            light,
            view,
            region: *region,
            id: *id,
        };
        map.build(&mut writer, settings.tile, &mut report, &mut |tiles| {
            progress(done + tiles, total)
        })
        .in_file(path)?;
        done += tiles(*region);
        progress(done, total);
        if maps.get(i + 1).is_none_or(|next| next.0.name != light.name) {
            if report.vertices == before[0] && settings.region.is_none() {
                let seen = report.tiles[1] > before[1];
                report.lit.push((light.name.clone(), why_lit(scene, seen)));
            }
            before = [report.vertices, report.tiles[1]];
        }
    }
    let started = Instant::now();
    report.summary = writer.finish().in_file(path)?;
    report.writing += started.elapsed();
    Ok(report)
}

/// Why a light's maps have no vertices; `seen` is whether an object is in front of them.
fn why_lit(scene: &Scene, seen: bool) -> &'static str {
    let clear = |o: &&Object| o.opacity == [0.0; 3] && !matches!(o.shape, Shape::Volume(_));
    let shadows = || scene.objects.iter().filter(|o| o.shadow);
    match (seen, shadows().all(|o| clear(&o))) {
        (false, _) => "no object is in its view: check its position, target and angle",
        (true, true) => "every object has opacity 0",
        (true, false) => "its rays meet nothing that absorbs light",
    }
}

/// The part of each map to build.
fn region(settings: &Settings, views: &[View]) -> Result<Region> {
    let [width, height] = views[0].size;
    let Some([x, y, w, h]) = settings.region else {
        return Ok([0, 0, width, height]);
    };
    let ends = |from: u32, length: u32, side: u32| {
        let end = from
            .checked_add(length)
            .filter(|&end| length > 0 && end <= side);
        let whole = |at: u32| at.is_multiple_of(settings.tile);
        end.map(|end| whole(from) && (whole(end) || end == side))
    };
    match (ends(x, w, width), ends(y, h, height)) {
        (Some(true), Some(true)) => Ok([x, y, w, h]),
        (Some(_), Some(_)) => Err(Error::new(
            ErrorKind::Setting,
            format!(
                "the region {x},{y},{w},{h} cuts tiles of {} pixels",
                settings.tile
            ),
        )),
        _ => Err(Error::new(
            ErrorKind::Setting,
            format!(
                "the region {x},{y},{w},{h} is not inside the {width} x {height} pixels of the map"
            ),
        )),
    }
}

fn header(
    scene: &Scene,
    light: &Light,
    view: &View,
    settings: &Settings,
    region: Region,
) -> MapHeader {
    let [x, y, width, height] = region;
    let mut header = MapHeader::new(view.name.clone(), width, height);
    let shadows = || scene.objects.iter().filter(|o| o.shadow);
    let volume = |o: &&crate::scene::Object| matches!(o.shape, Shape::Volume(_));
    header.channels = if shadows().any(|o| o.is_coloured()) {
        3
    } else {
        1
    };
    header.tile_size = settings.tile;
    header.depth_kind = view.depth;
    header.camera = view.camera;
    header.data_origin = [x as i32, y as i32];
    header.display_window = [0, 0, view.size[0] as i32 - 1, view.size[1] as i32 - 1];
    header.interpretation = match (
        shadows().any(|o| volume(&o)),
        shadows().any(|o| !volume(&o)),
    ) {
        (false, true) => Interpretation::Discrete,
        (true, false) => Interpretation::Continuous,
        _ => Interpretation::Unspecified,
    };
    let samples = Attribute::Integers(vec![i64::from(light.samples)]);
    let width = Attribute::Numbers(vec![f64::from(light.filter_width)]);
    header
        .attribute("samplesPerPixel", samples)
        .attribute("pixelFilter", light.filter.to_string())
        .attribute("pixelFilterWidth", width)
}

fn encoding(light: &Light, settings: &Settings) -> Encoding {
    settings.encoding.clone().tolerance(light.tolerance())
}

/// One map to build.
struct Map<'a> {
    scene: &'a Scene,
    light: &'a Light,
    view: &'a View,
    region: Region,
    /// The map's id in the writer.
    id: MapId,
}

impl Map<'_> {
    fn build(
        &self,
        writer: &mut Writer,
        tile: u32,
        report: &mut Report,
        progress: &mut dyn FnMut(u64),
    ) -> Result<()> {
        let started = Instant::now();
        let [x, y, w, h] = self.region.map(|v| v as i32);
        let reach = self.light.margin();
        let side = tile as i32;
        let grid = TileGrid {
            tile: side,
            margin: reach,
            tiles: [
                x / side,
                (x + w + side - 1) / side,
                y / side,
                (y + h + side - 1) / side,
            ],
        };
        // Shoot the rays of the margin too: the filter then sums all its rays at the border of a
        // map or region.
        let within = [x - reach, x + w - 1 + reach, y - reach, y + h - 1 + reach];
        let triangles = Triangles::new(self.scene, self.view);
        let boxes = triangles.boxes(within);
        let pixels = Pixels::new(self.scene, self.light, self.view, &triangles, &boxes);
        let media = pixels.media_boxes(within);
        report.triangles += triangles.indices.len() as u64;
        report.placing += started.elapsed();
        let (mut before, mut tiles_at_a_time) = (0, BATCH_TILES[0]);
        for band in grid.bands(&boxes, BIN_ITEMS) {
            let started = Instant::now();
            let bins = Bins::new(band, &boxes);
            let media = Bins::new(band, &media);
            report.placing += started.elapsed();
            let [tx0, tx1, ty0, ty1] = band.tiles;
            let mut covered: Vec<_> = (ty0..ty1)
                .flat_map(|ty| (tx0..tx1).map(move |tx| (tx, ty)))
                .filter(|&(tx, ty)| !bins.of(tx, ty).is_empty() || !media.of(tx, ty).is_empty())
                .collect();
            // In Morton order, the levels above the base hold the fewest unfinished tiles.
            covered.sort_by_key(|&(tx, ty)| morton(tx as u32, ty as u32));
            report.tiles[1] += covered.len() as u64;
            let band_tiles = u64::from(tx1.abs_diff(tx0)) * u64::from(ty1.abs_diff(ty0));
            let all = covered.len().max(1) as u64;
            let mut done = 0;
            let mut rest = &covered[..];
            while !rest.is_empty() {
                let (batch, later) = rest.split_at(tiles_at_a_time.min(rest.len()));
                rest = later;
                let inputs = self.tiles(batch, grid, &bins, &pixels)?;
                tiles_at_a_time = next_batch(&inputs);
                let started = Instant::now();
                writer.tiles(self.id, inputs)?;
                report.writing += started.elapsed();
                done += batch.len() as u64;
                progress(before + band_tiles * done / all);
            }
            before += band_tiles;
        }
        let work = &pixels.work;
        let take = |n: &std::sync::atomic::AtomicU64| n.load(Ordering::Relaxed);
        report.rays += take(&work.rays);
        report.hits += take(&work.hits);
        report.vertices += take(&work.vertices);
        report.shooting += Duration::from_nanos(take(&work.shooting));
        report.summing += Duration::from_nanos(take(&work.summing));
        Ok(())
    }

    /// Makes the functions of some tiles, one block of pixels at a time.
    fn tiles(
        &self,
        batch: &[(i32, i32)],
        grid: TileGrid,
        bins: &Bins,
        pixels: &Pixels<'_>,
    ) -> Result<Vec<(TileId, TilePixels)>> {
        let [x, y, w, h] = self.region.map(|v| v as i32);
        let side = pixels.block_side(grid.tile);
        let extent = |t: i32, from: i32, length: i32| {
            let first = t * grid.tile;
            first..(first + grid.tile).min(from + length)
        };
        let mut blocks: Vec<(usize, PixelBox)> = Vec::new();
        for (i, &(tx, ty)) in batch.iter().enumerate() {
            let (columns, rows) = (extent(tx, x, w), extent(ty, y, h));
            for y0 in rows.clone().step_by(side as usize) {
                for x0 in columns.clone().step_by(side as usize) {
                    let x1 = (x0 + side).min(columns.end) - 1;
                    let y1 = (y0 + side).min(rows.end) - 1;
                    blocks.push((i, [x0, x1, y0, y1]));
                }
            }
        }
        let made: Vec<_> = blocks
            .par_iter()
            .map_init(Worker::default, |worker, &(i, block)| {
                let (tx, ty) = batch[i];
                pixels.functions(block, bins.of(tx, ty), worker)
            })
            .collect::<deepshadow::Result<_>>()?;
        let mut tiles: Vec<_> = batch
            .iter()
            .map(|&(tx, ty)| {
                let pixels = extent(tx, x, w).len() * extent(ty, y, h).len();
                vec![Curve::default(); pixels]
            })
            .collect();
        for ((i, [x0, x1, y0, _]), functions) in blocks.into_iter().zip(made) {
            let (tx, ty) = batch[i];
            let (left, across) = (extent(tx, x, w).start, extent(tx, x, w).len());
            for (k, function) in functions.into_iter().enumerate() {
                let width = (x1 - x0 + 1) as usize;
                let row = (y0 - extent(ty, y, h).start) as usize + k / width;
                tiles[i][row * across + (x0 - left) as usize + k % width] = function;
            }
        }
        let inputs = batch.iter().zip(tiles).map(|(&(tx, ty), curves)| {
            (
                TileId::new((tx - x / grid.tile) as u32, (ty - y / grid.tile) as u32),
                TilePixels::Curves(curves),
            )
        });
        Ok(inputs.collect())
    }
}

/// Number of tiles in the batch after `made`. Limited by memory and by twice the size of `made`,
/// because neighbouring tiles have similar sizes.
///
/// The number does not depend on the threads, so neither does the file.
fn next_batch(made: &[(TileId, TilePixels)]) -> usize {
    let bytes = |(_, pixels): &(TileId, TilePixels)| match pixels {
        TilePixels::Curves(curves) => curves
            .iter()
            .map(|c| size_of_val(c) + c.len() * (4 + 8 * c.channels()))
            .sum(),
        _ => 0usize,
    };
    let most = made.iter().map(bytes).max().unwrap_or(0).max(1);
    (BATCH_BYTES / most)
        .min(2 * made.len())
        .clamp(1, BATCH_TILES[1])
}

/// The Morton code: the bits of both numbers interleaved.
fn morton(x: u32, y: u32) -> u64 {
    let spread = |v: u32| {
        (0..32).fold(0u64, |all, bit| {
            all | (u64::from(v) >> bit & 1) << (2 * bit)
        })
    };
    spread(x) | spread(y) << 1
}
