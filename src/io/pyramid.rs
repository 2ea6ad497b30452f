//! The levels above the base, built while tiles arrive in any order, within a budget of memory.
//!
//! Each arriving tile is averaged 2 x 2 into a *quarter* of the tile above it. A tile with all its
//! quarters is stored, and averaged in turn. Quarters that exceed the budget wait in scratch
//! storage.
//!
//! Each average yields two functions: a *stored* one, within the tolerance of its level, and a more
//! precise *hidden* one, from which the next level is averaged. The errors of the hidden functions
//! add up from level to level. Storing a level spends the rest of its tolerance, so every level has
//! the same largest error.
//!
//! A tile depends only on the four tiles below it, so neither the order of arrival nor the number
//! of threads changes the result.

use std::collections::{BTreeMap, HashMap};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::Arc;

use super::temporary::{FileSystem, Temporary};
use crate::format::directory::Entry;
use crate::format::{Codec, Tile, TileBuilder};
use crate::function::compress::Precision;
use crate::function::compress::{Encoder, MIN_TOLERANCE};
use crate::map::{LevelShape, MapHeader, TileId};
use crate::{Compressor, Curve, Error, Result, Sweep, Visibility};

/// How a level is made from the level below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Schedule {
    /// From hidden functions, with the same largest error at every level.
    Hidden,
    /// From stored functions, with half the tolerance at each level (LV00, section 5.3).
    Halved,
}

/// The parameters of the levels of one map.
#[derive(Clone, Debug)]
pub(crate) struct MipPlan {
    pub header: MapHeader,
    pub compressor: Compressor,
    pub schedule: Schedule,
    /// For each level, the largest error of its stored functions.
    pub max_errors: Vec<f64>,
    pub precisions: Vec<Precision>,
}

/// The functions of a tile, from which the level above is averaged.
pub(crate) enum Source {
    Curves(Vec<Curve>),
    Functions {
        functions: Vec<Visibility>,
        /// Largest error of a function.
        error: f64,
        /// Largest error of a function without vertices.
        lit_error: f64,
    },
}

impl Source {
    /// Largest error of a function, and of a function without vertices.
    fn errors(&self) -> (f64, f64) {
        match self {
            Source::Curves(curves) => {
                let error = curves.iter().fold(0.0, |e, c| c.error().max(e));
                (error, error)
            }
            Source::Functions {
                error, lit_error, ..
            } => (*error, *lit_error),
        }
    }

    fn is_lit(&self, i: usize) -> bool {
        match self {
            Source::Curves(curves) => curves[i].is_empty(),
            Source::Functions { functions, .. } => functions[i].is_empty(),
        }
    }
}

/// A quarter of a tile, in memory or, with `T` = [`ScratchTile`], in scratch storage.
#[derive(Debug)]
pub(crate) struct Quarter<T = Tile> {
    /// The stored functions, and the hidden ones if the schedule has them. None if all are lit.
    tiles: Vec<T>,
    /// Largest error of the functions that the next level is averaged from.
    error: f64,
    /// The same, of those without vertices.
    lit_error: f64,
}

impl<T> Quarter<T> {
    fn lit(lit_error: f64) -> Self {
        Quarter {
            tiles: Vec::new(),
            error: lit_error,
            lit_error,
        }
    }

    fn try_map<U>(self, f: impl FnMut(T) -> Result<U>) -> Result<Quarter<U>> {
        Ok(Quarter {
            tiles: self.tiles.into_iter().map(f).collect::<Result<_>>()?,
            error: self.error,
            lit_error: self.lit_error,
        })
    }
}

impl Quarter {
    fn bytes(&self) -> usize {
        self.tiles.iter().map(Tile::bytes).sum()
    }
}

/// `precision`, or f32 if the lattice is coarser than the tolerance.
pub(crate) fn affordable(precision: Precision, tolerance: f64) -> Precision {
    match precision {
        Precision::Lattice(l) if tolerance * f64::from(l) < 1.0 => Precision::F32,
        precision => precision,
    }
}

impl MipPlan {
    fn shape(&self, level: usize) -> LevelShape {
        LevelShape::of(&self.header, level as u32)
    }

    /// Averages a tile of `level` into a quarter of the tile above it.
    pub fn quarter(&self, level: usize, tile: TileId, source: &Source) -> Result<Quarter> {
        let shape = self.shape(level);
        let (width, height) = shape.tile_extent(tile);
        let (across, down) = (width.div_ceil(2), height.div_ceil(2));
        let (carried, lit_carried) = source.errors();
        if (0..(width * height) as usize).all(|i| source.is_lit(i)) {
            return Ok(Quarter::lit(lit_carried));
        }
        let above = level + 1;
        let max_error = self.max_errors[above];
        let precision = affordable(self.precisions[above], max_error - carried);
        let mut to_store = Encoder::new(self.compressor, precision, max_error)?;
        let (mut to_hide, error, lit_error) = match self.schedule {
            Schedule::Hidden => {
                // Hidden functions spend an eighth of the rest, and less at each level. The encoder
                // counts the error of its input against its tolerance.
                let rest = max_error - carried;
                let share = (rest * 0.5f64.powi((level + 3).min(7) as i32)).max(MIN_TOLERANCE);
                let error = carried + share;
                let encoder = Encoder::new(self.compressor, Precision::F32, error)?;
                // Hidden functions end at the nearest f32: without vertices they add no error.
                (Some(encoder), error, lit_carried)
            }
            Schedule::Halved => (None, max_error, max_error),
        };
        let corner = shape.first_pixel(tile);
        let mut exact = Sweep::new();
        let (mut child, mut average) = (Curve::lit(1), Curve::lit(1));
        let (mut stored_one, mut hidden_one) = (Visibility::lit(), Visibility::lit());
        let mut stored = TileBuilder::new(across, precision);
        let mut hidden = TileBuilder::new(across, Precision::F32);
        for y in 0..down {
            for x in 0..across {
                exact.clear();
                let mut all_lit = true;
                for j in 2 * y..(2 * y + 2).min(height) {
                    for i in 2 * x..(2 * x + 2).min(width) {
                        let at = (j * width + i) as usize;
                        let lit = source.is_lit(at);
                        all_lit &= lit;
                        let curve = match source {
                            Source::Curves(curves) => &curves[at],
                            Source::Functions { functions, .. } => {
                                let error = if lit { lit_carried } else { carried };
                                child.assign(&functions[at], error);
                                &child
                            }
                        };
                        exact.add(curve, self.weight(level, corner.x + i, corner.y + j))?;
                    }
                }
                if all_lit {
                    stored.push(&Visibility::lit());
                    hidden.push(&Visibility::lit());
                    continue;
                }
                exact.finish(&mut average)?;
                to_store.compress(&average, &mut stored_one)?;
                stored.push(&stored_one);
                if let Some(encoder) = &mut to_hide {
                    encoder.compress(&average, &mut hidden_one)?;
                    hidden.push(&hidden_one);
                }
            }
        }
        let mut tiles = vec![stored.finish()];
        tiles.extend(to_hide.map(|_| hidden.finish()));
        Ok(Quarter {
            tiles,
            error,
            lit_error,
        })
    }

    /// The number of base pixels that pixel (x, y) of `level` covers.
    fn weight(&self, level: usize, x: u32, y: u32) -> f64 {
        let covered = |side: u32, at: u32| {
            let start = u64::from(at) << level;
            ((start + (1 << level)).min(u64::from(side)) - start) as f64
        };
        covered(self.header.width, x) * covered(self.header.height, y)
    }

    /// Joins the quarters of a tile: the tile to store, and the source of the next level.
    pub fn assemble(&self, ready: &Ready) -> (Tile, Source) {
        let (width, height) = self.shape(ready.level).tile_extent(ready.tile);
        let half = self.header.tile_size / 2;
        let mut stored = TileBuilder::new(width, self.precisions[ready.level]);
        let mut functions = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let at = (usize::from(y >= half) << 1) | usize::from(x >= half);
                let tiles = &ready.quarters[at].tiles;
                let Some(first) = tiles.first() else {
                    stored.push(&Visibility::lit());
                    functions.push(Visibility::lit());
                    continue;
                };
                let i = (y % half * first.width() + x % half) as usize;
                stored.push(first.function(i));
                let source = tiles.last().unwrap_or(first);
                functions.push(source.function(i).to_visibility());
            }
        }
        let most =
            |error: fn(&Quarter) -> f64| ready.quarters.iter().map(error).fold(0.0, f64::max);
        let source = Source::Functions {
            functions,
            error: most(|q| q.error),
            lit_error: most(|q| q.lit_error),
        };
        (stored.finish(), source)
    }
}

/// Quarters that wait for the other quarters of their tile.
pub(crate) struct Pyramid {
    /// For each level from 1, by tile (y, x): the quarters that have arrived.
    waiting: Vec<BTreeMap<(u32, u32), Waiting>>,
    /// Bytes of waiting quarters in memory.
    held: usize,
    scratch: Option<Temporary>,
    system: Arc<dyn FileSystem>,
    folder: PathBuf,
}

#[derive(Default)]
struct Waiting {
    arrived: u32,
    quarters: [Arrival; 4],
}

#[derive(Default)]
enum Arrival {
    #[default]
    Missing,
    Held(Quarter),
    Spilled(Quarter<ScratchTile>),
}

/// A tile in scratch storage.
struct ScratchTile {
    entry: Entry,
    offset: u64,
    extent: (u32, u32),
}

/// A tile of `level` that has all its quarters.
pub(crate) struct Ready {
    pub level: usize,
    pub tile: TileId,
    quarters: [Quarter; 4],
}

impl Pyramid {
    /// A pyramid of `levels` levels, with its scratch storage in `folder`.
    pub fn new(levels: usize, system: Arc<dyn FileSystem>, folder: PathBuf) -> Self {
        Pyramid {
            waiting: (1..levels).map(|_| BTreeMap::new()).collect(),
            held: 0,
            scratch: None,
            system,
            folder,
        }
    }

    /// Takes the quarter that was made from a tile of `level`. Keeps at most `budget` bytes of
    /// quarters in memory. Returns the tile above if this was its last quarter.
    pub fn deposit(
        &mut self,
        plan: &MipPlan,
        (level, TileId { x, y }): (usize, TileId),
        quarter: Quarter,
        budget: usize,
    ) -> Result<Option<Ready>> {
        let bytes = quarter.bytes();
        let arrival = if bytes > 0 && self.held + bytes > budget {
            Arrival::Spilled(quarter.try_map(|tile| self.spill(&tile))?)
        } else {
            self.held += bytes;
            Arrival::Held(quarter)
        };
        let key = (y / 2, x / 2);
        let waiting = self.waiting[level].entry(key).or_default();
        waiting.quarters[((y & 1) << 1 | (x & 1)) as usize] = arrival;
        waiting.arrived += 1;
        let below = plan.shape(level);
        let present = |t: u32, tiles: u32| (tiles - t * 2).min(2);
        if waiting.arrived < present(x / 2, below.tiles_x()) * present(y / 2, below.tiles_y()) {
            return Ok(None);
        }
        self.take(level, key).map(Some)
    }

    /// Any waiting tile of the level above `level`. Its missing quarters are lit.
    pub fn take_incomplete(&mut self, level: usize) -> Result<Option<Ready>> {
        match self.waiting[level].first_key_value() {
            Some((&key, _)) => self.take(level, key).map(Some),
            None => Ok(None),
        }
    }

    fn take(&mut self, level: usize, key: (u32, u32)) -> Result<Ready> {
        let waiting = self.waiting[level].remove(&key).unwrap_or_default();
        let mut quarters = [(); 4].map(|()| Quarter::lit(0.0));
        for (quarter, arrival) in quarters.iter_mut().zip(waiting.quarters) {
            match arrival {
                Arrival::Missing => {}
                Arrival::Held(held) => {
                    self.held -= held.bytes();
                    *quarter = held;
                }
                Arrival::Spilled(spilled) => *quarter = spilled.try_map(|t| self.fetch(&t))?,
            }
        }
        Ok(Ready {
            level: level + 1,
            tile: TileId::new(key.1, key.0),
            quarters,
        })
    }

    /// Writes a tile to scratch storage.
    fn spill(&mut self, tile: &Tile) -> Result<ScratchTile> {
        let file = match &mut self.scratch {
            Some(file) => file,
            none => {
                let folder = &self.folder;
                let failed = |e| {
                    Error::io(
                        format!("cannot make scratch storage in {}", folder.display()),
                        e,
                    )
                };
                let file = Temporary::scratch(self.system.clone(), folder);
                none.insert(file.map_err(failed)?)
            }
        };
        // LZ4 halves the bytes on the disk and takes no noticeable time.
        let (entry, bytes) = tile.encode(Codec::Lz4)?;
        let offset = file.seek(SeekFrom::End(0));
        let written = offset.and_then(|offset| file.write_all(&bytes).map(|()| offset));
        Ok(ScratchTile {
            entry,
            offset: written.map_err(|e| Error::io("cannot write scratch storage", e))?,
            extent: (tile.width(), tile.pixels() as u32 / tile.width()),
        })
    }

    /// Reads a tile from scratch storage.
    fn fetch(&mut self, tile: &ScratchTile) -> Result<Tile> {
        let mut bytes = vec![0; tile.entry.stored_size as usize];
        let file = self.scratch.as_mut().expect("`spill` made the file");
        let found = file.seek(SeekFrom::Start(tile.offset));
        let read = found.and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|e| Error::io("cannot read scratch storage", e))?;
        Tile::decode(&tile.entry, &bytes, tile.extent, u64::MAX)
    }
}

/// Tiles that are filled pixel by pixel.
#[derive(Default)]
pub(crate) struct OpenTiles {
    tiles: HashMap<TileId, OpenTile>,
    /// Bytes of their functions.
    pub held: usize,
}

struct OpenTile {
    curves: Vec<Option<Curve>>,
    missing: usize,
    bytes: usize,
}

impl OpenTiles {
    /// Bytes that `curve` takes here.
    pub fn cost(curve: &Curve) -> usize {
        curve.len() * (4 + 8 * curve.channels()) + size_of::<Option<Curve>>()
    }

    /// Takes the function of a pixel: `at` is its index in a tile of `pixels` pixels. Returns all
    /// functions of the tile if this was the last one.
    pub fn put(
        &mut self,
        id: TileId,
        pixels: usize,
        at: usize,
        curve: Curve,
    ) -> Result<Option<Vec<Curve>>> {
        let tile = self.tiles.entry(id).or_insert_with(|| OpenTile {
            curves: vec![None; pixels],
            missing: pixels,
            bytes: 0,
        });
        if tile.curves[at].is_some() {
            return Err(Error::input("the pixel was given before"));
        }
        let cost = Self::cost(&curve);
        tile.bytes += cost;
        self.held += cost;
        tile.curves[at] = Some(curve);
        tile.missing -= 1;
        match tile.missing {
            0 => Ok(self.close(id)),
            _ => Ok(None),
        }
    }

    pub fn is_open(&self, tile: TileId) -> bool {
        self.tiles.contains_key(&tile)
    }

    /// The functions of an open tile. Missing pixels are lit.
    pub fn close(&mut self, tile: TileId) -> Option<Vec<Curve>> {
        let tile = self.tiles.remove(&tile)?;
        self.held -= tile.bytes;
        let curves = tile.curves.into_iter();
        Some(curves.map(Option::unwrap_or_default).collect())
    }

    /// The open tiles, in the order of the directory.
    pub fn keys(&self) -> Vec<TileId> {
        let mut keys: Vec<_> = self.tiles.keys().copied().collect();
        keys.sort_unstable_by_key(|tile| (tile.y, tile.x));
        keys
    }
}
