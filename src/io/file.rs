//! Opening a file, and reading single tiles and functions from it.

use std::borrow::Cow;
use std::cell::Cell;
use std::fs::File;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::source::{Memory, Positioned, ReadAt};
use crate::format::Tile;
use crate::format::directory::{self, Entry, TileKind};
use crate::format::footer::{BlockRef, Footer};
use crate::format::header::{self, Trailer};
use crate::format::layout::{BLOCK_ENTRIES, ENTRY_SIZE, HEADER_SIZE, TRAILER_SIZE};
use crate::format::tile::{PADDING, Words};
use crate::map::{Attribute, Group, LevelInfo, LevelShape, MapInfo};
use crate::{Error, Limits, Place, Result, Visibility, scratch};

/// A deep shadow map file that is open for reading, from any number of threads.
///
/// Opening reads the header, the trailer and the footer; blocks of the tile directory are read when they are first
/// used and kept (48 bytes a tile); tiles are read when asked for and not kept. Damage is found at the latest where it
/// is met: a tile whose bytes changed is an error, never another picture.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// let mut bytes = Vec::new();
/// let mut writer = Writer::new(&mut bytes)?;
/// let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
/// writer.pixel(map, 2, 1, &Curve::mono(vec![5.0], vec![0.25])?)?; // a sheet of glass
/// writer.finish()?;
///
/// let file = DsmFile::from_bytes(bytes)?;
/// assert_eq!(file.maps()[0].header.name, "light");
/// assert_eq!(file.function(0, 0, 2, 1)?.at(6.0), 0.25);
/// # Ok(()) }
/// ```
pub struct DsmFile {
    source: Arc<dyn ReadAt>,
    limits: Limits,
    trailer: Trailer,
    maps: Vec<MapInfo>,
    groups: Vec<Group>,
    attributes: Vec<Attribute>,
    directories: Vec<Vec<Directory>>,
}

/// The directory of one level: its blocks, read when they are first used.
struct Directory {
    blocks: Vec<BlockRef>,
    loaded: Vec<OnceLock<Box<[u8]>>>,
}

impl std::fmt::Debug for DsmFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DsmFile")
            .field("maps", &self.maps)
            .field("groups", &self.groups)
            .finish_non_exhaustive()
    }
}

impl DsmFile {
    /// Opens the file at `path` for positioned reads.
    ///
    /// # Errors
    /// `Io`; `Corrupt` and `Unsupported` by `spec/format.md`; `Limit` for a footer beyond the default [`Limits`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let failed = |e| Error::io(format!("cannot open {}", path.display()), e);
        let file = File::open(path).map_err(failed)?;
        if file.metadata().map_err(failed)?.is_dir() {
            return Err(failed(std::io::ErrorKind::IsADirectory.into()));
        }
        Self::from_source(
            Arc::new(Positioned::new(file).map_err(failed)?),
            Limits::default(),
        )
    }

    /// Opens a file that lies in memory.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    pub fn from_bytes(bytes: impl AsRef<[u8]> + Send + Sync + 'static) -> Result<Self> {
        Self::from_source(Arc::new(Memory(bytes)), Limits::default())
    }

    /// Opens the file at `path` through a memory map.
    ///
    /// # Safety
    /// While the file is open, nobody may change it or make it shorter: that would change bytes that Rust takes for constant, and
    /// reading behind the new end kills the process (SIGBUS). Files that are published by renaming, as [`crate::Writer::create`] does, are never changed.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    #[cfg(feature = "mmap")]
    pub unsafe fn map(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let failed = |e| Error::io(format!("cannot map {}", path.display()), e);
        let file = File::open(path).map_err(failed)?;
        // SAFETY: the caller promises that nobody changes or truncates the file while it is mapped.
        let map = unsafe { memmap2::Mmap::map(&file) }.map_err(failed)?;
        Self::from_source(Arc::new(Memory(map)), Limits::default())
    }

    /// Opens a file in the caller's own storage, with the caller's limits.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    pub fn from_source(source: Arc<dyn ReadAt>, limits: Limits) -> Result<Self> {
        let length = source.length();
        let read = |at: u64, buffer: &mut [u8]| {
            source
                .read_exact_at(buffer, at)
                .map_err(|e| read_error(at, e))
        };
        let mut head = [0; HEADER_SIZE];
        let start = HEADER_SIZE.min(usize::try_from(length).unwrap_or(HEADER_SIZE));
        read(0, &mut head[..start])?;
        if length < (HEADER_SIZE + TRAILER_SIZE) as u64 {
            // Something else altogether is said to be something else, not short.
            if head[..start.min(8)] != header::encode_header()[..start.min(8)] {
                return Err(Error::corrupt("HEADER-MAGIC", "this is not a .dsm file"));
            }
            return Err(Error::corrupt(
                "FILE-SHORT",
                format!("{length} bytes are too few for a file"),
            ));
        }
        header::check_header(&head)?;
        let mut tail = [0; TRAILER_SIZE];
        read(length - TRAILER_SIZE as u64, &mut tail)?;
        let trailer = Trailer::parse(&tail, length)?;
        if trailer.footer_size > limits.footer_bytes {
            let what = format!(
                "a footer of {} bytes, over the limit of {}",
                trailer.footer_size, limits.footer_bytes
            );
            return Err(Error::limit(what));
        }
        let mut bytes = vec![0; trailer.footer_size as usize];
        read(trailer.footer_offset, &mut bytes)?;
        if crc32fast::hash(&bytes) != trailer.footer_crc {
            let place = Place {
                byte: Some(trailer.footer_offset),
                ..Place::default()
            };
            return Err(Error::corrupt("FOOTER-CRC", "the footer is damaged").at(place));
        }
        let directory = trailer.footer_offset - trailer.directory_offset;
        let footer = Footer::parse(&bytes, trailer.footer_offset, directory)?;
        let mut file = DsmFile {
            source,
            limits,
            trailer,
            maps: Vec::new(),
            groups: footer.groups,
            attributes: footer.attributes,
            directories: Vec::new(),
        };
        for (m, map) in footer.maps.into_iter().enumerate() {
            let mut levels = Vec::new();
            let mut directories = Vec::new();
            for (l, level) in map.levels.into_iter().enumerate() {
                let outside = |b: &BlockRef| {
                    let end = b.offset.checked_add(u64::from(b.stored_size));
                    b.offset < trailer.directory_offset
                        || end.is_none_or(|end| end > trailer.footer_offset)
                };
                if let Some(block) = level.blocks.iter().find(|b| outside(b)) {
                    let what = format!(
                        "a block of {} bytes at byte {}",
                        block.stored_size, block.offset
                    );
                    let place = Place {
                        map: Some(m as u32),
                        level: Some(l as u32),
                        ..Place::default()
                    };
                    return Err(Error::corrupt("BLOCK-RANGE", what).at(place));
                }
                levels.push(LevelInfo {
                    shape: LevelShape::of(&map.header, l as u32),
                    max_error: level.max_error,
                    vertices: level.vertices,
                    payload_bytes: level.payload_bytes,
                });
                let loaded = level.blocks.iter().map(|_| OnceLock::new()).collect();
                directories.push(Directory {
                    blocks: level.blocks,
                    loaded,
                });
            }
            file.maps.push(MapInfo {
                header: map.header,
                levels,
            });
            file.directories.push(directories);
        }
        Ok(file)
    }

    /// The maps of the file, in order.
    pub fn maps(&self) -> &[MapInfo] {
        &self.maps
    }

    /// Index of the map called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.maps.iter().position(|m| m.header.name == name)
    }

    /// Groups of maps that are looked up together.
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Attributes of the file; those of a map are in its header.
    pub fn attributes(&self) -> &[Attribute] {
        &self.attributes
    }

    /// Length of the file in bytes.
    pub fn length(&self) -> u64 {
        self.trailer.file_length
    }

    /// What this file may allocate.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    pub(crate) fn trailer(&self) -> &Trailer {
        &self.trailer
    }

    pub(crate) fn blocks(&self) -> impl Iterator<Item = &BlockRef> {
        self.directories.iter().flatten().flat_map(|d| &d.blocks)
    }

    /// # Errors
    /// `Input` if there is no such map or level.
    pub fn level(&self, map: usize, level: usize) -> Result<&LevelInfo> {
        let info = self.maps.get(map).ok_or_else(|| {
            Error::input(format!("no map {map} in a file of {}", self.maps.len()))
        })?;
        let levels = info.levels.len();
        info.levels
            .get(level)
            .ok_or_else(|| Error::input(format!("no level {level} in a map of {levels} levels")))
    }

    /// The directory entry of a tile. Cost: the first of every 1024 tiles reads a block, at most 48 KiB.
    ///
    /// # Errors
    /// `Input` if there is no such tile; `Corrupt`, `Unsupported`, `Io`.
    pub fn entry(&self, map: usize, level: usize, tx: u32, ty: u32) -> Result<Entry> {
        let shape = self.level(map, level)?.shape;
        shape.check_tile(tx, ty)?;
        let index = shape.tile_index(tx, ty);
        let (width, height) = shape.tile_extent(tx, ty);
        let block = self.block(map, level, index / BLOCK_ENTRIES)?;
        let record = &block[(index % BLOCK_ENTRIES) as usize * ENTRY_SIZE..][..ENTRY_SIZE];
        Entry::parse(
            record,
            width * height,
            self.maps[map].header.channels,
            self.trailer.directory_offset,
        )
        .map_err(|e| e.at(tile_place(map, level, index)))
    }

    fn block(&self, map: usize, level: usize, block: u64) -> Result<&[u8]> {
        let directory = &self.directories[map][level];
        let slot = &directory.loaded[block as usize];
        if let Some(records) = slot.get() {
            return Ok(records);
        }
        let reference = &directory.blocks[block as usize];
        let tiles = self.maps[map].levels[level].shape.tiles();
        let n = (tiles - block * BLOCK_ENTRIES).min(BLOCK_ENTRIES) as usize;
        let stored = self.bytes(reference.offset, reference.stored_size)?;
        let records = directory::decode_block(reference, &stored, n).map_err(|e| {
            let place = tile_place(map, level, block * BLOCK_ENTRIES);
            e.at(Place {
                byte: Some(reference.offset),
                ..place
            })
        })?;
        Ok(slot.get_or_init(|| records.into_boxed_slice()))
    }

    /// `size` bytes of the file from `offset` on; borrowed if the source lies in memory.
    fn bytes(&self, offset: u64, size: u32) -> Result<Cow<'_, [u8]>> {
        if let Some(all) = self.source.as_slice() {
            let end = offset + u64::from(size);
            let slice = all.get(offset as usize..end as usize);
            let short = || read_error(offset, std::io::ErrorKind::UnexpectedEof.into());
            return slice.map(Cow::Borrowed).ok_or_else(short);
        }
        let mut buffer = vec![0; size as usize];
        self.read(offset, &mut buffer)?;
        Ok(Cow::Owned(buffer))
    }

    fn read(&self, offset: u64, buffer: &mut [u8]) -> Result<()> {
        let read = self.source.read_exact_at(buffer, offset);
        read.map_err(|e| read_error(offset, e))
    }

    /// The payload of a tile as stored, its CRC checked; empty for tiles without one.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn payload(
        &self,
        map: usize,
        level: usize,
        tx: u32,
        ty: u32,
    ) -> Result<(Entry, Cow<'_, [u8]>)> {
        let entry = self.entry(map, level, tx, ty)?;
        if entry.kind != TileKind::Data {
            return Ok((entry, Cow::Borrowed(&[])));
        }
        let stored = self.bytes(entry.offset, entry.stored_size)?;
        if crc32fast::hash(&stored) != entry.crc {
            let place = tile_place(
                map,
                level,
                self.maps[map].levels[level].shape.tile_index(tx, ty),
            );
            let place = Place {
                byte: Some(entry.offset),
                ..place
            };
            return Err(Error::corrupt("TILE-CRC", "the bytes of the tile are damaged").at(place));
        }
        Ok((entry, stored))
    }

    /// Tile (tx, ty) of a level, decoded, every rule checked.
    ///
    /// # Errors
    /// As [`DsmFile::entry`]; `Limit` for a tile beyond [`Limits::tile_bytes`].
    pub fn tile(&self, map: usize, level: usize, tx: u32, ty: u32) -> Result<Tile> {
        let (entry, stored) = self.payload(map, level, tx, ty)?;
        let shape = self.maps[map].levels[level].shape;
        let (extent, limit) = (shape.tile_extent(tx, ty), self.limits.tile_bytes);
        let tile = match entry.kind {
            TileKind::Data => Tile::decode_checked(&entry, &stored, extent, limit, Words::EMPTY),
            _ => Tile::decode(&entry, &[], extent, limit),
        };
        tile.map_err(|e| {
            let place = tile_place(map, level, shape.tile_index(tx, ty));
            e.at(Place {
                byte: Some(entry.offset),
                ..place
            })
        })
    }

    /// Bytes that a tile takes when it is decoded; none if it takes no planes, can be looked up where it is, or will be refused for its size.
    pub(crate) fn decoded_bytes(&self, entry: &Entry, extent: (u32, u32)) -> usize {
        match self.source.as_slice() {
            Some(_) if Tile::is_plain(entry) => 0,
            _ => Tile::planes_bytes(entry, extent, self.limits.tile_bytes),
        }
    }

    /// [`DsmFile::tile`] of a tile with planes: in place if the file lies in memory and the tile is stored as it is, else
    /// decoded into `buffer`.
    pub(crate) fn tile_for_cache(
        &self,
        map: usize,
        level: usize,
        tx: u32,
        ty: u32,
        entry: &Entry,
        buffer: Words,
    ) -> Result<Tile> {
        let shape = self.maps[map].levels[level].shape;
        let (extent, limit) = (shape.tile_extent(tx, ty), self.limits.tile_bytes);
        let decode = || {
            if Tile::is_plain(entry) && self.source.as_slice().is_some() {
                let bytes = Part {
                    source: self.source.clone(),
                    offset: entry.offset,
                    size: entry.stored_size,
                };
                if let Some(tile) = Tile::in_place(entry, Box::new(bytes), extent, limit)? {
                    return Ok(tile);
                }
            }
            if self.source.as_slice().is_some() {
                let stored = self.bytes(entry.offset, entry.stored_size)?;
                return Tile::decode_into(entry, &stored, extent, limit, buffer);
            }
            let size = entry.stored_size as usize;
            let padded = size + PADDING;
            let fits = Tile::planes_bytes(entry, extent, limit) == padded && size.is_multiple_of(8);
            if Tile::is_plain(entry) && fits && cfg!(target_endian = "little") {
                // Straight into the tile's own memory.
                let mut words = buffer;
                words.set_len(padded / 8);
                let stored = bytemuck::cast_slice_mut(&mut words[..size / 8]);
                self.read(entry.offset, stored)?;
                return Tile::adopt(entry, words, extent, limit);
            }
            thread_local! {
                static STORED: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
            }
            scratch::lend(&STORED, |stored| {
                let stored = scratch::first(stored, size);
                self.read(entry.offset, stored)?;
                Tile::decode_into(entry, stored, extent, limit, buffer)
            })
        };
        decode().map_err(|e: Error| {
            let place = tile_place(map, level, shape.tile_index(tx, ty));
            e.at(Place {
                byte: Some(entry.offset),
                ..place
            })
        })
    }

    /// The visibility function of pixel (x, y) of a level. Cost: reads and decodes its tile.
    ///
    /// # Errors
    /// As [`DsmFile::tile`]; `Input` if there is no such pixel.
    pub fn function(&self, map: usize, level: usize, x: u32, y: u32) -> Result<Visibility> {
        let shape = self.level(map, level)?.shape;
        if x >= shape.width || y >= shape.height {
            return Err(Error::input(format!(
                "pixel {x},{y} is outside the {} x {} pixels of the level",
                shape.width, shape.height
            )));
        }
        let side = shape.tile_size;
        let tile = self.tile(map, level, x / side, y / side)?;
        Ok(tile.function((y % side * tile.width() + x % side) as usize))
    }
}

/// A part of a source that lies in memory, kept alive.
struct Part {
    source: Arc<dyn ReadAt>,
    offset: u64,
    size: u32,
}

impl AsRef<[u8]> for Part {
    fn as_ref(&self) -> &[u8] {
        let end = self.offset + u64::from(self.size);
        let slice = self.source.as_slice();
        slice
            .and_then(|all| all.get(self.offset as usize..end as usize))
            .unwrap_or(&[])
    }
}

fn read_error(at: u64, e: std::io::Error) -> Error {
    Error::io("cannot read the file", e).at(Place {
        byte: Some(at),
        ..Place::default()
    })
}

pub(crate) fn tile_place(map: usize, level: usize, tile: u64) -> Place {
    Place {
        map: Some(map as u32),
        level: Some(level as u32),
        tile: Some(tile),
        ..Place::default()
    }
}
