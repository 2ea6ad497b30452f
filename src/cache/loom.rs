//! Every order in which two or three threads can go through a miss, a failure and an eviction.
//!
//! Run by `RUSTFLAGS="--cfg deepshadow_loom" cargo test --release --no-default-features --lib
//! cache::loom`. Loom tries all interleavings with at most three preemptions, finds deadlocks, and
//! finds values that nobody frees.

use ::loom::model::Builder;
use ::loom::sync::Arc;
use ::loom::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use ::loom::thread;

use super::account::Account;
use super::shelf::{CacheValue, Claim, LoadEvent, Resident, Shelf, SlotBlock};
use crate::format::tile::Words;
use crate::{Error, Result};

/// A value that says whose it is, in a buffer of one word.
struct Payload(Words);

/// Bytes of its buffer.
const WORD: usize = 8;
/// Bytes of a value on the shelf.
const ONE: usize = WORD + Resident::<Payload>::OVERHEAD;

impl CacheValue for Payload {
    fn bytes(&self) -> usize {
        8 * self.0.capacity()
    }

    fn is_evictable(&self) -> bool {
        true
    }

    fn is_lent(&self) -> bool {
        matches!(self.0, Words::Lent(..))
    }

    fn into_buffer(mut self) -> Words {
        // Whoever still looked at it would see this.
        self.0[0] = u64::MAX;
        self.0
    }
}

/// Bytes of an arena: one range.
const ARENA: usize = 64;
/// Bytes of a value on the shelf that has an arena of its own.
const ONE_IN_ARENA: usize = ARENA + Account::LOAN + Resident::<Payload>::OVERHEAD;

/// A shelf with one block, and how often each slot was loaded.
struct World {
    shelf: Shelf<Payload>,
    block: Arc<SlotBlock<Payload>>,
    loads: [AtomicUsize; 2],
}

impl World {
    /// A world with room for `values` values beside the block.
    fn new(values: usize) -> Arc<World> {
        Self::of(Account::new(usize::MAX), values * ONE)
    }

    /// A world with room for `values` values beside the block, each of them in an arena of its own.
    fn in_arenas(values: usize) -> Arc<World> {
        let account = Account::with_arenas(usize::MAX, |_| Some(ARENA));
        Self::of(account, values * ONE_IN_ARENA)
    }

    fn of(account: Arc<Account>, room: usize) -> Arc<World> {
        let shelf = Shelf::new(account);
        let block = Arc::new(SlotBlock::new(2, &shelf.account));
        shelf.set_budget(shelf.account.bytes() + room);
        let loads = [AtomicUsize::new(0), AtomicUsize::new(0)];
        Arc::new(World {
            shelf,
            block,
            loads,
        })
    }

    /// The value of slot `i`, read after all other threads had their chance to spoil it.
    fn get(&self, i: usize) -> LoadEvent {
        let (value, event) = self.shelf.get(&self.block, i, WORD, |buffer| {
            self.loads[i].fetch_add(1, SeqCst);
            Ok(payload(buffer, i))
        });
        let value = value.expect("nothing fails here");
        thread::yield_now();
        check(&value, i);
        event
    }

    /// The same, by a load that fails.
    fn fail(&self, i: usize) -> (Result<()>, LoadEvent) {
        let (value, event) = self.shelf.get(&self.block, i, WORD, |_| {
            self.loads[i].fetch_add(1, SeqCst);
            Err(Error::input("no such luck"))
        });
        (value.map(|value| check(&value, i)), event)
    }

    fn loads(&self, i: usize) -> usize {
        self.loads[i].load(SeqCst)
    }

    /// Checks that the values fit the budget, and that in the end only the block is charged.
    fn end(this: Arc<World>) {
        let world = Arc::try_unwrap(this).ok().expect("all threads have ended");
        let account = &world.shelf.account;
        assert!(!account.over_budget(), "{} bytes", account.bytes());
        world.shelf.clear();
        let block = {
            let before = account.bytes();
            drop(world.block);
            before - account.bytes()
        };
        assert!(block > 0);
        assert_eq!(account.bytes(), 0, "charged after all is gone");
    }
}

fn payload(mut buffer: Words, i: usize) -> Payload {
    buffer.set_len(1);
    buffer[0] = 100 + i as u64;
    Payload(buffer)
}

fn check(value: &Resident<Payload>, i: usize) {
    assert_eq!(value.value().0[0], 100 + i as u64, "another's value");
}

/// Runs `f` in every order; its answer says whether the order was one that the test is about, and
/// some must be.
fn model(f: impl Fn() -> bool + Send + Sync + 'static) {
    let seen = std::sync::Arc::new([const { std::sync::atomic::AtomicUsize::new(0) }; 2]);
    let mut builder = Builder::new();
    builder.preemption_bound = Some(3);
    let counts = seen.clone();
    builder.check(move || {
        let there = usize::from(f());
        counts[there].fetch_add(1, SeqCst);
    });
    let [other, there] = [0, 1].map(|i| seen[i].load(SeqCst));
    assert!(other + there > 20, "{other} + {there} orders");
    assert!(there > 0, "never in {other} orders");
}

/// Runs `f` in a thread of its own.
fn spawn<R: 'static>(
    world: &Arc<World>,
    f: impl FnOnce(&World) -> R + 'static,
) -> thread::JoinHandle<R> {
    let world = world.clone();
    thread::spawn(move || f(&world))
}

#[test]
fn three_threads_that_want_one_value_load_it_once() {
    model(|| {
        let world = World::new(1);
        let others = [0; 2].map(|_| spawn(&world, |w| w.get(0)));
        let mut events = vec![world.get(0)];
        events.extend(others.map(|t| t.join().unwrap()));
        let loaded = |e: &&LoadEvent| matches!(e, LoadEvent::Loaded { again: false, .. });
        assert_eq!(events.iter().filter(loaded).count(), 1, "{events:?}");
        assert_eq!(world.loads(0), 1);
        World::end(world);
        // Both others waited.
        events.iter().filter(|e| **e == LoadEvent::Waited).count() == 2
    });
}

#[test]
fn two_values_that_fit_are_loaded_once_each() {
    model(|| {
        let world = World::new(2);
        let other = spawn(&world, |w| (w.get(0), w.get(1)));
        world.get(1);
        world.get(0);
        other.join().unwrap();
        assert_eq!((world.loads(0), world.loads(1)), (1, 1));
        World::end(world);
        true
    });
}

#[test]
fn a_value_that_is_evicted_while_a_thread_looks_at_it_stays_what_it_is() {
    model(|| {
        let world = World::new(1);
        let other = spawn(&world, |w| w.get(0));
        world.get(1);
        other.join().unwrap();
        let both = world.loads(0) + world.loads(1);
        assert_eq!(both, 2);
        assert!(world.shelf.account.peak() <= world.shelf.account.budget() + ONE);
        let passed = world.shelf.account.peak() > world.shelf.account.budget();
        // One of them is gone, or both are; looking again brings it back.
        world.get(0);
        world.get(1);
        assert!((3..=4).contains(&(world.loads(0) + world.loads(1))));
        World::end(world);
        passed
    });
}

#[test]
fn a_value_that_fits_nowhere_is_gone_when_the_last_lets_go() {
    model(|| {
        let world = World::new(0);
        let other = spawn(&world, |w| w.get(0));
        let (ours, theirs) = (world.get(0), other.join().unwrap());
        let shared = ours == LoadEvent::Waited || theirs == LoadEvent::Waited;
        assert_eq!(world.loads(0), if shared { 1 } else { 2 });
        World::end(world);
        shared
    });
}

#[test]
fn when_a_thread_crashes_in_its_load_another_loads() {
    model(|| {
        let world = World::new(1);
        let others = [0; 2].map(|_| spawn(&world, |w| w.get(0)));
        let crashed = match world.shelf.claim(&world.block, 0, WORD) {
            // Drops the guard as a panic would: loom cannot continue after a real panic.
            Claim::Load(guard, _) => {
                thread::yield_now();
                drop(guard);
                true
            }
            Claim::Ready(value, _) => {
                check(&value.expect("nothing fails here"), 0);
                false
            }
        };
        let events = others.map(|t| t.join().unwrap());
        assert_eq!(world.loads(0), 1);
        World::end(world);
        // One of those who waited for the crash loads, and the other waits again.
        crashed && events.contains(&LoadEvent::Waited)
    });
}

#[test]
fn waiters_get_the_error_and_who_comes_later_loads() {
    model(|| {
        let world = World::new(1);
        let other = spawn(&world, |w| w.fail(0));
        let (ours, theirs) = (world.fail(0), other.join().unwrap());
        assert!(ours.0.is_err() && theirs.0.is_err());
        let waited = [ours.1, theirs.1].contains(&LoadEvent::Waited);
        assert_eq!(world.loads(0), if waited { 1 } else { 2 });
        assert!(matches!(
            world.get(0),
            LoadEvent::Loaded { again: false, .. }
        ));
        World::end(world);
        waited
    });
}

#[test]
fn values_may_be_forgotten_and_the_budget_changed_at_any_time() {
    model(|| {
        let world = World::new(1);
        let other = spawn(&world, |w| w.get(0));
        world.shelf.forget(std::slice::from_ref(&world.block));
        world.shelf.set_budget(world.shelf.account.budget() + ONE);
        other.join().unwrap();
        world.get(0);
        assert!((1..=2).contains(&world.loads(0)));
        let forgotten = world.loads(0) == 2;
        World::end(world);
        forgotten
    });
}

#[test]
fn clearing_while_others_load_loses_nothing() {
    model(|| {
        let world = World::new(2);
        let other = spawn(&world, |w| {
            w.get(0);
            w.get(1);
        });
        world.shelf.clear();
        world.get(0);
        other.join().unwrap();
        let cleared_between = world.loads(0) == 2;
        World::end(world);
        cleared_between
    });
}

#[test]
fn a_budget_that_falls_while_a_thread_lets_go_is_kept() {
    model(|| {
        let world = World::new(1);
        let budget = world.shelf.account.budget();
        let other = spawn(&world, |w| w.get(0));
        world.shelf.clear();
        world.shelf.set_budget(budget - ONE);
        other.join().unwrap();
        let once_there = world.shelf.account.peak() == budget;
        World::end(world);
        once_there
    });
}

#[test]
fn a_range_is_lent_again_only_when_nobody_looks_at_its_value() {
    model(|| {
        let world = World::in_arenas(1);
        let other = spawn(&world, |w| w.get(0));
        world.get(1);
        other.join().unwrap();
        assert_eq!(world.loads(0) + world.loads(1), 2);
        let account = &world.shelf.account;
        assert!(account.peak() <= account.budget() + ONE_IN_ARENA);
        let exceeded = account.peak() > account.budget();
        World::end(world);
        exceeded
    });
}

#[test]
fn an_arena_whose_last_value_goes_while_the_budget_falls_is_freed() {
    model(|| {
        let world = World::in_arenas(1);
        let budget = world.shelf.account.budget();
        let other = spawn(&world, |w| w.get(0));
        world.shelf.clear();
        world.shelf.set_budget(budget - ONE_IN_ARENA);
        other.join().unwrap();
        let once_there = world.shelf.account.peak() == budget;
        World::end(world);
        once_there
    });
}
