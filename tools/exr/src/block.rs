//! A block of samples in memory.

use crate::error::{Error, Place, Result};
use crate::header::{Channel, Part, Rect, SampleType};
use half::f16;
use std::ops::Range;

/// The values of one channel of a block, in the channel's type.
#[derive(Clone, Debug, PartialEq)]
pub enum ChannelData {
    /// 16-bit floats.
    Half(Vec<f16>),
    /// 32-bit floats.
    Float(Vec<f32>),
    /// Unsigned integers.
    Uint(Vec<u32>),
}

impl ChannelData {
    /// An empty channel.
    pub fn new(sample_type: SampleType) -> Self {
        match sample_type {
            SampleType::Half => ChannelData::Half(Vec::new()),
            SampleType::Float => ChannelData::Float(Vec::new()),
            SampleType::Uint => ChannelData::Uint(Vec::new()),
        }
    }

    /// The halves nearest to `values`, ties to even; values that round above 65504 are infinite.
    ///
    /// ```
    /// use deepshadow_exr::ChannelData;
    /// let h = ChannelData::half_from_f32(&[0.1, 65519.0, 65520.0]);
    /// assert_eq!((h.get(0), h.get(1), h.get(2)), (0.099975586, 65504.0, f32::INFINITY));
    /// ```
    pub fn half_from_f32(values: &[f32]) -> Self {
        ChannelData::Half(values.iter().map(|&v| f16::from_f32(v)).collect())
    }

    /// Type of the values.
    pub fn sample_type(&self) -> SampleType {
        match self {
            ChannelData::Half(_) => SampleType::Half,
            ChannelData::Float(_) => SampleType::Float,
            ChannelData::Uint(_) => SampleType::Uint,
        }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            ChannelData::Half(v) => v.len(),
            ChannelData::Float(v) => v.len(),
            ChannelData::Uint(v) => v.len(),
        }
    }

    /// Whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Value `i` as a float: exact, except that integers above 2^24 are rounded.
    ///
    /// # Panics
    /// If there is no value `i`.
    pub fn get(&self, i: usize) -> f32 {
        match self {
            ChannelData::Half(v) => v[i].to_f32(),
            ChannelData::Float(v) => v[i],
            ChannelData::Uint(v) => v[i] as f32,
        }
    }

    /// Appends `value` in the channel's type: halves are rounded, integers saturate (NaN gives 0).
    pub fn push(&mut self, value: f32) {
        match self {
            ChannelData::Half(v) => v.push(f16::from_f32(value)),
            ChannelData::Float(v) => v.push(value),
            ChannelData::Uint(v) => v.push(value as u32),
        }
    }

    /// Appends the values `range` of `other`, which must have the same type.
    pub(crate) fn extend(&mut self, other: &ChannelData, range: Range<usize>) {
        match (self, other) {
            (ChannelData::Half(a), ChannelData::Half(b)) => a.extend_from_slice(&b[range]),
            (ChannelData::Float(a), ChannelData::Float(b)) => a.extend_from_slice(&b[range]),
            (ChannelData::Uint(a), ChannelData::Uint(b)) => a.extend_from_slice(&b[range]),
            _ => unreachable!("blocks of one part have the same types"),
        }
    }

    /// Clears the values, sets the type, and reserves memory for `len` values.
    pub(crate) fn reset(&mut self, sample_type: SampleType, len: usize) {
        if self.sample_type() != sample_type {
            *self = ChannelData::new(sample_type);
        }
        match self {
            ChannelData::Half(v) => {
                v.clear();
                v.reserve_exact(len);
            }
            ChannelData::Float(v) => {
                v.clear();
                v.reserve_exact(len);
            }
            ChannelData::Uint(v) => {
                v.clear();
                v.reserve_exact(len);
            }
        }
    }

    /// Appends values from little-endian bytes.
    pub(crate) fn extend_le(&mut self, bytes: &[u8]) {
        let four = |b: &[u8]| [b[0], b[1], b[2], b[3]];
        match self {
            ChannelData::Half(v) => {
                v.extend(
                    bytes
                        .chunks_exact(2)
                        .map(|b| f16::from_le_bytes([b[0], b[1]])),
                );
            }
            ChannelData::Float(v) => {
                v.extend(bytes.chunks_exact(4).map(|b| f32::from_le_bytes(four(b))));
            }
            ChannelData::Uint(v) => {
                v.extend(bytes.chunks_exact(4).map(|b| u32::from_le_bytes(four(b))));
            }
        }
    }

    /// Appends the values `range` to `out` as little-endian bytes.
    pub(crate) fn write_le(&self, range: Range<usize>, out: &mut Vec<u8>) {
        match self {
            ChannelData::Half(v) => out.extend(v[range].iter().flat_map(|v| v.to_le_bytes())),
            ChannelData::Float(v) => out.extend(v[range].iter().flat_map(|v| v.to_le_bytes())),
            ChannelData::Uint(v) => out.extend(v[range].iter().flat_map(|v| v.to_le_bytes())),
        }
    }
}

/// The samples of a rectangle of pixels.
///
/// Pixels are ordered row by row from the top left. Pixel `p` has the samples
/// `offsets[p]..offsets[p + 1]` of every channel, in the file's order; they need not be sorted by
/// depth.
///
/// ```
/// use deepshadow_exr::{ChannelData, DeepBlock, Rect};
/// let block = DeepBlock {
///     rect: Rect { x: 10, y: 20, width: 2, height: 1 },
///     offsets: vec![0, 0, 2], // the left pixel is empty
///     channels: vec![ChannelData::Float(vec![1.5, 2.5])],
/// };
/// let samples = block.samples(11, 20).unwrap();
/// assert_eq!(samples, 0..2);
/// assert_eq!(block.channels[0].get(samples.start), 1.5);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeepBlock {
    /// The pixels.
    pub rect: Rect,
    /// Index of each pixel's first sample, then the number of samples.
    pub offsets: Vec<u32>,
    /// The channels of the part, in its order.
    pub channels: Vec<ChannelData>,
}

impl DeepBlock {
    /// An empty block of `rect`; add its pixels with [`DeepBlock::push_pixel`].
    pub fn with_channels(rect: Rect, channels: &[Channel]) -> Self {
        DeepBlock {
            rect,
            offsets: vec![0],
            channels: channels
                .iter()
                .map(|c| ChannelData::new(c.sample_type))
                .collect(),
        }
    }

    /// Completes a pixel. Its samples are those pushed to the channels since the previous pixel.
    ///
    /// # Panics
    /// If there are 2^32 samples or more.
    pub fn push_pixel(&mut self) {
        let len = self.channels.first().map_or(0, ChannelData::len);
        let len = u32::try_from(len).expect("a block has fewer than 2^32 samples");
        self.offsets.push(len);
    }

    /// Number of samples.
    pub fn sample_count(&self) -> usize {
        self.offsets.last().map_or(0, |&n| n as usize)
    }

    /// The samples of pixel `x`, `y`, or `None` outside the block.
    pub fn samples(&self, x: i32, y: i32) -> Option<Range<usize>> {
        if !self.rect.contains(x, y) {
            return None;
        }
        self.pixel(self.pixel_index(x, y))
    }

    /// Index of a pixel inside the block, row by row.
    fn pixel_index(&self, x: i32, y: i32) -> usize {
        let dx = i64::from(x) - i64::from(self.rect.x);
        let dy = i64::from(y) - i64::from(self.rect.y);
        dy as usize * self.rect.width as usize + dx as usize
    }

    /// The samples of the pixel with index `p`, row by row, or `None` beyond the last pixel.
    pub fn pixel(&self, p: usize) -> Option<Range<usize>> {
        let (a, b) = (*self.offsets.get(p)?, *self.offsets.get(p + 1)?);
        Some(a as usize..b as usize)
    }

    /// The pixels of `rect`, or `None` unless all of `rect` lies inside the block.
    pub fn crop(&self, rect: Rect) -> Option<DeepBlock> {
        if !self.rect.contains_rect(&rect) {
            return None;
        }
        let mut out = DeepBlock {
            rect,
            offsets: vec![0],
            channels: Vec::new(),
        };
        for c in &self.channels {
            out.channels.push(ChannelData::new(c.sample_type()));
        }
        for row in 0..rect.height as usize {
            let first = self.pixel_index(rect.x, rect.y) + row * self.rect.width as usize;
            out.append_row(self, first, rect.width as usize);
        }
        Some(out)
    }

    /// Appends the pixels `first..first + count` of `other`.
    pub(crate) fn append_row(&mut self, other: &DeepBlock, first: usize, count: usize) {
        let offsets = &other.offsets[first..=first + count];
        let (start, end) = (offsets[0], offsets[count]);
        let base = self.offsets.last().copied().unwrap_or(0);
        self.offsets
            .extend(offsets[1..].iter().map(|&o| base + (o - start)));
        for (mine, theirs) in self.channels.iter_mut().zip(&other.channels) {
            mine.extend(theirs, start as usize..end as usize);
        }
    }

    /// Checks that the block is consistent and has the channels of `part`.
    pub(crate) fn check(&self, part: &Part) -> Result<()> {
        let invalid = |message: String| Err(Error::input(message));
        let pixels = self.rect.pixels();
        if self.offsets.len() as u64 != pixels + 1 || self.offsets[0] != 0 {
            return invalid(format!(
                "a block of {pixels} pixels needs {} offsets that start with 0, not {}",
                pixels + 1,
                self.offsets.len()
            ));
        }
        if let Some(p) = self.offsets.windows(2).position(|w| w[0] > w[1]) {
            let width = self.rect.width as usize;
            let pixel = (
                self.rect.x.wrapping_add((p % width) as i32),
                self.rect.y.wrapping_add((p / width) as i32),
            );
            return Err(Error::input("the offsets of the block decrease").at(Place {
                pixel: Some(pixel),
                ..Place::default()
            }));
        }
        if self.channels.len() != part.channels.len() {
            return invalid(format!(
                "the block has {} channels, but the part has {}",
                self.channels.len(),
                part.channels.len()
            ));
        }
        for (data, channel) in self.channels.iter().zip(&part.channels) {
            if data.sample_type() != channel.sample_type || data.len() != self.sample_count() {
                return invalid(format!(
                    "channel {:?} holds {} values of type {:?} instead of {} of type {:?}",
                    channel.name,
                    data.len(),
                    data.sample_type(),
                    self.sample_count(),
                    channel.sample_type
                ));
            }
        }
        Ok(())
    }
}
