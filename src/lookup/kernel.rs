//! Kernels: they evaluate the pixels of a window at one depth.
//!
//! Kernels differ in how they search the vertices. Their values are the same to the last bit: all
//! of them compute in f64, in one order, from vertices that are f32 or k / L.

#[cfg(target_arch = "x86_64")]
use super::avx2;
use super::descriptor::{Kernel, Stored, Vertices, value};
use crate::format::wide::has_avx2;

// All here is inlined into functions that are compiled for AVX2, or it would be slow. So there are
// no closures on the way of a lookup: they need not be inlined.

/// The kernel of this processor, or the one for every machine.
///
/// The latter searches all pixels in lockstep, with the number of steps that the longest pixel
/// needs. A loop with its own end for each pixel would mispredict each end.
#[derive(Clone, Copy)]
pub(super) struct Native {
    avx2: bool,
}

impl Native {
    /// The kernel for every machine.
    pub const PORTABLE: Native = Native { avx2: false };

    pub fn new() -> Self {
        Native { avx2: has_avx2() }
    }

    /// Whether it is that of a processor with AVX2.
    #[inline(always)]
    pub fn has_avx2(self) -> bool {
        self.avx2
    }
}

impl Kernel for Native {
    #[inline(always)]
    unsafe fn stored<const C: usize, const N: usize, V: Stored>(
        &mut self,
        pixels: &[[Vertices<C>; N]; N],
        padded: bool,
        one: V,
        depth: f32,
    ) -> [[[f64; N]; N]; C] {
        #[cfg(target_arch = "x86_64")]
        if self.avx2 && padded && avx2::are_short(pixels.as_flattened()) {
            // SAFETY: just asked for; the rest as the caller promises.
            return unsafe { avx2::stored(pixels, one, depth) };
        }
        let (mut first, mut len) = ([[0; N]; N], [[0; N]; N]);
        let mut longest = 0;
        for k in 0..N * N {
            len[k / N][k % N] = pixels[k / N][k % N].len;
            longest = longest.max(len[k / N][k % N]);
        }
        // SAFETY: `first` and the `len` depths from it lie inside the pixel's own, or `len` is 0
        // and one may be read.
        let before = |pixel: &Vertices<C>, at: u32| unsafe { *pixel.z.add(at as usize) < depth };
        while longest > 1 {
            longest -= longest / 2;
            for j in 0..N {
                for i in 0..N {
                    let half = len[j][i] / 2;
                    let less = before(&pixels[j][i], first[j][i] + half);
                    first[j][i] += half & u32::from(less).wrapping_neg();
                    len[j][i] -= half;
                }
            }
        }
        let mut out = [[[0.0; N]; N]; C];
        for j in 0..N {
            for i in 0..N {
                let (pixel, first) = (&pixels[j][i], first[j][i]);
                let next = first + (len[j][i] & u32::from(before(pixel, first)));
                // SAFETY: as the caller promises.
                let value = unsafe { value(pixel, next, one, depth) };
                (0..C).for_each(|c| out[c][j][i] = value[c]);
            }
        }
        out
    }
}

/// The segments that the last lookup found; the next search starts there (LV00, section 3.4).
///
/// Keep one cursor for each series of nearby lookups, such as the points along a ray. A cursor
/// never changes an answer. Where the processor has AVX2, searches are as fast without it, and
/// lookups leave it alone.
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
        pixels: &[[Vertices<C>; N]; N],
        _padded: bool,
        one: V,
        depth: f32,
    ) -> [[[f64; N]; N]; C] {
        let mut out = [[[0.0; N]; N]; C];
        let before = &mut self.before[self.at..self.at + N * N];
        self.at += N * N;
        for (k, pixel) in pixels.as_flattened().iter().enumerate() {
            let n = pixel.len as usize;
            // SAFETY: these are the depths of the pixel.
            let z = unsafe { std::slice::from_raw_parts(pixel.z, n) };
            let at = (before[k] as usize).min(n);
            let is_last = |at: usize| at == n || depth <= z[at];
            let next = match at == 0 || z[at - 1] < depth {
                true if is_last(at) => at,
                true if is_last(at + 1) => at + 1,
                _ => z.partition_point(|&d| d < depth),
            };
            before[k] = next as u32;
            // SAFETY: as the caller promises.
            let value = unsafe { value(pixel, next as u32, one, depth) };
            (0..C).for_each(|c| out[c][k / N][k % N] = value[c]);
        }
        out
    }
}
