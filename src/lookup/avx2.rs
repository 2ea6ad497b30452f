//! The kernel of processors with AVX2. It searches by two halvings and one comparison of 16 depths,
//! and interpolates four pixels at once.

use std::arch::x86_64::*;

use super::descriptor::{Stored, Vertices, value};

/// The longest pixel whose depths two halvings leave at most 16 of.
const LONGEST: u32 = 64;

/// Whether the pixels are short enough for this kernel.
#[inline(always)]
pub(super) fn are_short<const C: usize>(pixels: &[Vertices<C>]) -> bool {
    let mut longest = 0;
    for pixel in pixels {
        longest |= pixel.len;
    }
    longest < LONGEST
}

/// As [`Kernel::stored`](super::descriptor::Kernel::stored).
///
/// # Safety
/// As there; the pixels are padded and [short](are_short), and
/// [the processor](crate::format::wide::has_avx2) has what the kernel needs.
#[inline(always)]
pub(super) unsafe fn stored<const C: usize, const N: usize, V: Stored>(
    pixels: &[[Vertices<C>; N]; N],
    one: V,
    depth: f32,
) -> [[[f64; N]; N]; C] {
    let all = pixels.as_flattened();
    let mut out = [[[0.0; N]; N]; C];
    // SAFETY: as the caller promises.
    unsafe {
        if N == 1 {
            let next = before(&all[0], depth);
            let value = value(&all[0], next, one, depth);
            for c in 0..C {
                out[c][0][0] = value[c];
            }
        } else {
            for (k, four) in all.as_chunks::<4>().0.iter().enumerate() {
                let mut values = [[0.0; 4]; C];
                interpolate(four, one, depth, &mut values);
                for c in 0..C {
                    out[c].as_flattened_mut()[4 * k..4 * k + 4].copy_from_slice(&values[c]);
                }
            }
        }
    }
    out
}

/// How many depths of a pixel lie before `depth`.
///
/// # Safety
/// The pixel has less than [`LONGEST`] vertices, 64 bytes from the end of its depths may be read,
/// and the processor has AVX2, BMI2 and POPCNT.
#[inline(always)]
unsafe fn before<const C: usize>(pixel: &Vertices<C>, depth: f32) -> u32 {
    let (mut first, mut len) = (0, pixel.len as usize);
    let z = pixel.z;
    // SAFETY: the depths that are read one by one are the pixel's, or the first one behind; the
    // sixteen begin at most at the end of its own.
    unsafe {
        for _ in 0..2 {
            let half = len / 2;
            let less = *z.add(first + half) < depth;
            first += half & usize::from(less).wrapping_neg();
            len -= half;
        }
        let depth = _mm256_set1_ps(depth);
        let (low, high) = (
            _mm256_loadu_ps(z.add(first)),
            _mm256_loadu_ps(z.add(first + 8)),
        );
        // Four bits for each depth: of masks with one bit, compilers make longer code.
        let low = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(low, depth));
        let high = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(high, depth));
        let low = u64::from(_mm256_movemask_epi8(low) as u32);
        let high = u64::from(_mm256_movemask_epi8(high) as u32);
        // What lies behind the pixel's depths does not count.
        let less = _bzhi_u64(low | high << 32, 4 * len as u32);
        first as u32 + less.count_ones() / 4
    }
}

/// The values of four pixels, as stored: [`value`] in four lanes.
///
/// # Safety
/// As [`before`] and [`value`]; 8 bytes from the end of the visibilities may be read.
#[inline(always)]
unsafe fn interpolate<const C: usize, V: Stored>(
    pixels: &[Vertices<C>; 4],
    one: V,
    depth: f32,
    out: &mut [[f64; 4]; C],
) {
    let [p, q, r, s] = pixels;
    // SAFETY: a pair begins at most at the end of its plane, and enough may be read behind it; `V`
    // is u16 or f32; the rest as the caller promises.
    unsafe {
        let next = [
            before(p, depth),
            before(q, depth),
            before(r, depth),
            before(s, depth),
        ];
        let n = lanes(next);
        let none = _mm_cmpeq_epi32(n, _mm_setzero_si128());
        let inside = _mm_cmpgt_epi32(lanes([p.len, q.len, r.len, s.len]), n);
        let between = _mm_andnot_si128(none, inside);
        let between = _mm256_castsi256_pd(_mm256_cvtepi32_epi64(between));
        let none = _mm256_castsi256_pd(_mm256_cvtepi32_epi64(none));
        // The last vertex before the depth, or the first. The one behind it is read along: where
        // it belongs to nobody, the depth is not between two vertices.
        let mut low = [0; 4];
        for k in 0..4 {
            low[k] = (next[k] - u32::from(next[k] != 0)) as usize;
        }
        let (z0, z1) = pairs([
            p.z.add(low[0]),
            q.z.add(low[1]),
            r.z.add(low[2]),
            s.z.add(low[3]),
        ]);
        let depth = _mm256_set1_pd(f64::from(depth));
        let t = _mm256_div_pd(_mm256_sub_pd(depth, z0), _mm256_sub_pd(z1, z0));
        let t = _mm256_and_pd(t, between);
        let one = _mm256_set1_pd(one.into());
        for (c, out) in out.iter_mut().enumerate() {
            let v = [
                p.v[c].cast::<V>().add(low[0]),
                q.v[c].cast::<V>().add(low[1]),
                r.v[c].cast::<V>().add(low[2]),
                s.v[c].cast::<V>().add(low[3]),
            ];
            let (a, b) = if size_of::<V>() == 2 {
                let pairs = lanes([
                    v[0].cast::<u32>().read_unaligned(),
                    v[1].cast::<u32>().read_unaligned(),
                    v[2].cast::<u32>().read_unaligned(),
                    v[3].cast::<u32>().read_unaligned(),
                ]);
                let low = _mm_and_si128(pairs, _mm_set1_epi32(0xFFFF));
                let high = _mm_srli_epi32::<16>(pairs);
                (_mm256_cvtepi32_pd(low), _mm256_cvtepi32_pd(high))
            } else {
                let (low, high) = pairs([v[0].cast(), v[1].cast(), v[2].cast(), v[3].cast()]);
                // Outside a segment `high` may be NaN, and 0 times NaN is NaN.
                (low, _mm256_blendv_pd(low, high, between))
            };
            let a = _mm256_blendv_pd(a, one, none);
            let value = _mm256_add_pd(a, _mm256_mul_pd(_mm256_sub_pd(b, a), t));
            _mm256_storeu_pd(out.as_mut_ptr(), value);
        }
    }
}

/// Four lanes.
#[inline(always)]
fn lanes(v: [u32; 4]) -> __m128i {
    // SAFETY: SSE2 is part of x86-64.
    unsafe { _mm_set_epi32(v[3] as i32, v[2] as i32, v[1] as i32, v[0] as i32) }
}

/// Two neighbours at each of four places.
///
/// # Safety
/// They may be read, and the processor has AVX2.
#[inline(always)]
unsafe fn pairs(at: [*const f32; 4]) -> (__m256d, __m256d) {
    // SAFETY: as the caller promises.
    unsafe {
        let ab = _mm_loadh_pd(_mm_load_sd(at[0].cast()), at[1].cast());
        let cd = _mm_loadh_pd(_mm_load_sd(at[2].cast()), at[3].cast());
        let (ab, cd) = (_mm_castpd_ps(ab), _mm_castpd_ps(cd));
        let first = _mm_shuffle_ps::<0b10_00_10_00>(ab, cd);
        let second = _mm_shuffle_ps::<0b11_01_11_01>(ab, cd);
        (_mm256_cvtps_pd(first), _mm256_cvtps_pd(second))
    }
}
