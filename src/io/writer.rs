//! Tiles in, file out: one forward pass, tiles in any order, levels built on the way.

mod encoding;
mod finished;
mod parallel;
mod state;

pub use encoding::{Encoding, Mips, Pixels, Summary};
pub(super) use parallel::{batch, in_parallel, threads};
use state::{Encoded, LevelState, MapState};

use std::io::Write;
use std::path::{Path, PathBuf};

use super::Progress;
use super::publish::{AtomicFile, Output};
use super::pyramid::{MipPlan, OpenTiles, Pyramid, Schedule};
use crate::format::directory::{self, Entry, TileKind};
use crate::format::footer::{BlockRef, Footer, LevelRecord, MAX_COUNT, MapRecord};
use crate::format::header::{Trailer, encode_header};
use crate::format::layout::{ALIGN, HEADER_SIZE, TRAILER_SIZE};
use crate::function::compress::Encoder;
use crate::function::compress::MIN_TOLERANCE;
use crate::map::{Attribute, Group, LevelShape, MapHeader, MapId, Pixel, TileId};
use crate::{Curve, Error, Place, Precision, Result};

type Callback = Box<dyn FnMut(Progress) -> bool + Send>;

/// Writes a deep shadow map file.
///
/// Add maps, give each pixel or tile once, in any order, then [`Writer::finish`]. Pixels that were not given are lit. Tiles are
/// compressed on all cores (feature `rayon`); what is written does not depend on how many there are. The levels above
/// the base are built on the way. A writer that is dropped before it finished, or that failed, leaves nothing behind.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, Pixel, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("wall.dsm");
/// let mut writer = Writer::create(&path)?;
/// let map = writer.add_map(MapHeader::new("light", 100, 50), Encoding::default())?;
/// for x in 0..100 {
///     // One row sees a wall.
///     writer.pixel(map, Pixel::new(x, 20), &Curve::mono(vec![7.5], vec![0.0])?)?;
/// }
/// let summary = writer.finish()?;
/// assert_eq!(summary.vertices[0][0], 100);
/// let file = DsmFile::open(&path)?;
/// assert_eq!(file.function(map.level(0), Pixel::new(3, 20))?.visibility_behind(7.5), 0.0);
/// # Ok(()) }
/// ```
pub struct Writer {
    out: Output,
    offset: u64,
    budget: usize,
    scratch: PathBuf,
    maps: Vec<MapState>,
    groups: Vec<Group>,
    attributes: Vec<(String, Attribute)>,
    progress: Option<Callback>,
    done: u64,
    failed: bool,
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer")
            .field("bytes", &self.offset)
            .field("maps", &self.maps.len())
            .finish_non_exhaustive()
    }
}

impl Writer {
    /// A file that appears at `path` when it is finished, in place of what stood there. Scratch storage lies in the same folder.
    ///
    /// # Errors
    /// `Io` if the folder cannot be written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut writer = Self::with_output(Output::File(AtomicFile::create(path)?))?;
        if let Some(folder) = path.parent().filter(|f| *f != Path::new("")) {
            writer.scratch = folder.to_owned();
        } else {
            writer.scratch = PathBuf::from(".");
        }
        Ok(writer)
    }

    /// A file that is written to `out`, forward only.
    ///
    /// # Errors
    /// `Io`.
    pub fn new(out: impl Write + Send + 'static) -> Result<Self> {
        Self::with_output(Output::Stream(Box::new(out)))
    }

    /// A file in memory: [`Writer::into_bytes`] finishes it and returns its bytes.
    pub fn in_memory() -> Self {
        Self::with_output(Output::Memory(Vec::new())).expect("a vector takes all bytes")
    }

    fn with_output(out: Output) -> Result<Self> {
        let mut writer = Writer {
            out,
            offset: 0,
            budget: 512 << 20,
            scratch: std::env::temp_dir(),
            maps: Vec::new(),
            groups: Vec::new(),
            attributes: Vec::new(),
            progress: None,
            done: 0,
            failed: false,
        };
        writer.put(&encode_header())?;
        Ok(writer)
    }

    /// The most bytes that open tiles may take, and that waiting levels may keep in memory. Default 512 MiB.
    pub fn set_budget(&mut self, bytes: usize) {
        self.budget = bytes;
    }

    /// The folder for scratch storage, which levels use when tiles come in an order that makes them wait beyond
    /// the budget (in Morton order they do not). Default: the folder of the file, or the system's for temporary files.
    pub fn set_scratch(&mut self, folder: impl Into<PathBuf>) {
        self.scratch = folder.into();
        self.maps
            .iter_mut()
            .for_each(|m| m.pyramid.folder.clone_from(&self.scratch));
    }

    /// Calls `callback` for every tile that was written, of any level. When it returns `false`, the
    /// method under way fails with `Cancelled`.
    pub fn on_progress(&mut self, callback: impl FnMut(Progress) -> bool + Send + 'static) {
        self.progress = Some(Box::new(callback));
    }

    /// Adds an attribute to the file. Names have 1 to 255 bytes and are unique in the file.
    pub fn add_attribute(&mut self, name: impl Into<String>, value: impl Into<Attribute>) {
        self.attributes.push((name.into(), value.into()));
    }

    /// Adds a group of maps that are looked up together.
    pub fn add_group(&mut self, group: Group) {
        self.groups.push(group);
    }

    /// Whether a map with this header can be added.
    fn check_map(&self, header: &MapHeader) -> Result<()> {
        header
            .check()
            .map_err(|(rule, what)| Error::input(format!("{what} ({rule})")))?;
        if self.maps.iter().any(|m| m.plan.header.name == header.name) {
            return Err(Error::input(format!(
                "two maps are called {:?} (MAP-NAME)",
                header.name
            )));
        }
        if self.maps.len() as u32 >= MAX_COUNT {
            return Err(Error::input("more than 65536 maps (MAP-COUNT)"));
        }
        // Whatever else the format does not allow is found now, not when the work is done.
        let level = |blocks| LevelRecord {
            max_error: 0.0,
            vertices: 0,
            payload_bytes: 0,
            blocks,
        };
        let small = MapHeader {
            width: 1,
            height: 1,
            ..header.clone()
        };
        let record = MapRecord {
            header: small,
            levels: vec![level(vec![BlockRef::default()])],
        };
        Footer {
            maps: vec![record],
            ..Footer::default()
        }
        .encode()?;
        Ok(())
    }

    /// Adds a map. The other methods take the id that this returns.
    ///
    /// # Errors
    /// `Input` for headers and encodings outside their domains, `Unsupported` for a codec that this build lacks.
    pub fn add_map(&mut self, header: MapHeader, encoding: Encoding) -> Result<MapId> {
        self.check_map(&header)?;
        encoding.codec.check()?;
        let tolerance = encoding.tolerance.max(MIN_TOLERANCE);
        let source_error = encoding.source_error;
        if !(source_error.is_finite() && source_error >= 0.0) {
            return Err(Error::input(format!("a source error of {source_error}")));
        }
        let precision = encoding
            .precision
            .unwrap_or_else(|| Precision::for_tolerance(tolerance));
        Encoder::new(encoding.compressor, precision, encoding.tolerance)?;
        let mip_tolerance = encoding.mip_tolerance.unwrap_or(tolerance);
        let mip_precision = encoding
            .precision
            .unwrap_or_else(|| Precision::for_tolerance(mip_tolerance));
        Encoder::new(encoding.compressor, mip_precision, mip_tolerance)?;
        let levels = match encoding.mips {
            Mips::None => 1,
            _ => header.full_level_count() as usize,
        };
        let mut max_errors = vec![tolerance];
        for level in 1..levels {
            max_errors.push(match encoding.mips {
                Mips::Halved => up(
                    max_errors[level - 1].max(source_error),
                    mip_tolerance * 0.5f64.powi(level as i32),
                ),
                _ => up(mip_tolerance.max(1.0 / 32768.0), source_error),
            });
        }
        let mut precisions = vec![mip_precision; levels];
        precisions[0] = precision;
        let schedule = if encoding.mips == Mips::Halved {
            Schedule::Halved
        } else {
            Schedule::Hidden
        };
        let shapes = (0..levels).map(|l| LevelShape::of(&header, l as u32));
        let levels_state: Vec<_> = shapes.map(LevelState::new).collect::<Result<_>>()?;
        let plan = MipPlan {
            header,
            compressor: encoding.compressor,
            schedule,
            max_errors,
            precisions,
        };
        let tiles = levels_state[0].shape.tiles();
        self.maps.push(MapState {
            plan,
            encoding,
            pyramid: Pyramid::new(levels, self.scratch.clone()),
            open: OpenTiles::default(),
            complete: Vec::new(),
            given: vec![vec![0; tiles.div_ceil(64) as usize]],
            finished: false,
            levels: levels_state,
            max_error: None,
        });
        Ok(MapId::from_index(self.maps.len() - 1))
    }

    fn map(&mut self, map: MapId) -> Result<&mut MapState> {
        if self.failed {
            return Err(Error::input("the writer has failed before"));
        }
        let maps = self.maps.len();
        self.maps
            .get_mut(map.index())
            .ok_or_else(|| Error::input(format!("no map {map} in a file of {maps}")))
    }

    /// Gives the function of a pixel of the base level. Tiles that are partly given are kept in
    /// memory.
    ///
    /// # Errors
    /// `Input` if there is no such pixel or it was given before; `Limit` if open tiles would exceed
    /// the budget; as [`Writer::tiles`].
    pub fn pixel(&mut self, map: MapId, pixel: Pixel, curve: &Curve) -> Result<()> {
        let place = |e: Error| e.at(pixel).at(map);
        let budget = self.budget;
        let state = self.map(map)?;
        state.check_unfinished().map_err(place)?;
        let shape = state.levels[0].shape;
        if pixel.x >= shape.width || pixel.y >= shape.height {
            let what = format!(
                "the pixel is outside the {} x {} pixels of the map",
                shape.width, shape.height
            );
            return Err(place(Error::input(what)));
        }
        let tile = shape.tile_of(pixel);
        if state.is_given(0, tile) && !state.open.is_open(tile) {
            return Err(place(Error::input("the pixel was given before")));
        }
        let held: usize = self.maps.iter().map(|m| m.open.held).sum();
        if held + OpenTiles::cost(curve) > budget {
            let what =
                format!("tiles that are partly given take more than the budget of {budget} bytes");
            return Err(place(Error::limit(what)));
        }
        let state = &mut self.maps[map.index()];
        let (width, height) = shape.tile_extent(tile);
        let (pixels, at) = ((width * height) as usize, shape.index_in_tile(pixel));
        let full = state.open.put(tile, pixels, at, curve.clone());
        if let Some(curves) = full.map_err(place)? {
            state.complete.push((tile, Pixels::Curves(curves)));
            if state.complete.len() >= batch() {
                let batch = std::mem::take(&mut state.complete);
                self.tiles(map, batch)?;
            }
        }
        Ok(())
    }

    /// Gives a whole tile of the base level. As [`Writer::tiles`] with one tile, which leaves the
    /// other cores idle.
    ///
    /// # Errors
    /// As [`Writer::tiles`].
    pub fn tile(&mut self, map: MapId, tile: TileId, pixels: Pixels) -> Result<()> {
        self.tiles(map, vec![(tile, pixels)])
    }

    /// Gives whole tiles of the base level, which are compressed in parallel and written in the order
    /// given.
    ///
    /// # Errors
    /// `Input` for tiles that do not exist, were given before, have another number of pixels, or are
    /// coloured in a map of one channel, for functions whose own error leaves nothing of the
    /// tolerance; `Limit`, `Io`, `Cancelled`.
    pub fn tiles(&mut self, map: MapId, tiles: Vec<(TileId, Pixels)>) -> Result<()> {
        let state = self.map(map)?;
        for (tile, pixels) in &tiles {
            state.accept(*tile, pixels).map_err(|e| {
                let index = state.levels[0].shape.tile_index(*tile);
                e.at(Place::tile(index)).at(map)
            })?;
        }
        let result = self.write_tiles(map, tiles);
        self.failed |= result.is_err();
        result
    }

    fn write_tiles(&mut self, map: MapId, tiles: Vec<(TileId, Pixels)>) -> Result<()> {
        let state = &self.maps[map.index()];
        let encoded = in_parallel(tiles, |(tile, pixels)| {
            let encoded = state.encode_base(tile, pixels)?;
            Ok((0, tile, encoded))
        })?;
        self.write_encoded(map, encoded)
    }

    /// Writes tiles, then whatever tiles of the levels above are complete with them.
    fn write_encoded(
        &mut self,
        map: MapId,
        mut encoded: Vec<(usize, TileId, Encoded)>,
    ) -> Result<()> {
        while !encoded.is_empty() {
            let mut ready = Vec::new();
            for (level, tile, encoded) in encoded {
                self.write_tile(map, level, tile, encoded.entry, &encoded.payload)?;
                if let Some(quarter) = encoded.quarter {
                    let budget = self.budget;
                    let state = &mut self.maps[map.index()];
                    let deposit =
                        state
                            .pyramid
                            .deposit(&state.plan, (level, tile), quarter, budget);
                    ready.extend(deposit?);
                }
            }
            let state = &self.maps[map.index()];
            encoded = in_parallel(ready, |ready| state.encode_parent(ready))?;
        }
        Ok(())
    }

    fn write_tile(
        &mut self,
        map: MapId,
        level: usize,
        tile: TileId,
        mut entry: Entry,
        payload: &[u8],
    ) -> Result<()> {
        if entry.kind == TileKind::Data {
            entry.offset = self.offset;
            self.put(payload)?;
        }
        self.maps[map.index()].levels[level].set(tile, entry);
        self.done += 1;
        let Some(callback) = &mut self.progress else {
            return Ok(());
        };
        let levels = self.maps.iter().flat_map(|m| &m.levels);
        let total = levels.map(|l| l.shape.tiles()).sum();
        let done = self.done;
        if callback(Progress { done, total }) {
            Ok(())
        } else {
            Err(Error::cancelled())
        }
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes)?;
        self.offset += bytes.len() as u64;
        Ok(())
    }

    /// Writes the tiles that are left, the directory and the footer, and makes the file visible.
    ///
    /// # Errors
    /// As [`Writer::tiles`]; `Input` for attributes and groups that the format does not allow, and for a file without maps.
    pub fn finish(self) -> Result<Summary> {
        self.finished().map(|(summary, _)| summary)
    }

    /// Finishes a file that was begun by [`Writer::in_memory`], and returns its bytes.
    ///
    /// # Errors
    /// As [`Writer::finish`]; `Input` if the file is not in memory.
    pub fn into_bytes(self) -> Result<Vec<u8>> {
        if !matches!(self.out, Output::Memory(_)) {
            return Err(Error::input("the file is not written to memory"));
        }
        self.finished().map(|(_, bytes)| bytes)
    }

    fn finished(mut self) -> Result<(Summary, Vec<u8>)> {
        for map in (0..self.maps.len()).map(MapId::from_index) {
            self.map(map)?;
            self.finish_map(map)?;
        }
        let mut summary = Summary::default();
        let directory_offset = self.offset;
        let mut footer = Footer {
            groups: std::mem::take(&mut self.groups),
            attributes: std::mem::take(&mut self.attributes),
            ..Footer::default()
        };
        for map in std::mem::take(&mut self.maps) {
            let mut max_errors = map.plan.max_errors;
            if let Some(max_error) = map.max_error {
                max_errors[0] = max_error;
            }
            let mut levels = Vec::new();
            for (level, max_error) in map.levels.iter().zip(max_errors) {
                let mut blocks = Vec::new();
                for b in 0..level.blocks.len() {
                    let (mut block, bytes) =
                        directory::encode_block(&level.block(b), map.encoding.codec)?;
                    block.offset = self.offset;
                    self.put(&bytes)?;
                    blocks.push(block);
                }
                let (vertices, payload_bytes) = (level.vertices, level.payload_bytes);
                levels.push(LevelRecord {
                    max_error: max_error.min(1.0),
                    vertices,
                    payload_bytes,
                    blocks,
                });
            }
            summary
                .vertices
                .push(levels.iter().map(|l| l.vertices).collect());
            footer.maps.push(MapRecord {
                header: map.plan.header,
                levels,
            });
        }
        let footer_offset = self.offset;
        let bytes = footer.encode()?;
        debug_assert_eq!((bytes.len() % ALIGN, footer_offset % ALIGN as u64), (0, 0));
        self.put(&bytes)?;
        let trailer = Trailer {
            file_length: self.offset + TRAILER_SIZE as u64,
            directory_offset,
            footer_offset,
            footer_size: bytes.len() as u64,
            footer_crc: crc32fast::hash(&bytes),
        };
        self.put(&trailer.encode())?;
        summary.bytes = self.offset;
        debug_assert!(self.offset >= (HEADER_SIZE + TRAILER_SIZE) as u64);
        let bytes = self.out.commit()?;
        Ok((summary, bytes))
    }

    fn finish_map(&mut self, map: MapId) -> Result<()> {
        let index = map.index();
        let complete = std::mem::take(&mut self.maps[index].complete);
        self.write_tiles(map, complete)?;
        for keys in self.maps[index].open.keys().chunks(batch()) {
            let state = &mut self.maps[index];
            let close = |&tile: &TileId| {
                let curves = state.open.close(tile)?;
                Some((tile, Pixels::Curves(curves)))
            };
            let tiles = keys.iter().filter_map(close).collect();
            self.tiles(map, tiles)?;
        }
        // What was never given is lit: tiles above it are complete without it.
        for level in 0..self.maps[index].levels.len() - 1 {
            loop {
                let state = &mut self.maps[index];
                let mut ready = Vec::new();
                while ready.len() < batch() {
                    match state.pyramid.take_incomplete(level)? {
                        Some(parent) => ready.push(parent),
                        None => break,
                    }
                }
                if ready.is_empty() {
                    break;
                }
                let state = &self.maps[index];
                let encoded = in_parallel(ready, |ready| state.encode_parent(ready))?;
                self.write_encoded(map, encoded)?;
            }
        }
        Ok(())
    }
}

/// The sum of two errors, rounded up where it rounds.
pub(super) fn up(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 {
        a + b
    } else {
        (a + b).next_up()
    }
}
