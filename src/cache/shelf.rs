//! Misses, loads and evictions: the part of the cache that takes a lock.
//!
//! A hit reads only the slot of a value. A miss comes here. One thread loads; others that want the
//! same value wait for it. The shelf makes room before a load and after it. It evicts values in the
//! order of their loads, with a second chance for those that were used since.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use lru::LruCache;

use super::account::{Account, Charge};
use super::sync::{Arc, AtomicBool, Cell, Condvar, Guard, Mutex, Ordering::Relaxed};
use crate::Result;
use crate::format::tile::Words;

/// A value that a shelf holds.
pub(crate) trait CacheValue: Send + Sync {
    /// Bytes of its memory, by capacity.
    fn bytes(&self) -> usize;
    /// Whether its memory is a loan, which is charged already.
    fn is_lent(&self) -> bool;
    /// Whether it may be evicted to make room.
    fn is_evictable(&self) -> bool;
    /// Its memory, for the next value.
    fn into_buffer(self) -> Words;
}

/// A value in memory, immutable.
pub(crate) struct Resident<T: CacheValue> {
    /// Taken out only by `drop`.
    value: Option<T>,
    charge: Option<Charge>,
    used: AtomicBool,
}

impl<T: CacheValue> Resident<T> {
    /// The most bytes that the bookkeeping of one value takes: this struct, its counts, the views
    /// of its planes or of its part of a file, and its place in the order of eviction, which is a
    /// node and a share of a table that may be half empty.
    pub const OVERHEAD: usize = size_of::<Resident<T>>() + 256;

    /// A value that is charged to nobody.
    pub fn free(value: T) -> Arc<Self> {
        Shelf::resident(value, None)
    }

    #[inline]
    pub fn value(&self) -> &T {
        self.value.as_ref().expect("taken only by drop")
    }

    /// Bytes of its planes.
    pub fn bytes(&self) -> usize {
        self.value().bytes()
    }

    /// Marks the value as used since it was last considered for eviction. Writes only if it must.
    #[inline]
    pub fn touch(&self) {
        if !self.used.load(Relaxed) {
            self.used.store(true, Relaxed);
        }
    }
}

impl<T: CacheValue> Drop for Resident<T> {
    fn drop(&mut self) {
        if let (Some(value), Some(charge)) = (self.value.take(), self.charge.take()) {
            charge.leave(value.into_buffer());
        }
    }
}

/// The slots of up to 1,024 successive tiles of a level.
pub(super) struct SlotBlock<T: CacheValue> {
    slots: Box<[TileSlot<T>]>,
    _charge: Charge,
}

/// The place of one tile.
struct TileSlot<T: CacheValue> {
    cell: Cell<Resident<T>>,
    loaded_before: AtomicBool,
}

impl<T: CacheValue> SlotBlock<T> {
    pub fn new(slots: usize, account: &Arc<Account>) -> Self {
        let slot = |_| TileSlot {
            cell: Cell::new(),
            loaded_before: AtomicBool::new(false),
        };
        SlotBlock {
            slots: (0..slots).map(slot).collect(),
            _charge: Account::charge(account, slots * size_of::<TileSlot<T>>()),
        }
    }

    /// Puts a value that is charged to nobody into slot `i`, for good.
    pub fn fill(&self, i: usize, value: &Arc<Resident<T>>) {
        self.slots[i].cell.set(Some(value.clone()));
    }

    /// The value in slot `i`.
    #[inline]
    pub fn peek(&self, i: usize) -> Guard<Resident<T>> {
        self.slots[i].cell.peek()
    }
}

/// How a value was obtained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoadEvent {
    /// Another thread had just loaded it.
    Found,
    /// This thread waited while another loaded it.
    Waited,
    /// This thread loaded it.
    Loaded {
        /// The value had been loaded and evicted before.
        again: bool,
        /// How long the load took.
        time: Duration,
    },
}

/// The result of [`Shelf::claim`].
pub(super) enum Claim<'a, T: CacheValue> {
    /// The value, or the error of the thread that loaded it.
    Ready(Result<Arc<Resident<T>>>, LoadEvent),
    /// This thread must load it, into this buffer or another.
    Load(LoadGuard<'a, T>, Words),
}

/// A slot: the address of its block, and its index in the block.
type SlotKey = (usize, usize);

struct ShelfState<T: CacheValue> {
    /// Evictable values in the order of eviction. Keeps their blocks alive.
    order: LruCache<SlotKey, Arc<SlotBlock<T>>>,
    pending: HashMap<SlotKey, Arc<PendingLoad<T>>>,
}

/// A load in progress.
struct PendingLoad<T: CacheValue> {
    outcome: Mutex<Outcome<T>>,
    ended: Condvar,
}

enum Outcome<T: CacheValue> {
    Pending,
    Done(Result<Arc<Resident<T>>>),
    /// The thread that loaded panicked.
    Crashed,
}

/// The values of all files of a cache.
pub(super) struct Shelf<T: CacheValue> {
    pub account: Arc<Account>,
    state: Mutex<ShelfState<T>>,
}

impl<T: CacheValue> Shelf<T> {
    /// A shelf whose values are charged to `account`.
    pub fn new(account: Arc<Account>) -> Self {
        Shelf {
            account,
            state: Mutex::new(ShelfState {
                order: LruCache::unbounded(),
                pending: HashMap::new(),
            }),
        }
    }

    fn lock(&self) -> impl std::ops::DerefMut<Target = ShelfState<T>> + '_ {
        self.state.lock().expect("no panic holds this lock")
    }

    /// The value of slot `i` of `block`. Loads it by `load` if the slot is empty, into a buffer of
    /// `need` bytes or another. One thread loads; others that want the same value wait for it or
    /// for its error.
    pub fn get(
        &self,
        block: &Arc<SlotBlock<T>>,
        i: usize,
        need: usize,
        load: impl FnOnce(Words) -> Result<T>,
    ) -> (Result<Arc<Resident<T>>>, LoadEvent) {
        match self.claim(block, i, need) {
            Claim::Ready(result, event) => (result, event),
            Claim::Load(guard, buffer) => {
                let start = Instant::now();
                let result = load(buffer);
                let time = start.elapsed();
                let (result, again) = guard.finish(result);
                (result, LoadEvent::Loaded { again, time })
            }
        }
    }

    /// The value of slot `i` of `block`, or the duty to load it. Waits while another thread loads
    /// it.
    pub fn claim<'a>(
        &'a self,
        block: &'a Arc<SlotBlock<T>>,
        i: usize,
        need: usize,
    ) -> Claim<'a, T> {
        let key = (Arc::as_ptr(block) as usize, i);
        loop {
            let mut state = self.lock();
            if let Some(resident) = block.slots[i].cell.get() {
                return Claim::Ready(Ok(resident), LoadEvent::Found);
            }
            if let Some(pending) = state.pending.get(&key).cloned() {
                drop(state);
                match pending.wait() {
                    Some(result) => return Claim::Ready(result, LoadEvent::Waited),
                    None => continue,
                }
            }
            let pending = Arc::new(PendingLoad {
                outcome: Mutex::new(Outcome::Pending),
                ended: Condvar::new(),
            });
            state.pending.insert(key, pending.clone());
            let (buffer, charge) = self.make_room(&mut state, need);
            let guard = LoadGuard {
                shelf: self,
                block,
                key,
                charge: Some(charge),
                pending,
                outcome: Outcome::Crashed,
            };
            return Claim::Load(guard, buffer);
        }
    }

    /// A value whose memory and bookkeeping are charged to `charge`.
    fn resident(value: T, charge: Option<Charge>) -> Arc<Resident<T>> {
        let charge = charge.map(|mut charge| {
            let memory = match value.is_lent() {
                true => Account::LOAN,
                false => value.bytes(),
            };
            charge.resize(memory + Resident::<T>::OVERHEAD);
            charge
        });
        Arc::new(Resident {
            value: Some(value),
            charge,
            used: AtomicBool::new(true),
        })
    }

    /// Memory of `need` bytes, charged with the bookkeeping of the value that it is for. Spare
    /// memory is freed before values are evicted. If nothing can be evicted, the budget is
    /// exceeded.
    fn make_room(&self, state: &mut ShelfState<T>, need: usize) -> (Words, Charge) {
        let account = &self.account;
        let words = need.div_ceil(8);
        let overhead = Resident::<T>::OVERHEAD;
        let mut arena = account.arena_for(need);
        let mut grown = false;
        loop {
            if arena.is_some() {
                if let Some(loan) = Account::lend(account, words) {
                    return (loan, Account::charge(account, Account::LOAN + overhead));
                }
            } else if words > 0
                && let Some((buffer, mut charge)) = Account::fitting(account, need)
            {
                charge.resize(8 * buffer.capacity() + overhead);
                return (Words::Own(buffer), charge);
            }
            let memory = arena.map_or(8 * words, |bytes| bytes + Account::LOAN);
            let charged = account.bytes().saturating_add(memory + overhead);
            let room = charged <= account.budget();
            if !room && account.free_one() {
                grown = words > 0;
            } else if room && let Some(bytes) = arena {
                if !account.add_arena(bytes) {
                    arena = None;
                }
            } else if room || !self.evict_one(state) {
                account.grown.fetch_add(grown.into(), Relaxed);
                let buffer = Vec::with_capacity(words);
                return (
                    Words::Own(buffer),
                    Account::charge(account, 8 * words + overhead),
                );
            }
        }
    }

    /// Frees and evicts until the budget is kept, or nothing is left to evict.
    fn trim(&self, state: &mut ShelfState<T>) {
        while self.account.over_budget() {
            if !self.account.free_one() && !self.evict_one(state) {
                return;
            }
        }
    }

    /// Evicts one value, preferably one that nobody holds. Returns false if there is none.
    fn evict_one(&self, state: &mut ShelfState<T>) -> bool {
        // Each value is spared twice at most: once because it was used, once because it is held.
        for round in 0..3 {
            for _ in 0..state.order.len() {
                let Some((key, block)) = state.order.pop_lru() else {
                    return false;
                };
                let cell = &block.slots[key.1].cell;
                let Some(resident) = cell.get() else {
                    continue;
                };
                // The slot and this function hold one count each.
                let held = Arc::strong_count(&resident) > 2;
                if resident.used.swap(false, Relaxed) || (held && round < 2) {
                    state.order.put(key, block);
                    continue;
                }
                drop(resident);
                drop(cell.set(None));
                return true;
            }
        }
        false
    }

    /// Evicts all evictable values, and frees spare memory.
    pub fn clear(&self) {
        let mut state = self.lock();
        while let Some((key, block)) = state.order.pop_lru() {
            block.slots[key.1].cell.set(None);
        }
        drop(state);
        while self.account.free_one() {}
    }

    /// Evicts the values of `blocks`, which are no longer used.
    pub fn forget(&self, blocks: &[Arc<SlotBlock<T>>]) {
        let mut state = self.lock();
        let gone: HashSet<usize> = blocks.iter().map(|b| Arc::as_ptr(b) as usize).collect();
        let keys: Vec<SlotKey> = state
            .order
            .iter()
            .map(|(key, _)| *key)
            .filter(|key| gone.contains(&key.0))
            .collect();
        for key in keys {
            if let Some(block) = state.order.pop(&key) {
                block.slots[key.1].cell.set(None);
            }
        }
    }

    /// Applies a new budget.
    pub fn set_budget(&self, bytes: usize) {
        self.account.set_budget(bytes);
        self.settle();
    }

    /// Makes room for charges that were added without making room, or for a lower budget. Takes the
    /// lock first, so that this thread sees the charges of others or they see those of this one.
    pub fn settle(&self) {
        self.trim(&mut self.lock());
    }
}

impl<T: CacheValue> PendingLoad<T> {
    /// Waits for the outcome. `None` if the loading thread panicked.
    fn wait(&self) -> Option<Result<Arc<Resident<T>>>> {
        let mut outcome = self.outcome.lock().expect("no panic holds this lock");
        loop {
            match &*outcome {
                Outcome::Pending => {
                    outcome = self.ended.wait(outcome).expect("no panic holds this lock");
                }
                Outcome::Done(result) => return Some(result.clone()),
                Outcome::Crashed => return None,
            }
        }
    }
}

/// Ends a load when its thread leaves it, with an outcome or by a panic.
pub(super) struct LoadGuard<'a, T: CacheValue> {
    shelf: &'a Shelf<T>,
    block: &'a Arc<SlotBlock<T>>,
    key: SlotKey,
    charge: Option<Charge>,
    pending: Arc<PendingLoad<T>>,
    outcome: Outcome<T>,
}

impl<T: CacheValue> LoadGuard<'_, T> {
    /// Puts a loaded value into its slot, and passes it or the error to all threads that wait. Also
    /// returns whether the slot held a value before.
    pub fn finish(mut self, result: Result<T>) -> (Result<Arc<Resident<T>>>, bool) {
        let result = result.map(|value| Shelf::resident(value, self.charge.take()));
        self.outcome = Outcome::Done(result.clone());
        let slot = &self.block.slots[self.key.1];
        let Ok(resident) = &result else {
            return (result, slot.loaded_before.load(Relaxed));
        };
        let mut state = self.shelf.lock();
        slot.cell.set(Some(resident.clone()));
        if resident.value().is_evictable() {
            state.order.put(self.key, self.block.clone());
        }
        self.shelf.trim(&mut state);
        (result, slot.loaded_before.swap(true, Relaxed))
    }
}

impl<T: CacheValue> Drop for LoadGuard<'_, T> {
    fn drop(&mut self) {
        // A load that failed takes no room. Waiting threads must see that before they make room.
        self.charge = None;
        let outcome = std::mem::replace(&mut self.outcome, Outcome::Crashed);
        self.shelf.lock().pending.remove(&self.key);
        let mut ours = self
            .pending
            .outcome
            .lock()
            .expect("no panic holds this lock");
        *ours = outcome;
        self.pending.ended.notify_all();
    }
}
