//! A decoded tile: the visibility functions of its pixels, in the planes that lookups read.

pub(crate) mod decode;
mod encode;
mod memory;

use std::fmt;

use crate::function::compress::Precision;
use crate::function::view::ValuePlanes;
use crate::function::{Broken, FunctionRef};
pub(in crate::format) use memory::{Counts, Memory, Planes, ValuesMut, planes_mut};
pub(crate) use memory::{Loan, PADDING, Shared, Words};
pub use memory::{TilePlanes, TileValues};

/// The visibility functions of one tile, in the number types that the file stores.
pub struct Tile {
    /// Pixels in a row.
    width: u32,
    counts: Counts,
    planes: Planes,
}

impl Clone for Tile {
    fn clone(&self) -> Self {
        let mut words = Words::EMPTY;
        planes_mut(&mut words, &self.counts);
        let n = self.counts.unpadded();
        bytemuck::cast_slice_mut(&mut words)[..n].copy_from_slice(&self.memory()[..n]);
        Tile::new(self.width, words, self.counts)
    }
}

impl PartialEq for Tile {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.counts) == (other.width, other.counts) && self.planes() == other.planes()
    }
}

impl fmt::Debug for Tile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tile")
            .field("width", &self.width)
            .field("planes", &self.planes())
            .finish()
    }
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
            ..Counts::default()
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

    /// The planes, for a GPU, an array or another language.
    #[inline]
    pub fn planes(&self) -> TilePlanes<'_> {
        *self.planes.borrow_dependent()
    }

    /// The bytes that the planes lie in, with the padding after them.
    pub(crate) fn memory(&self) -> &[u8] {
        self.planes.borrow_owner().bytes()
    }

    /// L of visibilities k / L, 0 for f32.
    #[inline]
    pub(crate) fn lattice(&self) -> u16 {
        self.counts.lattice
    }

    /// The memory, for the next tile; empty if the tile has none of its own.
    pub(crate) fn into_buffer(self) -> Words {
        match self.planes.into_owner() {
            Memory::Own(words) => words,
            Memory::Shared(_) => Words::EMPTY,
        }
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

    /// Bytes of memory that the tile owns, by capacity; 0 if it is looked up in the bytes of its
    /// file.
    pub fn bytes(&self) -> usize {
        match self.planes.borrow_owner() {
            Memory::Own(words) => 8 * words.capacity(),
            Memory::Shared(_) => 0,
        }
    }

    /// Whether the tile lies in memory that was lent for it.
    pub(crate) fn is_lent(&self) -> bool {
        matches!(self.planes.borrow_owner(), Memory::Own(Words::Lent(..)))
    }

    /// The function of pixel `i`, counted row by row. Copies nothing.
    ///
    /// # Panics
    /// If there is no such pixel.
    #[inline]
    pub fn function(&self, i: usize) -> FunctionRef<'_> {
        fn split<T>(values: &[T], starts: [usize; 3], n: usize) -> [&[T]; 3] {
            starts.map(|start| &values[start..start + n])
        }
        let planes = self.planes();
        let first = planes.vertex_table[i] as usize;
        let n = planes.vertex_table[i + 1] as usize - first;
        let (mut starts, mut channels) = ([first; 3], 1);
        if let Some(coloured) = self.counts.coloured
            && planes.colour_table[i + 1] > planes.colour_table[i]
        {
            channels = 3;
            starts[1] = planes.depths.len() + planes.colour_table[i] as usize;
            starts[2] = starts[1] + coloured;
        }
        let values = match planes.values {
            TileValues::F32(v) => ValuePlanes::F32(split(v, starts, n)),
            TileValues::Lattice {
                numerators,
                lattice,
            } => ValuePlanes::Lattice(split(numerators, starts, n), lattice),
        };
        FunctionRef::new(&planes.depths[first..first + n], channels, values)
    }

    /// The functions of all pixels, row by row.
    pub fn functions(&self) -> impl Iterator<Item = FunctionRef<'_>> {
        (0..self.pixels()).map(|i| self.function(i))
    }

    /// Least and greatest depth of a vertex; zeros if there is none.
    pub fn depth_range(&self) -> [f32; 2] {
        let planes = self.planes();
        let pixels = planes.vertex_table.windows(2).filter(|w| w[0] < w[1]);
        let ends = pixels.map(|w| [w[0], w[1] - 1].map(|i| planes.depths[i as usize]));
        let range = ends.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        range.unwrap_or_default().map(|z| z + 0.0)
    }

    /// Least and greatest visibility behind everything, of all pixels and channels.
    pub fn end_range(&self) -> [f32; 2] {
        let ends = self.functions().flat_map(FunctionRef::end_rgb);
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        let range = ends.fold(none, |[least, most], v| [least.min(v), most.max(v)]);
        range.map(|v| v as f32)
    }

    /// The first pixel that breaks a law, and the law. Slow: it checks one function after another.
    pub(super) fn first_broken(&self) -> Option<(usize, Broken)> {
        let broken = |(i, f): (usize, FunctionRef<'_>)| Some((i, f.check_canonical().err()?));
        self.functions().enumerate().find_map(broken)
    }
}
