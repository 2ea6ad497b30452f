//! Decoded tiles as lookups see them, and where their planes lie.

use std::marker::PhantomData;

use super::shelf::CacheValue;
use crate::format::TileValues;
use crate::format::tile::{PADDING, Words};
use crate::{Error, Tile};

/// A decoded tile, as lookups see it.
pub(crate) enum CachedTile {
    /// Lit at every depth.
    Lit,
    /// One vertex in every pixel: depth, visibility.
    Constant(f32, f32),
    /// Planes, and where they lie.
    Planes(Tile, Descriptor<'static>),
    /// A tile that fails to load, now and later: it breaks a rule, or needs what this build or the
    /// limits do not allow.
    Failed(Error),
}

/// Bytes that are charged for an error: itself and its text.
const ERROR: usize = 1024;

impl CachedTile {
    pub fn planes(tile: Tile) -> Self {
        let descriptor = Descriptor::of_planes(&tile);
        CachedTile::Planes(tile, descriptor)
    }
}

impl CacheValue for CachedTile {
    fn bytes(&self) -> usize {
        match self {
            CachedTile::Planes(tile, _) => tile.bytes(),
            CachedTile::Failed(_) => ERROR,
            CachedTile::Lit | CachedTile::Constant(..) => 0,
        }
    }

    fn is_evictable(&self) -> bool {
        !matches!(self, CachedTile::Lit)
    }

    fn is_lent(&self) -> bool {
        matches!(self, CachedTile::Planes(tile, _) if tile.is_lent())
    }

    fn into_buffer(self) -> Words {
        match self {
            CachedTile::Planes(tile, _) => tile.into_buffer(),
            _ => Words::EMPTY,
        }
    }
}

/// A tile as lookups read it, in half a line of the processor's cache.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub(crate) struct Descriptor<'a> {
    /// The vertex table; in a coloured tile the colour table follows it.
    pub base: *const u8,
    /// Bytes from `base` to the depths; of a constant tile the bits of its depth.
    pub depths: u32,
    /// Bytes from `base` to the visibilities; of a constant tile the bits of its visibility.
    pub values: u32,
    pub vertices: u32,
    /// Vertices of coloured pixels.
    pub coloured: u32,
    /// Pixels in a row, and rows.
    pub extent: [u16; 2],
    pub lattice: u16,
    pub kind: Kind,
    /// Whether a kernel may read 64 bytes from the end of the depths, and 8 from that of the
    /// visibilities.
    pub padded: bool,
    pub tile: PhantomData<&'a CachedTile>,
}

/// What a tile stores. The number of a type of planes is the binary logarithm of a visibility's
/// size.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// Planes with visibilities k / L.
    Lattice = 1,
    /// Planes with visibilities in f32.
    F32 = 2,
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
        match content {
            CachedTile::Planes(_, descriptor) => *descriptor,
            &CachedTile::Constant(depth, visibility) => Descriptor {
                depths: depth.to_bits(),
                values: visibility.to_bits(),
                ..Descriptor::plain(Kind::Constant)
            },
            _ => *Descriptor::LIT,
        }
    }

    /// The descriptor of a tile. It is valid as long as the tile's planes.
    pub fn of_planes(tile: &Tile) -> Self {
        // A tile without a vertex is lit.
        if tile.vertices() == 0 {
            return *Descriptor::LIT;
        }
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
            values + size * len + 8,
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
}
