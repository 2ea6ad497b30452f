//! The kernel of processors with AVX2. The rest of the library meets it as a value, [`Avx2`], that
//! exists only where the processor has what it needs.

use std::arch::x86_64::*;

use super::descriptor::{Descriptor, Stored, Vertices};
use super::kernel::{self, Kernel, Portable};

/// The longest pixel whose depths two halvings leave at most 16 of.
const LONGEST: u32 = 64;

/// Searches by two halvings and one comparison of 16 depths; interpolates four pixels at once.
#[derive(Clone, Copy)]
pub(super) struct Avx2(());

impl Avx2 {
    /// The kernel, if this processor has what it needs: what [`lookup`](super::sampler) and
    /// [`batch`](super::batch) are compiled for a second time.
    pub fn new() -> Option<Self> {
        let there = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt");
        there.then_some(Avx2(()))
    }
}

impl Kernel for Avx2 {
    #[inline(always)]
    unsafe fn stored<const C: usize, const N: usize, V: Stored>(
        &mut self,
        tile: &Descriptor<'_>,
        pixels: &[[Vertices; N]; N],
        depth: f32,
    ) -> [[[f64; N]; N]; C] {
        let all = pixels.as_flattened();
        let longest = all.iter().fold(0, |any, pixel| any | pixel.len);
        if !tile.is_padded() || longest >= LONGEST {
            // SAFETY: as the caller promises.
            return unsafe { Portable.stored::<C, N, V>(tile, pixels, depth) };
        }
        let mut out = [[[0.0; N]; N]; C];
        // SAFETY: this value proves that the processor has AVX2; the tile is padded and the pixels
        // short, as asked above; the rest as the caller promises.
        unsafe {
            if N == 1 {
                let next = before(tile.depths(), &all[0], depth);
                let value = kernel::value::<C, V>(tile, &all[0], next, depth);
                (0..C).for_each(|c| out[c][0][0] = value[c]);
            } else {
                for (k, four) in all.as_chunks::<4>().0.iter().enumerate() {
                    let values = interpolated::<C, V>(tile, four, depth);
                    for c in 0..C {
                        let four = &mut out[c].as_flattened_mut()[4 * k..4 * k + 4];
                        _mm256_storeu_pd(four.as_mut_ptr(), values[c]);
                    }
                }
            }
        }
        out
    }
}

/// How many depths of a pixel lie before `depth`.
///
/// # Safety
/// The pixel has less than [`LONGEST`] vertices, and 64 bytes from the end of the plane may be read.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn before(z: *const f32, pixel: &Vertices, depth: f32) -> u32 {
    let (mut first, mut len) = (pixel.start, pixel.len);
    for _ in 0..2 {
        let half = len / 2;
        // SAFETY: inside the pixel's depths, or the first one of the tile.
        let less = unsafe { *z.add((first + half) as usize) } < depth;
        first += half & u32::from(less).wrapping_neg();
        len -= half;
    }
    // SAFETY: `first` is at most the end of the plane, and 64 bytes from there may be read.
    let [low, high] = [0, 8].map(|k| unsafe {
        let sixteen = _mm256_loadu_ps(z.add(first as usize + k));
        let less = _mm256_cmp_ps::<_CMP_LT_OQ>(sixteen, _mm256_set1_ps(depth));
        _mm256_movemask_ps(less) as u32
    });
    // What lies behind the pixel's depths does not count.
    let less = (low | high << 8) & ((1 << len) - 1);
    first - pixel.start + less.count_ones()
}

/// The values of four pixels, as stored: [`kernel::value`] in four lanes.
///
/// # Safety
/// As [`before`] and [`kernel::value`]; one value more than the plane of visibilities has may be read.
#[inline]
#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
unsafe fn interpolated<const C: usize, V: Stored>(
    tile: &Descriptor<'_>,
    pixels: &[Vertices; 4],
    depth: f32,
) -> [__m256d; C] {
    let z = tile.depths();
    // SAFETY: as the caller promises.
    let next = pixels.map(|pixel| unsafe { before(z, &pixel, depth) });
    let lanes = |v: [u32; 4]| _mm_set_epi32(v[3] as i32, v[2] as i32, v[1] as i32, v[0] as i32);
    let mask = |m: __m128i| _mm256_castsi256_pd(_mm256_cvtepi32_epi64(m));
    let (n, ends) = (lanes(next), lanes(pixels.map(|pixel| pixel.len)));
    let none = _mm_cmpeq_epi32(n, _mm_setzero_si128());
    let between = mask(_mm_andnot_si128(none, _mm_cmpgt_epi32(ends, n)));
    let none = mask(none);
    // The last vertex before the depth, or the first. The one behind it is read along: where it
    // belongs to nobody, the depth is not between two vertices.
    let low = next.map(|next| (next - u32::from(next != 0)) as usize);
    let pair = |k: usize| z.wrapping_add(pixels[k].start as usize + low[k]);
    // SAFETY: a pair begins inside the plane, and the next 64 bytes may be read.
    let [ab, cd] = [0, 2].map(|k| unsafe {
        let first = _mm_load_sd(pair(k).cast());
        _mm_castpd_ps(_mm_loadh_pd(first, pair(k + 1).cast()))
    });
    let z0 = _mm256_cvtps_pd(_mm_shuffle_ps::<0b10_00_10_00>(ab, cd));
    let z1 = _mm256_cvtps_pd(_mm_shuffle_ps::<0b11_01_11_01>(ab, cd));
    let depth = _mm256_set1_pd(f64::from(depth));
    let t = _mm256_div_pd(_mm256_sub_pd(depth, z0), _mm256_sub_pd(z1, z0));
    let t = _mm256_and_pd(t, between);
    let one = _mm256_set1_pd(V::one(tile.lattice()).into());
    std::array::from_fn(|c| {
        let pair = |k: usize| tile.values::<V>(&pixels[k], c).wrapping_add(low[k]);
        // SAFETY: a pair begins inside the plane, and one value more may be read; all values have
        // the type that is asked for.
        let (a, b) = unsafe {
            if size_of::<V>() == 2 {
                let four = [0, 1, 2, 3].map(|k| pair(k).cast::<u32>().read_unaligned());
                let four = lanes(four);
                let low = _mm_and_si128(four, _mm_set1_epi32(0xFFFF));
                let high = _mm_srli_epi32::<16>(four);
                (_mm256_cvtepi32_pd(low), _mm256_cvtepi32_pd(high))
            } else {
                let [ab, cd] = [0, 2].map(|k| {
                    let first = _mm_load_sd(pair(k).cast());
                    _mm_castpd_ps(_mm_loadh_pd(first, pair(k + 1).cast()))
                });
                let low = _mm256_cvtps_pd(_mm_shuffle_ps::<0b10_00_10_00>(ab, cd));
                let high = _mm256_cvtps_pd(_mm_shuffle_ps::<0b11_01_11_01>(ab, cd));
                // What is not between may be no number, and 0 times that is none either.
                (low, _mm256_blendv_pd(low, high, between))
            }
        };
        let a = _mm256_blendv_pd(a, one, none);
        _mm256_add_pd(a, _mm256_mul_pd(_mm256_sub_pd(b, a), t))
    })
}
