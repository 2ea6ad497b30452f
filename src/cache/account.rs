//! Every byte that the cache holds, counted by capacity, and the memory that evicted tiles leave to
//! the next ones.

use std::collections::BTreeMap;

use super::arena::{Arenas, Range};
use super::sync::{Arc, AtomicU64, AtomicUsize, Mutex, Ordering::Relaxed};
use crate::format::tile::{Loan, Words};

/// The byte budget, and the bytes that are charged to it.
///
/// LV00, section 5.4, gives the cache slots that grow to the largest tile they have held. Here a
/// large cache keeps tiles in arenas, which are charged as a whole. A small cache, or a tile too
/// large for an arena, uses buffers of the system's allocator: the buffer of an evicted tile waits
/// in a stock of spare ones, still charged, until a tile takes it. Memory beyond the budget goes
/// back to the system: spare buffers, and arenas that hold no tile.
pub(super) struct Account {
    budget: AtomicUsize,
    bytes: AtomicUsize,
    peak: AtomicUsize,
    spare: Mutex<Spare>,
    arena_bytes: fn(usize) -> Option<usize>,
    pub grown: AtomicU64,
    pub shrunk: AtomicU64,
}

/// Memory that waits for tiles.
#[derive(Default)]
struct Spare {
    /// By capacity in words, and address.
    buffers: BTreeMap<(usize, usize), Vec<u64>>,
    arenas: Arenas,
}

/// Bytes of an arena for a budget: 1/64 of it in whole huge pages, so that little is lost where an
/// arena is not full. `None` for a small budget, and where the system has no huge pages.
fn arena_bytes(budget: usize) -> Option<usize> {
    const LEAST_BUDGET: usize = 64 << 20;
    const HUGE_PAGE: usize = 2 << 20;
    const MOST: usize = 32 << 20;
    if budget < LEAST_BUDGET || !cfg!(all(feature = "mmap", target_os = "linux")) {
        return None;
    }
    Some((budget / 64 / HUGE_PAGE * HUGE_PAGE).clamp(HUGE_PAGE, MOST))
}

/// A range of an arena as the memory of a tile.
struct ArenaLoan {
    account: Arc<Account>,
    /// Taken only by `drop`.
    range: Option<Range>,
}

impl Loan for ArenaLoan {
    fn words(&self) -> &[u64] {
        self.range.as_ref().expect("taken only by drop").words()
    }

    fn words_mut(&mut self) -> &mut [u64] {
        self.range.as_mut().expect("taken only by drop").words_mut()
    }
}

impl Drop for ArenaLoan {
    fn drop(&mut self) {
        if let Some(range) = self.range.take() {
            self.account.put(range);
        }
    }
}

/// Bytes that are charged to an account until this is dropped.
pub(crate) struct Charge {
    account: Arc<Account>,
    bytes: usize,
}

impl Account {
    /// Bytes of the bookkeeping of a loan, at most: itself, and a free range in two trees.
    pub const LOAN: usize = 192;

    pub fn new(budget: usize) -> Arc<Self> {
        Self::with_arenas(budget, arena_bytes)
    }

    /// An account with arenas of another size, as a function of the budget.
    pub fn with_arenas(budget: usize, arena_bytes: fn(usize) -> Option<usize>) -> Arc<Self> {
        Arc::new(Account {
            budget: AtomicUsize::new(budget),
            bytes: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
            spare: Mutex::new(Spare::default()),
            arena_bytes,
            grown: AtomicU64::new(0),
            shrunk: AtomicU64::new(0),
        })
    }

    pub fn budget(&self) -> usize {
        self.budget.load(Relaxed)
    }

    pub fn set_budget(&self, bytes: usize) {
        self.budget.store(bytes, Relaxed);
    }

    pub fn bytes(&self) -> usize {
        self.bytes.load(Relaxed)
    }

    pub fn peak(&self) -> usize {
        self.peak.load(Relaxed)
    }

    fn add(&self, bytes: usize) {
        let now = self.bytes.fetch_add(bytes, Relaxed) + bytes;
        self.peak.fetch_max(now, Relaxed);
    }

    pub fn over_budget(&self) -> bool {
        self.bytes() > self.budget()
    }

    /// Charges `bytes`, whatever the budget says.
    pub fn charge(account: &Arc<Self>, bytes: usize) -> Charge {
        account.add(bytes);
        Charge {
            account: account.clone(),
            bytes,
        }
    }

    /// A spare buffer that holds `need` bytes; the smallest that does, cut to the need if it is
    /// more than twice that.
    pub fn fitting(account: &Arc<Self>, need: usize) -> Option<(Vec<u64>, Charge)> {
        let words = need.div_ceil(8);
        let mut spare = account.spare();
        let key = *spare.buffers.range((words, 0)..).next()?.0;
        let mut buffer = spare.buffers.remove(&key)?;
        drop(spare);
        let mut charge = Charge {
            account: account.clone(),
            bytes: 8 * buffer.capacity(),
        };
        if charge.bytes > 2 * need {
            buffer.truncate(words);
            buffer.shrink_to(words);
            charge.resize(8 * buffer.capacity());
            account.shrunk.fetch_add(1, Relaxed);
        }
        Some((buffer, charge))
    }

    /// Bytes of a new arena, if a tile of `need` bytes belongs into one: at most a quarter of it.
    pub fn arena_for(&self, need: usize) -> Option<usize> {
        let bytes = (self.arena_bytes)(self.budget())?;
        (0 < need && need <= bytes / 4).then_some(bytes)
    }

    /// A loan of `words` from an arena that has room.
    pub fn lend(account: &Arc<Self>, words: usize) -> Option<Words> {
        // SAFETY: the loan puts the range back when it is dropped, and keeps the account alive.
        let range = unsafe { account.spare().arenas.take(words) }?;
        let loan = ArenaLoan {
            account: account.clone(),
            range: Some(range),
        };
        Some(Words::Lent(Box::new(loan), words))
    }

    /// Adds an arena, which is charged; whether the system had the memory.
    pub fn add_arena(&self, bytes: usize) -> bool {
        let mut spare = self.spare();
        let added = spare.arenas.grow(bytes);
        if added {
            self.add(bytes);
        }
        added
    }

    /// Takes a range back. Its arena goes if it is empty and there is no room for it.
    fn put(&self, range: Range) {
        let mut spare = self.spare();
        let empty = spare.arenas.put(range);
        // Checked while `spare` is locked: a thread whose charge is not seen here frees what is
        // spare after it.
        if empty.is_some() && self.over_budget() {
            self.free_arena(&mut spare);
        }
    }

    fn free_arena(&self, spare: &mut Spare) -> bool {
        let freed = spare.arenas.shrink();
        self.bytes.fetch_sub(freed.unwrap_or(0), Relaxed);
        freed.is_some()
    }

    /// Gives the largest spare buffer, or an empty arena, back to the system; whether there was
    /// one.
    pub fn free_one(&self) -> bool {
        let mut spare = self.spare();
        let Some((_, buffer)) = spare.buffers.pop_last() else {
            return self.free_arena(&mut spare);
        };
        self.bytes.fetch_sub(8 * buffer.capacity(), Relaxed);
        true
    }

    fn spare(&self) -> impl std::ops::DerefMut<Target = Spare> + '_ {
        self.spare.lock().expect("no panic holds this lock")
    }
}

impl Charge {
    /// Charges `bytes` from now on.
    pub fn resize(&mut self, bytes: usize) {
        if bytes > self.bytes {
            self.account.add(bytes - self.bytes);
        } else {
            self.account.bytes.fetch_sub(self.bytes - bytes, Relaxed);
        }
        self.bytes = bytes;
    }

    /// Ends the charge, and leaves the memory that it was for to the next tiles. A loan goes back.
    /// A buffer becomes a spare one, charged by its capacity, if there is room.
    pub fn leave(mut self, words: Words) {
        let Words::Own(buffer) = words else {
            // In this order: an empty arena stays if there is room without the charge.
            drop(self);
            drop(words);
            return;
        };
        self.resize(8 * buffer.capacity());
        if buffer.capacity() == 0 {
            return;
        }
        let account = self.account.clone();
        // Checked while `spare` is locked: a thread whose charge is not seen here frees what is
        // spare after it.
        let mut spare = account.spare();
        if !account.over_budget() {
            self.bytes = 0;
            let key = (buffer.capacity(), buffer.as_ptr() as usize);
            spare.buffers.insert(key, buffer);
        }
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.account.bytes.fetch_sub(self.bytes, Relaxed);
    }
}
