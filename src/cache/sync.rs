//! The primitives of the cache, in one place so that a model checker can take theirs.
//!
//! With `--cfg deepshadow_loom` they are loom's, and a slot is a lock around a pointer; else they
//! are the standard library's, and a slot is an `arc_swap` cell, read without a lock and without
//! writing to memory that others read.

#[cfg(not(deepshadow_loom))]
mod real {
    pub use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
    pub use std::sync::{Arc, Condvar, Mutex};

    /// A pointer that is read far more often than it is changed.
    pub struct Cell<T>(arc_swap::ArcSwapOption<T>);

    /// The value of a [`Cell`], kept alive without a count that threads share.
    pub type Guard<T> = arc_swap::Guard<Option<Arc<T>>>;

    impl<T> Cell<T> {
        pub fn new() -> Self {
            Cell(arc_swap::ArcSwapOption::const_empty())
        }

        #[inline]
        pub fn peek(&self) -> Guard<T> {
            self.0.load()
        }

        pub fn get(&self) -> Option<Arc<T>> {
            self.0.load_full()
        }

        pub fn set(&self, value: Option<Arc<T>>) -> Option<Arc<T>> {
            self.0.swap(value)
        }
    }
}

#[cfg(deepshadow_loom)]
mod real {
    pub use loom::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
    pub use loom::sync::{Arc, Condvar, Mutex};

    pub struct Cell<T>(Mutex<Option<Arc<T>>>);

    pub type Guard<T> = Option<Arc<T>>;

    impl<T> Cell<T> {
        pub fn new() -> Self {
            Cell(Mutex::new(None))
        }

        pub fn peek(&self) -> Guard<T> {
            self.get()
        }

        pub fn get(&self) -> Option<Arc<T>> {
            self.0.lock().unwrap().clone()
        }

        pub fn set(&self, value: Option<Arc<T>>) -> Option<Arc<T>> {
            std::mem::replace(&mut self.0.lock().unwrap(), value)
        }
    }
}

pub(super) use real::*;
