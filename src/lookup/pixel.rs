//! One pixel at one depth: the innermost arithmetic of every lookup.
//!
//! All of it is in f64 from vertices that are f32 or k / L, so that nothing overflows and the result is the nearest f32 of the exact one but for
//! what summing costs. `spec/semantics.md`, section 3, is the law.

use std::hint::select_unpredictable;

use crate::cache::Content;
use crate::format::tile::{Values, View};

/// Where a caller's last lookups found their segments (LV00, section 3.4): coherent lookups begin there.
///
/// Belongs to one strand of lookups that move little, such as neighbouring points of a ray. It speeds up what it fits and never changes
/// an answer. On coherent lookups it saves a third to a half of the time; on random ones it costs.
#[derive(Clone, Debug, Default)]
pub struct Cursor {
    /// For each of the first pixels of a footprint: how many of its vertices lay before the depth.
    pub(super) before: [u32; 16],
}

/// Where to look first.
pub(super) trait Hint {
    /// How many of the depths `z`, which are sorted, are less than `depth`.
    fn before(&mut self, tap: usize, z: &[f32], depth: f32) -> usize;
}

/// No hint.
pub(super) struct Search;

impl Hint for Search {
    #[inline(always)]
    fn before(&mut self, _: usize, z: &[f32], depth: f32) -> usize {
        z.partition_point(|&d| d < depth)
    }
}

impl Hint for Cursor {
    #[inline(always)]
    fn before(&mut self, tap: usize, z: &[f32], depth: f32) -> usize {
        let Some(last) = self.before.get_mut(tap) else {
            return z.partition_point(|&d| d < depth);
        };
        let at = (*last as usize).min(z.len());
        let found = match (
            at == 0 || z[at - 1] < depth,
            at == z.len() || depth <= z[at],
        ) {
            (true, true) => at,
            (true, false) if at + 1 == z.len() || depth <= z[at + 1] => at + 1,
            _ => z.partition_point(|&d| d < depth),
        };
        *last = found as u32;
        found
    }
}

/// Vertices of the pixels of a block: first, and behind the last.
type Ranges<const N: usize> = [[[usize; 2]; N]; N];

/// Weighted sum over a block of `N` x `N` pixels of one tile: `at` is its first pixel.
#[inline(always)]
pub(super) fn block<const C: usize, const N: usize>(
    content: &Content,
    at: usize,
    weights: (&[f64; N], &[f64; N]),
    depth: f32,
    hint: &mut impl Hint,
) -> [f64; C] {
    match content {
        Content::Planes(tile) => {
            let view = tile.view();
            let stride = tile.width() as usize;
            let ranges = ranges::<N>(view, at, stride);
            match view.v {
                Values::Lattice(v) => {
                    let one = f64::from(tile.lattice());
                    let sums = sum(view, v, one, ranges, weights, depth, hint);
                    let unit = 1.0 / one;
                    colours(view, v, one, (at, stride), sums, weights, depth).map(|sum| sum * unit)
                }
                Values::F32(v) => {
                    let sums = sum(view, v, 1.0, ranges, weights, depth, hint);
                    colours(view, v, 1.0, (at, stride), sums, weights, depth)
                }
            }
        }
        other => [flat(other, depth); C],
    }
}

/// Sends for the memory that [`block`] will read.
#[inline(always)]
pub(super) fn send_for<const N: usize>(content: &Content, at: usize) {
    if let Content::Planes(tile) = content {
        ranges::<N>(tile.view(), at, tile.width() as usize);
    }
}

/// Sends for the entry of the table of vertices that [`send_for`] will read.
#[inline(always)]
pub(super) fn send_for_table(content: &Content, at: usize) {
    if let Content::Planes(tile) = content {
        prefetch(tile.view().vertex.as_ptr().wrapping_add(at));
    }
}

/// Where the vertices of a block's pixels are; their memory is on its way when this returns.
#[inline(always)]
fn ranges<const N: usize>(view: &View<'_>, at: usize, stride: usize) -> Ranges<N> {
    std::array::from_fn(|j| {
        let row = &view.vertex[at + j * stride..][..N + 1];
        std::array::from_fn(|i| {
            let (start, end) = (row[i] as usize, row[i + 1] as usize);
            let middle = (start + end) / 2;
            prefetch(view.z.as_ptr().wrapping_add(middle));
            match view.v {
                Values::Lattice(v) => prefetch(v.as_ptr().wrapping_add(middle)),
                Values::F32(v) => prefetch(v.as_ptr().wrapping_add(middle)),
            }
            [start, end]
        })
    })
}

/// Sends for a line of memory.
#[inline(always)]
fn prefetch<T>(at: *const T) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: a prefetch changes nothing that the program can see, and no address makes it fail.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(at.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

/// The value of a tile whose pixels are all the same.
#[inline(always)]
fn flat(content: &Content, depth: f32) -> f64 {
    match content {
        Content::Constant(z, v) if depth > *z => f64::from(*v),
        _ => 1.0,
    }
}

/// Where a depth falls among the vertices of a pixel: the two around it, how far it is on the way, and whether it is in front
/// of the first.
///
/// Nothing branches on what the search finds: that is as good as random, and a wrong guess would keep the next pixel waiting.
#[derive(Clone, Copy)]
struct Segment {
    low: usize,
    high: usize,
    t: f64,
    in_front: bool,
}

#[inline(always)]
fn segment(z: &[f32], next: usize, depth: f32) -> Segment {
    let (low, high) = (next.saturating_sub(1), next.min(z.len() - 1));
    let (z0, z1) = (f64::from(z[low]), f64::from(z[high]));
    let t = (f64::from(depth) - z0) / (z1 - z0);
    Segment {
        low,
        high,
        t: select_unpredictable(low == high, 0.0, t),
        in_front: next == 0,
    }
}

/// The value of one channel, whose vertices are `v`.
#[inline(always)]
fn value<V: Copy + Into<f64>>(v: &[V], one: f64, at: &Segment) -> f64 {
    let (a, b): (f64, f64) = (v[at.low].into(), v[at.high].into());
    let a = select_unpredictable(at.in_front, one, a);
    a + (b - a) * at.t
}

/// The weighted sum of the first channel.
#[inline(always)]
fn sum<const N: usize, V: Copy + Into<f64>>(
    view: &View<'_>,
    v: &[V],
    one: f64,
    ranges: Ranges<N>,
    (wx, wy): (&[f64; N], &[f64; N]),
    depth: f32,
    hint: &mut impl Hint,
) -> f64 {
    let mut total = 0.0;
    for (j, (row, wy)) in ranges.iter().zip(wy).enumerate() {
        for (i, (&[start, end], wx)) in row.iter().zip(wx).enumerate() {
            let z = &view.z[start..end];
            if z.is_empty() {
                total += wx * wy * one;
                continue;
            }
            let next = hint.before(j * N + i, z, depth);
            total += wx * wy * value(&v[start..end], one, &segment(z, next, depth));
        }
    }
    total
}

/// All channels, of which `first` is the first.
#[inline(always)]
fn colours<const C: usize, const N: usize, V: Copy + Into<f64>>(
    view: &View<'_>,
    v: &[V],
    one: f64,
    (at, stride): (usize, usize),
    first: f64,
    (wx, wy): (&[f64; N], &[f64; N]),
    depth: f32,
) -> [f64; C] {
    let mut total = [first; C];
    if C == 1 || view.colour.is_empty() {
        return total;
    }
    let n = view.z.len();
    let coloured = (v.len() - n) / 2;
    total[1..].fill(0.0);
    for (j, wy) in wy.iter().enumerate() {
        for (i, wx) in wx.iter().enumerate() {
            let pixel = at + j * stride + i;
            let [start, end] = [0, 1].map(|k| view.vertex[pixel + k] as usize);
            let [from, to] = [0, 1].map(|k| view.colour[pixel + k] as usize);
            let z = &view.z[start..end];
            if z.is_empty() {
                total[1..].iter_mut().for_each(|sum| *sum += wx * wy * one);
                continue;
            }
            let at = segment(z, z.partition_point(|&d| d < depth), depth);
            for (c, total) in total[1..].iter_mut().enumerate() {
                let own = if from < to {
                    &v[n + c * coloured..][from..to]
                } else {
                    &v[start..end]
                };
                *total += wx * wy * value(own, one, &at);
            }
        }
    }
    total
}

/// First and last depth of a pixel's vertices.
pub(super) fn depth_range(content: &Content, at: usize) -> Option<[f32; 2]> {
    match content {
        Content::Planes(tile) => {
            let view = tile.view();
            let z = &view.z[view.vertex[at] as usize..view.vertex[at + 1] as usize];
            Some([*z.first()?, *z.last()?])
        }
        Content::Constant(z, _) => Some([*z; 2]),
        _ => None,
    }
}
