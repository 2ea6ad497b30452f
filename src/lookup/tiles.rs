//! The table of the tiles that a sampler holds. It finds a tile by its number, without the cache.

use std::collections::VecDeque;

use super::grid::Quad;
use crate::cache::{CachedTile, Charge, Descriptor, TileCache, TilePin};

/// Tiles in a block of the table.
const BLOCK: usize = 256;

/// Number of tiles, and of blocks, that the table holds whatever their size: enough for the four
/// tiles around a corner, in two levels.
const FREE: usize = 8;

/// Bytes of a block and of its share of the list of held tiles.
const BLOCK_BYTES: usize = size_of::<Block>() + 2 * BLOCK * size_of::<usize>();

/// Stands for no tile.
const NOWHERE: usize = usize::MAX;

/// [`BLOCK`] tiles with consecutive numbers.
struct Block {
    /// A descriptor is valid as long as `pins` holds the pin of its tile.
    descriptors: [Option<Descriptor<'static>>; BLOCK],
    pins: [Option<TilePin>; BLOCK],
    _charge: Option<Charge>,
}

/// The tiles that a sampler holds: at least eight if it needs them, and more while all of them fit
/// the budget.
///
/// Tile numbers run through all levels of the map. A block is allocated on first use. The first
/// block is not charged to the cache; the others are, and count as held bytes.
pub(super) struct TileTable {
    blocks: Vec<Option<Box<Block>>>,
    /// The tiles that are held, oldest first.
    held: VecDeque<usize>,
    /// The tile of the latest lookup that missed this table.
    last: usize,
    bytes: usize,
    /// Number of allocated blocks.
    made: usize,
}

impl TileTable {
    /// An empty table for a map of `tiles` tiles.
    pub fn new(tiles: usize) -> Self {
        TileTable {
            blocks: (0..tiles.div_ceil(BLOCK)).map(|_| None).collect(),
            held: VecDeque::new(),
            last: NOWHERE,
            bytes: 0,
            made: 0,
        }
    }

    /// A tile, if it is held.
    #[inline(always)]
    pub fn get(&self, tile: usize) -> Option<&Descriptor<'_>> {
        let block = self.blocks[tile / BLOCK].as_ref()?;
        block.descriptors[tile % BLOCK].as_ref()
    }

    /// Four tiles, if all are held.
    #[inline(always)]
    pub fn quad(&self, quad: &Quad) -> Option<[[&Descriptor<'_>; 2]; 2]> {
        let [[a, b], [c, d]] = quad.tiles;
        Some([[self.get(a)?, self.get(b)?], [self.get(c)?, self.get(d)?]])
    }

    /// The pin of a tile, if it is held.
    pub fn pin(&self, tile: usize) -> Option<&TilePin> {
        self.blocks[tile / BLOCK].as_ref()?.pins[tile % BLOCK].as_ref()
    }

    /// Whether to hold a tile of `bytes` bytes that missed this table: if it displaces no other
    /// tile, or if it misses twice in a row. Otherwise random lookups would pin and unpin tiles all
    /// the time, and contend with other threads for the counts.
    pub fn wants(&mut self, tile: usize, bytes: usize, most: usize) -> bool {
        let again = std::mem::replace(&mut self.last, tile) == tile;
        again || self.held.len() < FREE || self.bytes + bytes <= most
    }

    /// Holds a tile. Releases the oldest tiles if all together would take more than `most` bytes.
    pub fn hold(&mut self, tile: usize, pin: TilePin, most: usize, cache: &TileCache) {
        let need = pin.bytes();
        while self.held.len() >= FREE && self.bytes + need > most {
            self.release_oldest();
        }
        if self.blocks[tile / BLOCK].is_none() {
            if self.made >= FREE && self.bytes + need + BLOCK_BYTES > most {
                self.clear();
            }
            let charge = (self.made > 0).then(|| cache.charge(BLOCK_BYTES));
            self.bytes += charge.as_ref().map_or(0, |_| BLOCK_BYTES);
            self.made += 1;
            self.blocks[tile / BLOCK] = Some(Box::new(Block {
                descriptors: [const { None }; BLOCK],
                pins: [const { None }; BLOCK],
                _charge: charge,
            }));
        }
        let block = self.blocks[tile / BLOCK].as_mut().expect("just made");
        let content: *const CachedTile = pin.value();
        // SAFETY: the content lies in a counted allocation that nobody changes. `pin` keeps that
        // allocation alive, and this block stores it with the descriptor. `release_oldest` removes
        // both together. `get` lends the descriptor for no longer than `self` is borrowed.
        block.descriptors[tile % BLOCK] = Some(Descriptor::of(unsafe { &*content }));
        block.pins[tile % BLOCK] = Some(pin);
        self.held.push_back(tile);
        self.bytes += need;
    }

    /// Releases the tile that has been held longest.
    fn release_oldest(&mut self) {
        let Some(tile) = self.held.pop_front() else {
            return;
        };
        let block = self.blocks[tile / BLOCK].as_mut().expect("it holds a tile");
        block.descriptors[tile % BLOCK] = None;
        let pin = block.pins[tile % BLOCK].take().expect("it is held");
        // Lookups through this table did not tell the cache that they used the tile.
        pin.touch();
        self.bytes -= pin.bytes();
    }

    /// Releases all tiles and all blocks.
    pub fn clear(&mut self) {
        while !self.held.is_empty() {
            self.release_oldest();
        }
        self.blocks.fill_with(|| None);
        (self.last, self.bytes, self.made) = (NOWHERE, 0, 0);
    }
}
