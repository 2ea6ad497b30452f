//! Builds a tile from visibility functions.

use super::tile::{Counts, Tile, ValuesMut, Words, planes_mut};
use crate::function::FunctionRef;
use crate::function::compress::Precision;
use crate::function::view::lattice_index;

/// Builds a tile from functions, pixel by pixel, row by row.
///
/// ```
/// use deepshadow::raw::{Precision, TileBuilder};
/// use deepshadow::{Vertex, Visibility};
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
    /// The tables of [`TilePlanes`](super::TilePlanes).
    vertex: Vec<u32>,
    colour: Vec<u32>,
    z: Vec<f32>,
    /// The visibilities of each channel; of the last two for coloured pixels only.
    channels: [Vec<f32>; 3],
}

impl TileBuilder {
    /// A builder of a tile with `width` pixels in a row.
    ///
    /// The tile stores visibilities at this precision. It uses the lattice only if all of them lie
    /// on it, else f32.
    pub fn new(width: u32, precision: Precision) -> Self {
        TileBuilder {
            width,
            lattice: precision.lattice(),
            vertex: vec![0],
            colour: vec![0],
            ..TileBuilder::default()
        }
    }

    /// Adds the next pixel, from a function in canonical form: a
    /// [`Visibility`](crate::Visibility), or a function of another tile.
    ///
    /// # Panics
    /// If the tile would have more than 2^32 vertices.
    pub fn push<'a>(&mut self, f: impl Into<FunctionRef<'a>>) {
        let f = f.into();
        self.z.extend_from_slice(f.depths());
        for (c, plane) in self.channels[..f.channels()].iter_mut().enumerate() {
            plane.extend((0..f.len()).map(|i| f.value(i, c) as f32));
        }
        let vertices = u32::try_from(self.z.len());
        self.vertex
            .push(vertices.expect("a tile of more than 2^32 vertices"));
        self.colour.push(self.channels[1].len() as u32);
    }

    /// The tile.
    ///
    /// # Panics
    /// If its last row is not full.
    pub fn finish(self) -> Tile {
        let pixels = self.vertex.len() - 1;
        assert!(
            pixels > 0 && pixels.is_multiple_of(self.width as usize),
            "the last row of the tile is not full"
        );
        let coloured = Some(self.channels[1].len()).filter(|&n| n > 0);
        let values = self.channels.concat();
        // No visibility lies on the lattice 0.
        let numerators = values.iter().map(|&v| lattice_index(v, self.lattice));
        let numerators: Option<Vec<u16>> = numerators.collect();
        let counts = Counts {
            pixels,
            vertices: self.z.len(),
            coloured,
            lattice: numerators.as_ref().map_or(0, |_| self.lattice),
        };
        let mut words = Words::EMPTY;
        let planes = planes_mut(&mut words, &counts);
        planes.vertex.copy_from_slice(&self.vertex);
        planes
            .colour
            .copy_from_slice(&self.colour[..planes.colour.len()]);
        planes.z.copy_from_slice(&self.z);
        match planes.v {
            ValuesMut::Lattice(v) => v.copy_from_slice(&numerators.unwrap_or_default()),
            ValuesMut::F32(v) => v.copy_from_slice(&values),
        }
        Tile::new(self.width, words, counts)
    }
}
