//! Slices: the visibility of a rectangle of pixels at one depth.

use std::ops::Range;

use super::query::{Batch, Footprint};
use super::sampler::Sampler;
use crate::{Error, Result};

impl Sampler {
    /// Fills `out` with a slice of the map: the visibility at one depth, at the centre of each
    /// pixel of level 0 in a rectangle, row by row.
    ///
    /// `out` holds one number for each pixel of the rectangle. Each number is the answer of
    /// [`Sampler::visibility`] at that centre. The rectangle may reach beyond the map, where
    /// [`Border`](crate::Border) gives the values. Cost: that of a batch, tile by tile, so a wide
    /// rectangle does not displace its own tiles from the cache.
    ///
    /// # Errors
    /// As [`Sampler::visibility`]; `Input` if `out` has another length. The contents of `out` are
    /// then unspecified.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # fn main() -> Result<()> {
    /// # let mut writer = Writer::in_memory();
    /// # let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
    /// # writer.pixel(map, Pixel::new(2, 1), &Curve::mono(vec![5.0], vec![0.25])?)?;
    /// # let light = TileCache::new(64 << 20).add(DsmFile::from_bytes(writer.into_bytes()?)?);
    /// # let mut sampler = Sampler::new(&light, MapId(0))?;
    /// // Pixel (2, 1) lets a quarter of the light through, behind a depth of 5.
    /// let mut slice = [0.0; 6];
    /// sampler.visibility_slice(6.0, Footprint::Width(1.0), 1..4, 0..2, &mut slice)?;
    /// assert_eq!(slice, [1.0, 1.0, 1.0, 1.0, 0.25, 1.0]);
    /// # Ok(()) }
    /// ```
    pub fn visibility_slice(
        &mut self,
        depth: f32,
        footprint: Footprint,
        columns: Range<u32>,
        rows: Range<u32>,
        out: &mut [f32],
    ) -> Result<()> {
        let out = bytemuck::cast_slice_mut::<f32, [f32; 1]>(out);
        self.slice(depth, footprint, columns, rows, out)
    }

    /// [`Sampler::visibility_slice`] for red, green and blue.
    ///
    /// # Errors
    /// As [`Sampler::visibility_slice`].
    pub fn visibility_rgb_slice(
        &mut self,
        depth: f32,
        footprint: Footprint,
        columns: Range<u32>,
        rows: Range<u32>,
        out: &mut [[f32; 3]],
    ) -> Result<()> {
        self.slice(depth, footprint, columns, rows, out)
    }

    fn slice<const C: usize>(
        &mut self,
        depth: f32,
        footprint: Footprint,
        columns: Range<u32>,
        rows: Range<u32>,
        out: &mut [[f32; C]],
    ) -> Result<()> {
        let width = columns.len();
        if width.checked_mul(rows.len()) != Some(out.len()) {
            return Err(Error::input(format!(
                "a slice of {width} x {} pixels into {} numbers",
                rows.len(),
                out.len()
            )));
        }
        let side = self.file().file().map(self.map())?.header.tile_size;
        let depths = vec![depth; side as usize];
        let mut y = vec![0.0; side as usize];
        for band in in_tiles(&rows, side) {
            for part in in_tiles(&columns, side) {
                let x: Vec<f32> = part.clone().map(|x| x as f32 + 0.5).collect();
                let (n, first) = (x.len(), (part.start - columns.start) as usize);
                for row in band.clone() {
                    y[..n].fill(row as f32 + 0.5);
                    let start = (row - rows.start) as usize * width + first;
                    let batch = Batch::new(&x, &y[..n], &depths[..n]);
                    self.answer_all(&batch.footprints(&[footprint]), &mut out[start..start + n])?;
                }
            }
        }
        Ok(())
    }
}

/// The parts of a range in tiles that are `side` pixels wide.
fn in_tiles(range: &Range<u32>, side: u32) -> impl Iterator<Item = Range<u32>> + use<> {
    let (start, end) = (range.start, range.end);
    (start / side..end.div_ceil(side))
        .map(move |t| start.max(t * side)..end.min((t + 1).saturating_mul(side)))
}
