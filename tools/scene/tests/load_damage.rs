//! Truncates files anywhere and flips any bit. The loader must return an error of one line or a
//! valid object, in memory bounded by the file's size.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use crate::load_support::*;

/// Counts the bytes that each thread holds, and their maximum.
struct Counting;

thread_local! {
    static HELD: Cell<usize> = const { Cell::new(0) };
    static MOST: Cell<usize> = const { Cell::new(0) };
}

fn count(more: usize, less: usize) {
    let _ = HELD.try_with(|held| {
        held.set((held.get() + more).saturating_sub(less));
        let _ = MOST.try_with(|most| most.set(most.get().max(held.get())));
    });
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Checks one input as fuzzing does, in at most sixteen times its size; packed data and its
/// unpacker may take a few MiB more.
fn checked(input: &[u8], packed: bool) {
    let before = HELD.get();
    MOST.set(before);
    laws::run(input);
    let room = 16 * input.len() + if packed { 4 << 20 } else { 4096 };
    let taken = MOST.get() - before;
    assert!(taken <= room, "{taken} bytes for a file of {}", input.len());
}

fn all(mut each: impl FnMut(&[u8], bool)) {
    for (name, input) in seeds() {
        println!("{name}");
        each(&input, name.contains("gz") || name.contains("zlib"));
    }
}

#[test]
fn a_file_truncated_anywhere_is_refused_or_valid() {
    all(|input, packed| {
        (0..=input.len()).for_each(|end| checked(&input[..end], packed));
    });
}

#[test]
fn a_file_with_any_bit_flipped_is_refused_or_valid() {
    all(|input, packed| {
        let mut input = input.to_vec();
        for bit in 8..input.len() * 8 {
            input[bit / 8] ^= 1 << (bit % 8);
            checked(&input, packed);
            input[bit / 8] ^= 1 << (bit % 8);
        }
    });
}

#[test]
fn a_file_with_any_four_bytes_set_to_the_greatest_number_is_refused_or_valid() {
    all(|input, packed| {
        for at in 1..input.len().saturating_sub(3) {
            for with in [[255, 255, 255, 255], [255, 255, 255, 127], [0, 0, 128, 127]] {
                let mut input = input.to_vec();
                input[at..at + 4].copy_from_slice(&with);
                checked(&input, packed);
            }
        }
    });
}
