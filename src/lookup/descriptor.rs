//! The vertices of pixels in the planes of tiles, and the weighted sum over a window of pixels.
//!
//! The unsafe code of lookups is in this file, in `kernel`, in `avx2` and in `tiles`.

use std::hint::select_unpredictable;

use crate::cache::{Descriptor, Kind};

/// The vertices of one pixel.
#[derive(Clone, Copy)]
pub(super) struct Vertices<const C: usize> {
    pub len: u32,
    /// The depths. If there are none, one may be read.
    pub z: *const f32,
    /// The visibilities of each channel, in the type that the tile stores. If there are none, one
    /// may be read.
    pub v: [*const u8; C],
}

/// Memory of pixels that no tile holds.
static NOTHING: [f32; 32] = [0.0; 32];

impl<const C: usize> Vertices<C> {
    /// A pixel of a tile without planes.
    const NONE: Self = Vertices {
        len: 0,
        z: NOTHING.as_ptr(),
        v: [NOTHING.as_ptr().cast(); C],
    };
}

/// A type that visibilities are stored in.
pub(super) trait Stored: Copy + Into<f64> {}

impl Stored for u16 {}

impl Stored for f32 {}

/// Evaluates a window of pixels.
pub(super) trait Kernel {
    /// The values of `C` channels at `depth`, as stored: k of k / L, or f32.
    ///
    /// # Safety
    /// The pixels store `V`, and visibility 1 as `one`. If they are `padded`, 64 bytes from the end
    /// of their depths and 8 from that of their visibilities may be read.
    unsafe fn stored<const C: usize, const N: usize, V: Stored>(
        &mut self,
        pixels: &[[Vertices<C>; N]; N],
        padded: bool,
        one: V,
        depth: f32,
    ) -> [[[f64; N]; N]; C];
}

impl Descriptor<'_> {
    #[inline(always)]
    fn has_planes(&self) -> bool {
        matches!(self.kind, Kind::Lattice | Kind::F32)
    }

    /// The vertices of pixel number `at`, counted row by row.
    ///
    /// # Safety
    /// The tile has planes and this pixel.
    #[inline(always)]
    unsafe fn pixel<const C: usize>(&self, at: usize) -> Vertices<C> {
        let table = self.base.cast::<u32>();
        let size = self.kind as u32;
        // SAFETY: the table has an entry more than pixels, and so has the colour table behind it,
        // which is there if some vertices are coloured. A pixel without vertices takes the first of
        // the tile.
        unsafe {
            let (start, end) = (*table.add(at), *table.add(at + 1));
            let first = if start < end { start as usize } else { 0 };
            let values = self.base.add(self.values as usize);
            let mut v = [values.add(first << size); C];
            if C > 1 && self.coloured > 0 {
                let table = table.add(self.pixels() + 1);
                let (from, to) = (*table.add(at), *table.add(at + 1));
                if from < to {
                    for (v, c) in v[1..].iter_mut().zip(0..) {
                        let first = self.vertices + c * self.coloured + from;
                        *v = values.add((first as usize) << size);
                    }
                }
            }
            Vertices {
                len: end - start,
                z: self.base.add(self.depths as usize).cast::<f32>().add(first),
                v,
            }
        }
    }

    #[inline(always)]
    fn stride(&self) -> usize {
        self.extent[0].into()
    }

    #[inline(always)]
    fn pixels(&self) -> usize {
        self.stride() * usize::from(self.extent[1])
    }

    /// First and last depth of the vertices of pixel (x, y) of the tile.
    pub fn depth_range(&self, [x, y]: [u32; 2]) -> Option<[f32; 2]> {
        if self.kind == Kind::Constant {
            return Some([f32::from_bits(self.depths); 2]);
        }
        let window = Window::<1>::pixel();
        let located = Located {
            tile: self,
            at: [x, y],
            window,
        };
        let [[pixel]] = located.find::<1>().pixels;
        let n = pixel.len as usize;
        // SAFETY: these are vertices of a pixel that has some.
        (n > 0).then(|| unsafe { [*pixel.z, *pixel.z.add(n - 1)] })
    }
}

/// Weights of the columns and rows of a window of `N` x `N` pixels.
#[derive(Clone, Copy)]
pub(super) struct Window<const N: usize> {
    pub columns: [f64; N],
    pub rows: [f64; N],
}

impl<const N: usize> Window<N> {
    /// All weights 1.
    #[inline(always)]
    pub fn pixel() -> Self {
        Window {
            columns: [1.0; N],
            rows: [1.0; N],
        }
    }
}

/// A window of pixels of one tile.
#[derive(Clone, Copy)]
pub(super) struct Located<'a, const N: usize> {
    pub tile: &'a Descriptor<'a>,
    /// The first pixel's place in the tile.
    pub at: [u32; 2],
    pub window: Window<N>,
}

impl<'a, const N: usize> Located<'a, N> {
    /// Prefetches the entries of the tables that [`Located::find`] reads.
    #[inline(always)]
    pub fn prefetch<const C: usize>(&self) {
        let stride = self.tile.stride();
        let first = self.at[1] as usize * stride + self.at[0] as usize;
        for j in 0..N {
            prefetch(self.tile.base.wrapping_add(4 * (first + j * stride)));
            if C > 1 && self.tile.coloured > 0 {
                let first = first + self.tile.pixels() + 1;
                prefetch(self.tile.base.wrapping_add(4 * (first + j * stride)));
            }
        }
    }

    /// The vertices of the pixels.
    #[inline(always)]
    pub fn find<const C: usize>(&self) -> Found<'a, C, N> {
        let tile = self.tile;
        let mut pixels = [[Vertices::NONE; N]; N];
        if tile.has_planes() {
            let stride = tile.stride();
            let first = self.at[1] as usize * stride + self.at[0] as usize;
            let last = first + (N - 1) * (stride + 1);
            assert!(last < tile.pixels(), "a window of its tile");
            for (j, row) in pixels.iter_mut().enumerate() {
                for (i, pixel) in row.iter_mut().enumerate() {
                    // SAFETY: asserted above.
                    *pixel = unsafe { tile.pixel(first + j * stride + i) };
                }
            }
        }
        Found {
            tile,
            padded: tile.padded,
            split: false,
            pixels,
            window: self.window,
        }
    }
}

/// A window of pixels and their vertices.
#[derive(Clone, Copy)]
pub(super) struct Found<'a, const C: usize, const N: usize> {
    /// The tile; or one of several that store visibilities in the same way.
    tile: &'a Descriptor<'a>,
    /// Whether all tiles are padded.
    padded: bool,
    /// Whether the pixels come from several tiles, or lie beyond the border. They are then scaled
    /// one by one.
    split: bool,
    pixels: [[Vertices<C>; N]; N],
    window: Window<N>,
}

impl<const C: usize, const N: usize> Found<'_, C, N> {
    /// Prefetches the vertices.
    #[inline(always)]
    pub fn prefetch(&self) {
        for pixel in self.pixels.as_flattened() {
            let n = pixel.len as usize;
            prefetch(pixel.z);
            prefetch(pixel.z.wrapping_add(n));
            for v in pixel.v {
                prefetch(v.wrapping_add((n / 2) << self.tile.kind as u32));
            }
        }
    }

    /// The weighted sum.
    #[inline(always)]
    pub fn value(&self, depth: f32, kernel: &mut impl Kernel) -> [f64; C] {
        let (tile, pixels) = (self.tile, &self.pixels);
        if tile.lattice > 0 {
            let unit = 1.0 / f64::from(tile.lattice);
            // SAFETY: the pixels are from tiles that store u16.
            let stored = unsafe { kernel.stored(pixels, self.padded, tile.lattice, depth) };
            return self.sum(stored, unit);
        }
        if tile.has_planes() {
            // SAFETY: the pixels are from tiles that store f32.
            let stored = unsafe { kernel.stored(pixels, self.padded, 1.0f32, depth) };
            return self.sum(stored, 1.0);
        }
        match tile.kind {
            Kind::Constant if depth > f32::from_bits(tile.depths) => {
                [f64::from(f32::from_bits(tile.values)); C]
            }
            Kind::Dark => [0.0; C],
            _ => [1.0; C],
        }
    }

    #[inline(always)]
    fn sum(&self, mut values: [[[f64; N]; N]; C], mut unit: f64) -> [f64; C] {
        let mut sums = [0.0; C];
        if self.split {
            for values in &mut values {
                for (value, pixel) in
                    (values.as_flattened_mut().iter_mut()).zip(self.pixels.as_flattened())
                {
                    let lit = pixel.z == NOTHING.as_ptr();
                    *value = if lit { 1.0 } else { *value * unit };
                }
            }
            unit = 1.0;
        }
        for (sum, values) in sums.iter_mut().zip(&values) {
            let mut total = 0.0;
            for (row, wy) in values.iter().zip(&self.window.rows) {
                for (value, wx) in row.iter().zip(&self.window.columns) {
                    total += wx * wy * value;
                }
            }
            *sum = if N == 1 { values[0][0] } else { total } * unit;
        }
        sums
    }
}

/// A window of pixels of several tiles, or beyond the border.
pub(super) struct Split<'a, const N: usize> {
    pub pixels: [[Located<'a, 1>; N]; N],
    pub window: Window<N>,
}

impl<'a, const N: usize> Split<'a, N> {
    /// Prefetches the entries of the tables.
    #[inline(always)]
    pub fn prefetch<const C: usize>(&self) {
        let pixels = self.pixels.as_flattened().iter();
        pixels.for_each(|pixel| pixel.prefetch::<C>());
    }

    /// A tile that stores visibilities as all others do that are not lit.
    fn like(&self) -> Option<&'a Descriptor<'a>> {
        let mut like = Descriptor::LIT;
        for pixel in self.pixels.as_flattened() {
            let tile = pixel.tile;
            if tile.kind != Kind::Lit && like.kind == Kind::Lit {
                like = tile;
            }
            let alike = tile.has_planes() && tile.kind == like.kind && tile.lattice == like.lattice;
            if tile.kind != Kind::Lit && !alike {
                return None;
            }
        }
        Some(like)
    }

    /// The vertices of the pixels, if all tiles that are not lit store visibilities alike.
    pub fn find<const C: usize>(&self) -> Option<Found<'a, C, N>> {
        let tile = self.like()?;
        let mut found = Found {
            tile,
            padded: true,
            split: true,
            pixels: [[Vertices::NONE; N]; N],
            window: self.window,
        };
        let pixels = found.pixels.as_flattened_mut().iter_mut();
        for (pixel, located) in pixels.zip(self.pixels.as_flattened()) {
            if located.tile.has_planes() {
                *pixel = located.find().pixels[0][0];
                found.padded &= located.tile.padded;
            }
        }
        Some(found)
    }

    /// The weighted sum.
    #[inline(always)]
    pub fn value<const C: usize>(&self, depth: f32, kernel: &mut impl Kernel) -> [f64; C] {
        if let Some(found) = self.find() {
            found.prefetch();
            return found.value(depth, kernel);
        }
        let mut total = [0.0; C];
        for (row, wy) in self.pixels.iter().zip(&self.window.rows) {
            for (pixel, wx) in row.iter().zip(&self.window.columns) {
                let value = pixel.find::<C>().value(depth, kernel);
                for (total, value) in total.iter_mut().zip(value) {
                    *total += wx * wy * value;
                }
            }
        }
        total
    }
}

/// Has a line of memory fetched; any address will do.
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

/// The value of a pixel, as stored, where `next` of its depths lie before `depth`.
///
/// # Safety
/// As [`Kernel::stored`], and `next` is at most the number of vertices.
#[inline(always)]
pub(super) unsafe fn value<const C: usize, V: Stored>(
    pixel: &Vertices<C>,
    next: u32,
    one: V,
    depth: f32,
) -> [f64; C] {
    // The depth lies between two vertices, or outside all of them. The code has no branch on the
    // result of the search: a misprediction would delay the next pixel.
    let between = next.wrapping_sub(1) < pixel.len.wrapping_sub(1);
    let high = next.min(pixel.len.saturating_sub(1));
    let (low, high) = ((high - u32::from(between)) as usize, high as usize);
    let mut out = [0.0; C];
    // SAFETY: `low` and `high` are vertices of the pixel; or it has none, and one may be read.
    unsafe {
        let (z0, z1) = (f64::from(*pixel.z.add(low)), f64::from(*pixel.z.add(high)));
        let t = (f64::from(depth) - z0) / (z1 - z0);
        let t = f64::from_bits(select_unpredictable(between, t.to_bits(), 0));
        for (out, v) in out.iter_mut().zip(pixel.v) {
            let v = v.cast::<V>();
            let a: f64 = select_unpredictable(next == 0, one, *v.add(low)).into();
            let b: f64 = (*v.add(high)).into();
            *out = a + (b - a) * t;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Visibility;
    use crate::cache::CachedTile;
    use crate::lookup::kernel::{Cursor, Native};
    use crate::raw::{Precision, TileBuilder};

    const SIDE: usize = 8;
    const LATTICE: u16 = 500;

    /// A pixel as it is stored: depths, and the values of each channel.
    type Stored = (Vec<f32>, Vec<Vec<f64>>);

    fn dice(state: &mut u64, n: u64) -> u64 {
        *state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (*state >> 33) % n
    }

    /// A tile with 0 to 200 vertices a pixel, steps included, and the pixels that it stores.
    fn tile(seed: u64, lattice: bool, coloured: bool) -> (CachedTile, Vec<Stored>) {
        let seed = &mut seed.clone();
        let precision = match lattice {
            true => Precision::Lattice(LATTICE),
            false => Precision::F32,
        };
        let mut builder = TileBuilder::new(SIDE as u32, precision);
        let mut pixels = Vec::new();
        for _ in 0..SIDE * SIDE {
            let n = [0, 1, 2, 3, 16, 17, 31, 62, 63, 64, 65, 200][dice(seed, 12) as usize];
            let channels = if coloured && dice(seed, 2) == 0 { 3 } else { 1 };
            let (mut z, mut depth) = (Vec::new(), dice(seed, 8) as f32 - 4.0);
            while z.len() < n {
                depth += 0.25 + dice(seed, 4) as f32;
                z.push(depth);
                if z.len() > 1 && z.len() < n && dice(seed, 3) == 0 {
                    z.push(depth);
                }
            }
            let plane = |seed: &mut u64| -> Vec<f32> {
                let mut k: Vec<u64> = (0..n).map(|_| dice(seed, 501)).collect();
                k.sort_by(|a, b| b.cmp(a));
                k.iter().map(|&k| k as f32 / f32::from(LATTICE)).collect()
            };
            let planes = (0..channels).map(|_| plane(seed)).collect();
            let f = Visibility::from_planes(z, planes).unwrap();
            builder.push(&f);
            let stored = |&v: &f32| match lattice {
                true => (f64::from(v) * f64::from(LATTICE)).round(),
                false => f64::from(v),
            };
            let values = (0..3)
                .map(|c| {
                    let own = f.values(c % f.function().channels());
                    own.iter().map(stored).collect()
                })
                .collect();
            pixels.push((f.depths().to_vec(), values));
        }
        (CachedTile::planes(builder.finish()), pixels)
    }

    /// The value of a pixel by a scan.
    fn scan((z, v): &Stored, c: usize, one: f64, depth: f32) -> f64 {
        let next = z.iter().filter(|&&d| d < depth).count();
        match next {
            0 => one,
            _ if next == z.len() => v[c][next - 1],
            _ => {
                let [z0, z1] = [next - 1, next].map(|i| f64::from(z[i]));
                let [a, b] = [next - 1, next].map(|i| v[c][i]);
                a + (b - a) * ((f64::from(depth) - z0) / (z1 - z0))
            }
        }
    }

    /// All kernels against the scan, for windows of `N` x `N` pixels and `C` channels.
    fn same_bits<const C: usize, const N: usize>(lattice: bool, coloured: bool) {
        let (content, pixels) = tile(7 + C as u64 + N as u64, lattice, coloured);
        let padded = Descriptor::of(&content);
        assert!(padded.padded && (padded.coloured > 0) == coloured);
        let tight = Descriptor {
            padded: false,
            ..padded
        };
        let seed = &mut 3;
        let (one, unit) = match lattice {
            true => (f64::from(LATTICE), 1.0 / f64::from(LATTICE)),
            false => (1.0, 1.0),
        };
        let mut cursor = Cursor::default();
        for _ in 0..6000 {
            let at = [0, 1].map(|_| dice(seed, (SIDE - N + 1) as u64) as u32);
            let first = (at[1] as usize) * SIDE + at[0] as usize;
            let z = &pixels[first].0;
            let depth = match z.len() as u64 {
                0 => dice(seed, 100) as f32,
                n => z[dice(seed, n) as usize],
            };
            let depth = match dice(seed, 8) {
                0 => depth.next_up(),
                1 => depth.next_down(),
                2 => depth + 0.125,
                3 => f32::INFINITY,
                4 => f32::NEG_INFINITY,
                _ => depth,
            };
            let weights = |seed: &mut u64| [0; N].map(|_| dice(seed, 1000) as f64 / 999.0 - 0.1);
            let window = Window {
                columns: weights(seed),
                rows: weights(seed),
            };
            let expected: [u64; C] = std::array::from_fn(|c| {
                let mut total = 0.0;
                for j in 0..N {
                    for i in 0..N {
                        let value = scan(&pixels[first + j * SIDE + i], c, one, depth);
                        let weight = window.columns[i] * window.rows[j];
                        total += if N == 1 { value } else { weight * value };
                    }
                }
                (total * unit).to_bits()
            });
            for tile in [&padded, &tight] {
                let found = Located { tile, at, window }.find::<C>();
                let check = |what: &str, value: [f64; C]| {
                    assert_eq!(
                        value.map(f64::to_bits),
                        expected,
                        "{what} {at:?} {depth} {:?}",
                        pixels[first]
                    );
                };
                check("portable", found.value(depth, &mut { Native::PORTABLE }));
                check("native", found.value(depth, &mut Native::new()));
                cursor.begin();
                check("cursor", found.value(depth, &mut cursor));
            }
        }
    }

    #[test]
    fn every_kernel_has_the_bits_of_a_scan() {
        for (lattice, coloured) in [(true, false), (false, false), (true, true), (false, true)] {
            same_bits::<1, 1>(lattice, coloured);
            same_bits::<1, 2>(lattice, coloured);
            same_bits::<1, 4>(lattice, coloured);
            same_bits::<3, 1>(lattice, coloured);
            same_bits::<3, 2>(lattice, coloured);
            same_bits::<3, 4>(lattice, coloured);
        }
    }
}
