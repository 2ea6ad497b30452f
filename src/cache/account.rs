//! Every byte that the cache holds, counted by capacity, and the buffers that evicted tiles leave to the next ones.

use super::sync::{Arc, AtomicU64, AtomicUsize, Mutex, Ordering::Relaxed};

/// The byte budget and what is charged to it.
///
/// LV00, section 5.4, gives the cache slots that grow to the largest tile they have held. Here the slots' memory is a
/// stock of spare buffers: an evicted tile's buffer waits in it, still charged, until a tile takes it.
pub(super) struct Account {
    budget: AtomicUsize,
    bytes: AtomicUsize,
    peak: AtomicUsize,
    spare: Mutex<Vec<Vec<u64>>>,
    pub grown: AtomicU64,
    pub shrunk: AtomicU64,
}

/// Bytes that are charged to an account until this is dropped.
pub(super) struct Charge {
    account: Arc<Account>,
    bytes: usize,
}

impl Account {
    pub fn new(budget: usize) -> Arc<Self> {
        Arc::new(Account {
            budget: AtomicUsize::new(budget),
            bytes: AtomicUsize::new(0),
            peak: AtomicUsize::new(0),
            spare: Mutex::new(Vec::new()),
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
    pub fn charge(self: &Arc<Self>, bytes: usize) -> Charge {
        self.add(bytes);
        Charge {
            account: self.clone(),
            bytes,
        }
    }

    /// A spare buffer that holds `need` bytes; the smallest that does, cut to twice the need.
    pub fn fitting(self: &Arc<Self>, need: usize) -> Option<(Vec<u64>, Charge)> {
        let mut spare = self.spare.lock().expect("no panic holds this lock");
        let fits = |buffer: &Vec<u64>| 8 * buffer.capacity() >= need;
        let (at, _) = spare
            .iter()
            .enumerate()
            .filter(|(_, buffer)| fits(buffer))
            .min_by_key(|(_, buffer)| buffer.capacity())?;
        let mut buffer = spare.swap_remove(at);
        drop(spare);
        let mut charge = Charge {
            account: self.clone(),
            bytes: 8 * buffer.capacity(),
        };
        if charge.bytes > 2 * need {
            buffer.truncate(need.div_ceil(8));
            buffer.shrink_to(need.div_ceil(8));
            charge.resize(8 * buffer.capacity());
            self.shrunk.fetch_add(1, Relaxed);
        }
        Some((buffer, charge))
    }

    /// Gives the largest spare buffer back to the system; whether there was one.
    pub fn free_one(&self) -> bool {
        let mut spare = self.spare.lock().expect("no panic holds this lock");
        let Some((at, _)) = spare.iter().enumerate().max_by_key(|(_, b)| b.capacity()) else {
            return false;
        };
        let bytes = 8 * spare.swap_remove(at).capacity();
        self.bytes.fetch_sub(bytes, Relaxed);
        true
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

    /// Ends the charge; the buffer that it was for becomes a spare one, charged by its capacity.
    pub fn leave(mut self, buffer: Vec<u64>) {
        self.resize(8 * buffer.capacity());
        self.bytes = 0;
        if buffer.capacity() > 0 {
            let mut spare = self.account.spare.lock().expect("no panic holds this lock");
            spare.push(buffer);
        }
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.account.bytes.fetch_sub(self.bytes, Relaxed);
    }
}
