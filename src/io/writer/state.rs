//! One map on its way into a file: the checks and the encoding of its tiles, and its directory.

use super::encoding::{Encoding, Pixels, TileInput};
use crate::error::Place;
use crate::format::directory::{self, BlockRef, Entry, TileKind};
use crate::format::layout::BLOCK_ENTRIES;
use crate::format::{Codec, Tile, TileBuilder};
use crate::function::compress::Encoder;
use crate::io::pyramid::{MipPlan, OpenTiles, Pyramid, Quarter, Ready, Source, affordable};
use crate::map::{LevelShape, Pixel, TileId};
use crate::{Error, FunctionRef, Result, Visibility};

pub(super) const COLOURED: &str = "a coloured function in a map of one channel";
const GIVEN: &str = "the tile was given before";

pub(super) struct MapState {
    pub(super) plan: MipPlan,
    pub(super) encoding: Encoding,
    pub(super) levels: Vec<LevelState>,
    pub(super) pyramid: Pyramid,
    pub(super) open: OpenTiles,
    /// Tiles that have all their pixels, until they are enough for all cores.
    pub(super) complete: Vec<(TileId, Pixels)>,
    /// Whether the caller gives the tiles of all levels.
    pub(super) finished: bool,
    /// Largest error of the tiles that the base level was given, if there were any.
    pub(super) max_error: Option<f64>,
}

/// The directory of a level. Blocks without a tile in the file stay empty.
pub(super) struct LevelState {
    pub(super) shape: LevelShape,
    /// One bit for each tile that the caller gave.
    given: Vec<u64>,
    pub(super) blocks: Vec<Block>,
    pub(super) vertices: u64,
    pub(super) payload_bytes: u64,
}

/// A block of the directory.
#[derive(Clone)]
pub(super) enum Block {
    /// Entries, none if all tiles are empty so far, and the number of tiles written.
    Open(Vec<Entry>, usize),
    /// A block whose tiles are all written, without its offset: far fewer bytes.
    Closed(BlockRef, Vec<u8>),
}

/// A tile to write, and its quarter of the tile above if that is built from it.
pub(super) struct Encoded {
    pub(super) level: usize,
    pub(super) tile: TileId,
    pub(super) entry: Entry,
    pub(super) payload: Vec<u8>,
    pub(super) quarter: Option<Quarter>,
}

impl MapState {
    /// Checks that the map was added in the way that the method under way needs.
    pub(super) fn check_finished(&self, finished: bool) -> Result<()> {
        match (self.finished, finished) {
            (true, false) => Err(Error::input(
                "the map was added as finished: its levels are given by `finished_tiles`",
            )),
            (false, true) => Err(Error::input("the map was not added as finished")),
            _ => Ok(()),
        }
    }

    /// Whether all pixels of a tile of the base level were given.
    pub(super) fn is_given(&self, tile: TileId) -> bool {
        let waits = || self.complete.iter().any(|(id, _)| *id == tile);
        !self.open.is_open(tile) && (self.levels[0].is_given(tile) || waits())
    }

    /// Checks a tile that the caller gives.
    pub(super) fn check(&self, level: usize, tile: TileId, input: &TileInput) -> Result<()> {
        let levels = self.levels.len();
        let Some(state) = self.levels.get(level) else {
            return Err(Error::input(format!("no such level: there are {levels}")));
        };
        let shape = state.shape;
        shape.check_tile(tile)?;
        let (w, h) = shape.tile_extent(tile);
        let what = if state.is_given(tile) || self.open.is_open(tile) {
            GIVEN.into()
        } else if input.pixels != (w * h) as usize || input.width.is_some_and(|row| row != w) {
            let rows = input.width.map(|row| format!(", {row} in a row,"));
            let rows = rows.unwrap_or_default();
            let pixels = input.pixels;
            format!("{pixels} functions{rows} for a tile of {w} x {h} pixels")
        } else if input.coloured && self.plan.header.channels == 1 {
            COLOURED.into()
        } else {
            return Ok(());
        };
        Err(Error::input(what).at(Place::tile(shape.tile_index(tile))))
    }

    /// Largest error of functions that the base level is given.
    pub(super) fn error_of(&self, pixels: &Pixels) -> f64 {
        match pixels {
            Pixels::Curves(_) => self.plan.max_errors[0],
            Pixels::Functions(_) | Pixels::Stored(_) => self.encoding.source_error,
        }
    }

    pub(super) fn encode_base(&self, tile: TileId, pixels: Pixels) -> Result<Encoded> {
        let shape = self.levels[0].shape;
        let (width, _) = shape.tile_extent(tile);
        let precision = self.plan.precisions[0];
        let source = |functions| Source::Functions {
            functions,
            error: self.encoding.source_error,
            lit_error: self.encoding.source_error,
        };
        match pixels {
            Pixels::Curves(curves) => {
                let tolerance = self.plan.max_errors[0];
                let carried = curves.iter().fold(0.0f64, |e, c| c.error().max(e));
                let precision = affordable(precision, tolerance - carried);
                let mut builder = TileBuilder::new(width, precision);
                let mut encoder = Encoder::new(self.plan.compressor, precision, tolerance)?;
                let mut out = Visibility::lit();
                for (i, curve) in curves.iter().enumerate() {
                    encoder.compress(curve, &mut out).map_err(|e| {
                        let Pixel { x, y } = shape.first_pixel(tile);
                        e.at(Pixel::new(x + i as u32 % width, y + i as u32 / width))
                    })?;
                    builder.push(&out);
                }
                self.encoded(0, tile, &builder.finish(), &Source::Curves(curves))
            }
            Pixels::Functions(functions) => {
                let mut builder = TileBuilder::new(width, precision);
                functions.iter().for_each(|f| builder.push(f));
                self.encoded(0, tile, &builder.finish(), &source(functions))
            }
            Pixels::Stored(stored) => {
                let mut quarter = None;
                if self.has_above(0) {
                    let decoded = stored.tile()?;
                    let functions = decoded.functions().map(FunctionRef::to_visibility);
                    quarter = self.quarter(0, tile, &source(functions.collect()))?;
                }
                Ok(Encoded {
                    level: 0,
                    tile,
                    entry: stored.entry,
                    payload: stored.payload,
                    quarter,
                })
            }
        }
    }

    pub(super) fn encode_parent(&self, ready: &Ready) -> Result<Encoded> {
        let (tile, source) = self.plan.assemble(ready);
        self.encoded(ready.level, ready.tile, &tile, &source)
    }

    fn has_above(&self, level: usize) -> bool {
        level + 1 < self.levels.len()
    }

    /// The quarter of the tile above, if there is a level above.
    fn quarter(&self, level: usize, tile: TileId, source: &Source) -> Result<Option<Quarter>> {
        let quarter = || self.plan.quarter(level, tile, source);
        self.has_above(level).then(quarter).transpose()
    }

    fn encoded(&self, level: usize, id: TileId, tile: &Tile, source: &Source) -> Result<Encoded> {
        let (entry, payload) = tile.encode(self.encoding.codec)?;
        Ok(Encoded {
            level,
            tile: id,
            entry,
            payload,
            quarter: self.quarter(level, id, source)?,
        })
    }
}

impl LevelState {
    pub(super) fn new(shape: LevelShape) -> Result<Self> {
        let size = |tiles: u64| usize::try_from(tiles).map_err(|_| Error::limit("too many tiles"));
        Ok(LevelState {
            shape,
            given: vec![0; size(shape.tiles().div_ceil(64))?],
            blocks: vec![Block::Open(Vec::new(), 0); size(shape.tiles().div_ceil(BLOCK_ENTRIES))?],
            vertices: 0,
            payload_bytes: 0,
        })
    }

    fn is_given(&self, tile: TileId) -> bool {
        let index = self.shape.tile_index(tile);
        self.given[(index / 64) as usize] >> (index % 64) & 1 == 1
    }

    /// Marks a tile as given. Refuses the second of two.
    pub(super) fn give(&mut self, tile: TileId) -> Result<()> {
        let index = self.shape.tile_index(tile);
        if self.is_given(tile) {
            return Err(Error::input(GIVEN).at(Place::tile(index)));
        }
        self.given[(index / 64) as usize] |= 1 << (index % 64);
        Ok(())
    }

    /// Enters a tile into the directory, whose blocks are stored with `codec`.
    pub(super) fn set(&mut self, tile: TileId, entry: Entry, codec: Codec) -> Result<()> {
        self.vertices += u64::from(entry.vertices);
        self.payload_bytes += u64::from(entry.stored_size);
        let index = self.shape.tile_index(tile);
        let (b, i) = ((index / BLOCK_ENTRIES) as usize, index % BLOCK_ENTRIES);
        let size = self.block_len(b);
        let Block::Open(entries, written) = &mut self.blocks[b] else {
            return Ok(());
        };
        *written += 1;
        if entry.kind != TileKind::Empty {
            entries.resize(size, Entry::default());
            entries[i as usize] = entry;
        }
        if *written == size && !entries.is_empty() {
            let (block, bytes) = directory::encode_block(entries, codec)?;
            self.blocks[b] = Block::Closed(block, bytes);
        }
        Ok(())
    }

    pub(super) fn block_len(&self, block: usize) -> usize {
        (self.shape.tiles() - block as u64 * BLOCK_ENTRIES).min(BLOCK_ENTRIES) as usize
    }

    /// Takes a block, without its offset, and its bytes.
    pub(super) fn take_block(&mut self, block: usize, codec: Codec) -> Result<(BlockRef, Vec<u8>)> {
        let none = Block::Open(Vec::new(), 0);
        match std::mem::replace(&mut self.blocks[block], none) {
            Block::Open(mut entries, _) => {
                entries.resize(self.block_len(block), Entry::default());
                directory::encode_block(&entries, codec)
            }
            Block::Closed(block, bytes) => Ok((block, bytes)),
        }
    }
}
