//! Kernels: they evaluate the pixels of a window at one depth.
//!
//! Kernels differ in how they search the vertices. Their values are the same to the last bit: all
//! of them compute in f64, in one order, from vertices that are f32 or k / L.

use std::hint::select_unpredictable;

use super::descriptor::{Descriptor, Kernel, Stored, Vertices};

/// The kernel for every machine. It searches all pixels in lockstep, with the number of steps that
/// the longest pixel needs. A loop with its own end for each pixel would mispredict each end.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Kernel for Portable {
    #[inline(always)]
    unsafe fn stored<const C: usize, const N: usize, V: Stored>(
        &mut self,
        tile: &Descriptor<'_>,
        pixels: &[[Vertices; N]; N],
        depth: f32,
    ) -> [[[f64; N]; N]; C] {
        let z = tile.depths();
        let mut first = pixels.map(|row| row.map(|pixel| pixel.start));
        let mut len = pixels.map(|row| row.map(|pixel| pixel.len));
        let mut longest = *len.as_flattened().iter().max().expect("a pixel");
        // SAFETY: `first` and the `len` depths from it lie inside the pixel's own, or `len` is 0
        // and `first` is that of the tile.
        let before = |at: u32| unsafe { *z.add(at as usize) < depth };
        while longest > 1 {
            longest -= longest / 2;
            for (first, len) in first
                .as_flattened_mut()
                .iter_mut()
                .zip(len.as_flattened_mut())
            {
                let half = *len / 2;
                *first += half & u32::from(before(*first + half)).wrapping_neg();
                *len -= half;
            }
        }
        let mut out = [[[0.0; N]; N]; C];
        for j in 0..N {
            for i in 0..N {
                let first = first[j][i];
                let next = first - pixels[j][i].start + (len[j][i] & u32::from(before(first)));
                // SAFETY: as the caller promises.
                let value = unsafe { value::<C, V>(tile, &pixels[j][i], next, depth) };
                (0..C).for_each(|c| out[c][j][i] = value[c]);
            }
        }
        out
    }
}

/// The segments that the last lookup found; the next search starts there (LV00, section 3.4).
///
/// Keep one cursor for each series of nearby lookups, such as the points along a ray. A cursor
/// never changes an answer. Where the processor has AVX2, lookups without a cursor are faster.
#[derive(Clone, Debug, Default)]
pub struct Cursor {
    /// For each pixel of a lookup, the number of its vertices in front of the depth.
    before: [u32; 32],
    /// Number of pixels that this lookup has evaluated.
    at: usize,
}

impl Cursor {
    /// Starts a lookup, which evaluates at most two windows of 4 x 4 pixels.
    pub(super) fn begin(&mut self) {
        self.at = 0;
    }
}

impl Kernel for Cursor {
    #[inline(always)]
    unsafe fn stored<const C: usize, const N: usize, V: Stored>(
        &mut self,
        tile: &Descriptor<'_>,
        pixels: &[[Vertices; N]; N],
        depth: f32,
    ) -> [[[f64; N]; N]; C] {
        let mut out = [[[0.0; N]; N]; C];
        let before = &mut self.before[self.at..self.at + N * N];
        self.at += N * N;
        for (k, pixel) in pixels.as_flattened().iter().enumerate() {
            let (first, n) = (pixel.start as usize, pixel.len as usize);
            // SAFETY: the vertices of a pixel lie inside those of its tile.
            let z = unsafe { std::slice::from_raw_parts(tile.depths().add(first), n) };
            let at = (before[k] as usize).min(n);
            let is_last = |at: usize| at == n || depth <= z[at];
            let next = match at == 0 || z[at - 1] < depth {
                true if is_last(at) => at,
                true if is_last(at + 1) => at + 1,
                _ => z.partition_point(|&d| d < depth),
            };
            before[k] = next as u32;
            // SAFETY: as the caller promises.
            let value = unsafe { value::<C, V>(tile, pixel, next as u32, depth) };
            (0..C).for_each(|c| out[c][k / N][k % N] = value[c]);
        }
        out
    }
}

/// The value of a pixel, as stored, where `next` of its depths lie before `depth`.
///
/// # Safety
/// As [`Kernel::stored`], and `next` is at most the number of vertices.
#[inline(always)]
pub(super) unsafe fn value<const C: usize, V: Stored>(
    tile: &Descriptor<'_>,
    pixel: &Vertices,
    next: u32,
    depth: f32,
) -> [f64; C] {
    // The depth lies between two vertices, or outside all of them. The code has no branch on the
    // result of the search: a misprediction would delay the next pixel.
    let between = next.wrapping_sub(1) < pixel.len.wrapping_sub(1);
    let high = next.min(pixel.len.saturating_sub(1));
    let [low, high] = [high - u32::from(between), high].map(|k| k as usize);
    let z = tile.depths().wrapping_add(pixel.start as usize);
    // SAFETY: `low` and `high` are vertices of the pixel; or it has none, and they are the first
    // of the tile.
    let [z0, z1] = [low, high].map(|k| f64::from(unsafe { *z.add(k) }));
    let t = (f64::from(depth) - z0) / (z1 - z0);
    let t = f64::from_bits(t.to_bits() & u64::from(between).wrapping_neg());
    std::array::from_fn(|c| {
        let v = tile.values::<V>(pixel, c);
        // SAFETY: as above.
        let [a, b] = [low, high].map(|k| unsafe { *v.add(k) });
        let a: f64 = select_unpredictable(next == 0, V::one(tile.lattice()), a).into();
        a + (b.into() - a) * t
    })
}
