//! Per-thread buffers that tiles reuse one after another.

use std::cell::Cell;
use std::thread::LocalKey;

/// A buffer of the current thread.
pub(crate) type ThreadBuffer<T> = LocalKey<Cell<Vec<T>>>;

/// The most bytes that a thread keeps between uses. A larger buffer is freed.
const MOST: usize = 4 << 20;

/// Calls `f` with the buffer of this thread. Its contents are unspecified.
#[inline(always)]
pub(crate) fn lend<T, R>(buffer: &'static ThreadBuffer<T>, f: impl FnOnce(&mut Vec<T>) -> R) -> R {
    let mut vec = buffer.take();
    let result = f(&mut vec);
    if vec.capacity() * size_of::<T>() <= MOST {
        buffer.set(vec);
    }
    result
}

/// The first `n` elements. Grows the vector to `n` if it is shorter.
#[inline(always)]
pub(crate) fn first<T: Copy + Default>(vec: &mut Vec<T>, n: usize) -> &mut [T] {
    if vec.len() < n {
        vec.resize(n, T::default());
    }
    &mut vec[..n]
}
