//! Support for the cache tests: files, a source that counts its reads, and the right answers.

use std::collections::HashMap;
use std::io;
use std::sync::{Arc, Mutex};

use crate::random::Random;
use crate::support::tile_ids;
use crate::vectors_support::valid::{mixed_mono, mixed_rgb, off_lattice};
use crate::vectors_support::{RawFile, RawLevel, header, mono, tiles_of};
use deepshadow::raw::{LevelShape, Precision};
use deepshadow::*;

/// Codec and transform of the tiles of a file.
pub const WAYS: [(Codec, u8); 3] = [(Codec::None, 0), (Codec::Lz4, 1), (Codec::Zstd(3), 1)];

/// Bytes of a tile slot in the cache's tables.
pub const SLOT: usize = 16;

/// The cache's bookkeeping for a tile takes fewer bytes than this.
pub const BOOKKEEPING: usize = 512;

/// A function that differs from pixel to pixel.
///
/// Some tiles of 8 x 8 pixels are lit, some hold one vertex, and some are ten times as large as
/// others.
fn function(map: usize, level: u32, x: u32, y: u32) -> Visibility {
    match (x / 8 + 3 * (y / 8) + level) % 8 {
        0 => Visibility::lit(),
        1 => mono(&[(2.5 + level as f32, 0.25)]),
        2 => staircase(x, y, 40),
        _ if map == 1 && x & 1 == 0 => mixed_rgb(x, y),
        _ if map == 1 => off_lattice(x % 16, y + level),
        _ => mixed_mono(x + level, y),
    }
}

/// A staircase of `n` vertices that ends at 0.
pub fn staircase(x: u32, y: u32, n: u32) -> Visibility {
    let z = |i| 1.0 + (x + y) as f32 / 16.0 + i as f32 / 8.0;
    let v = |i: u32| ((64 - i.min(63)) / 2) as f32 / 64.0;
    let vertices: Vec<_> = (0..n).map(|i| (z(i), v(i))).collect();
    mono(&vertices)
}

/// A file of two maps: a mono one of four levels, a coloured one of one level.
///
/// Its first level has more than a thousand tiles.
pub fn everything(way: (Codec, u8)) -> Vec<u8> {
    let mut file = RawFile::default();
    let sizes = [("mono", 263, 257, 1, 4), ("colour", 70, 33, 3, 1)];
    for (map, (name, width, height, channels, count)) in sizes.into_iter().enumerate() {
        let h = header(name, width, height, channels);
        let precision = [Precision::Lattice(64), Precision::F32][map];
        let levels = (0..count).map(|l| RawLevel {
            max_error: 0.0,
            tiles: tiles_of(LevelShape::of(&h, l), precision, way, |x, y| {
                function(map, l, x, y)
            }),
            directory: way.0,
        });
        let levels = levels.collect();
        file.maps.push((h, levels));
    }
    file.assemble()
}

/// A file of one map, which is a single row of tiles of 8 x 8 pixels.
///
/// All pixels of tile `t` are staircases of `sizes[t]` vertices.
pub fn row(way: (Codec, u8), sizes: &[u32]) -> Vec<u8> {
    let h = header("row", 8 * sizes.len() as u32, 8, 1);
    let level = RawLevel {
        max_error: 0.0,
        tiles: tiles_of(
            LevelShape::of(&h, 0),
            Precision::Lattice(64),
            way,
            |x, y| match sizes[(x / 8) as usize] {
                0 => Visibility::lit(),
                n => staircase(x, y, n),
            },
        ),
        directory: Codec::None,
    };
    RawFile::of(h, vec![level]).assemble()
}

/// Bytes in memory behind a source that records its reads; a hook may delay them, fail or panic.
pub struct Watched {
    pub bytes: Vec<u8>,
    reads: Mutex<Vec<u64>>,
    hook: Mutex<Arc<Hook>>,
}

type Hook = dyn Fn(u64) -> io::Result<()> + Send + Sync;

impl Watched {
    /// A file of these bytes and its source.
    pub fn open(bytes: Vec<u8>) -> (DsmFile, Arc<Watched>) {
        let source = Arc::new(Watched {
            bytes,
            reads: Mutex::default(),
            hook: Mutex::new(Arc::new(|_| Ok(()))),
        });
        let file = DsmFile::from_source(source.clone(), Limits::default()).unwrap();
        // Read the directories before anybody counts.
        for (m, map) in file.maps().iter().enumerate() {
            for l in 0..map.levels.len() {
                file.entry(MapId(m as u32).level(l as u32), TileId::new(0, 0))
                    .unwrap();
            }
        }
        (file, source)
    }

    /// Calls `hook` with the offset before each read.
    pub fn on_read(&self, hook: impl Fn(u64) -> io::Result<()> + Send + Sync + 'static) {
        *self.hook.lock().unwrap() = Arc::new(hook);
    }

    /// How often a read began at `offset`.
    pub fn reads(&self, offset: u64) -> usize {
        let reads = self.reads.lock().unwrap();
        reads.iter().filter(|&&r| r == offset).count()
    }
}

impl ReadAt for Watched {
    fn length(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.reads.lock().unwrap().push(offset);
        let hook = self.hook.lock().unwrap().clone();
        hook(offset)?;
        buffer.copy_from_slice(&self.bytes[offset as usize..][..buffer.len()]);
        Ok(())
    }
}

/// Every tile of a file, decoded once.
pub struct Model {
    tiles: HashMap<(usize, usize, u32, u32), Tile>,
    shapes: Vec<Vec<LevelShape>>,
}

impl Model {
    pub fn new(bytes: Vec<u8>) -> Self {
        let file = DsmFile::from_bytes(bytes).unwrap();
        let mut tiles = HashMap::new();
        let shapes: Vec<Vec<LevelShape>> = file
            .maps()
            .iter()
            .map(|map| map.levels.iter().map(|level| level.shape).collect())
            .collect();
        for (level, tile) in tile_ids(&file) {
            let place = (level.map.0 as usize, level.level as usize, tile.x, tile.y);
            tiles.insert(place, file.tile(level, tile).unwrap());
        }
        Model { tiles, shapes }
    }

    /// Bytes of the cache's tables for all tiles.
    pub fn tables(&self) -> usize {
        SLOT * self.tiles.len()
    }

    /// Bytes of the largest tile.
    pub fn largest(&self) -> usize {
        self.tiles.values().map(Tile::bytes).max().unwrap()
    }

    pub fn shape(&self, map: usize, level: usize) -> LevelShape {
        self.shapes[map][level]
    }

    pub fn levels(&self, map: usize) -> usize {
        self.shapes[map].len()
    }

    /// The visibility of a pixel at a depth, computed as the specification says.
    pub fn answer(&self, map: usize, level: usize, (x, y): (u32, u32), depth: f32) -> [f32; 3] {
        let side = self.shape(map, level).tile_size;
        let tile = &self.tiles[&(map, level, x / side, y / side)];
        let f = tile.function((y % side * tile.width() + x % side) as usize);
        let (z, n) = (f.depths(), f.channels());
        let next = z.partition_point(|&z| z < depth);
        let scale = match tile.precision() {
            Precision::Lattice(l) => f64::from(l),
            _ => 1.0,
        };
        std::array::from_fn(|c| {
            let value = |k: usize| {
                let v = f.value(k, c % n);
                // On the lattice, interpolate between the stored integers k, not between k / L.
                if scale == 1.0 { v } else { (v * scale).round() }
            };
            if next == 0 {
                return 1.0;
            }
            let before = value(next - 1);
            if next == z.len() {
                return (before / scale) as f32;
            }
            let (z0, z1) = (f64::from(z[next - 1]), f64::from(z[next]));
            let t = (f64::from(depth) - z0) / (z1 - z0);
            ((before + (value(next) - before) * t) / scale) as f32
        })
    }
}

/// A sampler that looks up one pixel without a filter.
pub fn nearest(file: &CachedFile, map: usize, on_error: OnError) -> Sampler {
    let options = SamplerOptions::default()
        .filter(Filter::Nearest)
        .on_error(on_error);
    Sampler::with_options(file, MapId(map as u32), options).unwrap()
}

/// The query for one pixel of a level by a [`nearest`] sampler.
pub fn pixel(level: usize, (x, y): (u32, u32), depth: f32) -> Query {
    let side = (1u32 << level) as f32;
    Query::new((x as f32 + 0.5) * side, (y as f32 + 0.5) * side, depth).width(side)
}

impl Random {
    /// A pixel of a level, near the last one more often than not.
    pub fn pixel(&mut self, shape: LevelShape, last: (u32, u32)) -> (u32, u32) {
        let mut near = |last: u32, side: u32| match self.below(4) {
            0 => self.below(side),
            1 => (last + 3).min(side - 1),
            _ => last.saturating_sub(self.below(6)).min(side - 1),
        };
        (near(last.0, shape.width), near(last.1, shape.height))
    }

    /// A depth in front of, on, between or behind the vertices.
    pub fn depth(&mut self) -> f32 {
        match self.below(8) {
            0 => f32::INFINITY,
            1 => f32::NEG_INFINITY,
            _ => self.below(400) as f32 / 8.0 - 2.0,
        }
    }
}
