//! A plain shadow map with percentage-closer filtering (Reeves, Salesin and Cook 1987), as tight as
//! a competitor would write it.
//!
//! Contiguous boxes have their width as a constant and compare eight texels at a time with AVX2
//! where the processor has it (asked when the program runs), else as the compiler vectorises them.
//! Jittered taps are integer offsets from a table of stratified patterns, one load each, or
//! gathered eight at a time with AVX2. Rows are padded: at a power of two apart they would fall
//! into the same sets of the caches.

use crate::queries::Queries;
use crate::scene::{Dice, Hair};

/// Texels that stand unused behind each row.
const PADDING: usize = 48;

/// Depths, row by row.
#[derive(Debug)]
pub struct Plain {
    /// Texels in a row, and rows.
    pub side: usize,
    stride: usize,
    z: Vec<f32>,
    avx2: bool,
}

/// Taps of jittered lookups: patterns that take turns.
#[derive(Debug)]
pub struct Jitter {
    /// Taps of a lookup.
    pub taps: usize,
    /// Texels from a query that a tap can be away, along x or y.
    reach: usize,
    patterns: Vec<Vec<i32>>,
}

const PATTERNS: usize = 16;

impl Jitter {
    /// `n` x `n` taps over `texels` x `texels` of a map that is `side` wide, one at a random place
    /// in each stratum.
    pub fn new(n: usize, texels: usize, side: usize) -> Self {
        let stride = side + PADDING;
        let mut dice = Dice::new(9);
        let pattern = |_| {
            // The middle of the footprint is anywhere in its texel.
            let (u, v) = (dice.range(0.0, 1.0), dice.range(0.0, 1.0));
            let mut axis = |i: usize, u: f64| {
                let place = (i as f64 + dice.range(0.0, 1.0)) / n as f64 - 0.5;
                (place * texels as f64 + u).floor() as i32
            };
            let mut taps = Vec::new();
            for j in 0..n {
                for i in 0..n {
                    taps.push(axis(j, v) * stride as i32 + axis(i, u));
                }
            }
            taps
        };
        Jitter {
            taps: n * n,
            reach: texels / 2 + 1,
            patterns: (0..PATTERNS).map(pattern).collect(),
        }
    }

    #[inline(always)]
    fn pattern(&self, x: f32, y: f32) -> &[i32] {
        let mixed = x.to_bits() ^ y.to_bits().rotate_left(13);
        let turn = (mixed.wrapping_mul(0x9E37_79B9) >> 28) as usize;
        &self.patterns[turn % PATTERNS]
    }
}

impl Plain {
    /// The depth buffer of a scene with `n` x `n` texels a pixel.
    pub fn of(hair: &Hair, n: u32) -> Self {
        let side = (hair.side * n) as usize;
        Self::padded(side, hair.render(n, side + PADDING))
    }

    /// The top left corner of another map, or all of it if it is smaller.
    pub fn corner(of: &Plain, side: usize) -> Self {
        let side = side.min(of.side);
        let stride = side + PADDING;
        let mut z = vec![0.0; side * stride];
        for (to, from) in z.chunks_mut(stride).zip(of.z.chunks(of.stride)) {
            to[..side].copy_from_slice(&from[..side]);
        }
        Self::padded(side, z)
    }

    fn padded(side: usize, z: Vec<f32>) -> Self {
        let stride = side + PADDING;
        assert_eq!(z.len(), side * stride, "a square of depths");
        #[cfg(target_arch = "x86_64")]
        let avx2 = std::arch::is_x86_feature_detected!("avx2");
        #[cfg(not(target_arch = "x86_64"))]
        let avx2 = false;
        Plain {
            side,
            stride,
            z,
            avx2,
        }
    }

    /// One depth.
    pub fn depth(&self, x: usize, y: usize) -> f32 {
        self.z[y * self.stride + x]
    }

    /// Bytes of the depths, padding left out.
    pub fn bytes(&self) -> usize {
        4 * self.side * self.side
    }

    /// The instructions that boxes use here.
    pub fn features(&self) -> &'static str {
        if self.avx2 {
            "AVX2"
        } else {
            "the compile target's own"
        }
    }

    /// Sum of box-filtered visibilities over `W` x `W` texels. Queries are in texels, at least W/2
    /// + 1 from the border.
    pub fn sum_boxes<const W: usize>(&self, queries: &Queries) -> f32 {
        #[cfg(target_arch = "x86_64")]
        if self.avx2 {
            // SAFETY: the processor was asked for AVX2 when the map was made.
            return unsafe { self.sum_boxes_avx2::<W>(queries) };
        }
        self.sum_boxes_with::<W>(queries, |texels, z| count_box::<W>(texels, self.stride, z))
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn sum_boxes_avx2<const W: usize>(&self, queries: &Queries) -> f32 {
        self.sum_boxes_with::<W>(queries, |texels, z| {
            count_box_avx2::<W>(texels, self.stride, z)
        })
    }

    #[inline(always)]
    fn sum_boxes_with<const W: usize>(
        &self,
        queries: &Queries,
        count: impl Fn(&[f32], f32) -> u32,
    ) -> f32 {
        let scale = 1.0 / (W * W) as f32;
        let mut sum = 0.0;
        for (x, y, z) in queries.iter() {
            sum += count(self.texels::<W>(x, y), z) as f32 * scale;
        }
        sum
    }

    /// The texels from the first to the last of a box.
    #[inline(always)]
    fn texels<const W: usize>(&self, x: f32, y: f32) -> &[f32] {
        let (x, y) = ((x + 0.5) as usize - W / 2, (y + 0.5) as usize - W / 2);
        let first = y * self.stride + x;
        &self.z[first..first + (W - 1) * self.stride + W]
    }

    /// One box lookup, as [`Plain::sum_boxes`].
    pub fn box_at<const W: usize>(&self, x: f32, y: f32, z: f32) -> f32 {
        count_box::<W>(self.texels::<W>(x, y), self.stride, z) as f32 / (W * W) as f32
    }

    /// Where the taps of a query start; inside the map with all of them.
    #[inline(always)]
    fn middle(&self, jitter: &Jitter, x: f32, y: f32) -> usize {
        let (x, y) = (x as usize, y as usize);
        let inside = jitter.reach..self.side - jitter.reach;
        assert!(inside.contains(&x) && inside.contains(&y), "inside the map");
        y * self.stride + x
    }

    /// Sum of jittered lookups, one load a tap. Queries are in texels.
    pub fn sum_jittered(&self, jitter: &Jitter, queries: &Queries) -> f32 {
        let scale = 1.0 / jitter.taps as f32;
        let at = |(x, y, z): (f32, f32, f32)| self.count_jittered(jitter, x, y, z) as f32 * scale;
        queries.iter().map(at).sum()
    }

    /// Taps of one jittered lookup that are lit.
    #[inline(always)]
    pub fn count_jittered(&self, jitter: &Jitter, x: f32, y: f32, z: f32) -> u32 {
        let middle = self.middle(jitter, x, y) as i32;
        let mut lit = [0u32; 4];
        for four in jitter.pattern(x, y).chunks_exact(4) {
            for (lit, offset) in lit.iter_mut().zip(four) {
                // SAFETY: `middle` checked that the query is at least `reach` from every border; a
                // tap is at most `reach` away along x and y, and offsets were made for maps of this
                // side.
                let depth = unsafe { *self.z.get_unchecked((middle + offset) as usize) };
                *lit += u32::from(depth >= z);
            }
        }
        lit.iter().sum()
    }

    /// [`Plain::sum_jittered`] with eight taps a load; `None` without AVX2.
    pub fn sum_gathered(&self, jitter: &Jitter, queries: &Queries) -> Option<f32> {
        #[cfg(target_arch = "x86_64")]
        if self.avx2 {
            // SAFETY: the processor was asked for AVX2 when the map was made.
            return Some(unsafe { self.sum_gathered_avx2(jitter, queries) });
        }
        let _ = (jitter, queries);
        None
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn sum_gathered_avx2(&self, jitter: &Jitter, queries: &Queries) -> f32 {
        use std::arch::x86_64::*;
        let scale = 1.0 / jitter.taps as f32;
        let mut sum = 0.0;
        for (x, y, z) in queries.iter() {
            let middle = self.middle(jitter, x, y);
            let depth = _mm256_set1_ps(z);
            let mut lit = _mm256_setzero_si256();
            for eight in jitter.pattern(x, y).chunks_exact(8) {
                // SAFETY: eight offsets are read from a chunk of eight; the texels are inside the
                // map as in `count_jittered`.
                let near = unsafe {
                    let offsets = _mm256_loadu_si256(eight.as_ptr().cast());
                    _mm256_i32gather_ps::<4>(self.z.as_ptr().add(middle), offsets)
                };
                let mask = _mm256_cmp_ps::<_CMP_GE_OQ>(near, depth);
                lit = _mm256_sub_epi32(lit, _mm256_castps_si256(mask));
            }
            let mut lanes = [0u32; 8];
            // SAFETY: 32 bytes are written to an array of 32 bytes.
            unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), lit) };
            sum += lanes.iter().sum::<u32>() as f32 * scale;
        }
        sum
    }
}

/// Texels of `W` rows of `W`, `stride` apart, that are lit at depth `z`.
#[inline(always)]
fn count_box<const W: usize>(texels: &[f32], stride: usize, z: f32) -> u32 {
    let mut lanes = [0u32; W];
    for row in texels.chunks(stride).take(W) {
        for (lane, depth) in lanes.iter_mut().zip(&row[..W]) {
            *lane += u32::from(*depth >= z);
        }
    }
    lanes.iter().sum()
}

/// [`count_box`] with eight compares at a time.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
#[inline]
fn count_box_avx2<const W: usize>(texels: &[f32], stride: usize, z: f32) -> u32 {
    use std::arch::x86_64::*;
    if !W.is_multiple_of(8) {
        return count_box::<W>(texels, stride, z);
    }
    assert!(texels.len() >= (W - 1) * stride + W, "all rows");
    let depth = _mm256_set1_ps(z);
    let mut lit = [_mm256_setzero_si256(); 2];
    for row in 0..W {
        for i in 0..W / 8 {
            let at = row * stride + 8 * i;
            // SAFETY: `at + 8` is at most `(W - 1) * stride + W`, which was compared with the
            // length.
            let near = unsafe { _mm256_loadu_ps(texels.as_ptr().add(at)) };
            let mask = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_GE_OQ>(near, depth));
            lit[i % 2] = _mm256_sub_epi32(lit[i % 2], mask);
        }
    }
    let mut lanes = [0u32; 8];
    // SAFETY: 32 bytes are written to an array of 32 bytes.
    unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), _mm256_add_epi32(lit[0], lit[1])) };
    lanes.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::queries::Access;

    fn random_map() -> Plain {
        let mut dice = Dice::new(4);
        {
            let texels = 256 * (256 + PADDING);
            Plain::padded(
                256,
                (0..texels).map(|_| dice.range(1.0, 2.0) as f32).collect(),
            )
        }
    }

    #[test]
    fn a_box_counts_the_lit_texels_around_a_point() {
        let map = random_map();
        let queries = Queries::new(Access::Random, 300, (256, 256), 40.0, (1.0, 2.0));
        let mut sum = 0.0;
        for (x, y, z) in queries.iter() {
            let (x0, y0) = ((x + 0.5) as usize - 8, (y + 0.5) as usize - 8);
            let cells = (0..256).map(|i| map.depth(x0 + i % 16, y0 + i / 16));
            let slow = cells.filter(|&d| d >= z).count() as f32 / 256.0;
            assert_eq!(map.box_at::<16>(x, y, z), slow);
            sum += slow;
        }
        assert!((map.sum_boxes::<16>(&queries) - sum).abs() < 1e-3);
    }

    #[test]
    fn gathered_taps_are_the_taps_one_by_one() {
        let map = random_map();
        let queries = Queries::new(Access::Random, 300, (256, 256), 40.0, (1.0, 2.0));
        let jitter = Jitter::new(16, 64, 256);
        if let Some(gathered) = map.sum_gathered(&jitter, &queries) {
            assert_eq!(gathered, map.sum_jittered(&jitter, &queries));
        }
    }

    #[test]
    fn jittered_taps_stay_within_the_footprint() {
        let jitter = Jitter::new(8, 64, 1000);
        for offset in jitter.patterns.iter().flatten() {
            let stride = 1000 + PADDING as i32;
            let y = (offset + 500).div_euclid(stride);
            let x = offset - stride * y;
            assert!(x.abs() <= 33 && y.abs() <= 33, "{x} {y}");
        }
    }
}
