//! Pixels at one depth: where the depth falls among their vertices, and the value there.
//!
//! Kernels differ in how they search. The values are the same to the last bit: all of it is in
//! f64 from vertices that are f32 or k / L, in one order, so that nothing overflows and a lookup is
//! the nearest f32 of the exact answer but for what summing costs.

use std::hint::select_unpredictable;

use super::descriptor::{Descriptor, Stored, Vertices};

/// Evaluates a window of pixels of one tile.
pub(super) trait Kernel {
    /// The values of `C` channels at `depth`, as stored: k of k / L, or f32.
    ///
    /// # Safety
    /// The tile stores `V`, and the vertices come from its tables, for `C` channels or more.
    unsafe fn stored<const C: usize, const N: usize, V: Stored>(
        &mut self,
        tile: &Descriptor<'_>,
        pixels: &[[Vertices; N]; N],
        depth: f32,
    ) -> [[[f64; N]; N]; C];
}

/// The kernel of every machine. It searches all pixels in lockstep, each in as many steps as the
/// longest takes: a loop that ends for each at its own time would be mispredicted for each.
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

/// Where a caller's last lookups found their segments (LV00, section 3.4): coherent lookups begin
/// there.
///
/// Belongs to one strand of lookups that move little, such as neighbouring points of a ray. It
/// never changes an answer. Where the processor has AVX2, lookups without a cursor are faster.
#[derive(Clone, Debug, Default)]
pub struct Cursor {
    /// For each pixel of a lookup: how many of its vertices lay before the depth.
    before: [u32; 32],
    /// Pixels of this lookup that were evaluated.
    at: usize,
}

impl Cursor {
    /// A lookup begins, which evaluates two windows of at most 4 x 4 pixels.
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
    // Between two vertices, or at one: the first or the last. Nothing branches on what the search
    // finds: a wrong guess would keep the next pixel waiting.
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
