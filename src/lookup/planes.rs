//! The planes of a tile as lookups of one channel read them: pointers next to one another in one line of the
//! processor's cache.
//!
//! A count leads to a tile through four pointers, one after another, which takes as long as the search itself. So they are followed
//! once, when the tile is pinned. The unsafe code of lookups is in this file and in `pins`.

use std::hint::select_unpredictable;
use std::marker::PhantomData;

use super::pixel::{Hint, Search};
use crate::cache::Content;
use crate::format::tile::Values;

/// The planes of a tile, flattened.
#[derive(Clone, Copy)]
#[repr(C)]
pub(super) struct Planes<'a> {
    vertex: *const u32,
    z: *const f32,
    /// `u16` or `f32`, as `kind` says.
    v: *const u8,
    /// Visibility 1 as stored, and what stored numbers are multiplied by.
    one: f64,
    unit: f64,
    pixels: u32,
    stride: u32,
    lattice: u16,
    kind: Kind,
    tile: PhantomData<&'a Content>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Lattice,
    F32,
    /// One vertex in every pixel: `one` is its visibility, `unit` its depth.
    Constant,
    Lit,
}

// SAFETY: it stands for a `&Content`, which is `Send`.
unsafe impl Send for Planes<'_> {}

/// What is outside a map with a lit border.
pub(super) const LIT: &Planes<'static> = &Planes::lit();

// SAFETY: as above, of `&Content` again.
unsafe impl Sync for Planes<'_> {}

impl<'a> Planes<'a> {
    /// The planes of no tile: lit.
    pub const fn lit() -> Self {
        Planes {
            vertex: std::ptr::null(),
            z: std::ptr::null(),
            v: std::ptr::null(),
            one: 1.0,
            unit: 1.0,
            pixels: 0,
            stride: 0,
            lattice: 0,
            kind: Kind::Lit,
            tile: PhantomData,
        }
    }

    pub fn of(content: &'a Content) -> Self {
        let mut planes = Planes::lit();
        match content {
            Content::Planes(tile) => {
                let view = tile.view();
                planes.vertex = view.vertex.as_ptr();
                planes.z = view.z.as_ptr();
                planes.pixels = tile.pixels() as u32;
                planes.stride = tile.width();
                match view.v {
                    Values::Lattice(v) => {
                        planes.v = v.as_ptr().cast();
                        planes.lattice = tile.lattice();
                        planes.one = f64::from(tile.lattice());
                        planes.unit = 1.0 / planes.one;
                        planes.kind = Kind::Lattice;
                    }
                    Values::F32(v) => {
                        planes.v = v.as_ptr().cast();
                        planes.kind = Kind::F32;
                    }
                }
            }
            &Content::Constant(z, v) => {
                (planes.one, planes.unit) = (f64::from(v), f64::from(z));
                planes.kind = Kind::Constant;
            }
            _ => {}
        }
        planes
    }

    /// Place in the tile of pixel (x, y) of the level, where tiles have 2^`shift` pixels a side.
    #[inline(always)]
    pub fn place(&self, [x, y]: [i32; 2], shift: u32) -> usize {
        let mask = (1u32 << shift) - 1;
        ((y as u32 & mask) * self.stride + (x as u32 & mask)) as usize
    }

    /// The vertices of the pixels of the block of `N` x `N` pixels whose first is `at`. Their memory is on its way when this returns.
    #[inline(always)]
    fn ranges<const N: usize>(&self, at: usize) -> Ranges<N> {
        let stride = self.stride as usize;
        if self.pixels == 0 {
            return [[Range { start: 0, end: 0 }; N]; N];
        }
        assert!(
            at + (N - 1) * stride + N <= self.pixels as usize,
            "a block inside its tile"
        );
        let size = if self.kind == Kind::Lattice { 2 } else { 4 };
        let mut out = [[Range { start: 0, end: 0 }; N]; N];
        for (j, row) in out.iter_mut().enumerate() {
            for (i, range) in row.iter_mut().enumerate() {
                // SAFETY: asserted above.
                *range = unsafe { self.range(at + j * stride + i, size) };
            }
        }
        out
    }

    /// The vertices of a pixel. Their memory is on its way when this returns.
    ///
    /// # Safety
    /// The pixel is one of the tile.
    #[inline(always)]
    unsafe fn range(&self, pixel: usize, size: usize) -> Range {
        // SAFETY: the table has an entry more than pixels.
        let (start, end) = unsafe {
            let entry = self.vertex.add(pixel);
            (*entry, *entry.add(1))
        };
        prefetch(self.z.wrapping_add(start as usize));
        prefetch(self.z.wrapping_add(end as usize));
        let middle = (start as usize + end as usize) / 2;
        prefetch(self.v.wrapping_add(middle * size));
        Range { start, end }
    }

    /// Sends for the entry of the table of vertices that [`Found::new`] will read.
    #[inline(always)]
    pub fn send_for_table(&self, at: usize) {
        prefetch(self.vertex.wrapping_add(at));
    }

    /// Weighted sum of the first channel over the block of these ranges, which come from [`Planes::ranges`] of this tile.
    ///
    /// # Safety
    /// They do.
    #[inline(always)]
    unsafe fn sum<const N: usize>(
        &self,
        ranges: &Ranges<N>,
        weights: (&[f64; N], &[f64; N]),
        depth: f32,
        hint: &mut impl Hint,
    ) -> f64 {
        // SAFETY: as the caller promises.
        unsafe {
            match self.kind {
                Kind::Lattice => self.sum_of::<N, u16>(ranges, weights, depth, hint) * self.unit,
                Kind::F32 => self.sum_of::<N, f32>(ranges, weights, depth, hint),
                Kind::Constant if f64::from(depth) > self.unit => self.one,
                _ => 1.0,
            }
        }
    }

    /// # Safety
    /// As [`Planes::sum`], and `V` is the type of the visibilities.
    #[inline(always)]
    unsafe fn sum_of<const N: usize, V: Stored>(
        &self,
        ranges: &Ranges<N>,
        (wx, wy): (&[f64; N], &[f64; N]),
        depth: f32,
        hint: &mut impl Hint,
    ) -> f64 {
        let mut total = 0.0;
        for (j, (row, wy)) in ranges.iter().zip(wy).enumerate() {
            for (i, (range, wx)) in row.iter().zip(wx).enumerate() {
                // SAFETY: as the caller promises.
                let value = unsafe { self.value::<V>(range, depth, j * N + i, hint) };
                total += if N == 1 { value } else { wx * wy * value };
            }
        }
        total
    }

    /// The value of a pixel, as stored. The same arithmetic as `pixel::value`.
    ///
    /// # Safety
    /// As [`Planes::sum_of`].
    #[inline(always)]
    unsafe fn value<V: Stored>(
        &self,
        range: &Range,
        depth: f32,
        tap: usize,
        hint: &mut impl Hint,
    ) -> f64 {
        let (start, n) = (range.start as usize, (range.end - range.start) as usize);
        if n == 0 {
            return self.one;
        }
        // SAFETY: the table of a tile that was decoded rises and ends with the number of vertices, which is the length of `z` and at
        // most that of `v`: the cache holds no other. The caller's range comes from this table, so all that is read lies
        // inside. The lifetime of `self` keeps it alive.
        let (z, v) = unsafe {
            (
                std::slice::from_raw_parts(self.z.add(start), n),
                self.v.cast::<V>().add(start),
            )
        };
        let next = hint.before(tap, z, depth);
        // Between two vertices, or at one: the first or the last. Nothing branches on what the search finds: that is as good as
        // random, and a wrong guess would keep the next pixel waiting.
        let between = next.wrapping_sub(1) < n - 1;
        let high = next.min(n - 1);
        let low = high - usize::from(between);
        // SAFETY: `high` is less than `n`; `between` needs `next`, and with it `high`, to be at least 1, so `low` is too.
        let (z0, z1, a, b) = unsafe {
            let z = |i: usize| f64::from(*z.get_unchecked(i));
            (z(low), z(high), *v.add(low), *v.add(high))
        };
        let a: f64 = select_unpredictable(next == 0, V::one(self), a).into();
        let t = (f64::from(depth) - z0) / (z1 - z0);
        let t = f64::from_bits(t.to_bits() & u64::from(between).wrapping_neg());
        a + (b.into() - a) * t
    }
}

/// A type that visibilities are stored in.
trait Stored: Copy + Into<f64> {
    /// Visibility 1.
    fn one(planes: &Planes<'_>) -> Self;
}

impl Stored for u16 {
    #[inline(always)]
    fn one(planes: &Planes<'_>) -> u16 {
        planes.lattice
    }
}

impl Stored for f32 {
    #[inline(always)]
    fn one(_: &Planes<'_>) -> f32 {
        1.0
    }
}

/// A block of pixels of a tile, and what they weigh.
pub(super) struct Found<'a, const N: usize> {
    planes: &'a Planes<'a>,
    ranges: Ranges<N>,
    wx: [f64; N],
    wy: [f64; N],
}

impl<'a, const N: usize> Found<'a, N> {
    /// The block whose first pixel is `at`; its memory is on its way when this returns.
    #[inline(always)]
    pub fn new(planes: &'a Planes<'a>, at: usize, wx: [f64; N], wy: [f64; N]) -> Self {
        Found {
            planes,
            ranges: planes.ranges::<N>(at),
            wx,
            wy,
        }
    }

    /// The weighted sum.
    #[inline(always)]
    pub fn value(&self, depth: f32, hint: &mut impl Hint) -> f64 {
        // SAFETY: the ranges come from these planes, in `new`.
        unsafe {
            self.planes
                .sum(&self.ranges, (&self.wx, &self.wy), depth, hint)
        }
    }
}

/// A block of pixels that lies in several tiles, or beyond the border.
pub(super) struct Across<'a, const N: usize> {
    planes: [[&'a Planes<'a>; N]; N],
    ranges: Ranges<N>,
    wx: [f64; N],
    wy: [f64; N],
}

impl<'a, const N: usize> Across<'a, N> {
    /// The block whose pixels are at these places in these tiles. Its memory is on its way when this returns.
    #[inline(always)]
    pub fn new(pixels: [[(&'a Planes<'a>, usize); N]; N], (wx, wy): ([f64; N], [f64; N])) -> Self {
        let mut ranges = [[Range { start: 0, end: 0 }; N]; N];
        for (ranges, pixels) in ranges.iter_mut().zip(&pixels) {
            for (range, &(own, at)) in ranges.iter_mut().zip(pixels) {
                if own.pixels > 0 {
                    assert!(at < own.pixels as usize, "a pixel of its tile");
                    let size = if own.kind == Kind::Lattice { 2 } else { 4 };
                    // SAFETY: asserted above.
                    *range = unsafe { own.range(at, size) };
                }
            }
        }
        Across {
            planes: pixels.map(|row| row.map(|(planes, _)| planes)),
            ranges,
            wx,
            wy,
        }
    }

    /// The weighted sum, pixel by pixel.
    #[inline(always)]
    pub fn value(&self, depth: f32) -> f64 {
        let mut total = 0.0;
        for j in 0..N {
            for i in 0..N {
                // SAFETY: the range comes from these planes, in `new`.
                let value = unsafe {
                    self.planes[j][i].sum(
                        &[[self.ranges[j][i]]],
                        (&[1.0], &[1.0]),
                        depth,
                        &mut Search,
                    )
                };
                total += self.wx[i] * self.wy[j] * value;
            }
        }
        total
    }
}

/// Ranges of vertices of a block of pixels.
type Ranges<const N: usize> = [[Range; N]; N];

/// The vertices of one pixel: the first, and behind the last.
#[derive(Clone, Copy)]
struct Range {
    start: u32,
    end: u32,
}

/// Sends for a line of memory.
#[inline(always)]
pub(super) fn prefetch<T>(at: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch changes nothing that the program can see, and no address makes it fail.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(at.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}
