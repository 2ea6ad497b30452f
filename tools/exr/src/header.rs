//! The description of a part: windows, channels, compression and tiles.

use crate::attribute::Attribute;
use crate::error::{Error, Result};

/// A rectangle of pixels: top left pixel and size.
///
/// ```
/// use deepshadow_exr::Rect;
/// let r = Rect { x: -2, y: 3, width: 4, height: 1 };
/// assert!(r.contains(1, 3) && !r.contains(2, 3));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Rect {
    /// Column of the left pixels; may be negative.
    pub x: i32,
    /// Row of the top pixels; may be negative.
    pub y: i32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Rect {
    /// Number of pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// One past the right column.
    pub fn x_end(&self) -> i64 {
        i64::from(self.x) + i64::from(self.width)
    }

    /// One past the bottom row.
    pub fn y_end(&self) -> i64 {
        i64::from(self.y) + i64::from(self.height)
    }

    /// Whether pixel `x`, `y` lies inside.
    pub fn contains(&self, x: i32, y: i32) -> bool {
        x >= self.x && y >= self.y && i64::from(x) < self.x_end() && i64::from(y) < self.y_end()
    }

    /// Whether all of `other` lies inside.
    pub fn contains_rect(&self, other: &Rect) -> bool {
        other.x >= self.x
            && other.y >= self.y
            && other.x_end() <= self.x_end()
            && other.y_end() <= self.y_end()
    }

    /// The pixels in both, if any.
    pub fn intersection(&self, other: &Rect) -> Option<Rect> {
        let x = self.x.max(other.x);
        let y = self.y.max(other.y);
        let width = self.x_end().min(other.x_end()) - i64::from(x);
        let height = self.y_end().min(other.y_end()) - i64::from(y);
        (width > 0 && height > 0).then_some(Rect {
            x,
            y,
            width: width as u32,
            height: height as u32,
        })
    }
}

/// The three types of a channel's values, with their OpenEXR codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SampleType {
    /// Unsigned 32-bit integer, code 0.
    Uint,
    /// 16-bit float, code 1.
    Half,
    /// 32-bit float, code 2.
    Float,
}

impl SampleType {
    pub(crate) fn from_code(code: i32) -> Option<Self> {
        [SampleType::Uint, SampleType::Half, SampleType::Float]
            .into_iter()
            .find(|t| t.code() == code)
    }

    pub(crate) fn code(self) -> i32 {
        match self {
            SampleType::Uint => 0,
            SampleType::Half => 1,
            SampleType::Float => 2,
        }
    }

    /// Bytes of one value.
    pub fn bytes(self) -> usize {
        match self {
            SampleType::Half => 2,
            SampleType::Uint | SampleType::Float => 4,
        }
    }
}

/// One channel of a part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// Name with its layer prefix, such as `Z` or `smoke.A`.
    pub name: String,
    /// Type of its values.
    pub sample_type: SampleType,
    /// OpenEXR's `pLinear` hint, passed through unchanged.
    pub linear: bool,
    /// Columns and rows from one value to the next; (1, 1) in all deep parts.
    pub sampling: (i32, i32),
}

impl Channel {
    /// A channel with a value at every pixel or sample.
    pub fn new(name: impl Into<String>, sample_type: SampleType) -> Self {
        Channel {
            name: name.into(),
            sample_type,
            linear: false,
            sampling: (1, 1),
        }
    }
}

/// The compression of blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Compression {
    /// Uncompressed, code 0.
    None,
    /// Run-length encoding, code 1.
    Rle,
    /// zlib, one scanline per block, code 2. Most deep files use it.
    Zips,
    /// zlib, 16 scanlines per block, code 3; flat images only.
    Zip,
    /// Wavelets, code 4; flat images only.
    Piz,
    /// 24-bit floats, code 5; flat images only, lossy.
    Pxr24,
    /// Code 6; flat images only, lossy.
    B44,
    /// Code 7; flat images only, lossy.
    B44a,
    /// Code 8; flat images only, lossy.
    Dwaa,
    /// Code 9; flat images only, lossy.
    Dwab,
    /// Zstandard, code 13, since OpenEXR 3.5. Compresses deep data best.
    Zstd,
    /// Any other code. This crate cannot read or write it.
    Other(u8),
}

impl Compression {
    /// The compression with the OpenEXR code `code`.
    pub fn from_code(code: u8) -> Self {
        use Compression::*;
        match code {
            0 => None,
            1 => Rle,
            2 => Zips,
            3 => Zip,
            4 => Piz,
            5 => Pxr24,
            6 => B44,
            7 => B44a,
            8 => Dwaa,
            9 => Dwab,
            13 => Zstd,
            other => Other(other),
        }
    }

    /// OpenEXR's code.
    pub fn code(self) -> u8 {
        use Compression::*;
        match self {
            None => 0,
            Rle => 1,
            Zips => 2,
            Zip => 3,
            Piz => 4,
            Pxr24 => 5,
            B44 => 6,
            B44a => 7,
            Dwaa => 8,
            Dwab => 9,
            Zstd => 13,
            Other(code) => code,
        }
    }

    /// Whether OpenEXR allows this compression in deep parts.
    pub fn supports_deep(self) -> bool {
        matches!(
            self,
            Compression::None | Compression::Rle | Compression::Zips | Compression::Zstd
        )
    }

    /// Scanlines in a block of a scanline part; `None` for an unknown code.
    pub(crate) fn lines_per_block(self) -> Option<u32> {
        use Compression::*;
        Some(match self {
            None | Rle | Zips | Zstd => 1,
            Zip | Pxr24 => 16,
            Piz | B44 | B44a | Dwaa => 32,
            Dwab => 256,
            Other(10) => 256,
            Other(11) => 32,
            Other(_) => return Option::None,
        })
    }
}

/// The order of blocks in the file. It does not affect readers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LineOrder {
    /// Top first.
    Increasing,
    /// Bottom first.
    Decreasing,
    /// In the order in which they are written; tiled parts only.
    Random,
}

impl LineOrder {
    pub(crate) fn from_code(code: u8) -> Option<Self> {
        [
            LineOrder::Increasing,
            LineOrder::Decreasing,
            LineOrder::Random,
        ]
        .into_iter()
        .find(|o| o.code() == code)
    }

    pub(crate) fn code(self) -> u8 {
        match self {
            LineOrder::Increasing => 0,
            LineOrder::Decreasing => 1,
            LineOrder::Random => 2,
        }
    }
}

/// The smaller levels of a tiled part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LevelMode {
    /// No smaller levels.
    One,
    /// Width and height are halved together.
    Mipmap,
    /// Width and height are halved independently.
    Ripmap,
}

/// The tiling of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Tiles {
    /// Columns of a tile.
    pub width: u32,
    /// Rows of a tile.
    pub height: u32,
    /// The smaller levels. This crate reads and writes only the full-size level.
    pub levels: LevelMode,
    /// Whether the sizes of smaller levels are rounded up.
    pub round_up: bool,
}

impl Tiles {
    /// Tiles without smaller levels.
    pub fn new(width: u32, height: u32) -> Self {
        Tiles {
            width,
            height,
            levels: LevelMode::One,
            round_up: false,
        }
    }
}

/// The description of one image in a file.
///
/// [`DeepReader::parts`](crate::DeepReader::parts) returns the parts of a file, and
/// [`DeepWriter`](crate::DeepWriter) takes those of a new one. To convert a file, clone a part and
/// change its `compression` or `tiles`.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name; required in multi-part files.
    pub name: Option<String>,
    /// Whether pixels have any number of samples; in flat parts they have one.
    pub deep: bool,
    /// The pixels that are stored.
    pub data_window: Rect,
    /// The pixels of the visible picture.
    pub display_window: Rect,
    /// Channels, sorted by name.
    pub channels: Vec<Channel>,
    /// Compression of the blocks.
    pub compression: Compression,
    /// The order of blocks in the file.
    pub line_order: LineOrder,
    /// The tiling; `None` for scanlines.
    pub tiles: Option<Tiles>,
    /// All header attributes with raw values, in the file's order, including the fields above.
    ///
    /// A writer ignores attributes that repeat a field above, and those that it computes: `type`,
    /// `version`, `chunkCount` and `maxSamplesPerPixel`.
    pub attributes: Vec<Attribute>,
}

impl Part {
    /// A deep scanline part with ZIPS; its display window is the data window.
    pub fn deep_scanline(data_window: Rect, channels: Vec<Channel>) -> Self {
        Part {
            name: None,
            deep: true,
            data_window,
            display_window: data_window,
            channels,
            compression: Compression::Zips,
            line_order: LineOrder::Increasing,
            tiles: None,
            attributes: Vec::new(),
        }
    }

    /// A deep tiled part with ZIPS whose tiles may be written in any order.
    ///
    /// Nuke does not read deep tiles; prefer scanlines for files that you exchange.
    pub fn deep_tiled(data_window: Rect, channels: Vec<Channel>, tiles: Tiles) -> Self {
        Part {
            tiles: Some(tiles),
            line_order: LineOrder::Random,
            ..Self::deep_scanline(data_window, channels)
        }
    }

    /// The attribute with the name `name`.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|a| a.name == name)
    }

    /// Index of the channel with the name `name`.
    pub fn channel(&self, name: &str) -> Option<usize> {
        self.channels.iter().position(|c| c.name == name)
    }

    /// Bytes of one sample over all channels.
    pub fn sample_bytes(&self) -> usize {
        self.channels.iter().map(|c| c.sample_type.bytes()).sum()
    }

    /// Bytes of one value of each channel.
    pub(crate) fn channel_bytes(&self) -> Vec<usize> {
        self.channels
            .iter()
            .map(|c| c.sample_type.bytes())
            .collect()
    }

    /// All names in the header: of channels, attributes and attribute types.
    pub(crate) fn header_names(&self) -> impl Iterator<Item = &String> {
        let attributes = self.attributes.iter();
        let channels = self.channels.iter().map(|c| &c.name);
        channels.chain(attributes.flat_map(|a| [&a.name, &a.type_name]))
    }

    /// Checks that the part divides into blocks of known size.
    pub(crate) fn check_geometry(&self) -> Result<()> {
        let w = &self.data_window;
        if w.width == 0 || w.height == 0 {
            return Err(Error::corrupt("the data window is empty"));
        }
        if let Some(t) = &self.tiles {
            if t.width == 0 || t.height == 0 {
                return Err(Error::corrupt("a tile has no pixels"));
            }
            if t.width > i32::MAX as u32 || t.height > i32::MAX as u32 {
                return Err(Error::corrupt("a tile side is 2^31 or more"));
            }
        }
        if self.deep && self.channels.iter().any(|c| c.sampling != (1, 1)) {
            return Err(Error::corrupt("a deep channel is subsampled"));
        }
        Ok(())
    }
}
