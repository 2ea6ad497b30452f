//! [`Writer`]: takes tiles in any order, builds the levels, and writes the file front to back.

mod encoding;
mod finished;
mod parallel;
mod state;

use encoding::TileInput;
pub use encoding::{Encoding, Mips, Pixels, Summary};
pub(super) use parallel::{batch, in_parallel, threads};
use state::{COLOURED, Encoded, LevelState, MapState};

use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::publish::{AtomicFile, Output};
use super::pyramid::{MipPlan, OpenTiles, Pyramid, Schedule};
use super::temporary::{FileSystem, System};
use crate::format::directory::{BlockRef, TileKind};
use crate::format::footer::{Footer, LevelRecord, MAX_COUNT, MapRecord};
use crate::format::header::{Trailer, encode_header};
use crate::format::layout::{ALIGN, HEADER_SIZE, TRAILER_SIZE};
use crate::function::compress::Precision;
use crate::function::compress::{Encoder, MIN_TOLERANCE};
use crate::map::{Attribute, Group, LevelId, LevelShape, MapHeader, MapId, Pixel, TileId};
use crate::{Curve, Error, Result};

type Callback = Box<dyn FnMut(u64, u64) -> bool + Send>;

/// Writes a deep shadow map file.
///
/// Add maps, give each pixel or tile once, in any order, then call [`Writer::finish`]. Pixels that
/// were not given are lit. The writer compresses tiles on all cores (feature `rayon`) and builds
/// the levels above the base as tiles arrive; the number of cores does not change the file.
///
/// A writer that is dropped before it finishes, or that fails, leaves no file. If a method fails
/// after it has begun to write, or its progress callback panics, all later calls fail, too. Input
/// that is refused at once changes nothing.
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
    system: Arc<dyn FileSystem>,
    scratch: PathBuf,
    maps: Vec<MapState>,
    groups: Vec<Group>,
    attributes: Vec<(String, Attribute)>,
    progress: Option<Callback>,
    /// Bytes of tiles that are partly given.
    held: usize,
    /// Names of the maps.
    names: HashSet<String>,
    done: u64,
    /// Tiles of all maps and levels.
    total: u64,
    /// Whether a method that changes the file is in progress, or has failed.
    failed: bool,
    /// The same, for [`Writer::attempt`].
    attempting: bool,
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
    /// Writes a file that appears at `path` when it is finished, and replaces an existing one.
    /// Scratch storage is in the same folder.
    ///
    /// # Errors
    /// `Io` if the folder cannot be written; `Input` if `path` is not that of a file, but of a
    /// folder or a device.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        Self::create_on(Arc::new(System), path)
    }

    /// As [`Writer::create`], with the operations of `system`, which is also that of the scratch
    /// storage. Unstable, as all of [`raw`](crate::raw).
    ///
    /// # Errors
    /// As [`Writer::create`].
    pub fn create_on(system: Arc<dyn FileSystem>, path: impl AsRef<Path>) -> Result<Self> {
        let file = AtomicFile::create_on(system.clone(), path)?;
        let folder = file.folder().to_owned();
        Self::with_output(Output::File(file), system, folder)
    }

    /// Writes a file to `out`, front to back.
    ///
    /// # Errors
    /// `Io`.
    pub fn new(out: impl Write + Send + 'static) -> Result<Self> {
        let out = Output::Stream(Box::new(out));
        Self::with_output(out, Arc::new(System), std::env::temp_dir())
    }

    /// Writes a file in memory. [`Writer::into_bytes`] finishes it and returns its bytes.
    pub fn in_memory() -> Self {
        let out = Output::Memory(Vec::new());
        let writer = Self::with_output(out, Arc::new(System), std::env::temp_dir());
        writer.expect("writing to a vector does not fail")
    }

    fn with_output(out: Output, system: Arc<dyn FileSystem>, scratch: PathBuf) -> Result<Self> {
        let mut writer = Writer {
            out,
            offset: 0,
            budget: 512 << 20,
            system,
            scratch,
            maps: Vec::new(),
            groups: Vec::new(),
            attributes: Vec::new(),
            progress: None,
            held: 0,
            names: HashSet::new(),
            done: 0,
            total: 0,
            failed: false,
            attempting: false,
        };
        writer.put(&encode_header())?;
        Ok(writer)
    }

    /// Sets the most bytes of tiles that are partly given, and the most bytes of waiting levels in
    /// memory. Default 512 MiB each. Further levels wait in scratch storage; tiles in Morton order
    /// need none.
    pub fn set_budget(&mut self, bytes: usize) {
        self.budget = bytes;
    }

    /// Sets the folder of scratch storage for the maps that are added after this call. Default: the
    /// folder of the file, or the system's folder for temporary files.
    pub fn set_scratch(&mut self, folder: impl Into<PathBuf>) {
        self.scratch = folder.into();
    }

    /// Calls `callback` after every tile that is written, of any level, with the number of tiles
    /// done and of all tiles. If it returns `false`, the method in progress fails with `Cancelled`.
    pub fn on_progress(&mut self, callback: impl FnMut(u64, u64) -> bool + Send + 'static) {
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

    /// # Errors
    /// `Input` if the format or this file cannot hold a map with this header.
    fn check_map(&self, header: &MapHeader) -> Result<()> {
        let broken = |(rule, what)| Error::input(format!("{what} ({rule})"));
        header.check().map_err(broken)?;
        if self.names.contains(&header.name) {
            let what = format!("two maps are called {:?} (MAP-NAME)", header.name);
            return Err(Error::input(what));
        }
        if self.maps.len() as u32 >= MAX_COUNT {
            return Err(Error::input("more than 65536 maps (MAP-COUNT)"));
        }
        // Encodes the footer of a map of one pixel, to find now what would fail at the end.
        let record = MapRecord {
            header: MapHeader {
                width: 1,
                height: 1,
                ..header.clone()
            },
            levels: vec![LevelRecord {
                max_error: 0.0,
                vertices: 0,
                payload_bytes: 0,
                blocks: vec![BlockRef::default()],
            }],
        };
        let footer = Footer {
            maps: vec![record],
            ..Footer::default()
        };
        footer.encode().map(|_| ())
    }

    /// Adds a map. The other methods take the id that this returns.
    ///
    /// # Errors
    /// `Input` for headers and encodings outside their domains, `Unsupported` for a codec that this
    /// build lacks.
    pub fn add_map(&mut self, header: MapHeader, encoding: Encoding) -> Result<MapId> {
        self.check_map(&header)?;
        encoding.codec.check()?;
        let source_error = encoding.source_error;
        if !(source_error.is_finite() && source_error >= 0.0) {
            return Err(Error::input(format!("a source error of {source_error}")));
        }
        let precision_for = |tolerance| {
            let chosen = || Precision::for_tolerance(tolerance);
            encoding.precision.unwrap_or_else(chosen)
        };
        let tolerance = encoding.tolerance.max(MIN_TOLERANCE);
        let mip_tolerance = encoding.mip_tolerance.unwrap_or(tolerance);
        let (precision, mip_precision) = (precision_for(tolerance), precision_for(mip_tolerance));
        Encoder::new(encoding.compressor, precision, encoding.tolerance)?;
        Encoder::new(encoding.compressor, mip_precision, mip_tolerance)?;
        let (levels, schedule) = match encoding.mips {
            Mips::None => (1, Schedule::Hidden),
            Mips::Full => (header.full_level_count(), Schedule::Hidden),
            Mips::Halved => (header.full_level_count(), Schedule::Halved),
        };
        let mut max_errors = vec![tolerance];
        for level in 1..levels {
            max_errors.push(match schedule {
                Schedule::Hidden => up(mip_tolerance.max(1.0 / 32768.0), source_error),
                Schedule::Halved => up(
                    max_errors[level as usize - 1].max(source_error),
                    mip_tolerance * 0.5f64.powi(level as i32),
                ),
            });
        }
        let mut precisions = vec![mip_precision; levels as usize];
        precisions[0] = precision;
        let plan = MipPlan {
            header,
            compressor: encoding.compressor,
            schedule,
            max_errors,
            precisions,
        };
        self.push_map(plan, encoding, false)
    }

    fn push_map(&mut self, plan: MipPlan, encoding: Encoding, finished: bool) -> Result<MapId> {
        let levels = 0..plan.max_errors.len();
        let level = |l| LevelState::new(LevelShape::of(&plan.header, l as u32));
        let states: Vec<_> = levels.clone().map(level).collect::<Result<_>>()?;
        self.names.insert(plan.header.name.clone());
        self.total += states.iter().map(|l| l.shape.tiles()).sum::<u64>();
        self.maps.push(MapState {
            levels: states,
            plan,
            encoding,
            pyramid: Pyramid::new(levels.len(), self.system.clone(), self.scratch.clone()),
            open: OpenTiles::default(),
            complete: Vec::new(),
            finished,
            max_error: None,
        });
        Ok(MapId::from_index(self.maps.len() - 1))
    }

    fn map(&mut self, map: MapId) -> Result<&mut MapState> {
        if self.failed {
            return Err(failed_before());
        }
        let maps = self.maps.len();
        self.maps
            .get_mut(map.index())
            .ok_or_else(|| Error::input(format!("no map {map} in a file of {maps}")))
    }

    /// Does `work` that changes the file. If it fails or panics, the file is never published.
    fn change(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        self.failed = true;
        work(self)?;
        self.failed = false;
        Ok(())
    }

    /// As [`Writer::change`], for work that calls public methods.
    pub(super) fn attempt(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        let outer = std::mem::replace(&mut self.attempting, true);
        work(self)?;
        self.attempting = outer;
        Ok(())
    }

    /// Gives the function of a pixel of the base level. Tiles that are partly given stay in memory.
    ///
    /// # Errors
    /// `Input` if there is no such pixel or it was given before; `Limit` if tiles that are partly
    /// given would exceed the budget; and as [`Writer::tiles`].
    pub fn pixel(&mut self, map: MapId, pixel: Pixel, curve: &Curve) -> Result<()> {
        let place = |e: Error| e.at(pixel).at(map);
        let budget = self.budget;
        let state = self.map(map)?;
        state.check_finished(false).map_err(place)?;
        let shape = state.levels[0].shape;
        shape.check_pixel(pixel).map_err(place)?;
        let tile = shape.tile_of(pixel);
        if state.is_given(tile) {
            return Err(place(Error::input("the pixel was given before")));
        }
        if curve.channels() > state.plan.header.channels {
            return Err(place(Error::input(COLOURED)));
        }
        if self.held + OpenTiles::cost(curve) > budget {
            let what =
                format!("tiles that are partly given take more than the budget of {budget} bytes");
            return Err(place(Error::limit(what)));
        }
        let state = &mut self.maps[map.index()];
        let (width, height) = shape.tile_extent(tile);
        let (pixels, at) = ((width * height) as usize, shape.index_in_tile(pixel));
        let before = state.open.held;
        let full = state.open.put(tile, pixels, at, curve.clone());
        self.held = self.held + state.open.held - before;
        if let Some(curves) = full.map_err(place)? {
            state.complete.push((tile, Pixels::Curves(curves)));
            if state.complete.len() >= batch() {
                let batch = std::mem::take(&mut state.complete);
                return self.attempt(|writer| writer.tiles(map, batch));
            }
        }
        Ok(())
    }

    /// Gives a whole tile of the base level. [`Writer::tiles`] uses all cores; this uses one.
    ///
    /// # Errors
    /// As [`Writer::tiles`].
    pub fn tile(&mut self, map: MapId, tile: TileId, pixels: Pixels) -> Result<()> {
        self.tiles(map, vec![(tile, pixels)])
    }

    /// Gives whole tiles of the base level. Compresses them in parallel and writes them in the
    /// order given.
    ///
    /// # Errors
    /// `Input` for tiles that do not exist, were given before, have another number of pixels, or
    /// are coloured in a map of one channel, and for functions whose own error uses up the
    /// tolerance; `Limit`, `Io`, `Cancelled`.
    pub fn tiles(&mut self, map: MapId, tiles: Vec<(TileId, Pixels)>) -> Result<()> {
        let state = self.map(map)?;
        let checked = state.check_finished(false);
        checked.map_err(|e| e.at(map.level(0)))?;
        let errors = tiles.iter().map(|(_, pixels)| state.error_of(pixels));
        let max_error = errors.chain(state.max_error).reduce(f64::max);
        self.take(map.level(0), tiles, Pixels::input, MapState::encode_base)?;
        self.maps[map.index()].max_error = max_error;
        Ok(())
    }

    /// Encodes tiles of a level that the caller gives, and writes them. If one is refused, none is
    /// taken.
    fn take<T: Send>(
        &mut self,
        level: LevelId,
        tiles: Vec<(TileId, T)>,
        input: impl Fn(&T) -> TileInput,
        encode: impl Fn(&MapState, TileId, T) -> Result<Encoded> + Sync + Send,
    ) -> Result<()> {
        let place = |e: Error| e.at(level);
        let state = self.map(level.map)?;
        let check = |(id, tile): &(_, T)| state.check(level.index(), *id, &input(tile));
        tiles.iter().try_for_each(check).map_err(place)?;
        self.change(|writer| {
            let state = &mut writer.maps[level.map.index()];
            let mut give = |(id, _): &(TileId, T)| state.levels[level.index()].give(*id);
            tiles.iter().try_for_each(&mut give).map_err(place)?;
            writer.write(level.map, tiles, |state, (id, tile)| {
                encode(state, id, tile)
            })
        })
    }

    /// Encodes tiles in parallel, writes them in order, and then the tiles that they complete in
    /// the levels above.
    fn write<T: Send>(
        &mut self,
        map: MapId,
        tiles: Vec<T>,
        encode: impl Fn(&MapState, T) -> Result<Encoded> + Sync + Send,
    ) -> Result<()> {
        let state = &self.maps[map.index()];
        let encoded = in_parallel(tiles, |tile| encode(state, tile))?;
        self.write_encoded(map, encoded)
    }

    fn write_encoded(&mut self, map: MapId, mut encoded: Vec<Encoded>) -> Result<()> {
        while !encoded.is_empty() {
            let mut ready = Vec::new();
            for mut tile in encoded {
                let quarter = tile.quarter.take();
                let id = (tile.level, tile.tile);
                self.write_tile(map, tile)?;
                if let Some(quarter) = quarter {
                    let MapState { plan, pyramid, .. } = &mut self.maps[map.index()];
                    ready.extend(pyramid.deposit(plan, id, quarter, self.budget)?);
                }
            }
            let state = &self.maps[map.index()];
            encoded = in_parallel(ready, |ready| state.encode_parent(&ready))?;
        }
        Ok(())
    }

    fn write_tile(&mut self, map: MapId, tile: Encoded) -> Result<()> {
        let mut entry = tile.entry;
        if entry.kind == TileKind::Data {
            entry.offset = self.offset;
            self.put(&tile.payload)?;
        }
        let state = &mut self.maps[map.index()];
        state.levels[tile.level].set(tile.tile, entry, state.encoding.codec)?;
        self.done += 1;
        let Some(callback) = &mut self.progress else {
            return Ok(());
        };
        match callback(self.done, self.total) {
            true => Ok(()),
            false => Err(Error::cancelled()),
        }
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes)?;
        self.offset += bytes.len() as u64;
        Ok(())
    }

    /// Writes the remaining tiles, the directory and the footer, and makes the file visible.
    ///
    /// # Errors
    /// As [`Writer::tiles`]; `Input` for attributes and groups that the format does not allow, and
    /// for a file without maps.
    pub fn finish(self) -> Result<Summary> {
        self.finished().map(|(summary, _)| summary)
    }

    /// Finishes a file of [`Writer::in_memory`], and returns its bytes.
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
        if self.failed || self.attempting {
            return Err(failed_before());
        }
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
        for mut map in std::mem::take(&mut self.maps) {
            let mut max_errors = map.plan.max_errors;
            max_errors[0] = map.max_error.unwrap_or(max_errors[0]);
            let mut levels = Vec::new();
            for (level, max_error) in map.levels.iter_mut().zip(max_errors) {
                let mut blocks = Vec::new();
                for b in 0..level.blocks.len() {
                    let (mut block, bytes) = level.take_block(b, map.encoding.codec)?;
                    block.offset = self.offset;
                    self.put(&bytes)?;
                    blocks.push(block);
                }
                levels.push(LevelRecord {
                    max_error: max_error.min(1.0),
                    vertices: level.vertices,
                    payload_bytes: level.payload_bytes,
                    blocks,
                });
            }
            let vertices = levels.iter().map(|l| l.vertices);
            summary.vertices.push(vertices.collect());
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
        if !complete.is_empty() {
            self.tiles(map, complete)?;
        }
        for keys in self.maps[index].open.keys().chunks(batch()) {
            let state = &mut self.maps[index];
            let close = |&tile: &TileId| Some((tile, Pixels::Curves(state.open.close(tile)?)));
            let tiles = keys.iter().filter_map(close).collect();
            self.tiles(map, tiles)?;
        }
        // Tiles that were never given are lit, so no tile above them waits any longer.
        for level in 0..self.maps[index].levels.len() - 1 {
            loop {
                let pyramid = &mut self.maps[index].pyramid;
                let next = |_| pyramid.take_incomplete(level).transpose();
                let ready: Vec<_> = (0..batch()).map_while(next).collect::<Result<_>>()?;
                if ready.is_empty() {
                    break;
                }
                self.write(map, ready, |state, ready| state.encode_parent(&ready))?;
            }
        }
        Ok(())
    }
}

fn failed_before() -> Error {
    Error::input("an earlier call of this writer failed: the file is incomplete")
}

/// The sum of two errors, rounded up unless it is exact because one is 0.
pub(super) fn up(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 {
        a + b
    } else {
        (a + b).next_up()
    }
}
