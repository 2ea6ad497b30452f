//! Differences between two pictures.

use std::fmt;
use std::path::Path;

use deepshadow_frame::{Failure, Result};

use crate::image::Image;

/// Differences between the values of two pictures, over all pixels and channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Differences {
    /// Root of the mean squared difference.
    pub rmse: f64,
    /// Mean of the absolute differences.
    pub mean: f64,
    /// The largest absolute difference.
    pub max: f64,
}

impl Differences {
    /// Compares two pictures of the same size.
    ///
    /// # Errors
    /// `Failed` if the sizes differ or a value is not finite.
    pub fn between(a: &Image, b: &Image) -> Result<Self> {
        if (a.width, a.height) != (b.width, b.height) {
            return Err(Failure::Failed(format!(
                "{} x {} pixels cannot be compared with {} x {}",
                a.width, a.height, b.width, b.height
            )));
        }
        let (mut square, mut sum, mut max) = (0.0, 0.0, 0.0f64);
        for (a, b) in a.pixels.iter().flatten().zip(b.pixels.iter().flatten()) {
            let d = (f64::from(*a) - f64::from(*b)).abs();
            if !d.is_finite() {
                return Err(Failure::Failed(format!("{a} cannot be compared with {b}")));
            }
            (square, sum, max) = (square + d * d, sum + d, max.max(d));
        }
        let n = (3 * a.pixels.len()).max(1) as f64;
        Ok(Differences {
            rmse: (square / n).sqrt(),
            mean: sum / n,
            max,
        })
    }

    /// Peak signal-to-noise ratio in decibels, for a peak of 1. Infinite for equal pictures.
    pub fn psnr(&self) -> f64 {
        -20.0 * self.rmse.log10()
    }
}

impl fmt::Display for Differences {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "RMSE                {:.6}", self.rmse)?;
        writeln!(f, "mean difference     {:.6}", self.mean)?;
        writeln!(f, "largest difference  {:.6}", self.max)?;
        write!(f, "PSNR                {:.2} dB", self.psnr())
    }
}

/// Compares two files. If `difference` is a path, writes a picture of the difference there.
///
/// In that picture middle grey means equal. A channel is brighter where the first picture is.
///
/// # Errors
/// As [`Image::read`], [`Differences::between`] and [`Image::write`].
pub fn compare(a: &Path, b: &Path, difference: Option<&Path>) -> Result<Differences> {
    let (a, b) = (Image::read(a)?, Image::read(b)?);
    let found = Differences::between(&a, &b)?;
    if let Some(path) = difference {
        let pairs = a.pixels.iter().zip(&b.pixels);
        // 0.214 is the middle grey of sRGB.
        let grey = |d: f32| 0.214 * (1.0 + d) + 0.572 * d.max(0.0);
        let pixels = pairs.map(|(a, b)| std::array::from_fn(|c| grey(a[c] - b[c])));
        let drawn = Image {
            pixels: pixels.collect(),
            ..a
        };
        drawn.write(path)?;
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: [f32; 2]) -> Image {
        Image {
            width: 2,
            height: 1,
            pixels: values.map(|v| [v; 3]).to_vec(),
        }
    }

    #[test]
    fn equal_pictures_do_not_differ() {
        let found = Differences::between(&image([0.5, 2.0]), &image([0.5, 2.0])).unwrap();
        assert_eq!((found.rmse, found.mean, found.max), (0.0, 0.0, 0.0));
        assert_eq!(found.psnr(), f64::INFINITY);
    }

    #[test]
    fn differences_of_two_known_pixels_are_correct() {
        let found = Differences::between(&image([0.5, 0.0]), &image([0.1, 0.3])).unwrap();
        assert!((found.rmse - 0.125f64.sqrt()).abs() < 1e-7);
        assert!((found.mean - 0.35).abs() < 1e-7 && (found.max - 0.4).abs() < 1e-7);
        assert!((found.psnr() - 9.0309).abs() < 1e-3);
    }

    #[test]
    fn pictures_of_different_sizes_or_with_nan_cannot_be_compared() {
        let small = Image {
            width: 1,
            height: 1,
            pixels: vec![[0.0; 3]],
        };
        assert!(Differences::between(&image([0.0; 2]), &small).is_err());
        assert!(Differences::between(&image([0.0, f32::NAN]), &image([0.0; 2])).is_err());
    }
}
