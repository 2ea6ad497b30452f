//! The tiles that a sampler holds, found by their number alone, without the cache.

use std::collections::VecDeque;

use super::descriptor::Descriptor;
use super::grid::Quad;
use crate::cache::{CachedTile, Charge, TileCache, TilePin};

/// Tiles in a block of the table.
const BLOCK: usize = 256;

/// Tiles and blocks that are there whatever they take: for four tiles that meet in a corner, in two
/// levels.
const FREE: usize = 8;

/// Bytes of a block, and of what the list of held tiles takes for it.
const BLOCK_BYTES: usize = size_of::<Block>() + 2 * BLOCK * size_of::<usize>();

/// No tile.
const NOWHERE: usize = usize::MAX;

/// Neighbouring tiles.
struct Block {
    /// Each is valid for as long as its pin is there.
    descriptors: [Option<Descriptor<'static>>; BLOCK],
    pins: [Option<TilePin>; BLOCK],
    _charge: Option<Charge>,
}

/// Tiles that a sampler holds: eight, and more while they take no more than they may.
///
/// Tiles are numbered through all levels of the map. Blocks are made when they are first used. The
/// first is the sampler's own; the others are charged to the cache and count as held.
pub(super) struct TileTable {
    blocks: Vec<Option<Box<Block>>>,
    /// The tiles that are held, oldest first.
    held: VecDeque<usize>,
    /// The tile that was not held and asked for last.
    last: usize,
    bytes: usize,
    /// Blocks that there are.
    made: usize,
}

impl TileTable {
    /// A table of so many tiles.
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

    /// What keeps a tile, if it is held.
    pub fn pin(&self, tile: usize) -> Option<&TilePin> {
        self.blocks[tile / BLOCK].as_ref()?.pins[tile % BLOCK].as_ref()
    }

    /// Whether a tile of so many bytes should be held that was not: if it displaces no other, or is
    /// asked for twice in a row. Else random lookups would hold and let go of tiles that other
    /// threads count too.
    pub fn wants(&mut self, tile: usize, bytes: usize, most: usize) -> bool {
        let again = std::mem::replace(&mut self.last, tile) == tile;
        again || self.held.len() < FREE || self.bytes + bytes <= most
    }

    /// Holds a tile, instead of others if all take more than `most` bytes.
    pub fn hold(&mut self, tile: usize, pin: TilePin, most: usize, cache: &TileCache) {
        let need = pin.bytes();
        while self.held.len() >= FREE && self.bytes + need > most {
            self.let_go();
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
        // SAFETY: the content lies in a counted allocation that nobody changes, and `pin`, which
        // is put beside the descriptor, keeps it. Both go together in `let_go` and `clear`, and
        // `get` lends the descriptor for no longer than `self` is borrowed.
        block.descriptors[tile % BLOCK] = Some(Descriptor::of(unsafe { &*content }));
        block.pins[tile % BLOCK] = Some(pin);
        self.held.push_back(tile);
        self.bytes += need;
    }

    /// Lets go of the tile that was held longest.
    fn let_go(&mut self) {
        let Some(tile) = self.held.pop_front() else {
            return;
        };
        let block = self.blocks[tile / BLOCK].as_mut().expect("it holds a tile");
        block.descriptors[tile % BLOCK] = None;
        let pin = block.pins[tile % BLOCK].take().expect("it is held");
        // What was held until now was used until now.
        pin.touch();
        self.bytes -= pin.bytes();
    }

    /// Lets go of all tiles, and of the table.
    pub fn clear(&mut self) {
        while !self.held.is_empty() {
            self.let_go();
        }
        self.blocks.fill_with(|| None);
        (self.last, self.bytes, self.made) = (NOWHERE, 0, 0);
    }
}
