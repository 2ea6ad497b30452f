//! Flat images with one number or one colour per pixel.

use std::io::Cursor;

use deepshadow::{Limits, MapHeader};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes,
    Vec2, WritableImage,
};

use crate::source::header::{exr_attributes, windows};
use deepshadow_frame::args::Region;
use deepshadow_frame::{Failure, Result};

/// Bytes of memory for a number: itself, its copy by channel, and its encoded bytes.
const NUMBER: u64 = 12;

/// A flat image of floats, pixel by pixel, one channel or three.
#[derive(Clone, Debug)]
pub struct Picture {
    width: u32,
    height: u32,
    channels: usize,
    values: Vec<f32>,
}

impl Picture {
    /// Creates an image without rows, with one channel or three.
    ///
    /// # Errors
    /// `Failed` if it would exceed the limits.
    pub fn new(width: u32, height: u32, coloured: bool, limits: Limits) -> Result<Self> {
        let channels = if coloured { 3 } else { 1 };
        let numbers = u64::from(width) * u64::from(height) * channels as u64;
        let fits = limits.check(NUMBER * numbers, "a flat image");
        fits.map_err(|e| {
            Failure::Failed(format!(
                "{e}: cut the map with --region, use a higher --level without --width, or raise \
                 --memory"
            ))
        })?;
        Ok(Picture {
            width,
            height,
            channels,
            values: Vec::with_capacity(numbers as usize),
        })
    }

    /// Adds the next pixels, row by row. An image of one channel takes the first number of each.
    pub fn extend(&mut self, pixels: impl IntoIterator<Item = [f32; 3]>) {
        for pixel in pixels {
            self.values.extend_from_slice(&pixel[..self.channels]);
        }
    }

    /// Returns the largest number, but at least 1.
    pub fn largest(&self) -> f32 {
        self.values.iter().fold(1.0, |m: f32, &v| m.max(v))
    }

    /// Returns an OpenEXR image in memory, with the windows of a level of the map and its camera.
    /// The picture begins at the first pixel of `region`.
    ///
    /// # Errors
    /// `Failed` if the encoder fails.
    pub fn exr(&self, header: &MapHeader, level: u32, region: Region) -> Result<Vec<u8>> {
        let (data, display) = windows(header, level, self.width, self.height);
        let first = [data.x, data.y].map(i64::from);
        let [x, y] = [0, 1].map(|i| (first[i] + i64::from(region[i])) as i32);
        let names: &[&str] = match self.channels {
            1 => &["Y"],
            _ => &["R", "G", "B"],
        };
        let channel = |(c, name): (usize, &&str)| {
            let values = self.values.iter().skip(c).step_by(self.channels);
            AnyChannel::new(*name, FlatSamples::F32(values.copied().collect()))
        };
        let channels = AnyChannels::sort(names.iter().enumerate().map(channel).collect());
        let mut attributes = LayerAttributes {
            layer_position: Vec2(x, y),
            ..LayerAttributes::default()
        };
        for a in exr_attributes(header).0 {
            let Some(m) = a.as_m44f() else { continue };
            match a.name.as_str() {
                "worldToCamera" => attributes.world_to_camera = Some(m),
                "worldToNDC" => attributes.world_to_normalized_device = Some(m),
                _ => {}
            }
        }
        let size = (self.width as usize, self.height as usize);
        let layer = Layer::new(size, attributes, Encoding::SMALL_LOSSLESS, channels);
        let mut image = Image::from_layer(layer);
        image.attributes.display_window = IntegerBounds::new(
            Vec2(display.x, display.y),
            Vec2(display.width as usize, display.height as usize),
        );
        let mut bytes = Cursor::new(Vec::new());
        let written = image.write().non_parallel().to_buffered(&mut bytes);
        written.map_err(|e| Failure::Failed(format!("cannot encode the image: {e}")))?;
        Ok(bytes.into_inner())
    }

    /// Returns a PNG image in memory: 16 bits, linear, scaled so that `white` is the largest value,
    /// and with `meaning` as its description.
    ///
    /// # Errors
    /// `Failed` if the encoder fails.
    pub fn png(&self, white: f32, meaning: &str) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_color(match self.channels {
            1 => png::ColorType::Grayscale,
            _ => png::ColorType::Rgb,
        });
        encoder.set_source_gamma(png::ScaledFloat::new(1.0));
        let failed =
            |e: png::EncodingError| Failure::Failed(format!("cannot encode the image: {e}"));
        encoder
            .add_text_chunk("Description".into(), meaning.into())
            .map_err(failed)?;
        let mut writer = encoder.write_header().map_err(failed)?;
        let scaled = |v: &f32| (f64::from(*v) / f64::from(white) * 65535.0).round() as u16;
        // PNG stores numbers with the high byte first.
        let data: Vec<u8> = self
            .values
            .iter()
            .map(scaled)
            .flat_map(|v| [(v >> 8) as u8, v as u8])
            .collect();
        writer.write_image_data(&data).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }
}
