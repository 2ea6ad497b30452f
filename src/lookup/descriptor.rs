//! Where the planes of a tile lie, and the weighted sum over a window of its pixels.
//!
//! The unsafe code of lookups is in this file, in `kernel`, in `avx2` and in `tiles`.

use std::marker::PhantomData;

use crate::cache::CachedTile;
use crate::format::TileValues;
use crate::format::tile::PADDING;

/// A tile as lookups read it, in half a line of the processor's cache.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub(super) struct Descriptor<'a> {
    /// The vertex table; in a coloured tile the colour table follows it.
    base: *const u8,
    /// Bytes from `base` to the depths; of a constant tile the bits of its depth.
    depths: u32,
    /// Bytes from `base` to the visibilities; of a constant tile the bits of its visibility.
    values: u32,
    vertices: u32,
    /// Vertices of coloured pixels.
    coloured: u32,
    /// Pixels in a row, and rows.
    extent: [u16; 2],
    lattice: u16,
    kind: Kind,
    /// Whether a kernel may read 64 bytes from the end of the depths, and 4 from that of the
    /// visibilities.
    padded: bool,
    tile: PhantomData<&'a CachedTile>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Planes with visibilities k / L.
    Lattice,
    /// Planes with visibilities in f32.
    F32,
    /// One vertex in every pixel.
    Constant,
    /// Visibility 1 at every depth.
    Lit,
    /// Visibility 0 at every depth.
    Dark,
}

// SAFETY: it stands for a `&CachedTile`, which is `Send`.
unsafe impl Send for Descriptor<'_> {}

// SAFETY: as above, of `&CachedTile` again.
unsafe impl Sync for Descriptor<'_> {}

/// The vertices of one pixel, by their place among those of the tile.
#[derive(Clone, Copy, Default)]
pub(super) struct Vertices {
    /// The first; 0 if there is none.
    pub start: u32,
    pub len: u32,
    /// The first among the vertices of coloured pixels; `MONO` if the channels are alike.
    colour: u32,
}

const MONO: u32 = u32::MAX;

/// A type that visibilities are stored in.
pub(super) trait Stored: Copy + Into<f64> {
    /// Visibility 1.
    fn one(lattice: u16) -> Self;
}

impl Stored for u16 {
    #[inline(always)]
    fn one(lattice: u16) -> u16 {
        lattice
    }
}

impl Stored for f32 {
    #[inline(always)]
    fn one(_: u16) -> f32 {
        1.0
    }
}

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

impl<'a> Descriptor<'a> {
    /// The area outside a map with a lit border.
    pub const LIT: &'static Descriptor<'static> = &Descriptor::plain(Kind::Lit);

    /// A tile that counts as dark.
    pub const DARK: &'static Descriptor<'static> = &Descriptor::plain(Kind::Dark);

    const fn plain(kind: Kind) -> Self {
        Descriptor {
            base: std::ptr::null(),
            depths: 0,
            values: 0,
            vertices: 0,
            coloured: 0,
            extent: [0; 2],
            lattice: 0,
            kind,
            padded: false,
            tile: PhantomData,
        }
    }

    pub fn of(content: &'a CachedTile) -> Self {
        let tile = match content {
            // A tile without a vertex is lit.
            CachedTile::Planes(tile) if tile.vertices() > 0 => tile,
            &CachedTile::Constant(depth, visibility) => {
                return Descriptor {
                    depths: depth.to_bits(),
                    values: visibility.to_bits(),
                    ..Descriptor::plain(Kind::Constant)
                };
            }
            _ => return *Descriptor::LIT,
        };
        let (view, memory) = (tile.planes(), tile.memory());
        let base = memory.as_ptr();
        let offset = |plane: *const u8| plane as usize - base as usize;
        let depths = offset(view.depths.as_ptr().cast());
        let (kind, values, len, size) = match view.values {
            TileValues::Lattice { numerators: v, .. } => {
                (Kind::Lattice, v.as_ptr().cast(), v.len(), 2)
            }
            TileValues::F32(v) => (Kind::F32, v.as_ptr().cast(), v.len(), 4),
        };
        let values = offset(values);
        let tables = view.vertex_table.len() + view.colour_table.len();
        assert!(view.vertex_table.as_ptr().cast() == base && depths == 4 * tables);
        let ends = [
            depths + 4 * view.depths.len() + PADDING,
            values + size * len + 4,
        ];
        let rows = tile.pixels() / tile.width() as usize;
        Descriptor {
            base,
            depths: depths as u32,
            values: values as u32,
            vertices: view.depths.len() as u32,
            coloured: ((len - view.depths.len()) / 2) as u32,
            extent: [tile.width() as u16, rows as u16],
            lattice: tile.lattice(),
            kind,
            padded: ends.iter().all(|&end| end <= memory.len()),
            tile: PhantomData,
        }
    }

    #[inline(always)]
    fn has_planes(&self) -> bool {
        matches!(self.kind, Kind::Lattice | Kind::F32)
    }

    #[inline(always)]
    pub fn is_padded(&self) -> bool {
        self.padded
    }

    #[inline(always)]
    pub fn lattice(&self) -> u16 {
        self.lattice
    }

    /// The depths of all vertices.
    #[inline(always)]
    pub fn depths(&self) -> *const f32 {
        self.base.wrapping_add(self.depths as usize).cast()
    }

    /// The visibilities of channel `c` of a pixel. `V` is the type that the tile stores.
    #[inline(always)]
    pub fn values<V: Stored>(&self, pixel: &Vertices, c: usize) -> *const V {
        let first = if c == 0 || pixel.colour == MONO {
            pixel.start
        } else {
            self.vertices + (c as u32 - 1) * self.coloured + pixel.colour
        };
        let values = self.base.wrapping_add(self.values as usize).cast::<V>();
        values.wrapping_add(first as usize)
    }

    /// The vertices of pixel (x, y) of the tile.
    ///
    /// # Safety
    /// The tile has planes and this pixel.
    #[inline(always)]
    unsafe fn pixel<const C: usize>(&self, [x, y]: [u32; 2]) -> Vertices {
        let [stride, rows] = self.extent.map(u32::from);
        let at = (y * stride + x) as usize;
        let table = self.base.cast::<u32>();
        // SAFETY: the table has an entry more than pixels, and so has the colour table behind it,
        // which is there if some vertices are coloured.
        unsafe {
            let [start, end] = [0, 1].map(|k| *table.add(at + k));
            let mut colour = MONO;
            if C > 1 && self.coloured > 0 {
                let table = table.add((stride * rows + 1) as usize);
                let [from, to] = [0, 1].map(|k| *table.add(at + k));
                colour = if from < to { from } else { MONO };
            }
            Vertices {
                start: if start < end { start } else { 0 },
                len: end - start,
                colour,
            }
        }
    }

    /// First and last depth of the vertices of pixel (x, y) of the tile.
    pub fn depth_range(&self, [x, y]: [u32; 2]) -> Option<[f32; 2]> {
        if self.kind == Kind::Constant {
            return Some([f32::from_bits(self.depths); 2]);
        }
        let window = Window::<1>::pixel();
        let [[pixel]] = Found::new::<1>(self, [x, y], window).pixels;
        let (first, n) = (pixel.start as usize, pixel.len as usize);
        // SAFETY: the range of a pixel that has vertices lies inside the depths.
        (n > 0).then(|| unsafe { [0, n - 1].map(|k| *self.depths().add(first + k)) })
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
        let [stride, rows] = self.tile.extent.map(u32::from);
        let tables = if C > 1 && self.tile.coloured > 0 {
            2
        } else {
            1
        };
        for k in 0..tables {
            for j in 0..N as u32 {
                let at = k * (stride * rows + 1) + (self.at[1] + j) * stride + self.at[0];
                prefetch(self.tile.base.wrapping_add(4 * at as usize));
            }
        }
    }

    /// The vertices of the pixels. They are prefetched when this returns.
    #[inline(always)]
    pub fn find<const C: usize>(&self) -> Found<'a, N> {
        Found::new::<C>(self.tile, self.at, self.window)
    }
}

/// A window of pixels of one tile, and their vertices.
#[derive(Clone, Copy)]
pub(super) struct Found<'a, const N: usize> {
    tile: &'a Descriptor<'a>,
    /// From the tables of `tile`, with as many channels as `value` is asked for.
    pixels: [[Vertices; N]; N],
    window: Window<N>,
}

impl<'a, const N: usize> Found<'a, N> {
    #[inline(always)]
    fn new<const C: usize>(tile: &'a Descriptor<'a>, at: [u32; 2], window: Window<N>) -> Self {
        let mut pixels = [[Vertices::default(); N]; N];
        if tile.has_planes() {
            let ([stride, rows], [x, y]) = (tile.extent.map(usize::from), at.map(|c| c as usize));
            let last = (y + N - 1) * stride + x + N - 1;
            assert!(last < stride * rows, "a window of its tile");
            for (j, row) in (0..).zip(&mut pixels) {
                for (i, pixel) in (0..).zip(row) {
                    // SAFETY: asserted above.
                    *pixel = unsafe { tile.pixel::<C>([at[0] + i, at[1] + j]) };
                    let z = tile.depths().wrapping_add(pixel.start as usize);
                    prefetch(z);
                    prefetch(z.wrapping_add(pixel.len as usize));
                    for c in 0..C {
                        let middle = pixel.len as usize / 2;
                        if tile.kind == Kind::Lattice {
                            prefetch(tile.values::<u16>(pixel, c).wrapping_add(middle));
                        } else {
                            prefetch(tile.values::<f32>(pixel, c).wrapping_add(middle));
                        }
                    }
                }
            }
        }
        Found {
            tile,
            pixels,
            window,
        }
    }

    /// The weighted sum of `C` channels; found with as many.
    #[inline(always)]
    pub fn value<const C: usize>(&self, depth: f32, kernel: &mut impl Kernel) -> [f64; C] {
        let tile = self.tile;
        if tile.kind == Kind::Lattice {
            // SAFETY: `new` took the vertices from the tables of this tile, which stores u16.
            let stored = unsafe { kernel.stored::<C, N, u16>(tile, &self.pixels, depth) };
            let unit = 1.0 / f64::from(tile.lattice);
            return self.sum(&stored).map(|sum| sum * unit);
        }
        if tile.kind == Kind::F32 {
            // SAFETY: as above; this one stores f32.
            let stored = unsafe { kernel.stored::<C, N, f32>(tile, &self.pixels, depth) };
            return self.sum(&stored);
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
    fn sum<const C: usize>(&self, values: &[[[f64; N]; N]; C]) -> [f64; C] {
        values.map(|values| {
            if N == 1 {
                return values[0][0];
            }
            let mut total = 0.0;
            for (row, wy) in values.iter().zip(&self.window.rows) {
                for (value, wx) in row.iter().zip(&self.window.columns) {
                    total += wx * wy * value;
                }
            }
            total
        })
    }
}

/// A window of pixels of several tiles, or beyond the border.
pub(super) struct Split<'a, const N: usize> {
    pub pixels: [[Located<'a, 1>; N]; N],
    pub window: Window<N>,
}

impl<const N: usize> Split<'_, N> {
    /// Prefetches the entries of the tables.
    #[inline(always)]
    pub fn prefetch<const C: usize>(&self) {
        let pixels = self.pixels.as_flattened().iter();
        pixels.for_each(|pixel| pixel.prefetch::<C>());
    }

    /// Prefetches the vertices.
    #[inline(always)]
    pub fn find<const C: usize>(&self) {
        let pixels = self.pixels.as_flattened().iter();
        pixels.for_each(|pixel| {
            pixel.find::<C>();
        });
    }

    /// The weighted sum, pixel by pixel.
    #[inline(always)]
    pub fn value<const C: usize>(&self, depth: f32, kernel: &mut impl Kernel) -> [f64; C] {
        let mut found = [[None; N]; N];
        for (found, pixel) in (found.as_flattened_mut().iter_mut()).zip(self.pixels.as_flattened())
        {
            *found = Some(pixel.find::<C>());
        }
        let mut total = [0.0; C];
        for (row, wy) in found.iter().zip(&self.window.rows) {
            for (pixel, wx) in row.iter().flatten().zip(&self.window.columns) {
                let value = pixel.value::<C>(depth, kernel);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Visibility;
    #[cfg(target_arch = "x86_64")]
    use crate::lookup::avx2::Avx2;
    use crate::lookup::kernel::{Cursor, Portable};
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
        (CachedTile::Planes(builder.finish()), pixels)
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
                check("portable", found.value(depth, &mut Portable));
                cursor.begin();
                check("cursor", found.value(depth, &mut cursor));
                #[cfg(target_arch = "x86_64")]
                if let Some(mut avx2) = Avx2::new() {
                    check("AVX2", found.value(depth, &mut avx2));
                }
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
