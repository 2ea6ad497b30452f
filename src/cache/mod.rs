//! Decoded tiles of many files within one byte budget (LV00, section 5.4). The documentation of
//! [`TileCache`] describes how it works.
//!
//! | module | what it holds |
//! |---|---|
//! | [`account`] | the budget, the bytes charged to it, spare memory |
//! | [`arena`] | large allocations in huge pages that tiles share |
//! | [`descriptor`] | where the planes of a tile lie |
//! | [`shelf`] | misses, loads and evictions: all that takes a lock |
//! | [`stats`] | counters |
//! | [`sync`] | primitives of the standard library or of loom |

mod account;
mod arena;
mod descriptor;
#[cfg(all(test, deepshadow_loom))]
mod loom;
mod shelf;
mod stats;
mod sync;

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

use crate::format::directory::{Entry, TileKind};
use crate::format::layout::BLOCK_ENTRIES;
use crate::format::tile::Words;
use crate::map::LevelShape;
use crate::{DsmFile, ErrorKind, LevelId, MapId, Result, TileId};
use account::Account;
pub(crate) use account::Charge;
pub(crate) use descriptor::{CachedTile, Descriptor, Kind};
use shelf::{LoadEvent, Resident, Shelf, SlotBlock};
pub use stats::CacheStats;
use sync::{Arc, Guard};

/// Decoded tiles of many files within one byte budget (LV00, section 5.4).
///
/// **Ownership.** [`TileCache::add`] takes a file and returns a [`CachedFile`], a handle that keeps
/// both the file and the cache alive. A decoded tile is immutable; its planes lie in one piece of
/// memory, in the types of the file. A lookup keeps its tiles for the length of one evaluation, or
/// its [`Sampler`](crate::Sampler) pins them: a pin is a reference count that keeps a tile alive
/// after its eviction. A sampler pins eight tiles, and more while the pins of all samplers take
/// less than half of the budget. Tiles of codec `none` in a file that lies in memory, mapped or
/// not, are looked up in place; the cache only remembers that it checked them. Tiles that are lit
/// everywhere, or that hold the same single vertex in every pixel, take no planes.
///
/// **Memory.** A cache with a budget of 64 MiB or more keeps tiles in *arenas*: allocations of 1/64
/// of the budget, 2 to 32 MiB, aligned to 2 MiB. On Linux, with the feature `mmap`, the system maps
/// them with huge pages, which makes random lookups in large maps faster. A tile larger than a
/// quarter of an arena, a smaller cache, and other systems use one buffer per tile. LV00's growing
/// slots live on as recycled memory: the memory of an evicted tile serves the next tiles.
///
/// **Accounting.** The budget is in bytes and counts capacity: arenas as a whole, free ranges
/// included; buffers, spare ones included; the bookkeeping of each tile; tables of slots; and tiles
/// that were evicted but are still pinned. The cache makes room before a load and after it. Only
/// three things can exceed the budget: pinned tiles with the arenas that they lie in; loads in
/// progress; and the tables of slots, which stay as long as their file. A tile larger than the
/// whole budget is loaded, looked up, and freed when its sampler moves on. A spare buffer gives way
/// to a larger one when none fits, and is cut when it has more than twice the size that a tile
/// needs. Spare buffers and empty arenas are freed when the cache is over its budget, and by
/// [`TileCache::clear`]. The directory of a file belongs to the file, has its own budget
/// ([`Limits`](crate::Limits)) and is not counted; neither is the memory that a codec needs to
/// decode.
///
/// **Lifetime.** The first lookup of a tile loads it. It stays until the cache needs room. Then the
/// tile that was loaded first is evicted first, unless it was used since the last time it was
/// considered, or is pinned while others are not. A tile that breaks a rule of the specification is
/// remembered as broken: its error stays until the cache needs room, and is then found again by the
/// next lookup. A tile that could not be read is tried again by the next lookup. When the last
/// handle of a file is dropped, handles of samplers included, its tiles and tables go; the memory
/// of the tiles becomes spare.
///
/// **Threading.** All methods take `&self`; any number of threads may share a cache. The thread
/// that first wants a tile loads it. Other threads that want it wait for its value or its error; no
/// thread waits inside a thread pool for work of that pool. If a load panics, the panic propagates
/// in its thread, and the next waiting thread loads instead. The result of a lookup depends on the
/// file alone.
///
/// **Cost.** A hit through a pin reads one cache line and the tile. A hit without a pin reads the
/// slot, two words of the thread's own and the mark of use. It takes no lock, hashes nothing, and
/// writes to shared memory only to set a mark that is not set. A miss takes one lock three times,
/// then reads, decodes and checks the tile: 10 to 200 microseconds for 32 x 32 pixels. Slots take
/// 16 bytes per tile, in blocks of 1,024 that are allocated on first use.
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
    shelf: Shelf<CachedTile>,
    /// The one value of all tiles without a vertex.
    lit: Arc<Resident<CachedTile>>,
    /// Number of samplers.
    samplers: AtomicUsize,
    /// Counters of all files, dropped ones included.
    counters: Mutex<CacheStats>,
}

/// A file in a [`TileCache`]. Clones share it.
#[derive(Clone)]
pub struct CachedFile(std::sync::Arc<FileSlots>);

/// A reference count that keeps a tile alive.
pub(crate) type TilePin = Arc<Resident<CachedTile>>;

/// A tile that stays alive for one evaluation.
pub(crate) enum TileRef {
    /// From its slot, without touching the reference count.
    Guarded(Guard<Resident<CachedTile>>),
    /// With a reference count: a tile that was just loaded, or is pinned.
    Counted(TilePin),
}

impl TileRef {
    #[inline]
    fn resident(&self) -> &TilePin {
        match self {
            TileRef::Guarded(guard) => guard.as_ref().expect("an empty slot is not held"),
            TileRef::Counted(pin) => pin,
        }
    }

    #[inline]
    pub fn tile(&self) -> &CachedTile {
        self.resident().value()
    }

    /// Bytes of its planes.
    pub fn bytes(&self) -> usize {
        self.resident().bytes()
    }

    /// Another reference count of the tile.
    pub fn pin(&self) -> TilePin {
        self.resident().clone()
    }
}

/// The slots of one file.
pub(crate) struct FileSlots {
    cache: std::sync::Arc<TileCache>,
    file: std::sync::Arc<DsmFile>,
    levels: Vec<Vec<LevelSlots>>,
}

struct LevelSlots {
    shape: LevelShape,
    blocks: Box<[OnceLock<Arc<SlotBlock<CachedTile>>>]>,
    /// Counters of the level. They change at misses, not at hits.
    counters: Mutex<CacheStats>,
}

impl TileCache {
    /// A cache of `budget` bytes.
    pub fn new(budget: usize) -> std::sync::Arc<Self> {
        std::sync::Arc::new(TileCache {
            shelf: Shelf::new(Account::new(budget)),
            lit: Resident::free(CachedTile::Lit),
            samplers: AtomicUsize::new(0),
            counters: Mutex::default(),
        })
    }

    /// Adds a file. A [`Sampler`](crate::Sampler) of the handle looks up its tiles.
    pub fn add(
        self: &std::sync::Arc<Self>,
        file: impl Into<std::sync::Arc<DsmFile>>,
    ) -> CachedFile {
        let file = file.into();
        let level = |info: &crate::LevelInfo| LevelSlots {
            shape: info.shape,
            blocks: (0..info.shape.tiles().div_ceil(BLOCK_ENTRIES))
                .map(|_| OnceLock::new())
                .collect(),
            counters: Mutex::default(),
        };
        let levels = file
            .maps()
            .iter()
            .map(|map| map.levels.iter().map(level).collect())
            .collect();
        CachedFile(std::sync::Arc::new(FileSlots {
            cache: self.clone(),
            file,
            levels,
        }))
    }

    /// The byte budget.
    pub fn budget(&self) -> usize {
        self.shelf.account.budget()
    }

    /// Sets the byte budget, and frees at once what exceeds it.
    pub fn set_budget(&self, bytes: usize) {
        self.shelf.set_budget(bytes);
    }

    /// Counts a new sampler.
    pub(crate) fn add_sampler(&self) {
        self.samplers.fetch_add(1, Relaxed);
    }

    /// Counts a dropped sampler.
    pub(crate) fn remove_sampler(&self) {
        self.samplers.fetch_sub(1, Relaxed);
    }

    /// Charges bytes that a sampler takes in addition to its pins.
    pub(crate) fn charge(&self, bytes: usize) -> Charge {
        let charge = Account::charge(&self.shelf.account, bytes);
        self.shelf.settle();
        charge
    }

    /// Bytes that one sampler may pin. All samplers together may pin half of the budget.
    pub(crate) fn pin_budget(&self) -> usize {
        let samplers = self.samplers.load(Relaxed);
        self.budget() / 2 / samplers.max(1)
    }

    /// Evicts all tiles and frees spare memory. Pinned tiles stay alive until their samplers
    /// release them.
    pub fn clear(&self) {
        self.shelf.clear();
    }

    /// Counters of all files, dropped ones included. Samplers count hits; they report them at every
    /// miss, when they are released and when they are dropped.
    pub fn stats(&self) -> CacheStats {
        self.stats_of(&self.counters)
    }

    /// These counters, and the memory of the cache.
    fn stats_of(&self, counters: &Mutex<CacheStats>) -> CacheStats {
        let account = &self.shelf.account;
        let bytes = account.bytes();
        CacheStats {
            bytes,
            // Another thread may have added to the one and not yet to the other.
            peak_bytes: account.peak().max(bytes),
            budget: account.budget(),
            grown: account.grown.load(Relaxed),
            shrunk: account.shrunk.load(Relaxed),
            ..*counters.lock().expect("no panic holds this lock")
        }
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

    /// Counters of one level of a map of this file. The figures about memory are those of the whole
    /// cache.
    ///
    /// # Errors
    /// `Input` if there is no such map or level.
    pub fn stats(&self, level: LevelId) -> Result<CacheStats> {
        self.0.file.level(level)?;
        let slots = &self.0.levels[level.map.index()][level.index()];
        Ok(self.0.cache.stats_of(&slots.counters))
    }

    /// Changes the counters of a level, and those of the cache.
    pub(crate) fn count(&self, map: usize, level: usize, change: impl Fn(&mut CacheStats)) {
        for counters in [&self.0.levels[map][level].counters, &self.0.cache.counters] {
            change(&mut counters.lock().expect("no panic holds this lock"));
        }
    }

    /// Tile number `index` of a level. A tile that is not in the cache is loaded and returned as
    /// [`TileRef::Counted`].
    ///
    /// # Errors
    /// As [`DsmFile::tile`].
    #[inline]
    pub(crate) fn tile(&self, map: usize, level: usize, index: u64) -> Result<TileRef> {
        let blocks = &self.0.levels[map][level].blocks;
        let (b, i) = (index / BLOCK_ENTRIES, (index % BLOCK_ENTRIES) as usize);
        if let Some(block) = blocks[b as usize].get() {
            let guard = block.peek(i);
            if let Some(resident) = guard.as_ref() {
                resident.touch();
                if let CachedTile::Failed(e) = resident.value() {
                    return Err(e.clone());
                }
                return Ok(TileRef::Guarded(guard));
            }
        }
        self.load(map, level, index).map(TileRef::Counted)
    }

    #[cold]
    fn load(&self, map: usize, level: usize, index: u64) -> Result<TilePin> {
        let slots = &*self.0;
        let own = &slots.levels[map][level];
        let id = MapId::from_index(map).level(level as u32);
        let tile = own.shape.tile_at(index);
        let shelf = &slots.cache.shelf;
        let (b, i) = (index / BLOCK_ENTRIES, (index % BLOCK_ENTRIES) as usize);
        let mut fresh = false;
        let block = own.blocks[b as usize].get_or_init(|| {
            fresh = true;
            let tiles = own.shape.tiles() - b * BLOCK_ENTRIES;
            Arc::new(SlotBlock::new(
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
                let (again, time) = (false, Duration::ZERO);
                self.count(map, level, |c| c.count(LoadEvent::Loaded { again, time }));
                return Ok(slots.cache.lit.clone());
            }
            Ok(entry) => slots.file.decoded_bytes(entry, own.shape.tile_extent(tile)),
            Err(_) => 0,
        };
        let (result, event) = shelf.get(block, i, need, |buffer| {
            let tile = entry.and_then(|entry| slots.read(id, tile, &entry, buffer));
            match tile {
                // Only an error of the system may not happen again.
                Err(e) if e.kind() != ErrorKind::Io => Ok(CachedTile::Failed(e)),
                tile => tile,
            }
        });
        self.count(map, level, |c| c.count(event));
        let resident = result?;
        match resident.value() {
            CachedTile::Failed(e) => Err(e.clone()),
            _ => Ok(resident),
        }
    }
}

impl FileSlots {
    fn read(
        &self,
        level: LevelId,
        tile: TileId,
        entry: &Entry,
        buffer: Words,
    ) -> Result<CachedTile> {
        Ok(match entry.kind {
            TileKind::Empty => CachedTile::Lit,
            TileKind::Constant => CachedTile::Constant(entry.depths[0], entry.ends[0]),
            TileKind::Data => {
                CachedTile::planes(self.file.tile_for_cache(level, tile, entry, buffer)?)
            }
        })
    }
}

impl Drop for FileSlots {
    fn drop(&mut self) {
        let levels = self.levels.iter().flatten();
        let blocks: Vec<_> = levels
            .flat_map(|level| level.blocks.iter().filter_map(OnceLock::get).cloned())
            .collect();
        self.cache.shelf.forget(&blocks);
    }
}
