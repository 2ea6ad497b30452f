//! Maps of any size: a block of compressed functions, repeated with every pixel's depths shifted.

use deepshadow::raw::{Encoder, Precision};
use deepshadow::{
    Codec, Compressor, Curve, DsmFile, Encoding, MapHeader, Mips, Pixels, TileId, Visibility,
    Writer,
};
use rayon::prelude::*;

/// Side of the tiles.
pub const TILE: u32 = 32;

/// A square of compressed functions.
#[derive(Clone, Debug)]
pub struct Block {
    /// Pixels in a row, and rows.
    pub side: u32,
    /// The promise of all functions.
    pub tolerance: f64,
    /// What compressed them, and compresses the levels of maps.
    pub compressor: Compressor,
    /// Channels of the maps that are made of it: 1 or 3.
    pub channels: usize,
    /// Row by row.
    pub functions: Vec<Visibility>,
}

impl Block {
    /// Compresses exact functions with [`Compressor::Lookahead`].
    pub fn compress(side: u32, curves: &[Curve], tolerance: f64) -> Self {
        Self::compress_with(Compressor::Lookahead, side, curves, tolerance)
    }

    /// Compresses exact functions.
    pub fn compress_with(
        compressor: Compressor,
        side: u32,
        curves: &[Curve],
        tolerance: f64,
    ) -> Self {
        let precision = Precision::for_tolerance(tolerance);
        let functions = curves
            .par_chunks(side as usize)
            .flat_map_iter(|row| {
                let mut encoder =
                    Encoder::new(compressor, precision, tolerance).expect("a tolerance in range");
                row.iter().map(move |curve| {
                    let mut f = Visibility::lit();
                    encoder.compress(curve, &mut f).expect("a legal curve");
                    f
                })
            })
            .collect();
        Block {
            side,
            tolerance,
            compressor,
            channels: 1,
            functions,
        }
    }

    /// Vertices a pixel, on average.
    pub fn vertices(&self) -> f64 {
        let total: usize = self.functions.iter().map(Visibility::len).sum();
        total as f64 / self.functions.len() as f64
    }

    /// Rows of a map of this width, a multiple of a tile, whose base level decodes to about
    /// `bytes`.
    pub fn rows_for(&self, width: u32, bytes: usize) -> u32 {
        let row = f64::from(width) * (6.0 * self.vertices() + 4.0);
        ((bytes as f64 / row / f64::from(TILE)).round() as u32).max(1) * TILE
    }

    /// The function of pixel (x, y) of a larger map: the block is repeated, and all depths of a
    /// pixel move by as many floats as its place says, up to 2^-10 of the depth. So no two
    /// neighbours are alike, and the order of the depths stays.
    fn pixel(&self, x: u32, y: u32) -> Visibility {
        let f = &self.functions[((y % self.side) * self.side + x % self.side) as usize];
        if f.is_empty() {
            return Visibility::lit();
        }
        let place = u64::from(y) << 32 | u64::from(x);
        let shift = (place.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 51) as u32;
        let z = f
            .depths()
            .iter()
            .map(|z| f32::from_bits(z.to_bits() + shift));
        // The other channels are powers of the first, on the same lattice.
        let Precision::Lattice(lattice) = Precision::for_tolerance(self.tolerance) else {
            panic!("a tolerance that a lattice serves");
        };
        let power = |p: i32| {
            let on_lattice = |v: &f32| (v.powi(p) * f32::from(lattice)).round();
            let plane = f.values(0).iter().map(on_lattice);
            plane.map(|k| k / f32::from(lattice)).collect()
        };
        let mut planes = vec![f.values(0).to_vec()];
        planes.extend((2..=self.channels as i32).map(power));
        Visibility::from_planes(z.collect(), planes).expect("the laws hold still")
    }

    /// A map file of `width` x `height` pixels, in memory.
    pub fn write(&self, width: u32, height: u32, mips: Mips, codec: Codec) -> Vec<u8> {
        let mut writer = Writer::in_memory();
        let encoding = Encoding::new(self.tolerance)
            .compressor(self.compressor)
            .precision(Precision::for_tolerance(self.tolerance))
            .codec(codec)
            .mips(mips);
        let header = MapHeader::new("compare", width, height).channels(self.channels);
        let map = writer.add_map(header, encoding).expect("a legal map");
        for ty in 0..height.div_ceil(TILE) {
            let row = (0..width.div_ceil(TILE)).into_par_iter();
            let row: Vec<_> = row.map(|tx| self.tile(tx, ty, width, height)).collect();
            writer.tiles(map, row).expect("tiles of the map");
        }
        writer.into_bytes().expect("all tiles are there")
    }

    fn tile(&self, tx: u32, ty: u32, width: u32, height: u32) -> (TileId, Pixels) {
        let columns = tx * TILE..((tx + 1) * TILE).min(width);
        let rows = ty * TILE..((ty + 1) * TILE).min(height);
        let pixels = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        let pixels = Pixels::Functions(pixels.map(|(x, y)| self.pixel(x, y)).collect());
        (TileId::new(tx, ty), pixels)
    }

    /// [`Block::write`] without compression of bytes, opened.
    pub fn file(&self, width: u32, height: u32, mips: Mips) -> DsmFile {
        DsmFile::from_bytes(self.write(width, height, mips, Codec::None)).expect("our own file")
    }

    /// A map of `side` x `side` pixels whose tiles of 32 x 32 pixels are those of a small one, as
    /// they are stored; all levels are there. Its lookups are as those of a map that was made
    /// whole.
    pub fn repeated(&self, side: u32) -> DsmFile {
        let small = DsmFile::from_bytes(self.write(self.side, self.side, Mips::Full, Codec::Lz4));
        let small = small.expect("our own file");
        let header = MapHeader::new("compare", side, side).channels(1);
        let levels = header.full_level_count();
        let mut writer = Writer::in_memory();
        let errors = vec![self.tolerance; levels as usize];
        let map = writer
            .add_finished_map(header, Codec::Lz4, &errors)
            .expect("a legal map");
        for l in 0..levels {
            let own = side >> l;
            // The level of the small map with as many pixels, or the last that has whole tiles.
            let whole = (self.side / TILE).ilog2();
            let from = match own < TILE {
                true => self.side.ilog2() - own.ilog2(),
                false => l.min(whole),
            };
            let repeat = (self.side >> from).div_ceil(TILE);
            let level = map.level(from);
            let tiles = own.div_ceil(TILE);
            for ty in 0..tiles {
                let tile = |tx: u32| {
                    let stored = TileId::new(tx % repeat, ty % repeat);
                    let stored = small.stored_tile(level, stored).expect("our own file");
                    (TileId::new(tx, ty), stored)
                };
                let row = (0..tiles).map(tile).collect();
                writer
                    .stored_tiles(map.level(l), row)
                    .expect("tiles of the map");
            }
        }
        DsmFile::from_bytes(writer.into_bytes().expect("all tiles are there"))
            .expect("our own file")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Hair;

    #[test]
    fn no_two_neighbours_are_alike() {
        let block = Block::compress(16, &Hair::new(16, 2).curves(4), 0.03);
        for y in 0..40 {
            for x in 1..40 {
                assert_ne!(block.pixel(x, y), block.pixel(x - 1, y));
                assert_ne!(block.pixel(y, x), block.pixel(y, x - 1));
            }
        }
    }
}
