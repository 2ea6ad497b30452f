//! One map on its way into a file: its tiles as they are encoded, its directory as it fills.

use super::{Encoding, Pixels};
use crate::format::directory::{Entry, TileKind};
use crate::format::layout::BLOCK_ENTRIES;
use crate::format::{Tile, TileBuilder};
use crate::function::compress::Encoder;
use crate::io::pyramid::{MipPlan, OpenTiles, Pyramid, Quarter, Ready, Source, affordable};
use crate::io::stored::StoredTile;
use crate::map::{LevelShape, Pixel, TileId};
use crate::{Error, FunctionRef, Result, Visibility};

pub(super) struct MapState {
    pub(super) plan: MipPlan,
    pub(super) encoding: Encoding,
    pub(super) levels: Vec<LevelState>,
    pub(super) pyramid: Pyramid,
    pub(super) open: OpenTiles,
    pub(super) complete: Vec<(TileId, Pixels)>,
    /// For each level, one bit for each tile that was given; of the base alone, but for finished maps.
    pub(super) given: Vec<Vec<u64>>,
    /// Whether the tiles of all levels are given as they are.
    pub(super) finished: bool,
    /// The largest error of the functions that the base level was given, if it was given any.
    pub(super) max_error: Option<f64>,
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

    pub(super) fn is_given(&self, level: usize, tile: TileId) -> bool {
        let index = self.levels[level].shape.tile_index(tile);
        self.given[level][(index / 64) as usize] >> (index % 64) & 1 == 1
    }

    pub(super) fn mark_given(&mut self, level: usize, tile: TileId) {
        let index = self.levels[level].shape.tile_index(tile);
        self.given[level][(index / 64) as usize] |= 1 << (index % 64);
    }

    /// Checks a tile that is given, and marks it so.
    pub(super) fn accept(&mut self, tile: TileId, pixels: &Pixels) -> Result<()> {
        let shape = self.levels[0].shape;
        self.check_unfinished()?;
        shape.check_tile(tile)?;
        if self.is_given(0, tile) || self.open.is_open(tile) {
            return Err(Error::input("the tile was given before"));
        }
        let (width, height) = shape.tile_extent(tile);
        if pixels.len() != (width * height) as usize {
            return Err(Error::input(format!(
                "{} functions for a tile of {width} x {height} pixels",
                pixels.len()
            )));
        }
        if let Pixels::Stored(stored) = pixels {
            let (w, h) = stored.extent;
            if (w, h) != (width, height) {
                return Err(Error::input(format!(
                    "a stored tile of {w} x {h} pixels for one of {width} x {height}"
                )));
            }
        }
        if pixels.most_channels() > self.plan.header.channels {
            return Err(Error::input("a coloured function in a map of one channel"));
        }
        let max_error = match pixels {
            Pixels::Curves(_) => self.plan.max_errors[0],
            Pixels::Functions(_) | Pixels::Stored(_) => self.encoding.source_error,
        };
        self.max_error = Some(self.max_error.unwrap_or(0.0).max(max_error));
        self.mark_given(0, tile);
        Ok(())
    }

    pub(super) fn encode_base(&self, tile: TileId, pixels: Pixels) -> Result<Encoded> {
        let shape = self.levels[0].shape;
        let (width, _) = shape.tile_extent(tile);
        let precision = self.plan.precisions[0];
        let mut builder;
        let source = match &pixels {
            Pixels::Curves(curves) => {
                let tolerance = self.plan.max_errors[0];
                let carried = curves.iter().fold(0.0f64, |e, c| c.error().max(e));
                let precision = affordable(precision, tolerance - carried);
                builder = TileBuilder::new(width, precision);
                let mut encoder = Encoder::new(self.plan.compressor, precision, tolerance)?;
                let mut out = Visibility::lit();
                for (i, curve) in curves.iter().enumerate() {
                    encoder.compress(curve, &mut out).map_err(|e| {
                        let (x, y) = (i as u32 % width, i as u32 / width);
                        let [left, top] = [tile.x, tile.y].map(|t| t * shape.tile_size);
                        e.at(Pixel::new(left + x, top + y))
                    })?;
                    builder.push(&out);
                }
                Source::Curves(curves)
            }
            Pixels::Stored(stored) => {
                let functions = match self.has_above(0) {
                    true => {
                        let tile = stored.tile()?;
                        tile.functions().map(FunctionRef::to_visibility).collect()
                    }
                    false => Vec::new(),
                };
                let source = Source::Functions {
                    functions: &functions,
                    error: self.encoding.source_error,
                    lit_error: self.encoding.source_error,
                };
                let quarter = self.quarter(0, tile, &source)?;
                let Pixels::Stored(StoredTile { entry, payload, .. }) = pixels else {
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
                    error: self.encoding.source_error,
                    lit_error: self.encoding.source_error,
                }
            }
        };
        self.encoded(0, tile, builder.finish(), source)
    }

    pub(super) fn encode_parent(&self, ready: Ready) -> Result<(usize, TileId, Encoded)> {
        let (level, id) = (ready.level, ready.tile);
        let parent = ready.assemble(&self.plan);
        let encoded = self.encoded(level, id, parent.stored.clone(), parent.source())?;
        Ok((level, id, encoded))
    }

    fn has_above(&self, level: usize) -> bool {
        level + 1 < self.levels.len()
    }

    /// What a tile leaves to the level above, if there is one.
    fn quarter(&self, level: usize, tile: TileId, source: &Source) -> Result<Option<Quarter>> {
        self.has_above(level)
            .then(|| self.plan.quarter(level, tile, source))
            .transpose()
    }

    pub(super) fn encoded(
        &self,
        level: usize,
        id: TileId,
        tile: Tile,
        source: Source,
    ) -> Result<Encoded> {
        let (entry, payload) = tile.encode(self.encoding.codec)?;
        let quarter = self.quarter(level, id, &source)?;
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

    pub(super) fn set(&mut self, tile: TileId, entry: Entry) {
        if entry.kind == TileKind::Empty {
            return;
        }
        self.vertices += u64::from(entry.vertices);
        self.payload_bytes += u64::from(entry.stored_size);
        let index = self.shape.tile_index(tile);
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
