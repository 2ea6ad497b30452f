//! Functions to a tile.

use super::tile::{Counts, Tile, ValuesMut, Words, planes_mut};
use crate::function::FunctionRef;
use crate::function::compress::Precision;
use crate::function::view::lattice_index;

/// Builds a tile from functions, pixel by pixel, row by row.
///
/// ```
/// use deepshadow::{Precision, Vertex, Visibility, raw::TileBuilder};
/// let mut builder = TileBuilder::new(2, Precision::Lattice(4));
/// builder.push(&Visibility::lit());
/// builder.push(&Visibility::mono(vec![Vertex::new(2.0, 0.75)]).unwrap());
/// let tile = builder.finish();
/// assert_eq!((tile.pixels(), tile.vertices()), (2, 1));
/// assert_eq!(tile.function(1).visibility(3.0), 0.75);
/// ```
#[derive(Debug, Default)]
pub struct TileBuilder {
    width: u32,
    lattice: u16,
    vertex: Vec<u32>,
    coloured: Vec<bool>,
    z: Vec<f32>,
    first: Vec<f32>,
    other: Vec<[f32; 2]>,
}

impl TileBuilder {
    /// A tile of `width` pixels in a row, whose visibilities are stored at this precision; on a lattice only if all of them lie on it.
    pub fn new(width: u32, precision: Precision) -> Self {
        let lattice = match precision {
            Precision::F32 => 0,
            Precision::Lattice(lattice) => lattice,
        };
        TileBuilder {
            width,
            lattice,
            vertex: vec![0],
            ..TileBuilder::default()
        }
    }

    /// The next pixel, from a function in canonical form: a [`Visibility`](crate::Visibility), or
    /// another tile's.
    ///
    /// # Panics
    /// If the tile would have more than 2^32 vertices.
    pub fn push<'a>(&mut self, f: impl Into<FunctionRef<'a>>) {
        let f = f.into();
        let value = |i, c| f.value(i, c) as f32;
        self.z.extend_from_slice(f.depths());
        self.first.extend((0..f.len()).map(|i| value(i, 0)));
        self.coloured.push(f.channels() == 3);
        if f.channels() == 3 {
            let others = (0..f.len()).map(|i| [value(i, 1), value(i, 2)]);
            self.other.extend(others);
        }
        self.vertex
            .push(u32::try_from(self.z.len()).expect("a tile of more than 2^32 vertices"));
    }

    /// The tile.
    ///
    /// # Panics
    /// If its last row is not full.
    pub fn finish(self) -> Tile {
        let pixels = self.coloured.len();
        assert!(
            pixels > 0 && pixels.is_multiple_of(self.width as usize),
            "the last row of the tile is not full"
        );
        let mut colour = Vec::new();
        let mut values = self.first;
        if !self.other.is_empty() {
            colour.push(0);
            for (i, coloured) in self.coloured.iter().enumerate() {
                let grown = if *coloured {
                    self.vertex[i + 1] - self.vertex[i]
                } else {
                    0
                };
                colour.push(colour[i] + grown);
            }
            for c in 0..2 {
                values.extend(self.other.iter().map(|v| v[c]));
            }
        }
        let on_lattice = |&v: &f32| lattice_index(v, self.lattice);
        let steps = match self.lattice {
            0 => None,
            _ => values.iter().map(on_lattice).collect::<Option<Vec<u16>>>(),
        };
        let counts = Counts {
            pixels,
            vertices: self.z.len(),
            coloured: colour.last().map(|&m| m as usize),
            lattice: if steps.is_some() { self.lattice } else { 0 },
        };
        let mut words = Words::EMPTY;
        let planes = planes_mut(&mut words, &counts);
        planes.vertex.copy_from_slice(&self.vertex);
        planes.colour.copy_from_slice(&colour);
        planes.z.copy_from_slice(&self.z);
        match planes.v {
            ValuesMut::Lattice(v) => v.copy_from_slice(&steps.unwrap_or_default()),
            ValuesMut::F32(v) => v.copy_from_slice(&values),
        }
        Tile::new(self.width, words, counts)
    }
}
