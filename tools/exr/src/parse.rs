//! Parses the headers of a file.

use crate::attribute::Attribute;
use crate::error::{Error, Result};
use crate::header::{Channel, Compression, LevelMode, LineOrder, Part, Rect, SampleType, Tiles};
use crate::limits::{Limits, PER_HEADER_BYTE};
use crate::source::Source;

/// The first four bytes of every OpenEXR file.
pub(crate) const MAGIC: u32 = 20_000_630;
/// The only version of the format.
pub(crate) const VERSION: u32 = 2;
/// Flag: the file has one part of flat tiles.
pub(crate) const FLAG_TILED: u32 = 0x200;
/// Flag: names have up to 255 bytes instead of 31.
pub(crate) const FLAG_LONG_NAMES: u32 = 0x400;
/// Flag: a part is deep.
pub(crate) const FLAG_DEEP: u32 = 0x800;
/// Flag: the file has several parts.
pub(crate) const FLAG_MULTIPART: u32 = 0x1000;

/// The parsed headers of a file.
pub(crate) struct Headers {
    pub(crate) parts: Vec<Part>,
    /// Length of each part's offset table.
    pub(crate) chunk_counts: Vec<u64>,
    pub(crate) multipart: bool,
    /// First byte after the headers.
    pub(crate) end: u64,
}

/// Reads the headers in order, through a small buffer.
struct HeaderReader<'a> {
    source: &'a Source,
    limits: &'a Limits,
    buffer: Vec<u8>,
    /// Byte offset of the buffer in the file.
    start: u64,
    /// Index of the next byte in the buffer.
    at: usize,
}

impl HeaderReader<'_> {
    fn position(&self) -> u64 {
        self.start + self.at as u64
    }

    fn take(&mut self, len: usize) -> Result<&[u8]> {
        let position = self.position();
        let bytes = (position + len as u64).saturating_mul(PER_HEADER_BYTE);
        let checked = self.limits.check("the headers", bytes);
        checked.map_err(|e| e.at_byte(position))?;
        if self.buffer.len() - self.at < len {
            let left = self.source.len() - position;
            if (len as u64) > left {
                return Err(Error::corrupt("the file ends inside a header").at_byte(position));
            }
            let fetch = (len as u64).max(4096).min(left);
            self.source.read_vec(&mut self.buffer, position, fetch)?;
            self.start = position;
            self.at = 0;
        }
        let bytes = &self.buffer[self.at..self.at + len];
        self.at += len;
        Ok(bytes)
    }

    fn u8(&mut self) -> Result<u8> {
        Ok(self.take(1)?[0])
    }

    fn i32(&mut self) -> Result<i32> {
        let b = self.take(4)?;
        Ok(i32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }

    /// Reads a zero-terminated name; an empty name ends a list.
    fn name(&mut self, max: usize) -> Result<String> {
        let position = self.position();
        let mut bytes = Vec::new();
        loop {
            match self.u8()? {
                0 => break,
                _ if bytes.len() == max => {
                    return Err(Error::corrupt(format!("a name is longer than {max} bytes"))
                        .at_byte(position));
                }
                byte => bytes.push(byte),
            }
        }
        String::from_utf8(bytes)
            .map_err(|_| Error::corrupt("a name is not UTF-8").at_byte(position))
    }
}

/// Reads all headers.
pub(crate) fn read_headers(source: &Source, limits: &Limits) -> Result<Headers> {
    let mut cursor = HeaderReader {
        source,
        limits,
        buffer: Vec::new(),
        start: 0,
        at: 0,
    };
    let not_exr = || Error::corrupt("no OpenEXR magic number").at_byte(0);
    if source.len() < 4 || cursor.i32()? != MAGIC as i32 {
        return Err(not_exr());
    }
    let version = cursor.i32()? as u32;
    let known = FLAG_TILED | FLAG_LONG_NAMES | FLAG_DEEP | FLAG_MULTIPART;
    if version & 0xff != VERSION || version & !0xff & !known != 0 {
        return Err(Error::unsupported(format!(
            "version {} with flags {:#x}",
            version & 0xff,
            version & !0xff
        ))
        .at_byte(4));
    }
    let multipart = version & FLAG_MULTIPART != 0;
    if version & FLAG_TILED != 0 && version & (FLAG_DEEP | FLAG_MULTIPART) != 0 {
        return Err(Error::corrupt(
            "the flag for flat tiles excludes the flags for deep and for several parts",
        )
        .at_byte(4));
    }

    let mut parts = Vec::new();
    let mut chunk_counts = Vec::new();
    loop {
        let position = cursor.position();
        let attributes = read_attributes(&mut cursor)?;
        if multipart && attributes.is_empty() && !parts.is_empty() {
            break;
        }
        let in_part = |e: Error| e.at_byte(position).in_part(parts.len());
        let part = part_from(attributes, version).map_err(in_part)?;
        let count = checked_chunk_count(&part, multipart).map_err(in_part)?;
        parts.push(part);
        chunk_counts.push(count);
        if !multipart {
            break;
        }
    }
    Ok(Headers {
        parts,
        chunk_counts,
        multipart,
        end: cursor.position(),
    })
}

/// Reads the attributes of one part, up to the empty name that ends them.
///
/// Names may have 255 bytes even without the flag for long names: some writers forget it.
fn read_attributes(cursor: &mut HeaderReader<'_>) -> Result<Vec<Attribute>> {
    let mut attributes: Vec<Attribute> = Vec::new();
    let mut names = std::collections::HashSet::new();
    loop {
        let position = cursor.position();
        let name = cursor.name(255)?;
        if name.is_empty() {
            return Ok(attributes);
        }
        let type_name = cursor.name(255)?;
        let size = cursor.i32()?;
        let Ok(size) = usize::try_from(size) else {
            return Err(
                Error::corrupt(format!("attribute {name:?} has a size of {size} bytes"))
                    .at_byte(position),
            );
        };
        if size as u64 > cursor.source.len() - cursor.position() {
            return Err(Error::corrupt(format!(
                "attribute {name:?} has {size} bytes, more than the file has left"
            ))
            .at_byte(position));
        }
        if !names.insert(name.clone()) {
            return Err(
                Error::corrupt(format!("attribute {name:?} occurs twice")).at_byte(position)
            );
        }
        let value = cursor.take(size)?.to_vec();
        attributes.push(Attribute {
            name,
            type_name,
            value,
        });
    }
}

fn part_from(attributes: Vec<Attribute>, version: u32) -> Result<Part> {
    let value = |name: &str, type_name: &str, size: Option<usize>| -> Result<Option<&[u8]>> {
        let Some(a) = attributes.iter().find(|a| a.name == name) else {
            return Ok(None);
        };
        if a.type_name != type_name || size.is_some_and(|s| s != a.value.len()) {
            return Err(Error::corrupt(format!(
                "attribute {name:?} has type {:?} and {} bytes instead of type {type_name:?}",
                a.type_name,
                a.value.len()
            )));
        }
        Ok(Some(&a.value))
    };
    let required = |name: &str, type_name: &str, size: Option<usize>| {
        value(name, type_name, size)?
            .ok_or_else(|| Error::corrupt(format!("attribute {name:?} is missing")))
    };

    // `type` is reliable only in multi-part and deep files; the flags are always.
    let from_type = version & (FLAG_DEEP | FLAG_MULTIPART) != 0;
    let (deep, tiled) = if from_type {
        match required("type", "string", None)? {
            b"scanlineimage" => (false, false),
            b"tiledimage" => (false, true),
            b"deepscanline" => (true, false),
            b"deeptile" => (true, true),
            other => {
                return Err(Error::unsupported(format!(
                    "a part of type {:?}",
                    String::from_utf8_lossy(&other[..other.len().min(40)])
                )));
            }
        }
    } else {
        (false, version & FLAG_TILED != 0)
    };
    let name = match value("name", "string", None)? {
        Some(bytes) => Some(
            String::from_utf8(bytes.to_vec())
                .map_err(|_| Error::corrupt("the part's name is not UTF-8"))?,
        ),
        None if version & FLAG_MULTIPART != 0 => {
            return Err(Error::corrupt("attribute \"name\" is missing"));
        }
        None => None,
    };
    let compression = Compression::from_code(required("compression", "compression", Some(1))?[0]);
    if compression.code() > 13 {
        return Err(Error::unsupported(format!(
            "compression {} is unknown",
            compression.code()
        )));
    }
    if deep && !compression.supports_deep() {
        return Err(Error::unsupported(format!(
            "a deep part with compression {compression:?}"
        )));
    }
    let code = required("lineOrder", "lineOrder", Some(1))?[0];
    let line_order = LineOrder::from_code(code)
        .ok_or_else(|| Error::corrupt(format!("line order {code} is unknown")))?;
    let tiles = if tiled {
        Some(tiles_from(required("tiles", "tiledesc", Some(9))?)?)
    } else {
        None
    };
    let part = Part {
        name,
        deep,
        data_window: window_from(required("dataWindow", "box2i", Some(16))?, "data")?,
        display_window: window_from(required("displayWindow", "box2i", Some(16))?, "display")?,
        channels: channels_from(required("channels", "chlist", None)?)?,
        compression,
        line_order,
        tiles,
        attributes: Vec::new(),
    };
    part.check_geometry()?;
    Ok(Part { attributes, ..part })
}

/// The number of chunks of the part; `chunkCount` must agree with it.
fn checked_chunk_count(part: &Part, multipart: bool) -> Result<u64> {
    let count = part.chunk_count()?;
    match part.attribute("chunkCount").map(|a| a.as_int()) {
        Some(Some(stated)) if u64::try_from(stated).is_ok_and(|stated| stated == count) => {
            Ok(count)
        }
        Some(stated) if multipart || part.deep => Err(Error::corrupt(format!(
            "chunkCount is {}, but the part has {count} blocks",
            stated.map_or("not an int".into(), |s| s.to_string())
        ))),
        None if multipart => Err(Error::corrupt("attribute \"chunkCount\" is missing")),
        _ => Ok(count),
    }
}

fn i32_at(bytes: &[u8], at: usize) -> i32 {
    i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Decodes a `box2i`, the first and the last pixel of a window.
fn window_from(b: &[u8], which: &str) -> Result<Rect> {
    let [x0, y0, x1, y1] = [0, 4, 8, 12].map(|at| i32_at(b, at));
    let bad = || Error::corrupt(format!("invalid {which} window: {x0},{y0} to {x1},{y1}"));
    // OpenEXR's own limit, so that no sum of two coordinates overflows.
    let max_coordinate = i32::MAX / 2;
    if [x0, y0, x1, y1]
        .iter()
        .any(|v| !(-max_coordinate..=max_coordinate).contains(v))
    {
        return Err(bad());
    }
    if x1 < x0 || y1 < y0 {
        return Err(bad());
    }
    Ok(Rect {
        x: x0,
        y: y0,
        width: (x1 - x0 + 1) as u32,
        height: (y1 - y0 + 1) as u32,
    })
}

fn tiles_from(b: &[u8]) -> Result<Tiles> {
    let tiles = Tiles {
        width: i32_at(b, 0) as u32,
        height: i32_at(b, 4) as u32,
        levels: match b[8] & 0xf {
            0 => LevelMode::One,
            1 => LevelMode::Mipmap,
            2 => LevelMode::Ripmap,
            other => return Err(Error::corrupt(format!("level mode {other} is unknown"))),
        },
        round_up: match b[8] >> 4 {
            0 => false,
            1 => true,
            other => return Err(Error::corrupt(format!("rounding {other} is unknown"))),
        },
    };
    Ok(tiles)
}

/// Decodes a `chlist` and sorts it by name, as the data is sorted.
fn channels_from(mut b: &[u8]) -> Result<Vec<Channel>> {
    let truncated = || Error::corrupt("the channel list is truncated");
    let mut channels = Vec::new();
    loop {
        let end = b.iter().position(|&c| c == 0).ok_or_else(truncated)?;
        if end == 0 {
            if b.len() > 1 {
                return Err(Error::corrupt("bytes follow the channel list"));
            }
            break;
        }
        if end > 255 {
            return Err(Error::corrupt("a channel's name is longer than 255 bytes"));
        }
        let name = std::str::from_utf8(&b[..end])
            .map_err(|_| Error::corrupt("a channel's name is not UTF-8"))?;
        let rest = &b[end + 1..];
        if rest.len() < 16 {
            return Err(truncated());
        }
        let code = i32_at(rest, 0);
        let sample_type = SampleType::from_code(code).ok_or_else(|| {
            Error::corrupt(format!("channel {name:?} has the unknown type {code}"))
        })?;
        let sampling = (i32_at(rest, 8), i32_at(rest, 12));
        if sampling.0 < 1 || sampling.1 < 1 {
            return Err(Error::corrupt(format!(
                "channel {name:?} has the sampling {},{}",
                sampling.0, sampling.1
            )));
        }
        channels.push(Channel {
            name: name.to_owned(),
            sample_type,
            linear: rest[4] != 0,
            sampling,
        });
        b = &rest[16..];
    }
    if channels.is_empty() {
        return Err(Error::corrupt("there are no channels"));
    }
    channels.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(w) = channels.windows(2).find(|w| w[0].name == w[1].name) {
        return Err(Error::corrupt(format!(
            "channel {:?} occurs twice",
            w[0].name
        )));
    }
    Ok(channels)
}
