//! The kernel of processors with AVX2. The rest of the library meets it as a value, [`Avx2`], that
//! exists only where the processor has what it needs.

use std::arch::x86_64::*;

use super::descriptor::{Descriptor, Kernel, Stored, Vertices};
use super::kernel::{self, Portable};

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
                    let mut values = [[0.0; 4]; C];
                    interpolate::<C, V>(tile, four, depth, &mut values);
                    for c in 0..C {
                        out[c].as_flattened_mut()[4 * k..4 * k + 4].copy_from_slice(&values[c]);
                    }
                }
            }
        }
        out
    }
}

// All from here on is inlined into functions that are compiled for these features, or it would be
// slow. So there are no closures: they need not be inlined.

/// How many depths of a pixel lie before `depth`.
///
/// # Safety
/// The pixel has less than [`LONGEST`] vertices, 64 bytes from the end of the plane may be read,
/// and the processor has AVX2, BMI2 and POPCNT.
#[inline(always)]
unsafe fn before(z: *const f32, pixel: &Vertices, depth: f32) -> u32 {
    let (mut first, mut len) = (pixel.start as usize, pixel.len as usize);
    // SAFETY: the depths that are read one by one are the pixel's, or the first one of the tile;
    // the sixteen begin at most at the end of the plane.
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
        let low = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(low, depth)) as u32;
        let high = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(high, depth)) as u32;
        // What lies behind the pixel's depths does not count.
        let less = _bzhi_u32(low | high << 8, len as u32);
        first as u32 - pixel.start + less.count_ones()
    }
}

/// The values of four pixels, as stored: [`kernel::value`] in four lanes.
///
/// # Safety
/// As [`before`] and [`kernel::value`]; one value more than the plane of visibilities has may be
/// read.
#[inline(always)]
unsafe fn interpolate<const C: usize, V: Stored>(
    tile: &Descriptor<'_>,
    pixels: &[Vertices; 4],
    depth: f32,
    out: &mut [[f64; 4]; C],
) {
    let z = tile.depths();
    let [p, q, r, s] = pixels;
    // SAFETY: a pair begins inside its plane, and enough may be read behind it; the tile stores
    // `V`, which is u16 or f32; the rest as the caller promises.
    unsafe {
        let next = [
            before(z, p, depth),
            before(z, q, depth),
            before(z, r, depth),
            before(z, s, depth),
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
            z.add(p.start as usize + low[0]),
            z.add(q.start as usize + low[1]),
            z.add(r.start as usize + low[2]),
            z.add(s.start as usize + low[3]),
        ]);
        let depth = _mm256_set1_pd(f64::from(depth));
        let t = _mm256_div_pd(_mm256_sub_pd(depth, z0), _mm256_sub_pd(z1, z0));
        let t = _mm256_and_pd(t, between);
        let one = _mm256_set1_pd(V::one(tile.lattice()).into());
        for (c, out) in out.iter_mut().enumerate() {
            let v = [
                tile.values::<V>(p, c).add(low[0]),
                tile.values::<V>(q, c).add(low[1]),
                tile.values::<V>(r, c).add(low[2]),
                tile.values::<V>(s, c).add(low[3]),
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
