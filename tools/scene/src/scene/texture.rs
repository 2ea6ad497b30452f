//! Textures of opacity.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use crate::error::{Error, ErrorKind, InFile, Result};

/// An image of opacities that repeats in both directions. (0, 0) is its lower left corner, (1, 1)
/// its upper right corner.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Row by row from the top: red, green and blue, 0 to 1.
    pub values: Vec<[f32; 3]>,
}

/// Most pixels of a texture.
const MAX_PIXELS: u64 = 1 << 28;

impl Texture {
    /// Reads a PNG of any type. Grey applies to red, green and blue; alpha is ignored; values are
    /// used unchanged, not as sRGB.
    ///
    /// # Errors
    /// [`ErrorKind::File`] or [`ErrorKind::Io`], with the file's name.
    pub fn read(path: &Path) -> Result<Self> {
        Self::decode(path).in_file(path)
    }

    fn decode(path: &Path) -> Result<Self> {
        let bad = |e: png::DecodingError| Error::new(ErrorKind::File, e.to_string());
        let mut decoder = png::Decoder::new(BufReader::new(File::open(path)?));
        decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
        let mut reader = decoder.read_info().map_err(bad)?;
        let (width, height) = (reader.info().width, reader.info().height);
        let size = reader
            .output_buffer_size()
            .filter(|_| u64::from(width) * u64::from(height) <= MAX_PIXELS);
        let size = size.ok_or_else(|| {
            Error::new(
                ErrorKind::File,
                format!("{width} x {height} pixels are too many"),
            )
        })?;
        let mut bytes = vec![0; size];
        let info = reader.next_frame(&mut bytes).map_err(bad)?;
        let (samples, colours) = match info.color_type {
            png::ColorType::Grayscale => (1, [0; 3]),
            png::ColorType::GrayscaleAlpha => (2, [0; 3]),
            png::ColorType::Rgba => (4, [0, 1, 2]),
            _ => (3, [0, 1, 2]),
        };
        let pixels = bytes[..info.buffer_size()].chunks_exact(samples);
        let values = pixels
            .map(|p| colours.map(|c| f32::from(p[c]) / 255.0))
            .collect();
        Ok(Texture {
            width,
            height,
            values,
        })
    }

    /// The value at a texture coordinate, bilinear between the centres of pixels.
    pub fn at(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let place = |t: f32, n: u32| {
            let x = (t - t.floor()) * n as f32 - 0.5;
            let low = x.floor();
            let wrap = |i: i64| i.rem_euclid(i64::from(n)) as usize;
            (wrap(low as i64), wrap(low as i64 + 1), x - low)
        };
        let (x0, x1, fx) = place(u, self.width);
        let (y0, y1, fy) = place(1.0 - v, self.height);
        let row = |y: usize| y * self.width as usize;
        let (top, bottom) = (row(y0), row(y1));
        std::array::from_fn(|c| {
            let mix =
                |row: usize| self.values[row + x0][c] * (1.0 - fx) + self.values[row + x1][c] * fx;
            (mix(top) * (1.0 - fy) + mix(bottom) * fy).clamp(0.0, 1.0)
        })
    }

    /// Whether red, green and blue differ anywhere.
    pub fn is_coloured(&self) -> bool {
        self.values.iter().any(|[r, g, b]| r != g || g != b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texture_has_its_values_at_the_centres_of_pixels_and_repeats() {
        let grey = |v: f32| [v; 3];
        let texture = Texture {
            width: 2,
            height: 2,
            values: vec![grey(0.0), grey(0.25), grey(0.5), grey(1.0)],
        };
        for shift in [0.0, 1.0, -3.0] {
            assert_eq!(texture.at([0.25 + shift, 0.75]), grey(0.0));
            assert_eq!(texture.at([0.75, 0.25 + shift]), grey(1.0));
        }
        assert_eq!(texture.at([0.5, 0.75]), grey(0.125));
        assert_eq!(texture.at([0.0, 0.75]), grey(0.125)); // the other side
    }
}
