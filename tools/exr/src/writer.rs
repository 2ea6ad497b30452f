//! Writing block by block.

use crate::attribute::Attribute;
use crate::block::DeepBlock;
use crate::codec::{self, Layout};
use crate::error::{Error, Place, Result};
use crate::header::{Compression, LevelMode, LineOrder, Part, Rect};
use crate::parse::{FLAG_DEEP, FLAG_LONG_NAMES, FLAG_MULTIPART, MAGIC, VERSION};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::NamedTempFile;

/// Writes deep parts, one block or band of lines after the other.
///
/// Holds the headers and 8 bytes per block. Lines come from the top (from the bottom for
/// [`LineOrder::Decreasing`]); tiles in any order for [`LineOrder::Random`], else row by row.
///
/// To pack on several threads, give each a [`DeepWriter::encoder`] and write what they return.
///
/// A file by path is written beside its final place and moved there by [`DeepWriter::finish`]: whatever
/// happens before, an older file of that name stays whole.
pub struct DeepWriter<W: Write + Seek = File> {
    out: Out<W>,
    parts: Vec<PartState>,
    level: Option<i32>,
    multipart: bool,
    /// Next byte to be written.
    position: u64,
    /// Where the first offset table begins.
    tables: u64,
}

enum Out<W: Write + Seek> {
    Plain(BufWriter<W>),
    Temporary(BufWriter<NamedTempFile>, PathBuf),
}

struct PartState {
    part: Arc<Part>,
    /// Where each block lies; 0 before it is written.
    offsets: Vec<u64>,
    /// Blocks written, and thus the next one where their order is fixed.
    written: usize,
    max_samples: u32,
    /// Where the value of `maxSamplesPerPixel` lies.
    max_samples_at: u64,
}

/// Packs blocks of one part, on any thread.
#[derive(Clone, Debug)]
pub struct BlockEncoder {
    part: Arc<Part>,
    index: usize,
    multipart: bool,
    level: Option<i32>,
}

/// A packed block, ready for [`DeepWriter::write_encoded`].
#[derive(Clone, Debug)]
pub struct EncodedBlock {
    part: usize,
    block: usize,
    bytes: Vec<u8>,
    max_samples: u32,
}

impl DeepWriter<File> {
    /// Creates a file at `path` once it is finished.
    ///
    /// # Errors
    /// `Io` if no file can be made in that folder, otherwise as for [`DeepWriter::new`].
    pub fn create(path: impl AsRef<Path>, parts: Vec<Part>) -> Result<Self> {
        let path = path.as_ref();
        let folder = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".deepshadow-").suffix(".part");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // What the umask leaves of it, as for any new file.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let file = builder
            .tempfile_in(folder)
            .map_err(|e| Error::io(format!("cannot create a file in {}", folder.display()), e))?;
        let out = BufWriter::with_capacity(1 << 18, file);
        Self::start(Out::Temporary(out, path.to_owned()), parts)
    }
}

impl<W: Write + Seek> DeepWriter<W> {
    /// Writes to a stream, from its position 0.
    ///
    /// # Errors
    /// `Input` if there are no parts or one cannot be written as described: it is not deep, has no
    /// channels or two of one name, a compression that is not for deep data, smaller levels, an empty
    /// window, or no name of its own in a file of several; `Io` where writing fails.
    pub fn new(stream: W, parts: Vec<Part>) -> Result<Self> {
        Self::start(Out::Plain(BufWriter::with_capacity(1 << 18, stream)), parts)
    }

    fn start(out: Out<W>, mut parts: Vec<Part>) -> Result<Self> {
        let multipart = parts.len() > 1;
        if parts.is_empty() {
            return Err(Error::input("a file needs at least one part"));
        }
        for (index, part) in parts.iter_mut().enumerate() {
            check_part(part, multipart).map_err(|e| {
                e.at(Place {
                    part: Some(index),
                    ..Place::default()
                })
            })?;
        }
        for (index, part) in parts.iter().enumerate() {
            if multipart && parts[..index].iter().any(|p| p.name == part.name) {
                return Err(Error::input(format!(
                    "two parts are called {:?}",
                    part.name.as_deref().unwrap_or_default()
                )));
            }
        }
        let mut writer = DeepWriter {
            out,
            parts: Vec::new(),
            level: None,
            multipart,
            position: 0,
            tables: 0,
        };
        writer.seek(0)?;
        writer.write_headers(parts)?;
        Ok(writer)
    }

    /// Sets how hard ZIPS (0 to 9, default 4) and Zstandard (1 to 22, default 5) try.
    pub fn set_level(&mut self, level: i32) {
        self.level = Some(level);
    }

    /// The parts, with channels in the file's order.
    pub fn parts(&self) -> impl ExactSizeIterator<Item = &Part> {
        self.parts.iter().map(|p| &*p.part)
    }

    /// A packer for blocks of `part`.
    ///
    /// # Errors
    /// `Input` if there is no such part.
    pub fn encoder(&self, part: usize) -> Result<BlockEncoder> {
        let state = self.state(part)?;
        Ok(BlockEncoder {
            part: state.part.clone(),
            index: part,
            multipart: self.multipart,
            level: self.level,
        })
    }

    /// Packs and writes a block: a tile, or a band of whole lines.
    ///
    /// # Errors
    /// `Input` if it is not the next one, is none of the part's blocks, or contradicts itself; `Io`.
    pub fn write(&mut self, part: usize, block: &DeepBlock) -> Result<()> {
        let encoder = self.encoder(part)?;
        if encoder.part.tiles.is_some() || block.rect.height == 1 {
            return self.write_encoded(encoder.encode(block)?);
        }
        block.check(&encoder.part).map_err(|e| encoder.place(e))?;
        let height = block.rect.height;
        for i in 0..height {
            let row = match encoder.part.line_order {
                LineOrder::Decreasing => height - 1 - i,
                _ => i,
            };
            let encoded = encoder.encode_row(block, row)?;
            self.write_encoded(encoded)?;
        }
        Ok(())
    }

    /// Writes a block that [`BlockEncoder::encode`] packed.
    ///
    /// # Errors
    /// `Input` if it is not the next one or was written before; `Io`.
    pub fn write_encoded(&mut self, encoded: EncodedBlock) -> Result<()> {
        let place = Place {
            part: Some(encoded.part),
            block: Some(encoded.block),
            ..Place::default()
        };
        let state = self.state(encoded.part)?;
        let next = match state.part.line_order {
            LineOrder::Increasing => Some(state.written),
            LineOrder::Decreasing => state.offsets.len().checked_sub(1 + state.written),
            LineOrder::Random => Some(encoded.block),
        };
        if state.offsets.get(encoded.block).is_none_or(|&o| o != 0) {
            return Err(Error::input("a block is written twice").at(place));
        }
        if next != Some(encoded.block) {
            return Err(Error::input(format!(
                "blocks come in {:?} order, so block {} is next",
                state.part.line_order,
                next.unwrap_or_default()
            ))
            .at(place));
        }
        let position = self.position;
        self.put(&encoded.bytes)?;
        let state = &mut self.parts[encoded.part];
        state.offsets[encoded.block] = position;
        state.written += 1;
        state.max_samples = state.max_samples.max(encoded.max_samples);
        Ok(())
    }

    /// Writes what is only known now, and puts the file in its place.
    ///
    /// # Errors
    /// `Input` if blocks are missing; `Io`. The file is then not put in its place.
    pub fn finish(mut self) -> Result<()> {
        for (index, state) in self.parts.iter().enumerate() {
            if let Some(block) = state.offsets.iter().position(|&o| o == 0) {
                let missing = state.offsets.len() - state.written;
                return Err(Error::input(format!(
                    "{missing} of {} blocks were not written",
                    state.offsets.len()
                ))
                .at(Place {
                    part: Some(index),
                    block: Some(block),
                    ..Place::default()
                }));
            }
        }
        for part in std::mem::take(&mut self.parts) {
            self.seek(part.max_samples_at)?;
            let max = i32::try_from(part.max_samples).unwrap_or(i32::MAX);
            self.put(&max.to_le_bytes())?;
            self.seek(self.tables)?;
            let table: Vec<u8> = part.offsets.iter().flat_map(|o| o.to_le_bytes()).collect();
            self.put(&table)?;
            self.tables = self.position;
        }
        let failed = |e| Error::io("cannot finish the file", e);
        match self.out {
            Out::Plain(mut out) => out.flush().map_err(failed),
            Out::Temporary(out, path) => {
                let file = out.into_inner().map_err(|e| failed(e.into_error()))?;
                file.as_file().sync_all().map_err(failed)?;
                file.persist(&path).map_err(|e| {
                    Error::io(
                        format!("cannot move the file to {}", path.display()),
                        e.error,
                    )
                })?;
                Ok(())
            }
        }
    }

    fn state(&self, part: usize) -> Result<&PartState> {
        let count = self.parts.len();
        self.parts
            .get(part)
            .ok_or_else(|| Error::input(format!("there is no part {part} of {count}")))
    }

    fn write_headers(&mut self, parts: Vec<Part>) -> Result<()> {
        let long = parts.iter().any(|p| {
            let names = p.channels.iter().map(|c| &c.name);
            let names = names.chain(p.attributes.iter().flat_map(|a| [&a.name, &a.type_name]));
            names.into_iter().any(|n| n.len() > 31)
        });
        let flags = FLAG_DEEP
            | if long { FLAG_LONG_NAMES } else { 0 }
            | if self.multipart { FLAG_MULTIPART } else { 0 };
        self.put(&MAGIC.to_le_bytes())?;
        self.put(&(VERSION | flags).to_le_bytes())?;
        for part in parts {
            let mut max_samples_at = 0;
            for a in header_attributes(&part) {
                let mut bytes = Vec::new();
                for name in [&a.name, &a.type_name] {
                    bytes.extend_from_slice(name.as_bytes());
                    bytes.push(0);
                }
                // Checked in `check_part`.
                bytes.extend_from_slice(&(a.value.len() as i32).to_le_bytes());
                if a.name == "maxSamplesPerPixel" {
                    max_samples_at = self.position + bytes.len() as u64;
                }
                bytes.extend_from_slice(&a.value);
                self.put(&bytes)?;
            }
            self.put(&[0])?;
            self.parts.push(PartState {
                offsets: vec![0; part.block_count()],
                part: Arc::new(part),
                written: 0,
                max_samples: 0,
                max_samples_at,
            });
        }
        if self.multipart {
            self.put(&[0])?;
        }
        self.tables = self.position;
        let blocks: usize = self.parts.iter().map(|p| p.offsets.len()).sum();
        // In pieces: a part may have many blocks.
        for start in (0..blocks).step_by(1024) {
            self.put(&[0; 8 * 1024][..8 * (blocks - start).min(1024)])?;
        }
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let result = match &mut self.out {
            Out::Plain(out) => out.write_all(bytes),
            Out::Temporary(out, _) => out.write_all(bytes),
        };
        result.map_err(|e| Error::io("cannot write", e).at_byte(self.position))?;
        self.position += bytes.len() as u64;
        Ok(())
    }

    fn seek(&mut self, position: u64) -> Result<()> {
        let result = match &mut self.out {
            Out::Plain(out) => out.seek(SeekFrom::Start(position)),
            Out::Temporary(out, _) => out.seek(SeekFrom::Start(position)),
        };
        result.map_err(|e| Error::io("cannot seek", e).at_byte(position))?;
        self.position = position;
        Ok(())
    }
}

impl BlockEncoder {
    /// The part whose blocks it packs.
    pub fn part(&self) -> &Part {
        &self.part
    }

    /// Packs a tile or one line.
    ///
    /// # Errors
    /// `Input` if the block's pixels are not those of a block of the part, or it contradicts itself.
    pub fn encode(&self, block: &DeepBlock) -> Result<EncodedBlock> {
        block.check(&self.part).map_err(|e| self.place(e))?;
        self.encode_checked(block, block.rect, 0)
    }

    /// Packs row `row` of a block of several, which has been checked.
    fn encode_row(&self, block: &DeepBlock, row: u32) -> Result<EncodedBlock> {
        let rect = Rect {
            y: block.rect.y.wrapping_add(row as i32),
            height: 1,
            ..block.rect
        };
        self.encode_checked(block, rect, row as usize * block.rect.width as usize)
    }

    fn place(&self, e: Error) -> Error {
        e.at(Place {
            part: Some(self.index),
            ..Place::default()
        })
    }

    /// Packs the pixels of `rect`, the first of which is pixel `first` of `block`.
    fn encode_checked(&self, block: &DeepBlock, rect: Rect, first: usize) -> Result<EncodedBlock> {
        let part = &*self.part;
        let found = part.blocks_meeting(rect).next();
        let Some((index, _)) = found.filter(|(_, r)| *r == rect) else {
            return Err(self.place(Error::input(format!("{rect:?} is not a block of the part"))));
        };
        let width = rect.width as usize;
        let pixels = first..first + width * rect.height as usize;
        let mut max_samples = 0;
        let mut counts = Vec::with_capacity(4 * pixels.len());
        let mut row_samples = Vec::with_capacity(rect.height as usize);
        for row in pixels.clone().step_by(width) {
            let offsets = &block.offsets[row..=row + width];
            for pair in offsets.windows(2) {
                max_samples = max_samples.max(pair[1] - pair[0]);
                counts.extend_from_slice(&(pair[1] - offsets[0]).to_le_bytes());
            }
            row_samples.push((offsets[width] - offsets[0]) as usize);
        }
        if row_samples.iter().any(|&n| n > i32::MAX as usize) {
            return Err(self.place(Error::input("a line has more than 2^31 samples")));
        }
        let rows = vec![width; rect.height as usize];
        let counts_layout = Layout {
            row_samples: &rows,
            channel_bytes: &[4],
        };
        let channel_bytes: Vec<usize> = part
            .channels
            .iter()
            .map(|c| c.sample_type.bytes())
            .collect();
        let layout = Layout {
            row_samples: &row_samples,
            channel_bytes: &channel_bytes,
        };
        let mut raw = Vec::with_capacity(layout.bytes());
        for row in pixels.step_by(width) {
            let span = block.offsets[row] as usize..block.offsets[row + width] as usize;
            for channel in &block.channels {
                channel.write_le(span.clone(), &mut raw);
            }
        }

        let mut bytes = Vec::new();
        if self.multipart {
            bytes.extend_from_slice(&(self.index as i32).to_le_bytes());
        }
        match &part.tiles {
            Some(_) => {
                let columns = part.grid().0 as usize;
                for v in [index % columns, index / columns, 0, 0] {
                    bytes.extend_from_slice(&(v as i32).to_le_bytes());
                }
            }
            None => bytes.extend_from_slice(&rect.y.to_le_bytes()),
        }
        codec::with_scratch(|scratch| {
            let (_, a, b) = codec::split(scratch);
            let sizes_at = bytes.len();
            bytes.resize(sizes_at + 24, 0);
            let packed = codec::pack(part.compression, &counts, &counts_layout, self.level, a, b);
            let start = bytes.len();
            bytes.extend_from_slice(packed);
            if part.compression == Compression::None {
                // Readers expect plain tables at full size at the edges too.
                let (width, height) = part.block_size();
                bytes.resize(start + 4 * width as usize * height as usize, 0);
            }
            let counts_len = bytes.len() - start;
            let packed = codec::pack(part.compression, &raw, &layout, self.level, a, b);
            bytes.extend_from_slice(packed);
            for (i, size) in [counts_len, packed.len(), raw.len()]
                .into_iter()
                .enumerate()
            {
                let at = sizes_at + 8 * i;
                bytes[at..at + 8].copy_from_slice(&(size as u64).to_le_bytes());
            }
        });
        Ok(EncodedBlock {
            part: self.index,
            block: index,
            bytes,
            max_samples,
        })
    }
}

/// Fails where `part` cannot be written; sorts its channels' names being the caller's duty.
fn check_part(part: &mut Part, multipart: bool) -> Result<()> {
    let bad = |what: String| Err(Error::input(what));
    if !part.deep {
        return bad("only deep parts are written".into());
    }
    if !part.compression.is_for_deep() {
        return bad(format!("{:?} is not for deep data", part.compression));
    }
    part.check_geometry()
        .map_err(|e| Error::input(format!("the part cannot be written: {e}")))?;
    for w in [&part.data_window, &part.display_window] {
        let far = i64::from(i32::MAX / 2);
        let ends = [w.x.into(), w.y.into(), w.x_end() - 1, w.y_end() - 1];
        if w.pixels() == 0 || ends.iter().any(|v| !(-far..=far).contains(v)) {
            return bad(format!("{w:?} is empty or beyond 2^30"));
        }
    }
    if part.tiles.is_some_and(|t| t.levels != LevelMode::One) {
        return bad("tiles of one level only are written".into());
    }
    if part.tiles.is_none() && part.line_order == LineOrder::Random {
        return bad("lines have an order; Random is for tiles".into());
    }
    if i32::try_from(part.block_count()).is_err() {
        return bad("a part of 2^31 blocks or more".into());
    }
    if part.channels.is_empty() {
        return bad("a part needs at least one channel".into());
    }
    if !part.channels.is_sorted_by(|a, b| a.name < b.name) {
        return bad("channels must be sorted by name, without equal ones".into());
    }
    let names = part.channels.iter().map(|c| &c.name);
    let names = names.chain(part.attributes.iter().flat_map(|a| [&a.name, &a.type_name]));
    for name in names {
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return bad(format!(
                "{name:?} is no name: they have 1 to 255 bytes, none 0"
            ));
        }
    }
    if multipart && part.name.as_ref().is_none_or(|n| n.is_empty()) {
        return bad("a part needs a name among several".into());
    }
    if let Some(a) = part
        .attributes
        .iter()
        .find(|a| i32::try_from(a.value.len()).is_err())
    {
        return bad(format!("attribute {:?} has 2^31 bytes or more", a.name));
    }
    Ok(())
}

/// All attributes of the header by name: those that the fields say, the defaults, the others as given.
fn header_attributes(part: &Part) -> impl Iterator<Item = Attribute> {
    let window = |r: &Rect| {
        let ends = [r.x, r.y, (r.x_end() - 1) as i32, (r.y_end() - 1) as i32];
        ends.iter().flat_map(|v| v.to_le_bytes()).collect()
    };
    let mut channels = Vec::new();
    for c in &part.channels {
        let code = match c.sample_type {
            crate::SampleType::Uint => 0_i32,
            crate::SampleType::Half => 1,
            crate::SampleType::Float => 2,
        };
        channels.extend_from_slice(c.name.as_bytes());
        channels.push(0);
        for v in [code, i32::from(c.linear), c.sampling.0, c.sampling.1] {
            channels.extend_from_slice(&v.to_le_bytes());
        }
    }
    channels.push(0);
    let line_order = match part.line_order {
        LineOrder::Increasing => 0,
        LineOrder::Decreasing => 1,
        LineOrder::Random => 2,
    };
    let kind = if part.tiles.is_some() {
        "deeptile"
    } else {
        "deepscanline"
    };
    let mut all: BTreeMap<String, Attribute> = BTreeMap::new();
    let mut set = |a: Attribute| all.insert(a.name.clone(), a);
    set(Attribute::float("pixelAspectRatio", 1.0));
    set(Attribute::v2f("screenWindowCenter", [0.0, 0.0]));
    set(Attribute::float("screenWindowWidth", 1.0));
    part.attributes
        .iter()
        .filter(|a| a.name != "name" && a.name != "tiles")
        .for_each(|a| {
            set(a.clone());
        });
    set(Attribute::new("channels", "chlist", channels));
    set(Attribute::new(
        "compression",
        "compression",
        vec![part.compression.code()],
    ));
    set(Attribute::new(
        "dataWindow",
        "box2i",
        window(&part.data_window),
    ));
    set(Attribute::new(
        "displayWindow",
        "box2i",
        window(&part.display_window),
    ));
    set(Attribute::new("lineOrder", "lineOrder", vec![line_order]));
    if let Some(name) = &part.name {
        set(Attribute::text("name", name));
    }
    if let Some(t) = &part.tiles {
        let mut tiles = [t.width, t.height]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<_>>();
        tiles.push(0);
        set(Attribute::new("tiles", "tiledesc", tiles));
    }
    set(Attribute::text("type", kind));
    set(Attribute::int("version", 1));
    set(Attribute::int("chunkCount", part.block_count() as i32));
    set(Attribute::int("maxSamplesPerPixel", -1));
    all.into_values()
}
