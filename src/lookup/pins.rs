//! The tiles that a sampler holds: found by their place alone, without the cache.

use super::planes::Planes;
use crate::cache::{Content, Pin};

/// Places for tiles. Neighbours do not displace one another: not in a row of 1024 tiles, nor in 27 rows of 37.
const SLOTS: usize = 1024;

/// Tiles that are held whatever they take: four that meet in a corner, in two levels.
const FREE: usize = 8;

/// No tile.
const NOWHERE: u64 = u64::MAX;

/// A tile of a map, and the slot that it may be in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct TileKey {
    key: u64,
    slot: usize,
}

impl TileKey {
    #[inline(always)]
    pub fn new(level: usize, [tx, ty]: [u32; 2]) -> Self {
        TileKey {
            key: (level as u64) << 48 | u64::from(ty) << 24 | u64::from(tx),
            slot: (tx as usize + 37 * ty as usize + 419 * level) % SLOTS,
        }
    }

    /// Column and row of the tile.
    pub fn place(&self) -> [u64; 2] {
        [self.key & 0xFF_FFFF, self.key >> 24 & 0xFF_FFFF]
    }
}

/// What a hit reads: one line of the processor's cache.
#[derive(Clone)]
#[repr(C, align(64))]
struct Slot {
    key: u64,
    /// Valid for as long as the pin beside is what it was made from.
    planes: Planes<'static>,
}

const EMPTY: Slot = Slot {
    key: NOWHERE,
    planes: Planes::lit(),
};

/// Tiles that a sampler holds: eight, and more while they take no more than they may.
pub(super) struct Pins {
    slots: Box<[Slot; SLOTS]>,
    /// What keeps the planes of each slot alive.
    pins: Box<[Option<Pin>]>,
    /// The tile that was not pinned and asked for last.
    last: u64,
    count: usize,
    bytes: usize,
    /// Where the next tile is let go that has to be.
    hand: usize,
}

impl Pins {
    pub fn new() -> Self {
        Pins {
            slots: vec![EMPTY; SLOTS].try_into().ok().expect("as many slots"),
            pins: (0..SLOTS).map(|_| None).collect(),
            last: NOWHERE,
            count: 0,
            bytes: 0,
            hand: 0,
        }
    }

    /// The planes of a tile, if it is pinned.
    #[inline(always)]
    pub fn get(&self, tile: &TileKey) -> Option<&Planes<'_>> {
        let slot = &self.slots[tile.slot];
        (slot.key == tile.key).then_some(&slot.planes)
    }

    /// The tile, if it is pinned.
    pub fn content(&self, tile: &TileKey) -> Option<&Content> {
        self.get(tile)?;
        self.pins[tile.slot].as_ref().map(|pin| pin.value())
    }

    /// Whether a tile of so many bytes should be pinned that passed by: if it displaces no other, or is asked for twice in a row. Else lookups
    /// at random would pin and let go of tiles that other threads count too.
    pub fn wants(&mut self, tile: &TileKey, bytes: usize, most: usize) -> bool {
        let again = std::mem::replace(&mut self.last, tile.key) == tile.key;
        let room = self.count < FREE || self.bytes + bytes <= most;
        again || (room && self.pins[tile.slot].is_none())
    }

    /// Pins a tile, instead of the one in its slot, and of others if all take more than `most` bytes.
    pub fn set(&mut self, tile: &TileKey, pin: Pin, most: usize) {
        self.empty(tile.slot);
        let bytes = pin.bytes();
        while self.count >= FREE && self.bytes + bytes > most {
            self.hand = (self.hand + 1) % SLOTS;
            self.empty(self.hand);
        }
        let content: *const Content = pin.value();
        // SAFETY: the content lies in a counted allocation that nobody changes, and `pin`, which is put beside the planes, keeps
        // it. Both go together in `empty`, and `get` lends the planes for no longer than `self` is borrowed.
        self.slots[tile.slot].planes = Planes::of(unsafe { &*content });
        self.slots[tile.slot].key = tile.key;
        self.pins[tile.slot] = Some(pin);
        self.count += 1;
        self.bytes += bytes;
    }

    /// Lets go of the tile in a slot.
    fn empty(&mut self, slot: usize) {
        self.slots[slot] = EMPTY;
        if let Some(pin) = self.pins[slot].take() {
            // What was pinned until now was used until now.
            pin.touch();
            self.count -= 1;
            self.bytes -= pin.bytes();
        }
    }

    /// Lets go of all tiles.
    pub fn clear(&mut self) {
        (0..SLOTS).for_each(|slot| self.empty(slot));
        self.last = NOWHERE;
    }
}
