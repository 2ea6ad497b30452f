//! [`DsmFile`]: opens a file, and reads single tiles and functions.

use std::borrow::Cow;
use std::cell::Cell;
use std::fs::File;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Condvar, Mutex};

use lru::LruCache;

use super::source::{Memory, Positioned, ReadAt};
use crate::error::Place;
use crate::format::Tile;
use crate::format::directory::{self, BlockRef, Entry, TileKind};
use crate::format::footer::Footer;
use crate::format::header::{self, Trailer};
use crate::format::layout::{BLOCK_ENTRIES, ENTRY_SIZE, HEADER_SIZE, TRAILER_SIZE};
use crate::format::tile::decode::decoding_bytes;
use crate::format::tile::{PADDING, Words};
use crate::map::{Attribute, Group, LevelId, LevelInfo, LevelShape, MapId, MapInfo, Pixel, TileId};
use crate::{Error, Limits, Result, Visibility, scratch};

/// Decoded blocks of the directory, by level and index.
type Blocks = LruCache<(LevelId, u64), Arc<[u8]>>;

/// A deep shadow map file that any number of threads may read.
///
/// Opening reads the header, the trailer and the footer. The first use of a block of the tile
/// directory reads it, and the file keeps blocks (48 bytes per tile) within a sixteenth of
/// [`Limits::memory`]. Tiles are read at each call and not kept. Every read checks a CRC and the
/// rules of the specification, so a damaged tile is an error, never another picture.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, Pixel, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// let mut writer = Writer::in_memory();
/// let map = writer.add_map(MapHeader::new("light", 4, 4), Encoding::default())?;
/// let glass = Curve::mono(vec![5.0], vec![0.25])?;
/// writer.pixel(map, Pixel::new(2, 1), &glass)?;
///
/// let file = DsmFile::from_bytes(writer.into_bytes()?)?;
/// let map = file.find("light").unwrap();
/// assert_eq!(file.function(map.level(0), Pixel::new(2, 1))?.visibility(6.0), 0.25);
/// # Ok(()) }
/// ```
pub struct DsmFile {
    source: Arc<dyn ReadAt>,
    limits: Limits,
    trailer: Trailer,
    maps: Vec<MapInfo>,
    groups: Vec<Group>,
    attributes: Vec<(String, Attribute)>,
    /// The blocks of the directory of each level.
    directories: Vec<Vec<Vec<BlockRef>>>,
    /// Blocks that were used last, decoded.
    recent: Mutex<Blocks>,
    /// Bytes that threads take to decode large tiles.
    decoding: Mutex<u64>,
    decoded: Condvar,
    /// Whether the layout was checked.
    pub(super) is_covered: AtomicBool,
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
    /// `Io`; `Corrupt` and `Unsupported` by `spec/format.md`; `Limit` for a footer beyond the
    /// default [`Limits`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::open_within(path, Limits::default())
    }

    /// [`DsmFile::open`] with the caller's limits.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    pub fn open_within(path: impl AsRef<Path>, limits: Limits) -> Result<Self> {
        let path = path.as_ref();
        let failed = |e| Error::io(format!("cannot open {}", path.display()), e);
        let file = File::open(path).map_err(failed)?;
        if file.metadata().map_err(failed)?.is_dir() {
            return Err(failed(std::io::ErrorKind::IsADirectory.into()));
        }
        Self::from_file(file, limits)
    }

    /// Reads an open file by positioned reads, with the caller's limits.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    pub fn from_file(file: File, limits: Limits) -> Result<Self> {
        let source = Positioned::new(file).map_err(|e| Error::io("cannot read the file", e))?;
        Self::from_source(Arc::new(source), limits)
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    pub fn from_bytes(bytes: impl AsRef<[u8]> + Send + Sync + 'static) -> Result<Self> {
        Self::from_source(Arc::new(Memory(bytes)), Limits::default())
    }

    /// Opens the file at `path` through a memory map.
    ///
    /// # Safety
    /// While the file is open, nobody may change or truncate it. A change breaks Rust's rule that
    /// shared bytes are constant; a read past the new end kills the process (SIGBUS). Files that
    /// are replaced by renaming, as [`crate::Writer::create`] does, never change.
    ///
    /// # Errors
    /// As [`DsmFile::open`].
    #[cfg(feature = "mmap")]
    pub unsafe fn open_mmap(path: impl AsRef<Path>) -> Result<Self> {
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
            // A short file of another format is reported as such, not as too short.
            if head[..start.min(8)] != header::encode_header()[..start.min(8)] {
                return Err(Error::corrupt("HEADER-MAGIC", "this is not a .dsm file"));
            }
            let what = format!("{length} bytes are too few for a file");
            return Err(Error::corrupt("FILE-SHORT", what));
        }
        header::check_header(&head)?;
        let mut tail = [0; TRAILER_SIZE];
        read(length - TRAILER_SIZE as u64, &mut tail)?;
        let trailer = Trailer::parse(&tail, length)?;
        limits.check_footer(trailer.footer_size)?;
        let mut bytes = vec![0; trailer.footer_size as usize];
        read(trailer.footer_offset, &mut bytes)?;
        if crc32fast::hash(&bytes) != trailer.footer_crc {
            let place = Place::byte(trailer.footer_offset);
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
            recent: Mutex::new(LruCache::unbounded()),
            decoding: Mutex::new(0),
            decoded: Condvar::new(),
            is_covered: AtomicBool::new(false),
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
                    let place = MapId::from_index(m).level(l as u32);
                    return Err(Error::corrupt("BLOCK-RANGE", what).at(place));
                }
                levels.push(LevelInfo {
                    shape: LevelShape::of(&map.header, l as u32),
                    max_error: level.max_error,
                    vertices: level.vertices,
                    payload_bytes: level.payload_bytes,
                });
                directories.push(level.blocks);
            }
            file.maps.push(MapInfo {
                header: map.header,
                levels,
            });
            file.directories.push(directories);
        }
        Ok(file)
    }

    /// The maps of the file; a [`MapId`] is an index of this list.
    pub fn maps(&self) -> &[MapInfo] {
        &self.maps
    }

    /// The map called `name`.
    pub fn find(&self, name: &str) -> Option<MapId> {
        let index = self.maps.iter().position(|m| m.header.name == name);
        index.map(MapId::from_index)
    }

    /// The group called `name`.
    pub fn find_group(&self, name: &str) -> Option<&Group> {
        self.groups.iter().find(|g| g.name == name)
    }

    /// A map of the file.
    ///
    /// # Errors
    /// `Input` if there is no such map.
    pub fn map(&self, id: MapId) -> Result<&MapInfo> {
        let count = self.maps.len();
        let map = self.maps.get(id.index());
        map.ok_or_else(|| Error::input(format!("no map {id} in a file of {count}")))
    }

    /// A level of a map.
    ///
    /// # Errors
    /// `Input` if there is no such map or level.
    pub fn level(&self, id: LevelId) -> Result<&LevelInfo> {
        let levels = &self.map(id.map)?.levels;
        levels.get(id.index()).ok_or_else(|| {
            let (level, count) = (id.level, levels.len());
            Error::input(format!("no level {level} in a map of {count} levels"))
        })
    }

    /// All levels of all maps, in order.
    pub fn levels(&self) -> impl Iterator<Item = (LevelId, &LevelInfo)> {
        self.maps.iter().enumerate().flat_map(|(m, map)| {
            let id = move |(l, info)| (MapId::from_index(m).level(l as u32), info);
            map.levels.iter().enumerate().map(id)
        })
    }

    /// Groups of maps that are looked up together.
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Attributes of the file; those of a map are in its header.
    pub fn attributes(&self) -> &[(String, Attribute)] {
        &self.attributes
    }

    /// Length of the file in bytes.
    pub fn length(&self) -> u64 {
        self.trailer.file_length
    }

    /// The most that this file may allocate.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    pub(crate) fn trailer(&self) -> &Trailer {
        &self.trailer
    }

    pub(crate) fn blocks(&self) -> impl Iterator<Item = &BlockRef> {
        self.directories.iter().flatten().flatten()
    }

    /// The directory entry of a tile. Cost: the first use of a block of 1024 tiles reads up to 48
    /// KiB.
    ///
    /// # Errors
    /// `Input` if there is no such tile; `Corrupt`, `Unsupported`, `Io`.
    pub fn entry(&self, level: LevelId, tile: TileId) -> Result<Entry> {
        let shape = self.level(level)?.shape;
        shape.check_tile(tile)?;
        let index = shape.tile_index(tile);
        let (width, height) = shape.tile_extent(tile);
        let block = self.block(level, index / BLOCK_ENTRIES)?;
        Entry::parse(
            record(&block, index),
            width * height,
            self.maps[level.map.index()].header.channels,
            self.trailer.directory_offset,
        )
        .map_err(|e| e.at(Place::tile(index)).at(level))
    }

    /// Number of tiles from `first` on, at most `most`, that have equal entries in one block.
    pub(super) fn equal_entries(&self, level: LevelId, first: u64, most: u64) -> Result<u64> {
        let block = self.block(level, first / BLOCK_ENTRIES)?;
        if block.len() == ENTRY_SIZE {
            return Ok(most);
        }
        let same = |i: &u64| record(&block, first + i) == record(&block, first);
        Ok((0..most).take_while(same).count() as u64)
    }

    fn block(&self, level: LevelId, block: u64) -> Result<Arc<[u8]>> {
        let recent = || self.recent.lock().expect("no panic holds this lock");
        if let Some(records) = recent().get(&(level, block)) {
            return Ok(records.clone());
        }
        let reference = &self.directories[level.map.index()][level.index()][block as usize];
        let tiles = self.level(level)?.shape.tiles();
        let n = (tiles - block * BLOCK_ENTRIES).min(BLOCK_ENTRIES) as usize;
        let stored = self.bytes(reference.offset, reference.stored_size)?;
        let records = directory::decode_block(reference, &stored, n).map_err(|e| {
            let place = Place::tile(block * BLOCK_ENTRIES);
            e.at(Place::byte(reference.offset)).at(place).at(level)
        })?;
        let records: Arc<[u8]> = records.into();
        let mut recent = recent();
        if recent.len() >= self.limits.blocks() {
            recent.pop_lru();
        }
        recent.put((level, block), records.clone());
        Ok(records)
    }

    /// `size` bytes of the file from `offset` on; borrowed if the source is in memory.
    fn bytes(&self, offset: u64, size: u32) -> Result<Cow<'_, [u8]>> {
        if let Some(all) = self.source.as_slice() {
            let end = offset + u64::from(size);
            let slice = all.get(offset as usize..end as usize);
            let short = || read_error(offset, std::io::ErrorKind::UnexpectedEof.into());
            return slice.map(Cow::Borrowed).ok_or_else(short);
        }
        self.limits.check(size.into(), "a piece of the file")?;
        let mut buffer = vec![0; size as usize];
        self.read(offset, &mut buffer)?;
        Ok(Cow::Owned(buffer))
    }

    fn read(&self, offset: u64, buffer: &mut [u8]) -> Result<()> {
        let read = self.source.read_exact_at(buffer, offset);
        read.map_err(|e| read_error(offset, e))
    }

    /// The stored payload of a tile; empty for tiles without one. Checks its CRC.
    ///
    /// # Errors
    /// As [`DsmFile::entry`].
    pub fn payload(&self, level: LevelId, tile: TileId) -> Result<(Entry, Cow<'_, [u8]>)> {
        let entry = self.entry(level, tile)?;
        if entry.kind != TileKind::Data {
            return Ok((entry, Cow::Borrowed(&[])));
        }
        let stored = self.bytes(entry.offset, entry.stored_size)?;
        if crc32fast::hash(&stored) != entry.crc {
            let e = Error::corrupt("TILE-CRC", "the bytes of the tile are damaged");
            return Err(e.at(self.payload_place(level, tile, &entry)));
        }
        Ok((entry, stored))
    }

    /// The place of a payload, for errors.
    pub(crate) fn payload_place(&self, level: LevelId, tile: TileId, entry: &Entry) -> Place {
        let shape = self.maps[level.map.index()].levels[level.index()].shape;
        Place {
            tile: Some(shape.tile_index(tile)),
            byte: Some(entry.offset),
            ..level.into()
        }
    }

    /// A decoded tile of a level; checks every rule.
    ///
    /// # Errors
    /// As [`DsmFile::entry`]; `Limit` for a tile beyond [`Limits::memory`].
    pub fn tile(&self, level: LevelId, tile: TileId) -> Result<Tile> {
        let extent = self.level(level)?.shape.tile_extent(tile);
        self.decode(level, tile, extent)
    }

    /// A tile whose pixels are all equal, as a tile of one pixel.
    pub(super) fn tile_of_one_pixel(&self, level: LevelId, tile: TileId) -> Result<Tile> {
        self.decode(level, tile, (1, 1))
    }

    fn decode(&self, level: LevelId, tile: TileId, extent: (u32, u32)) -> Result<Tile> {
        let _turn = self.turn(&self.entry(level, tile)?, extent);
        let (entry, stored) = self.payload(level, tile)?;
        let limit = self.limits.memory;
        let decoded = Tile::decode_checked(&entry, &stored, extent, limit, Words::EMPTY);
        decoded.map_err(|e| e.at(self.payload_place(level, tile, &entry)))
    }

    /// Bytes of the planes of a decoded tile. 0 if it has none, if lookups can use it in place, or
    /// if its size exceeds the limit.
    pub(crate) fn decoded_bytes(&self, entry: &Entry, extent: (u32, u32)) -> usize {
        match self.source.as_slice() {
            Some(_) if Tile::is_plain(entry) => 0,
            _ => self.planes_bytes(entry, extent),
        }
    }

    /// Bytes of the planes of a decoded tile. 0 if it has none, or if its size exceeds the limit.
    pub(super) fn planes_bytes(&self, entry: &Entry, extent: (u32, u32)) -> usize {
        Tile::planes_bytes(entry, extent, self.limits.memory)
    }

    /// [`DsmFile::tile`] for a tile with planes. A plain tile of a file in memory stays in place;
    /// any other is decoded into `buffer`.
    pub(crate) fn tile_for_cache(
        &self,
        level: LevelId,
        tile: TileId,
        entry: &Entry,
        buffer: Words,
    ) -> Result<Tile> {
        let extent = self.level(level)?.shape.tile_extent(tile);
        let limit = self.limits.memory;
        let _turn = self.turn(entry, extent);
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
                // Reads straight into the memory of the tile.
                let mut words = buffer;
                words.set_len(padded / 8);
                let stored = bytemuck::cast_slice_mut(&mut words[..size / 8]);
                self.read(entry.offset, stored)?;
                return Tile::adopt(entry, words, extent, limit);
            }
            thread_local! {
                static STORED: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
            }
            self.limits.check(size as u64, "a piece of the file")?;
            scratch::lend(&STORED, |stored| {
                let stored = scratch::first(stored, size);
                self.read(entry.offset, stored)?;
                Tile::decode_into(entry, stored, extent, limit, buffer)
            })
        };
        decode().map_err(|e: Error| e.at(self.payload_place(level, tile, entry)))
    }

    /// Waits until a tile can be decoded within the limits, beside those that other threads decode.
    /// Tiles that are small, or will be refused, need not wait.
    fn turn(&self, entry: &Entry, extent: (u32, u32)) -> Option<Turn<'_>> {
        let most = self.limits.memory;
        let bytes = decoding_bytes(entry, extent.0 * extent.1);
        let counts = entry.kind == TileKind::Data && (most / 64..=most).contains(&bytes);
        counts.then(|| {
            let busy = self.decoding.lock().expect("no panic holds this lock");
            let free = self.decoded.wait_while(busy, |busy| *busy + bytes > most);
            *free.expect("no panic holds this lock") += bytes;
            Turn(self, bytes)
        })
    }

    /// The visibility function of a pixel of a level. Cost: reads and decodes its tile.
    ///
    /// # Errors
    /// As [`DsmFile::tile`]; `Input` if there is no such pixel.
    pub fn function(&self, level: LevelId, pixel: Pixel) -> Result<Visibility> {
        let shape = self.level(level)?.shape;
        shape.check_pixel(pixel)?;
        let tile = self.tile(level, shape.tile_of(pixel))?;
        let function = tile.function(shape.index_in_tile(pixel));
        let copy = function.len() * 4 * (1 + function.channels());
        self.limits
            .check((tile.bytes() + copy) as u64, "a function")?;
        Ok(function.to_visibility())
    }
}

/// Bytes that this thread takes to decode a tile.
struct Turn<'a>(&'a DsmFile, u64);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        *self.0.decoding.lock().expect("no panic holds this lock") -= self.1;
        self.0.decoded.notify_all();
    }
}

/// The record of tile `index` in its block, which holds a single one if all are equal.
fn record(block: &[u8], index: u64) -> &[u8] {
    &block[(index % BLOCK_ENTRIES) as usize * ENTRY_SIZE % block.len()..][..ENTRY_SIZE]
}

/// A part of a source in memory. Keeps the source alive.
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
    Error::io("cannot read the file", e).at(Place::byte(at))
}
