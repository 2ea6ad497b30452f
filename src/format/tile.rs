//! A decoded tile: the functions of its pixels, as lookups use them.

mod decode;
mod encode;
mod memory;

use std::fmt;

use super::laws;
use crate::function::compress::Precision;
use crate::function::{Broken, Visibility};
pub(in crate::format) use memory::{Counts, Planes, ValuesMut, planes_mut};
pub(crate) use memory::{Loan, PADDING, Shared, Values, View, Words};

/// The visibility functions of one tile, in the types that the file stores.
pub struct Tile {
    /// Pixels in a row.
    width: u32,
    counts: Counts,
    planes: Planes,
}

impl Clone for Tile {
    fn clone(&self) -> Self {
        let mut words = Words::EMPTY;
        let (from, to) = (self.view(), planes_mut(&mut words, &self.counts));
        to.vertex.copy_from_slice(from.vertex);
        to.colour.copy_from_slice(from.colour);
        to.z.copy_from_slice(from.z);
        match (from.v, to.v) {
            (Values::Lattice(from), ValuesMut::Lattice(to)) => to.copy_from_slice(from),
            (Values::F32(from), ValuesMut::F32(to)) => to.copy_from_slice(from),
            _ => unreachable!("equal counts have equal kinds"),
        }
        Tile::new(self.width, words, self.counts)
    }
}

impl PartialEq for Tile {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.counts) == (other.width, other.counts) && self.view() == other.view()
    }
}

impl fmt::Debug for Tile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tile")
            .field("width", &self.width)
            .field("planes", self.view())
            .finish()
    }
}

/// The f32 nearest to k / L.
#[inline]
pub(crate) fn lattice_value(k: u16, lattice: u16) -> f32 {
    f32::from(k) / f32::from(lattice)
}

/// The k with `lattice_value(k, lattice) == v`, if there is one.
#[inline]
pub(crate) fn lattice_index(v: f32, lattice: u16) -> Option<u16> {
    let k = (f64::from(v) * f64::from(lattice)).round() as u16;
    (lattice_value(k, lattice) == v).then_some(k)
}

impl Tile {
    /// A tile of `width` x `height` pixels that are all lit.
    ///
    /// # Panics
    /// If a side is zero.
    pub fn lit(width: u32, height: u32) -> Tile {
        assert!(width > 0 && height > 0, "a tile has pixels");
        let counts = Counts {
            pixels: (width * height) as usize,
            vertices: 0,
            coloured: None,
            lattice: 0,
        };
        let mut words = Words::EMPTY;
        planes_mut(&mut words, &counts).vertex.fill(0);
        Tile::new(width, words, counts)
    }

    /// The tile whose planes [`planes_mut`] laid out in `words`.
    pub(super) fn new(width: u32, words: Words, counts: Counts) -> Tile {
        Tile {
            width,
            counts,
            planes: Planes::own(words, &counts),
        }
    }

    /// The planes.
    #[inline]
    pub(crate) fn view(&self) -> &View<'_> {
        self.planes.borrow_dependent()
    }

    /// The bytes that the planes lie in, with the padding behind them.
    pub(crate) fn memory(&self) -> &[u8] {
        self.planes.borrow_owner().bytes()
    }

    /// L of visibilities k / L, 0 for f32.
    #[inline]
    pub(crate) fn lattice(&self) -> u16 {
        self.counts.lattice
    }

    /// The memory, for the next tile.
    pub(crate) fn into_buffer(self) -> Words {
        self.planes.into_buffer()
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.counts.pixels
    }

    /// Number of vertices of all pixels.
    pub fn vertices(&self) -> usize {
        self.counts.vertices
    }

    /// Whether some pixels have three channels.
    pub fn is_coloured(&self) -> bool {
        self.counts.coloured.is_some()
    }

    /// How visibilities are stored.
    pub fn precision(&self) -> Precision {
        match self.counts.lattice {
            0 => Precision::F32,
            lattice => Precision::Lattice(lattice),
        }
    }

    /// Bytes of memory that the tile holds, by capacity; none if it is looked up in the bytes of its file.
    pub fn bytes(&self) -> usize {
        self.planes.capacity()
    }

    /// Whether the tile lies in memory that was lent for it.
    pub(crate) fn is_lent(&self) -> bool {
        self.planes.is_lent()
    }

    /// Number of vertices of pixel `i`, counted row by row.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn vertex_count(&self, i: usize) -> usize {
        (self.view().vertex[i + 1] - self.view().vertex[i]) as usize
    }

    /// The function of pixel `i`, counted row by row.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn function(&self, i: usize) -> Visibility {
        let mut out = Visibility::lit();
        self.read_function(i, &mut out);
        out
    }

    /// The function of pixel `i`, into memory that is used again.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn read_function(&self, i: usize, out: &mut Visibility) {
        let channels = self.channels(i);
        out.reset(channels);
        let range = self.view().vertex[i] as usize..self.view().vertex[i + 1] as usize;
        for (j, at) in range.enumerate() {
            let mut v = [0.0; 3];
            for (c, v) in v[..channels].iter_mut().enumerate() {
                *v = self.value(self.index(i, j, c));
            }
            out.push_unchecked(self.view().z[at], &v[..channels]);
        }
    }

    /// Channels of pixel `i`.
    pub(super) fn channels(&self, i: usize) -> usize {
        if self.is_coloured() && self.view().colour[i + 1] > self.view().colour[i] {
            3
        } else {
            1
        }
    }

    /// Where channel `c` of vertex `j` of pixel `i` stands among the visibilities.
    pub(super) fn index(&self, i: usize, j: usize, c: usize) -> usize {
        let coloured = self.counts.coloured.unwrap_or(0);
        let view = self.view();
        match c {
            0 => view.vertex[i] as usize + j,
            c => view.z.len() + (c - 1) * coloured + view.colour[i] as usize + j,
        }
    }

    fn value(&self, at: usize) -> f32 {
        match self.view().v {
            Values::Lattice(k) => lattice_value(k[at], self.counts.lattice),
            Values::F32(v) => v[at],
        }
    }

    /// Least and greatest depth of a vertex; zeros if there is none.
    pub fn depth_range(&self) -> [f32; 2] {
        // Depths are sorted in each pixel.
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for ends in self.view().vertex.windows(2).filter(|w| w[0] < w[1]) {
            let (first, last) = (
                self.view().z[ends[0] as usize],
                self.view().z[ends[1] as usize - 1],
            );
            range = [range[0].min(first), range[1].max(last)];
        }
        if range[0] > range[1] {
            [0.0; 2]
        } else {
            range.map(|z| z + 0.0)
        }
    }

    /// Least and greatest visibility behind everything, of all pixels and channels.
    pub fn end_range(&self) -> [f32; 2] {
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        let mut take = |v: f32| range = [range[0].min(v), range[1].max(v)];
        for i in 0..self.pixels() {
            match self.vertex_count(i) {
                0 => take(1.0),
                n if !self.is_coloured() => {
                    take(self.value(self.view().vertex[i] as usize + n - 1))
                }
                n => (0..self.channels(i)).for_each(|c| take(self.value(self.index(i, n - 1, c)))),
            }
        }
        range
    }

    /// The first law that a pixel breaks, by the slow way that knows its place.
    pub(super) fn first_broken(&self) -> Option<(usize, Broken)> {
        let mut f = Visibility::lit();
        (0..self.pixels()).find_map(|i| {
            self.read_function(i, &mut f);
            laws::canonical(f.channels(), f.depths(), f.values())
                .err()
                .map(|broken| (i, broken))
        })
    }
}
