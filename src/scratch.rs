//! Memory that a thread uses again and again, tile after tile.

use std::cell::Cell;
use std::thread::LocalKey;

/// Where a thread keeps it.
pub(crate) type Kept<T> = LocalKey<Cell<Vec<T>>>;

/// Bytes that a thread keeps; what a larger tile needed is given back.
const MOST: usize = 4 << 20;

/// Lends the vector to `f`; what is in it is left over.
#[inline(always)]
pub(crate) fn lend<T, R>(kept: &'static Kept<T>, f: impl FnOnce(&mut Vec<T>) -> R) -> R {
    let mut vec = kept.take();
    let result = f(&mut vec);
    if vec.capacity() * size_of::<T>() <= MOST {
        kept.set(vec);
    }
    result
}

/// The first `n` of the vector, which is made longer if it must be.
#[inline(always)]
pub(crate) fn first<T: Copy + Default>(vec: &mut Vec<T>, n: usize) -> &mut [T] {
    if vec.len() < n {
        vec.resize(n, T::default());
    }
    &mut vec[..n]
}
