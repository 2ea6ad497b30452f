//! Parallel maps that keep the order of their items.

use crate::Result;

/// Number of tiles to compress at once, enough to occupy all cores.
pub(in crate::io) fn batch() -> usize {
    4 * threads()
}

#[cfg(feature = "rayon")]
pub(in crate::io) fn threads() -> usize {
    rayon::current_num_threads()
}

#[cfg(not(feature = "rayon"))]
pub(in crate::io) fn threads() -> usize {
    1
}

#[cfg(feature = "rayon")]
pub(in crate::io) fn in_parallel<T: Send, U: Send>(
    items: Vec<T>,
    f: impl Fn(T) -> Result<U> + Sync + Send,
) -> Result<Vec<U>> {
    use rayon::prelude::*;
    if items.len() == 1 {
        return items.into_iter().map(f).collect();
    }
    items.into_par_iter().map(f).collect()
}

#[cfg(not(feature = "rayon"))]
pub(in crate::io) fn in_parallel<T, U>(
    items: Vec<T>,
    f: impl Fn(T) -> Result<U>,
) -> Result<Vec<U>> {
    items.into_iter().map(f).collect()
}
