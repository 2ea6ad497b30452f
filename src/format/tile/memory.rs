//! The memory of a decoded tile: a buffer of its own, or shared bytes of a file.
//!
//! Both have the layout of `spec/format.md`, section 7, in the machine's byte order. A tile of
//! codec none in a memory map is therefore looked up where it lies.

use byteorder::{ByteOrder, LittleEndian as LE};
use self_cell::self_cell;

/// The planes of a [`Tile`](crate::Tile), borrowed: the layout of `spec/format.md`, section 7.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TilePlanes<'a> {
    /// Index of the first vertex of each pixel, row by row, and last the number of vertices.
    pub vertex_table: &'a [u32],
    /// The same, counting only vertices of coloured pixels; empty in a tile without such pixels.
    pub colour_table: &'a [u32],
    /// Depths of all vertices.
    pub depths: &'a [f32],
    /// Visibilities: the first channel of all vertices, then the second of the vertices of coloured
    /// pixels, then their third.
    pub values: TileValues<'a>,
}

/// The visibilities of a tile, as it stores them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TileValues<'a> {
    /// The f32 nearest to `k / lattice`, for each `k` of `numerators`.
    Lattice {
        /// 0 to `lattice`.
        numerators: &'a [u16],
        /// The denominator of all.
        lattice: u16,
    },
    /// f32.
    F32(&'a [f32]),
}

/// Bytes that do not change or move while this value lives.
pub(crate) type Shared = Box<dyn AsRef<[u8]> + Send + Sync>;

/// Memory that is lent for a tile. Dropping the loan returns the memory to its owner.
pub(crate) trait Loan: Send + Sync {
    /// The memory.
    fn words(&self) -> &[u64];
    /// The memory, for writing.
    fn words_mut(&mut self) -> &mut [u64];
}

/// A buffer for the planes of one tile, in words so that every plane is aligned.
pub(crate) enum Words {
    /// An allocation.
    Own(Vec<u64>),
    /// The first words of a loan.
    Lent(Box<dyn Loan>, usize),
}

impl Words {
    /// A buffer without memory.
    pub const EMPTY: Words = Words::Own(Vec::new());

    /// Number of words that the memory holds.
    pub fn capacity(&self) -> usize {
        match self {
            Words::Own(words) => words.capacity(),
            Words::Lent(loan, _) => loan.words().len(),
        }
    }

    /// Sets the length to `n` words. Allocates if the memory is too small. The contents are
    /// unspecified.
    pub fn set_len(&mut self, n: usize) {
        if n > self.capacity() {
            *self = Words::Own(vec![0; n]);
            return;
        }
        match self {
            Words::Own(words) => words.resize(n, 0),
            Words::Lent(_, len) => *len = n,
        }
    }
}

impl std::ops::Deref for Words {
    type Target = [u64];

    fn deref(&self) -> &[u64] {
        match self {
            Words::Own(words) => words,
            Words::Lent(loan, len) => &loan.words()[..*len],
        }
    }
}

impl std::ops::DerefMut for Words {
    fn deref_mut(&mut self) -> &mut [u64] {
        match self {
            Words::Own(words) => words,
            Words::Lent(loan, len) => &mut loan.words_mut()[..*len],
        }
    }
}

/// The memory of one tile.
pub(in crate::format) enum Memory {
    /// A buffer.
    Own(Words),
    /// Bytes of a file that lies in memory.
    Shared(Shared),
}

/// The numbers that fix the layout of a decoded tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::format) struct Counts {
    pub pixels: usize,
    pub vertices: usize,
    /// Vertices of coloured pixels; `None` in a tile without a colour table.
    pub coloured: Option<usize>,
    /// L of visibilities k / L, 0 for f32.
    pub lattice: u16,
}

impl Counts {
    /// Bytes of the decoded tile, padding included.
    pub fn bytes(&self) -> u64 {
        self.planes().iter().sum::<u64>().next_multiple_of(8)
    }

    /// Bytes of the decoded tile without its padding.
    pub fn unpadded(&self) -> usize {
        self.planes().iter().sum::<u64>() as usize
    }

    /// Bytes of each plane, in order: pixel table, colour table, depths, visibilities.
    fn planes(&self) -> [u64; 4] {
        let table = 4 * (self.pixels as u64 + 1);
        let (n, coloured) = (self.vertices as u64, self.coloured.unwrap_or(0) as u64);
        [
            table,
            table * u64::from(self.coloured.is_some()),
            4 * n,
            if self.lattice == 0 { 4 } else { 2 } * (n + 2 * coloured),
        ]
    }
}

/// The planes of a tile that is being filled.
pub(in crate::format) struct ViewMut<'a> {
    pub vertex: &'a mut [u32],
    pub colour: &'a mut [u32],
    pub z: &'a mut [f32],
    pub v: ValuesMut<'a>,
}

impl ViewMut<'_> {
    /// Converts the planes between the byte order of the file and that of the machine.
    pub fn convert_byte_order(&mut self) {
        LE::from_slice_u32(self.vertex);
        LE::from_slice_u32(self.colour);
        LE::from_slice_f32(self.z);
        match &mut self.v {
            ValuesMut::Lattice(v) => LE::from_slice_u16(v),
            ValuesMut::F32(v) => LE::from_slice_f32(v),
        }
    }
}

/// Visibilities of a tile that is being filled.
pub(in crate::format) enum ValuesMut<'a> {
    Lattice(&'a mut [u16]),
    F32(&'a mut [f32]),
}

/// The planes in `bytes`; `None` if they are too few or not aligned.
fn view<'a>(mut bytes: &'a [u8], counts: &Counts) -> Option<TilePlanes<'a>> {
    fn plane<'a, T: bytemuck::AnyBitPattern>(rest: &mut &'a [u8], n: usize) -> Option<&'a [T]> {
        let (head, tail) = rest.split_at_checked(n)?;
        *rest = tail;
        bytemuck::try_cast_slice(head).ok()
    }
    let [vertex, colour, z, v] = counts.planes().map(|n| n as usize);
    Some(TilePlanes {
        vertex_table: plane(&mut bytes, vertex)?,
        colour_table: plane(&mut bytes, colour)?,
        depths: plane(&mut bytes, z)?,
        values: match counts.lattice {
            0 => TileValues::F32(plane(&mut bytes, v)?),
            lattice => TileValues::Lattice {
                numerators: plane(&mut bytes, v)?,
                lattice,
            },
        },
    })
}

/// Bytes after the planes in every buffer that a tile owns. The vector kernels of lookups may read
/// up to this many bytes past a plane.
pub(crate) const PADDING: usize = 64;

/// Makes `words` as long as a tile of `counts` and its padding, and splits it into planes. The
/// contents of the planes are unspecified.
pub(in crate::format) fn planes_mut<'a>(words: &'a mut Words, counts: &Counts) -> ViewMut<'a> {
    fn plane<'a, T: bytemuck::Pod>(rest: &mut &'a mut [u8], n: usize) -> &'a mut [T] {
        let (head, tail) = std::mem::take(rest).split_at_mut(n);
        *rest = tail;
        bytemuck::cast_slice_mut(head)
    }
    words.set_len((counts.bytes() as usize + PADDING) / 8);
    let mut rest: &mut [u8] = bytemuck::cast_slice_mut(words);
    let [vertex, colour, z, v] = counts.planes().map(|n| n as usize);
    ViewMut {
        vertex: plane(&mut rest, vertex),
        colour: plane(&mut rest, colour),
        z: plane(&mut rest, z),
        v: if counts.lattice == 0 {
            ValuesMut::F32(plane(&mut rest, v))
        } else {
            ValuesMut::Lattice(plane(&mut rest, v))
        },
    }
}

self_cell!(
    /// Memory and the planes in it.
    pub(in crate::format) struct Planes {
        owner: Memory,
        #[covariant]
        dependent: TilePlanes,
    }
);

impl Planes {
    /// The planes of a buffer that [`planes_mut`] made.
    pub fn own(words: Words, counts: &Counts) -> Planes {
        Planes::new(Memory::Own(words), |memory| {
            view(memory.bytes(), counts).expect("a buffer of words holds every plane")
        })
    }

    /// The planes in bytes of a file, if this machine can read them there.
    pub fn shared(bytes: Shared, counts: &Counts) -> Option<Planes> {
        if cfg!(target_endian = "big") {
            return None;
        }
        Planes::try_new(Memory::Shared(bytes), |memory| {
            view(memory.bytes(), counts).ok_or(())
        })
        .ok()
    }
}

impl Memory {
    /// All bytes that may be read: the planes and the padding after them.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Memory::Own(words) => bytemuck::cast_slice(words),
            Memory::Shared(bytes) => (**bytes).as_ref(),
        }
    }
}
