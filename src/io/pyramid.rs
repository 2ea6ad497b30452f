//! The levels above the base, built while tiles arrive in any order, within a budget of memory.
//!
//! Each tile is averaged 2 x 2 as it arrives, into a quarter of the tile above it. When all quarters of a tile are there, it
//! is stored, and averaged in turn. Two functions come of every average: the one that is *stored*, within the tolerance of
//! its level, and a *hidden* one, more precise, from which the next level is averaged. The errors of the hidden
//! chain add up, and what they leave of the tolerance is spent when a level is stored, so that every level keeps the same
//! promise. Quarters that wait beyond the budget go to scratch storage. Each result depends on the four tiles below it
//! alone: neither the order of arrival nor the number of threads changes it.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::PathBuf;

use crate::format::directory::Entry;
use crate::format::{Codec, Tile, TileBuilder};
use crate::function::compress::Encoder;
use crate::function::compress::MIN_TOLERANCE;
use crate::map::{LevelShape, MapHeader, TileId};
use crate::{Compressor, Curve, Error, Precision, Result, Sweep, Visibility};

/// How levels are made from the ones below them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Schedule {
    /// From the hidden chain, the same promise at every level.
    Hidden,
    /// From the stored functions of the level below, the tolerance halved at each level (LV00, section 5.3).
    Halved,
}

/// What is needed to make the levels of one map.
#[derive(Clone, Debug)]
pub(crate) struct MipPlan {
    pub header: MapHeader,
    pub compressor: Compressor,
    pub schedule: Schedule,
    /// For each level, how far its stored functions may be from the exact average.
    pub max_errors: Vec<f64>,
    pub precisions: Vec<Precision>,
}

/// The functions of a tile, one after another.
pub(crate) enum Source<'a> {
    Curves(&'a [Curve]),
    /// Stored functions, all within `error` of what they stand for, and those that are lit within `lit_error`.
    Functions {
        functions: &'a [Visibility],
        error: f64,
        lit_error: f64,
    },
}

impl Source<'_> {
    /// How far any of the functions may be from what it stands for.
    fn error(&self) -> f64 {
        match self {
            Source::Curves(curves) => curves.iter().fold(0.0, |e, c| c.error().max(e)),
            Source::Functions { error, .. } => *error,
        }
    }

    /// How far what is said to be lit may be from it.
    fn lit_error(&self) -> f64 {
        match self {
            Source::Curves(_) => self.error(),
            Source::Functions { lit_error, .. } => *lit_error,
        }
    }

    fn is_lit(&self, i: usize) -> bool {
        match self {
            Source::Curves(curves) => curves[i].is_empty(),
            Source::Functions { functions, .. } => functions[i].is_empty(),
        }
    }
}

/// The functions of a quarter of a tile. What was never given is lit without error.
#[derive(Debug, Default)]
pub(crate) struct Quarter {
    /// `None` if they are all lit.
    functions: Option<Box<Functions>>,
    /// How far those that are lit may be from what they stand for.
    lit_error: f64,
}

/// Stored and hidden functions of some pixels, the hidden ones with their errors.
#[derive(Debug)]
struct Functions {
    stored: Tile,
    /// With [`Schedule::Halved`], the stored ones serve.
    hidden: Option<Tile>,
    error: f64,
}

impl Functions {
    fn bytes(&self) -> usize {
        self.stored.bytes() + self.hidden.as_ref().map_or(0, Tile::bytes)
    }
}

/// A tile of a level, made from its quarters: stored, and as the source of the next level.
pub(crate) struct Parent {
    pub stored: Tile,
    hidden: Vec<Visibility>,
    error: f64,
    lit_error: f64,
}

impl Parent {
    /// The functions that the next level is made from.
    pub fn source(&self) -> Source<'_> {
        Source::Functions {
            functions: &self.hidden,
            error: self.error,
            lit_error: self.lit_error,
        }
    }
}

/// `precision`, or f32 where its lattice is coarser than a tolerance.
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
        let (width, height) = self.shape(level).tile_extent(tile);
        let (across, down) = (width.div_ceil(2), height.div_ceil(2));
        if (0..(width * height) as usize).all(|i| source.is_lit(i)) {
            return Ok(Quarter {
                functions: None,
                lit_error: source.lit_error(),
            });
        }
        let above = level + 1;
        let max_error = self.max_errors[above];
        let carried = source.error();
        let precision = affordable(self.precisions[above], max_error - carried);
        let mut to_store = Encoder::new(self.compressor, precision, max_error)?;
        // Hidden functions spend an eighth of what is left, then less at each level. The encoder counts the error of
        // its input against its tolerance.
        let share =
            ((max_error - carried) * 0.5f64.powi((level + 3).min(7) as i32)).max(MIN_TOLERANCE);
        let mut to_hide = match self.schedule {
            Schedule::Hidden => Some(Encoder::new(
                self.compressor,
                Precision::F32,
                carried + share,
            )?),
            Schedule::Halved => None,
        };
        let error = if to_hide.is_some() {
            carried + share
        } else {
            max_error
        };
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
                        all_lit &= source.is_lit(at);
                        let curve = match source {
                            Source::Curves(curves) => &curves[at],
                            Source::Functions {
                                functions,
                                error,
                                lit_error,
                            } => {
                                let lit = functions[at].is_empty();
                                child.assign(&functions[at], if lit { *lit_error } else { *error });
                                &child
                            }
                        };
                        let [left, top] = [tile.x, tile.y].map(|t| t * self.header.tile_size);
                        exact.add(curve, self.weight(level, left + i, top + j))?;
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
        // Hidden functions end at the nearest f32: those that are lit have no error but that of what they were made from.
        let lit_error = match self.schedule {
            Schedule::Hidden => source.lit_error(),
            Schedule::Halved => error,
        };
        let hidden = to_hide.map(|_| hidden.finish());
        Ok(Quarter {
            functions: Some(Box::new(Functions {
                stored: stored.finish(),
                hidden,
                error,
            })),
            lit_error,
        })
    }

    /// How many pixels of the base pixel (x, y) of `level` stands for.
    fn weight(&self, level: usize, x: u32, y: u32) -> f64 {
        let covered = |side: u32, at: u32| {
            let start = u64::from(at) << level;
            ((start + (1 << level)).min(u64::from(side)) - start) as f64
        };
        covered(self.header.width, x) * covered(self.header.height, y)
    }

    /// Puts the quarters of a tile of `level` together.
    fn assemble(&self, level: usize, tile: TileId, quarters: [Quarter; 4]) -> Parent {
        let (width, height) = self.shape(level).tile_extent(tile);
        let half = self.header.tile_size / 2;
        let mut stored = TileBuilder::new(width, self.precisions[level]);
        let mut hidden = Vec::with_capacity((width * height) as usize);
        for y in 0..height {
            for x in 0..width {
                let quarter = &quarters[(usize::from(y >= half) << 1) | usize::from(x >= half)];
                let Some(functions) = &quarter.functions else {
                    stored.push(&Visibility::lit());
                    hidden.push(Visibility::lit());
                    continue;
                };
                let i = (y % half * functions.stored.width() + x % half) as usize;
                stored.push(functions.stored.function(i));
                let own = functions.hidden.as_ref().unwrap_or(&functions.stored);
                hidden.push(own.function(i).to_visibility());
            }
        }
        let lit_error = quarters.iter().fold(0.0f64, |e, q| e.max(q.lit_error));
        let error = quarters
            .iter()
            .flat_map(|q| &q.functions)
            .fold(lit_error, |e, f| e.max(f.error));
        Parent {
            stored: stored.finish(),
            hidden,
            error,
            lit_error,
        }
    }
}

/// Quarters that wait for their neighbours.
pub(crate) struct Pyramid {
    /// For each level from 1, by (ty, tx): what has arrived.
    waiting: Vec<BTreeMap<(u32, u32), Waiting>>,
    /// Bytes of waiting quarters in memory.
    pub held: usize,
    scratch: Option<File>,
    scratch_end: u64,
    pub folder: PathBuf,
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
    Spilled(Spilled),
}

/// A quarter in scratch storage.
struct Spilled {
    stored: (Entry, u64),
    hidden: Option<(Entry, u64)>,
    extent: (u32, u32),
    error: f64,
    lit_error: f64,
}

/// A tile of `level` whose quarters are all there.
pub(crate) struct Ready {
    pub level: usize,
    pub tile: TileId,
    quarters: [Quarter; 4],
}

impl Ready {
    pub fn assemble(self, plan: &MipPlan) -> Parent {
        plan.assemble(self.level, self.tile, self.quarters)
    }
}

impl Pyramid {
    pub fn new(levels: usize, folder: PathBuf) -> Self {
        let waiting = (1..levels).map(|_| BTreeMap::new()).collect();
        Pyramid {
            waiting,
            held: 0,
            scratch: None,
            scratch_end: 0,
            folder,
        }
    }

    /// Takes the quarter of a tile of `level`; keeps it in memory if no more than `budget` bytes are held.
    /// Returns the tile above if this was its last quarter.
    pub fn deposit(
        &mut self,
        plan: &MipPlan,
        (level, TileId { x, y }): (usize, TileId),
        quarter: Quarter,
        budget: usize,
    ) -> Result<Option<Ready>> {
        let arrival = match &quarter.functions {
            Some(functions) if self.held + functions.bytes() > budget => {
                Arrival::Spilled(self.spill(functions, quarter.lit_error)?)
            }
            Some(functions) => {
                self.held += functions.bytes();
                Arrival::Held(quarter)
            }
            None => Arrival::Held(quarter),
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

    /// Any tile of the level above `level` that still waits, its missing quarters being lit.
    pub fn take_incomplete(&mut self, level: usize) -> Result<Option<Ready>> {
        match self.waiting[level].first_key_value() {
            Some((&key, _)) => self.take(level, key).map(Some),
            None => Ok(None),
        }
    }

    fn take(&mut self, level: usize, key: (u32, u32)) -> Result<Ready> {
        let waiting = self.waiting[level].remove(&key).unwrap_or_default();
        let mut quarters: [Quarter; 4] = Default::default();
        for (quarter, arrival) in quarters.iter_mut().zip(waiting.quarters) {
            *quarter = match arrival {
                Arrival::Missing => Quarter::default(),
                Arrival::Held(quarter) => {
                    self.held -= quarter.functions.as_ref().map_or(0, |f| f.bytes());
                    quarter
                }
                Arrival::Spilled(spilled) => self.fetch(&spilled)?,
            };
        }
        Ok(Ready {
            level: level + 1,
            tile: TileId::new(key.1, key.0),
            quarters,
        })
    }

    fn spill(&mut self, functions: &Functions, lit_error: f64) -> Result<Spilled> {
        if self.scratch.is_none() {
            let file = tempfile::tempfile_in(&self.folder).map_err(|e| {
                Error::io(
                    format!("cannot make scratch storage in {}", self.folder.display()),
                    e,
                )
            })?;
            self.scratch = Some(file);
        }
        let stored = self.put(&functions.stored)?;
        let hidden = functions
            .hidden
            .as_ref()
            .map(|tile| self.put(tile))
            .transpose()?;
        let width = functions.stored.width();
        let extent = (width, functions.stored.pixels() as u32 / width);
        Ok(Spilled {
            stored,
            hidden,
            extent,
            error: functions.error,
            lit_error,
        })
    }

    fn put(&mut self, tile: &Tile) -> Result<(Entry, u64)> {
        // Small enough to halve what goes through the disk, fast enough not to be noticed.
        let (entry, bytes) = tile.encode(Codec::Lz4)?;
        let at = self.scratch_end;
        let file = self.scratch.as_mut().expect("made before it is used");
        let write = |file: &mut File| {
            file.seek(SeekFrom::Start(at))?;
            file.write_all(&bytes)
        };
        write(file).map_err(|e| Error::io("cannot write scratch storage", e))?;
        self.scratch_end += bytes.len() as u64;
        Ok((entry, at))
    }

    fn fetch(&mut self, spilled: &Spilled) -> Result<Quarter> {
        let stored = self.get(&spilled.stored, spilled.extent)?;
        let hidden = spilled
            .hidden
            .as_ref()
            .map(|place| self.get(place, spilled.extent))
            .transpose()?;
        Ok(Quarter {
            functions: Some(Box::new(Functions {
                stored,
                hidden,
                error: spilled.error,
            })),
            lit_error: spilled.lit_error,
        })
    }

    fn get(&mut self, (entry, at): &(Entry, u64), extent: (u32, u32)) -> Result<Tile> {
        let mut bytes = vec![0; entry.stored_size as usize];
        let file = self.scratch.as_mut().expect("made before it is used");
        let mut read = |file: &mut File| {
            file.seek(SeekFrom::Start(*at))?;
            file.read_exact(&mut bytes)
        };
        read(file).map_err(|e| Error::io("cannot read scratch storage", e))?;
        Tile::decode(entry, &bytes, extent, u64::MAX)
    }
}

/// Tiles that are filled pixel by pixel.
#[derive(Default)]
pub(crate) struct OpenTiles {
    tiles: HashMap<TileId, OpenTile>,
    /// Bytes of the functions in them.
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

    /// Takes the function of a pixel: `at` is its index in a tile of `pixels` pixels. Returns the
    /// tile's functions when they are all there.
    pub fn put(
        &mut self,
        id: TileId,
        pixels: usize,
        at: usize,
        curve: Curve,
    ) -> Result<Option<Vec<Curve>>> {
        let fresh = || OpenTile {
            curves: vec![None; pixels],
            missing: pixels,
            bytes: 0,
        };
        let tile = self.tiles.entry(id).or_insert_with(fresh);
        if tile.curves[at].is_some() {
            return Err(Error::input("the pixel was given before"));
        }
        let cost = Self::cost(&curve);
        tile.bytes += cost;
        self.held += cost;
        tile.curves[at] = Some(curve);
        tile.missing -= 1;
        if tile.missing > 0 {
            return Ok(None);
        }
        Ok(self.close(id))
    }

    pub fn is_open(&self, tile: TileId) -> bool {
        self.tiles.contains_key(&tile)
    }

    /// The functions of an open tile, pixels that were not given being lit.
    pub fn close(&mut self, tile: TileId) -> Option<Vec<Curve>> {
        let tile = self.tiles.remove(&tile)?;
        self.held -= tile.bytes;
        Some(
            tile.curves
                .into_iter()
                .map(Option::unwrap_or_default)
                .collect(),
        )
    }

    /// The open tiles, in the order of the directory.
    pub fn keys(&self) -> Vec<TileId> {
        let mut keys: Vec<_> = self.tiles.keys().copied().collect();
        keys.sort_unstable_by_key(|tile| (tile.y, tile.x));
        keys
    }
}
