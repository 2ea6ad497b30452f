//! Pictures in memory and in PNG or OpenEXR files.

use std::io::{BufReader, Cursor};
use std::path::Path;

use deepshadow::raw::AtomicFile;
use deepshadow_frame::foreign::FileKind;
use deepshadow_frame::output::{begin, finish};
use deepshadow_frame::stream::{Input, is_standard_output};
use deepshadow_frame::{Failure, InFile, Result};
use exr::prelude::{
    Encoding, Layer, LayerAttributes, ReadChannels, ReadLayers, SpecificChannels, WritableImage,
    read,
};

/// A picture in linear RGB, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

/// File format of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 8-bit sRGB. Values are clamped to 0 to 1.
    Png,
    /// Linear, 32-bit floats.
    Exr,
}

impl Format {
    /// The format with the extension of `path`; PNG for standard output.
    ///
    /// # Errors
    /// `Usage` for all but `.png` and `.exr`.
    pub fn of(path: &Path) -> Result<Self> {
        if is_standard_output(path) {
            return Ok(Format::Png);
        }
        let extension = path.extension().map(|e| e.to_ascii_lowercase());
        match extension.as_ref().and_then(|e| e.to_str()) {
            Some("png") => Ok(Format::Png),
            Some("exr") => Ok(Format::Exr),
            _ => Err(Failure::Usage(format!(
                "{}: pictures are .png or .exr files",
                path.display()
            ))),
        }
    }
}

impl Image {
    /// Reads a picture.
    ///
    /// From an OpenEXR file it reads the first layer with red, green and blue. It converts the sRGB
    /// values of a PNG file to linear values.
    ///
    /// # Errors
    /// `Usage` for another extension; `Failed`, naming the file.
    pub fn read(path: &Path) -> Result<Self> {
        let format = Format::of(path)?;
        let mut input = Input::open(path).in_file(path)?;
        let (name, kind) = match format {
            Format::Png => ("a PNG image", FileKind::Other("a PNG image")),
            Format::Exr => ("an OpenEXR file", FileKind::OpenExr),
        };
        let found = input.kind().in_file(path)?;
        if found != kind {
            return Err(Failure::Failed(format!("not {name}, but {found}"))).in_file(path);
        }
        let file = input.file().in_file(path)?;
        match format {
            Format::Png => from_png(file).in_file(path),
            Format::Exr => from_exr(file).in_file(path),
        }
    }

    /// Writes the picture to `path`, atomically.
    ///
    /// # Errors
    /// `Usage` for another extension; `Failed`, naming the file.
    pub fn write(&self, path: &Path) -> Result<()> {
        self.finish(begin(path)?, path)
    }

    /// Writes the picture to a file that `begin` began at `path`.
    ///
    /// # Errors
    /// As [`Image::write`].
    pub fn finish(&self, file: AtomicFile, path: &Path) -> Result<()> {
        let bytes = match Format::of(path)? {
            Format::Png => self.png(),
            Format::Exr => self.exr(),
        };
        finish(file, path, &bytes.in_file(path)?)
    }

    fn png(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
        let data: Vec<u8> = self.pixels.iter().flat_map(|p| p.map(srgb)).collect();
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&data).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }

    fn exr(&self) -> Result<Vec<u8>> {
        let width = self.width as usize;
        let channels = SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
            let [r, g, b] = self.pixels[at.y() * width + at.x()];
            (r, g, b)
        });
        let size = (width, self.height as usize);
        let layer = Layer::new(
            size,
            LayerAttributes::default(),
            Encoding::SMALL_LOSSLESS,
            channels,
        );
        let image = exr::prelude::Image::from_layer(layer);
        let mut bytes = Cursor::new(Vec::new());
        let written = image.write().non_parallel().to_buffered(&mut bytes);
        written.map_err(failed)?;
        Ok(bytes.into_inner())
    }
}

fn failed(e: impl std::fmt::Display) -> Failure {
    Failure::Failed(format!("no picture: {e}"))
}

fn from_png(file: std::fs::File) -> Result<Image> {
    let mut decoder = png::Decoder::new(BufReader::new(file));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(failed)?;
    let size = reader
        .output_buffer_size()
        .ok_or_else(|| failed("it is too large"))?;
    let mut data = vec![0; size];
    let info = reader.next_frame(&mut data).map_err(failed)?;
    let channels = info.color_type.samples();
    let colours = if channels >= 3 { [0, 1, 2] } else { [0; 3] };
    let pixels = data[..info.buffer_size()].chunks_exact(channels);
    Ok(Image {
        width: info.width,
        height: info.height,
        pixels: pixels.map(|p| colours.map(|c| linear(p[c]))).collect(),
    })
}

fn from_exr(file: std::fs::File) -> Result<Image> {
    let reader = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size: exr::math::Vec2<usize>, _| (size, vec![[0.0; 3]; size.area()]),
            |(size, pixels): &mut (exr::math::Vec2<usize>, Vec<[f32; 3]>), at, (r, g, b)| {
                let at: exr::math::Vec2<usize> = at;
                pixels[at.y() * size.x() + at.x()] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel();
    let image = reader.from_buffered(BufReader::new(file)).map_err(failed)?;
    let (size, pixels) = image.layer_data.channel_data.pixels;
    Ok(Image {
        width: size.x() as u32,
        height: size.y() as u32,
        pixels,
    })
}

/// Encodes a linear value as 8-bit sRGB (IEC 61966-2-1), clamped to 0 to 1.
fn srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let v = match v {
        v if v <= 0.003_130_8 => 12.92 * v,
        v => 1.055 * v.powf(1.0 / 2.4) - 0.055,
    };
    (v * 255.0).round() as u8
}

/// Decodes an 8-bit sRGB value.
fn linear(srgb: u8) -> f32 {
    match f32::from(srgb) / 255.0 {
        v if v <= 0.04045 => v / 12.92,
        v => ((v + 0.055) / 1.055).powf(2.4),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image() -> Image {
        let pixels = (0..6).map(|i| [i as f32 / 5.0, 0.25, 1.5 - i as f32]);
        Image {
            width: 3,
            height: 2,
            pixels: pixels.collect(),
        }
    }

    #[test]
    fn an_exr_picture_survives_a_round_trip_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        image().write(&path).unwrap();
        assert_eq!(Image::read(&path).unwrap(), image());
    }

    #[test]
    fn a_png_picture_survives_a_round_trip_within_its_steps_and_clamped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        image().write(&path).unwrap();
        let found = Image::read(&path).unwrap();
        for (a, b) in image().pixels.iter().zip(&found.pixels) {
            for c in 0..3 {
                assert!((a[c].clamp(0.0, 1.0) - b[c]).abs() < 0.005, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn every_step_of_srgb_survives_a_round_trip() {
        assert!((0..=255).all(|v| srgb(linear(v)) == v));
        assert_eq!(
            (srgb(-1.0), srgb(0.5), srgb(7.0), srgb(f32::NAN)),
            (0, 188, 255, 0)
        );
    }

    #[test]
    fn files_with_other_extensions_are_rejected() {
        let refused = Image::read(Path::new("a.jpg")).unwrap_err();
        assert!(matches!(refused, Failure::Usage(_)), "{refused}");
    }
}
