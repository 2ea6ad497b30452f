//! Every byte that the cache holds, counted by capacity, and the buffers that evicted tiles leave to the next ones.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::sync::{Arc, AtomicU64, AtomicUsize, Mutex, Ordering::Relaxed};

/// The byte budget and what is charged to it.
///
/// LV00, section 5.4, gives the cache slots that grow to the largest tile they have held. Here the slots' memory is a
/// stock of spare buffers: an evicted tile's buffer waits in it, still charged, until a tile takes it. There is a stock only
/// within the budget: what is left beyond it goes back to the system.
pub(super) struct Account {
    budget: AtomicUsize,
    bytes: AtomicUsize,
    peak: AtomicUsize,
    spare: Mutex<Stock>,
    pub grown: AtomicU64,
    pub shrunk: AtomicU64,
}

/// Spare buffers by their capacity in words.
#[derive(Default)]
struct Stock(BTreeMap<usize, Vec<Vec<u64>>>);

impl Stock {
    fn put(&mut self, buffer: Vec<u64>) {
        self.0.entry(buffer.capacity()).or_default().push(buffer);
    }

    /// The smallest buffer of at least `words`.
    fn fitting(&mut self, words: usize) -> Option<Vec<u64>> {
        let size = *self.0.range(words..).next()?.0;
        self.take(size)
    }

    fn largest(&mut self) -> Option<Vec<u64>> {
        let size = *self.0.last_key_value()?.0;
        self.take(size)
    }

    fn take(&mut self, size: usize) -> Option<Vec<u64>> {
        let Entry::Occupied(mut same) = self.0.entry(size) else {
            return None;
        };
        let buffer = same.get_mut().pop();
        if same.get().is_empty() {
            same.remove();
        }
        buffer
    }
}

/// Bytes that are charged to an account until this is dropped.
pub(crate) struct Charge {
    account: Arc<Account>,
    bytes: usize,
}

impl Account {
    pub fn new(budget: usize) -> Arc<Self> {
        Arc::new(Account {
            budget: AtomicUsize::new(budget),
            bytes: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
            spare: Mutex::new(Stock::default()),
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

    /// A spare buffer that holds `need` bytes; the smallest that does, cut to the need if it is more than twice that.
    pub fn fitting(account: &Arc<Self>, need: usize) -> Option<(Vec<u64>, Charge)> {
        let words = need.div_ceil(8);
        let mut buffer = account.stock().fitting(words)?;
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

    /// Gives the largest spare buffer back to the system; whether there was one.
    pub fn free_one(&self) -> bool {
        let Some(buffer) = self.stock().largest() else {
            return false;
        };
        self.bytes.fetch_sub(8 * buffer.capacity(), Relaxed);
        true
    }

    fn stock(&self) -> impl std::ops::DerefMut<Target = Stock> + '_ {
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

    /// Ends the charge; the buffer that it was for becomes a spare one, charged by its capacity, if there is room.
    pub fn leave(mut self, buffer: Vec<u64>) {
        self.resize(8 * buffer.capacity());
        if buffer.capacity() == 0 {
            return;
        }
        let account = self.account.clone();
        // Asked with the stock locked: who adds a charge that is not seen here looks into the stock after it.
        let mut stock = account.stock();
        if !account.over_budget() {
            self.bytes = 0;
            stock.put(buffer);
        }
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.account.bytes.fetch_sub(self.bytes, Relaxed);
    }
}
