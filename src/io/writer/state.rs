//! One map on its way into a file: its tiles as they are encoded, its directory as it fills.

use super::{Encoding, Pixels, TileInput};
use crate::format::directory::{Entry, TileKind};
use crate::format::layout::BLOCK_ENTRIES;
use crate::format::{Tile, TileBuilder};
use crate::io::pyramid::{OpenTiles, Plan, Pyramid, Quarter, Ready, Source, affordable};
use crate::io::stored::StoredTile;
use crate::map::LevelShape;
use crate::{Encoder, Error, Place, Result, Visibility};

pub(super) struct MapState {
    pub(super) plan: Plan,
    pub(super) encoding: Encoding,
    pub(super) levels: Vec<LevelState>,
    pub(super) pyramid: Pyramid,
    pub(super) open: OpenTiles,
    pub(super) complete: Vec<TileInput>,
    /// For each level, one bit for each tile that was given; of the base alone, but for finished maps.
    pub(super) given: Vec<Vec<u64>>,
    /// Whether the tiles of all levels are given as they are.
    pub(super) finished: bool,
    /// The largest promise of what the base level was given, if it was given anything.
    pub(super) promise: Option<f64>,
}

/// The directory of a level as it fills; blocks that hold only empty tiles are not there.
pub(super) struct LevelState {
    pub(super) shape: LevelShape,
    pub(super) blocks: Vec<Vec<Entry>>,
    pub(super) vertices: u64,
    pub(super) payload_bytes: u64,
}

/// A tile that is ready to be written, and what it leaves to the level above.
pub(super) struct Encoded {
    pub(super) entry: Entry,
    pub(super) payload: Vec<u8>,
    pub(super) quarter: Option<Quarter>,
}

impl MapState {
    pub(super) fn check_unfinished(&self) -> Result<()> {
        match self.finished {
            true => Err(Error::input(
                "the map was added as finished: its levels are given by `finished_tiles`",
            )),
            false => Ok(()),
        }
    }

    pub(super) fn is_given(&self, level: usize, (tx, ty): (u32, u32)) -> bool {
        let index = self.levels[level].shape.tile_index(tx, ty);
        self.given[level][(index / 64) as usize] >> (index % 64) & 1 == 1
    }

    pub(super) fn mark_given(&mut self, level: usize, (tx, ty): (u32, u32)) {
        let index = self.levels[level].shape.tile_index(tx, ty);
        self.given[level][(index / 64) as usize] |= 1 << (index % 64);
    }

    /// Checks a tile that is given, and marks it so.
    pub(super) fn accept(&mut self, tile: &TileInput) -> Result<()> {
        let shape = self.levels[0].shape;
        self.check_unfinished()?;
        shape.check_tile(tile.tx, tile.ty)?;
        let place = (tile.tx, tile.ty);
        if self.is_given(0, place) || self.open.is_open(place) {
            return Err(Error::input("the tile was given before"));
        }
        let (width, height) = shape.tile_extent(tile.tx, tile.ty);
        if tile.pixels.len() != (width * height) as usize {
            return Err(Error::input(format!(
                "{} functions for a tile of {width} x {height} pixels",
                tile.pixels.len()
            )));
        }
        if let Pixels::Stored(stored) = &tile.pixels {
            let (w, h) = stored.extent;
            if (w, h) != (width, height) {
                return Err(Error::input(format!(
                    "a stored tile of {w} x {h} pixels for one of {width} x {height}"
                )));
            }
        }
        if tile.pixels.most_channels() > self.plan.header.channels {
            return Err(Error::input("a coloured function in a map of one channel"));
        }
        let promise = match tile.pixels {
            Pixels::Curves(_) => self.plan.promises[0],
            Pixels::Functions(_) | Pixels::Stored(_) => self.encoding.given_error,
        };
        self.promise = Some(self.promise.unwrap_or(0.0).max(promise));
        self.mark_given(0, place);
        Ok(())
    }

    pub(super) fn encode_base(&self, tile: TileInput) -> Result<Encoded> {
        let shape = self.levels[0].shape;
        let (width, _) = shape.tile_extent(tile.tx, tile.ty);
        let precision = self.plan.precisions[0];
        let mut builder;
        let source = match &tile.pixels {
            Pixels::Curves(curves) => {
                let tolerance = self.plan.promises[0];
                let carried = curves.iter().fold(0.0f64, |e, c| c.error().max(e));
                let precision = affordable(precision, tolerance - carried);
                builder = TileBuilder::new(width, precision);
                let mut encoder = Encoder::new(self.plan.compressor, precision, tolerance)?;
                let mut out = Visibility::lit();
                for (i, curve) in curves.iter().enumerate() {
                    encoder.compress(curve, &mut out).map_err(|e| {
                        let (x, y) = (i as u32 % width, i as u32 / width);
                        let pixel = (tile.tx * shape.tile_size + x, tile.ty * shape.tile_size + y);
                        e.at(Place {
                            pixel: Some(pixel),
                            ..Place::default()
                        })
                    })?;
                    builder.push(&out);
                }
                Source::Curves(curves)
            }
            Pixels::Stored(stored) => {
                let functions = match self.has_above(0) {
                    true => {
                        let tile = stored.tile()?;
                        (0..tile.pixels()).map(|i| tile.function(i)).collect()
                    }
                    false => Vec::new(),
                };
                let source = Source::Functions {
                    functions: &functions,
                    error: self.encoding.given_error,
                    lit_error: self.encoding.given_error,
                };
                let quarter = self.quarter(0, (tile.tx, tile.ty), &source)?;
                let Pixels::Stored(StoredTile { entry, payload, .. }) = tile.pixels else {
                    unreachable!("it was one just now")
                };
                return Ok(Encoded {
                    entry,
                    payload,
                    quarter,
                });
            }
            Pixels::Functions(functions) => {
                builder = TileBuilder::new(width, precision);
                functions.iter().for_each(|f| builder.push(f));
                Source::Functions {
                    functions,
                    error: self.encoding.given_error,
                    lit_error: self.encoding.given_error,
                }
            }
        };
        self.encoded(0, (tile.tx, tile.ty), builder.finish(), source)
    }

    pub(super) fn encode_parent(&self, ready: Ready) -> Result<((usize, u32, u32), Encoded)> {
        let (level, tx, ty) = (ready.level, ready.tx, ready.ty);
        let parent = ready.assemble(&self.plan);
        let encoded = self.encoded(level, (tx, ty), parent.stored.clone(), parent.source())?;
        Ok(((level, tx, ty), encoded))
    }

    fn has_above(&self, level: usize) -> bool {
        level + 1 < self.levels.len()
    }

    /// What a tile leaves to the level above, if there is one.
    fn quarter(
        &self,
        level: usize,
        (tx, ty): (u32, u32),
        source: &Source,
    ) -> Result<Option<Quarter>> {
        self.has_above(level)
            .then(|| self.plan.quarter(level, tx, ty, source))
            .transpose()
    }

    pub(super) fn encoded(
        &self,
        level: usize,
        (tx, ty): (u32, u32),
        tile: Tile,
        source: Source,
    ) -> Result<Encoded> {
        let (entry, payload) = tile.encode(self.encoding.codec)?;
        let quarter = self.quarter(level, (tx, ty), &source)?;
        Ok(Encoded {
            entry,
            payload,
            quarter,
        })
    }
}

impl LevelState {
    pub(super) fn new(shape: LevelShape) -> Result<Self> {
        let blocks = usize::try_from(shape.tiles().div_ceil(BLOCK_ENTRIES))
            .map_err(|_| Error::limit("too many tiles"))?;
        Ok(LevelState {
            shape,
            blocks: vec![Vec::new(); blocks],
            vertices: 0,
            payload_bytes: 0,
        })
    }

    pub(super) fn set(&mut self, tx: u32, ty: u32, entry: Entry) {
        if entry.kind == TileKind::Empty {
            return;
        }
        self.vertices += u64::from(entry.vertices);
        self.payload_bytes += u64::from(entry.stored_size);
        let index = self.shape.tile_index(tx, ty);
        let size = self.block_len((index / BLOCK_ENTRIES) as usize);
        let block = &mut self.blocks[(index / BLOCK_ENTRIES) as usize];
        block.resize(size, Entry::default());
        block[(index % BLOCK_ENTRIES) as usize] = entry;
    }

    pub(super) fn block_len(&self, block: usize) -> usize {
        (self.shape.tiles() - block as u64 * BLOCK_ENTRIES).min(BLOCK_ENTRIES) as usize
    }

    pub(super) fn block(&self, block: usize) -> std::borrow::Cow<'_, [Entry]> {
        match &self.blocks[block] {
            entries if entries.is_empty() => vec![Entry::default(); self.block_len(block)].into(),
            entries => entries.into(),
        }
    }
}
