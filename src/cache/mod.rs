//! Decoded tiles in memory: many files, one byte budget (LV00, section 5.4). [`TileCache`] says how it works.
//!
//! | module | what it holds |
//! |---|---|
//! | [`account`] | every byte, by capacity, and spare memory |
//! | [`arena`] | large allocations in huge pages that tiles share |
//! | [`shelf`] | misses, loads, evictions: what takes a lock |
//! | [`stats`] | what is counted |
//! | [`sync`] | the primitives, the standard library's or loom's |

mod account;
mod arena;
#[cfg(all(test, deepshadow_loom))]
mod loom;
mod shelf;
mod stats;
mod sync;

use std::sync::OnceLock;
use std::time::Duration;

use crate::format::directory::{Entry, TileKind};
use crate::format::layout::BLOCK_ENTRIES;
use crate::format::tile::Words;
use crate::map::LevelShape;
use crate::{DsmFile, Error, ErrorKind, LevelId, MapId, Result, Tile, TileId};
pub(crate) use account::Charge;
use shelf::{Block, Event, Resident, Shelf, Value};
use stats::LevelCounters;
pub use stats::{CacheStats, LevelStats};
use sync::{Arc, Guard};

/// Decoded tiles of many files within one byte budget (LV00, section 5.4).
///
/// **Ownership.** The cache owns the tiles of the files that were added to it; a [`CachedFile`] is a handle that keeps
/// both alive. A decoded tile is immutable; its planes lie in one allocation, in the types of the file. A lookup holds what it reads: either
/// for the length of one evaluation, or by a pin of its [`Sampler`](crate::Sampler), a count that keeps the tile alive after
/// it was evicted. A sampler pins eight tiles, and more while the pins of all samplers take less than half of the budget. Tiles of codec `none` in a file that lies in memory, mapped or not, are looked up where they are; only their check is
/// remembered. Tiles that are lit everywhere, or hold the same one vertex in every pixel, take no planes.
///
/// **Accounting.** The budget is in bytes and counts capacity: decoded tiles with their bookkeeping, tables of slots, spare buffers, and
/// tiles that were evicted but are still pinned. Room is made before a load and after it, so that the budget is passed only by what samplers
/// pin, by loads under way, and by what stays as long as its file: tables of slots and tiles remembered as broken, a few hundred bytes each. A tile larger
/// than the whole budget is loaded, looked up, and gone when its sampler moves on. LV00's growing
/// slots are here a stock of buffers: an evicted tile's memory serves the next tile, gives way to a larger one when none fits, is cut when it
/// is more than twice what is needed, and is freed when the budget is passed. The directory of a file (48 bytes a tile, as it is read) belongs to the
/// file and is not counted, nor is what a codec needs while it decodes.
///
/// **Lifetime.** A tile is loaded when it is first looked up, and stays until room is needed: then the tile that was loaded longest ago
/// goes first, unless it was used since it was last passed over, or is pinned while others are not. A tile that breaks a rule of the specification
/// is remembered as broken and never read again while its file is in the cache; one that could not be read is tried again by the next lookup.
/// Dropping the last handle of a file, samplers' handles included, ends its tiles and tables; the tiles' memory is spare from then on.
///
/// **Threading.** Everything is shared by reference, any number of threads at once. A tile is loaded by the thread that first wants it,
/// and others that want it wait for its outcome, value or error; nothing waits inside a thread pool for work of that pool. If a load panics,
/// the panic goes on in its thread and the next that waits loads instead. What a lookup returns depends on the file alone.
///
/// **Cost.** A hit through a pin reads one line of memory and the tile. A hit without one reads the slot, two words of the thread's own and the mark; it takes no lock,
/// hashes nothing, and writes to shared memory only to set a mark that is not set. A miss takes one lock three times, reads, decodes and checks:
/// 10 to 200 microseconds for 32 x 32 pixels. Slots take 16 bytes a tile, made in blocks of 1024 when one is first used.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// # let mut writer = Writer::in_memory();
/// # let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
/// # writer.pixel(map, Pixel::new(2, 1), &Curve::mono(vec![5.0], vec![0.25])?)?;
/// # let file = DsmFile::from_bytes(writer.into_bytes()?)?;
/// let cache = TileCache::new(256 << 20);
/// let light = cache.add(file);
/// let mut sampler = Sampler::new(&light, MapId(0))?;
/// assert_eq!(sampler.visibility(&Query::new(2.5, 1.5, 6.0))?, 0.25);
/// assert_eq!(cache.stats().loads, 1);
/// # Ok(()) }
/// ```
pub struct TileCache {
    shelf: Shelf<Content>,
    /// Tiles without a vertex are all the same.
    lit: Arc<Resident<Content>>,
    files: std::sync::Mutex<Vec<std::sync::Weak<Slots>>>,
    /// Samplers that live.
    samplers: std::sync::atomic::AtomicUsize,
    /// What was done for files that are gone.
    past: std::sync::Mutex<LevelStats>,
}

/// A file in a [`TileCache`]. Clones share it.
#[derive(Clone)]
pub struct CachedFile(std::sync::Arc<Slots>);

/// A decoded tile, as lookups see it.
pub(crate) enum Content {
    /// Lit at every depth.
    Lit,
    /// One vertex in every pixel: depth, visibility.
    Constant(f32, f32),
    /// Planes.
    Planes(Tile),
    /// The tile breaks a rule, or asks for what this build or its limits do not allow: asking again does not help.
    Failed(Error),
}

impl Value for Content {
    fn bytes(&self) -> usize {
        match self {
            Content::Planes(tile) => tile.bytes(),
            _ => 0,
        }
    }

    fn may_go(&self) -> bool {
        matches!(self, Content::Planes(_) | Content::Constant(..))
    }

    fn is_lent(&self) -> bool {
        matches!(self, Content::Planes(tile) if tile.is_lent())
    }

    fn into_buffer(self) -> Words {
        match self {
            Content::Planes(tile) => tile.into_buffer(),
            _ => Words::EMPTY,
        }
    }
}

/// A tile that stays while this is held.
pub(crate) type Pin = Arc<Resident<Content>>;

/// A tile that stays for one evaluation.
pub(crate) enum Held {
    /// Read from its slot, without a count.
    Passing(Guard<Resident<Content>>),
    /// Just loaded.
    Loaded(Pin),
}

impl Held {
    #[inline]
    pub fn content(&self) -> &Content {
        match self {
            Held::Passing(guard) => guard.as_ref().expect("an empty slot is not held").value(),
            Held::Loaded(pin) => pin.value(),
        }
    }

    /// Bytes of its planes.
    pub fn bytes(&self) -> usize {
        match self.content() {
            Content::Planes(tile) => tile.bytes(),
            _ => 0,
        }
    }

    /// A count of its own.
    pub fn pin(&self) -> Pin {
        match self {
            Held::Passing(guard) => guard.as_ref().expect("an empty slot is not held").clone(),
            Held::Loaded(pin) => pin.clone(),
        }
    }
}

/// The slots of one file.
pub(crate) struct Slots {
    cache: std::sync::Arc<TileCache>,
    file: std::sync::Arc<DsmFile>,
    levels: Vec<Vec<Level>>,
}

struct Level {
    shape: LevelShape,
    blocks: Box<[OnceLock<Arc<Block<Content>>>]>,
    counters: LevelCounters,
}

impl TileCache {
    /// A cache of `budget` bytes.
    pub fn new(budget: usize) -> std::sync::Arc<Self> {
        std::sync::Arc::new(TileCache {
            shelf: Shelf::new(budget),
            lit: Resident::free(Content::Lit),
            files: std::sync::Mutex::default(),
            samplers: std::sync::atomic::AtomicUsize::new(0),
            past: std::sync::Mutex::default(),
        })
    }

    /// Takes a file, or a share of one. Its tiles are looked up by a [`Sampler`](crate::Sampler) of the handle.
    pub fn add(
        self: &std::sync::Arc<Self>,
        file: impl Into<std::sync::Arc<DsmFile>>,
    ) -> CachedFile {
        let file = file.into();
        let level = |info: &crate::LevelInfo| Level {
            shape: info.shape,
            blocks: (0..info.shape.tiles().div_ceil(BLOCK_ENTRIES))
                .map(|_| OnceLock::new())
                .collect(),
            counters: LevelCounters::default(),
        };
        let levels = file
            .maps()
            .iter()
            .map(|map| map.levels.iter().map(level).collect())
            .collect();
        let slots = std::sync::Arc::new(Slots {
            cache: self.clone(),
            file,
            levels,
        });
        let mut files = self.files.lock().expect("no panic holds this lock");
        files.retain(|f| f.strong_count() > 0);
        files.push(std::sync::Arc::downgrade(&slots));
        CachedFile(slots)
    }

    /// The byte budget.
    pub fn budget(&self) -> usize {
        self.shelf.account.budget()
    }

    /// Sets the byte budget; what is beyond it goes at once.
    pub fn set_budget(&self, bytes: usize) {
        self.shelf.set_budget(bytes);
    }

    /// A sampler begins.
    pub(crate) fn enter(&self) {
        self.samplers
            .fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    }

    /// A sampler ends.
    pub(crate) fn leave(&self) {
        self.samplers
            .fetch_sub(1, std::sync::atomic::Ordering::Relaxed);
    }

    /// Charges bytes that a sampler takes beside its pins.
    pub(crate) fn charge(&self, bytes: usize) -> Charge {
        let charge = account::Account::charge(&self.shelf.account, bytes);
        self.shelf.settle();
        charge
    }

    /// Bytes that one sampler may pin: all together half of the budget.
    pub(crate) fn share(&self) -> usize {
        let samplers = self.samplers.load(std::sync::atomic::Ordering::Relaxed);
        self.budget() / 2 / samplers.max(1)
    }

    /// Evicts every tile and frees the spare buffers. What samplers pin lives until they let go of it; tiles that are known to be
    /// broken stay so.
    pub fn clear(&self) {
        self.shelf.clear();
    }

    /// What the cache has done so far, for files that are gone too. Hits are counted by samplers, which report them at every miss, when they
    /// are released and when they are dropped.
    pub fn stats(&self) -> CacheStats {
        let files: Vec<_> = {
            let files = self.files.lock().expect("no panic holds this lock");
            files.iter().filter_map(std::sync::Weak::upgrade).collect()
        };
        let past = *self.past.lock().expect("no panic holds this lock");
        let levels = files.iter().flat_map(|f| f.levels.iter().flatten());
        CacheStats::new(
            &self.shelf.account,
            levels.map(|level| level.counters.stats()).chain([past]),
        )
    }
}

impl std::fmt::Debug for TileCache {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TileCache")
            .field("budget", &self.budget())
            .field("bytes", &self.shelf.account.bytes())
            .finish_non_exhaustive()
    }
}

impl std::fmt::Debug for CachedFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("CachedFile").field(&self.0.file).finish()
    }
}

impl CachedFile {
    /// The file.
    pub fn file(&self) -> &DsmFile {
        &self.0.file
    }

    /// The cache that it is in.
    pub fn cache(&self) -> &std::sync::Arc<TileCache> {
        &self.0.cache
    }

    /// What the cache has done for one level of a map of this file.
    ///
    /// # Errors
    /// `Input` if there is no such map or level.
    pub fn stats(&self, level: LevelId) -> Result<LevelStats> {
        self.0.file.level(level)?;
        Ok(self.0.levels[level.map.index()][level.index()]
            .counters
            .stats())
    }

    pub(crate) fn counters(&self, map: usize, level: usize) -> &LevelCounters {
        &self.0.levels[map][level].counters
    }

    /// Tile number `index` of a level, from its slot if it is there, else loaded.
    ///
    /// # Errors
    /// As [`DsmFile::tile`].
    #[inline]
    pub(crate) fn hold(&self, map: usize, level: usize, index: u64) -> Result<Held> {
        let blocks = &self.0.levels[map][level].blocks;
        let (b, i) = (index / BLOCK_ENTRIES, (index % BLOCK_ENTRIES) as usize);
        if let Some(block) = blocks[b as usize].get() {
            let guard = block.peek(i);
            if let Some(resident) = guard.as_ref() {
                resident.touch();
                if let Content::Failed(e) = resident.value() {
                    return Err(e.clone());
                }
                return Ok(Held::Passing(guard));
            }
        }
        self.load(map, level, index).map(Held::Loaded)
    }

    #[cold]
    fn load(&self, map: usize, level: usize, index: u64) -> Result<Pin> {
        let slots = &*self.0;
        let own = &slots.levels[map][level];
        let (id, tile) = (
            MapId(map as u32).level(level as u32),
            own.shape.tile_at(index),
        );
        let shelf = &slots.cache.shelf;
        let (b, i) = (index / BLOCK_ENTRIES, (index % BLOCK_ENTRIES) as usize);
        let mut fresh = false;
        let block = own.blocks[b as usize].get_or_init(|| {
            fresh = true;
            let tiles = own.shape.tiles() - b * BLOCK_ENTRIES;
            Arc::new(Block::new(
                tiles.min(BLOCK_ENTRIES) as usize,
                &shelf.account,
            ))
        });
        if fresh {
            shelf.settle();
        }
        let entry = slots.file.entry(id, tile);
        let need = match &entry {
            Ok(entry) if entry.kind == TileKind::Empty => {
                block.fill(i, &slots.cache.lit);
                own.counters.count(Event::Loaded {
                    again: false,
                    time: Duration::ZERO,
                });
                return Ok(slots.cache.lit.clone());
            }
            Ok(entry) => slots.file.decoded_bytes(entry, own.shape.tile_extent(tile)),
            Err(_) => 0,
        };
        let (result, event) = shelf.get(block, i, need, |buffer| {
            let content = entry.and_then(|entry| slots.read(id, tile, &entry, buffer));
            match content {
                // What does not depend on the moment is not tried again.
                Err(e) if e.kind() != ErrorKind::Io => Ok(Content::Failed(e)),
                content => content,
            }
        });
        own.counters.count(event);
        match result {
            Ok(resident) => match resident.value() {
                Content::Failed(e) => Err(e.clone()),
                _ => Ok(resident),
            },
            Err(e) => Err(e),
        }
    }
}

impl Slots {
    fn read(&self, level: LevelId, tile: TileId, entry: &Entry, buffer: Words) -> Result<Content> {
        Ok(match entry.kind {
            TileKind::Empty => Content::Lit,
            TileKind::Constant => Content::Constant(entry.depths[0], entry.ends[0]),
            TileKind::Data => {
                Content::Planes(self.file.tile_for_cache(level, tile, entry, buffer)?)
            }
        })
    }
}

impl Drop for Slots {
    fn drop(&mut self) {
        let levels = self.levels.iter().flatten();
        let blocks: Vec<_> = levels
            .flat_map(|level| level.blocks.iter().filter_map(OnceLock::get).cloned())
            .collect();
        self.cache.shelf.forget(&blocks);
        let mut past = self.cache.past.lock().expect("no panic holds this lock");
        for level in self.levels.iter().flatten() {
            past.add(&level.counters.stats());
        }
    }
}
