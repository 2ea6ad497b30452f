//! Tiles in, file out: one forward pass, tiles in any order, levels built on the way.

mod encoding;
mod finished;
mod parallel;
mod state;

pub use encoding::{Encoding, Mips, Pixels, Summary, TileInput};
pub(super) use parallel::{batch, in_parallel, threads};
use state::{Encoded, LevelState, MapState};

use std::io::Write;
use std::path::{Path, PathBuf};

use super::Progress;
use super::publish::{AtomicFile, Plain, Sink};
use super::pyramid::{OpenTiles, Plan, Pyramid, Schedule};
use crate::format::directory::{self, Entry, TileKind};
use crate::format::footer::{BlockRef, Footer, LevelRecord, MAX_COUNT, MapRecord};
use crate::format::header::{Trailer, encode_header};
use crate::format::layout::{ALIGN, HEADER_SIZE, TRAILER_SIZE};
use crate::map::{Attribute, Group, LevelShape, MapHeader};
use crate::{Curve, Encoder, Error, MIN_TOLERANCE, Place, Result, lattice_for};

type Callback<'a> = Box<dyn FnMut(Progress) -> bool + Send + 'a>;

/// Writes a deep shadow map file.
///
/// Add maps, give each pixel or tile once, in any order, then [`Writer::finish`]. Pixels that were not given are lit. Tiles are
/// compressed on all cores (feature `rayon`); what is written does not depend on how many there are. The levels above
/// the base are built on the way. A writer that is dropped before it finished, or that failed, leaves nothing behind.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("wall.dsm");
/// let mut writer = Writer::create(&path)?;
/// let map = writer.add_map(MapHeader::new("light", 100, 50), Encoding::default())?;
/// for x in 0..100 {
///     writer.pixel(map, x, 20, &Curve::mono(vec![7.5], vec![0.0])?)?; // one row sees a wall
/// }
/// let summary = writer.finish()?;
/// assert_eq!(summary.vertices[0][0], 100);
/// assert_eq!(DsmFile::open(&path)?.function(0, 0, 3, 20)?.behind(7.5), 0.0);
/// # Ok(()) }
/// ```
pub struct Writer<'a> {
    out: Box<dyn Sink + 'a>,
    offset: u64,
    budget: usize,
    scratch: PathBuf,
    maps: Vec<MapState>,
    groups: Vec<Group>,
    attributes: Vec<Attribute>,
    progress: Option<Callback<'a>>,
    done: u64,
    failed: bool,
}

impl std::fmt::Debug for Writer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer")
            .field("bytes", &self.offset)
            .field("maps", &self.maps.len())
            .finish_non_exhaustive()
    }
}

impl Writer<'static> {
    /// A file that appears at `path` when it is finished, in place of what stood there. Scratch storage lies in the same folder.
    ///
    /// # Errors
    /// `Io` if the folder cannot be written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut writer = Self::with_sink(Box::new(AtomicFile::create(path)?))?;
        if let Some(folder) = path.parent().filter(|f| *f != Path::new("")) {
            writer.scratch = folder.to_owned();
        } else {
            writer.scratch = PathBuf::from(".");
        }
        Ok(writer)
    }
}

impl<'a> Writer<'a> {
    /// A file that is written to `out`, forward only.
    ///
    /// # Errors
    /// `Io`.
    pub fn new(out: impl Write + Send + 'a) -> Result<Self> {
        Self::with_sink(Box::new(Plain(out)))
    }

    fn with_sink(out: Box<dyn Sink + 'a>) -> Result<Self> {
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

    /// Has `callback` called for every tile that was written, of any level; when it returns `false`, the call under way fails with `Cancelled`.
    pub fn on_progress(&mut self, callback: impl FnMut(Progress) -> bool + Send + 'a) {
        self.progress = Some(Box::new(callback));
    }

    /// Adds an attribute to the file.
    pub fn add_attribute(&mut self, attribute: Attribute) {
        self.attributes.push(attribute);
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

    /// Adds a map; its number is what the other methods take.
    ///
    /// # Errors
    /// `Input` for headers and encodings outside their domains, `Unsupported` for a codec that this build lacks.
    pub fn add_map(&mut self, header: MapHeader, encoding: Encoding) -> Result<usize> {
        self.check_map(&header)?;
        encoding.codec.check()?;
        let tolerance = encoding.tolerance.max(MIN_TOLERANCE);
        let given = encoding.given_error;
        if !(given.is_finite() && given >= 0.0) {
            return Err(Error::input(format!("a given error of {given}")));
        }
        let precision = encoding.precision.unwrap_or_else(|| lattice_for(tolerance));
        Encoder::new(encoding.compressor, precision, encoding.tolerance)?;
        let mip_tolerance = encoding.mip_tolerance.unwrap_or(tolerance);
        let mip_precision = encoding
            .precision
            .unwrap_or_else(|| lattice_for(mip_tolerance));
        Encoder::new(encoding.compressor, mip_precision, mip_tolerance)?;
        let levels = match encoding.mips {
            Mips::None => 1,
            _ => header.full_level_count() as usize,
        };
        let mut promises = vec![tolerance];
        for level in 1..levels {
            promises.push(match encoding.mips {
                Mips::Halved => up(
                    promises[level - 1].max(given),
                    mip_tolerance * 0.5f64.powi(level as i32),
                ),
                _ => up(mip_tolerance.max(1.0 / 32768.0), given),
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
        let plan = Plan {
            header,
            compressor: encoding.compressor,
            schedule,
            promises,
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
            promise: None,
        });
        Ok(self.maps.len() - 1)
    }

    fn map(&mut self, map: usize) -> Result<&mut MapState> {
        if self.failed {
            return Err(Error::input("the writer has failed before"));
        }
        let maps = self.maps.len();
        self.maps
            .get_mut(map)
            .ok_or_else(|| Error::input(format!("no map {map} in a file of {maps}")))
    }

    /// Gives the function of pixel (x, y) of the base level. Tiles that are partly given are kept in memory.
    ///
    /// # Errors
    /// `Input` if there is no such pixel or it was given before; `Limit` if open tiles would exceed the budget; as [`Writer::tiles`].
    pub fn pixel(&mut self, map: usize, x: u32, y: u32, curve: &Curve) -> Result<()> {
        let place = Place {
            map: Some(map as u32),
            pixel: Some((x, y)),
            ..Place::default()
        };
        let budget = self.budget;
        let state = self.map(map)?;
        state.check_unfinished().map_err(|e| e.at(place))?;
        let shape = state.levels[0].shape;
        if x >= shape.width || y >= shape.height {
            let what = format!(
                "the pixel is outside the {} x {} pixels of the map",
                shape.width, shape.height
            );
            return Err(Error::input(what).at(place));
        }
        let side = shape.tile_size;
        let tile = (x / side, y / side);
        if state.is_given(0, tile) && !state.open.is_open(tile) {
            return Err(Error::input("the pixel was given before").at(place));
        }
        let held: usize = self.maps.iter().map(|m| m.open.held).sum();
        if held + OpenTiles::cost(curve) > budget {
            let what =
                format!("tiles that are partly given take more than the budget of {budget} bytes");
            return Err(Error::limit(what).at(place));
        }
        let state = &mut self.maps[map];
        let (width, height) = shape.tile_extent(tile.0, tile.1);
        let at = (y % side * width + x % side) as usize;
        let full = state
            .open
            .put(tile, (width * height) as usize, at, curve.clone())
            .map_err(|e| e.at(place))?;
        if let Some(curves) = full {
            state.complete.push(TileInput {
                tx: tile.0,
                ty: tile.1,
                pixels: Pixels::Curves(curves),
            });
            if state.complete.len() >= batch() {
                let batch = std::mem::take(&mut state.complete);
                self.tiles(map, batch)?;
            }
        }
        Ok(())
    }

    /// Gives a whole tile of the base level. As [`Writer::tiles`] with one tile, which leaves the other cores idle.
    ///
    /// # Errors
    /// As [`Writer::tiles`].
    pub fn tile(&mut self, map: usize, tile: TileInput) -> Result<()> {
        self.tiles(map, vec![tile])
    }

    /// Gives whole tiles of the base level, which are compressed in parallel and written in the order given.
    ///
    /// # Errors
    /// `Input` for tiles that do not exist, were given before, have another number of pixels, or are coloured in a map of one channel, for functions whose
    /// own error leaves nothing of the tolerance; `Limit`, `Io`, `Cancelled`.
    pub fn tiles(&mut self, map: usize, tiles: Vec<TileInput>) -> Result<()> {
        let state = self.map(map)?;
        for tile in &tiles {
            state.accept(tile).map_err(|e| {
                let index = state.levels[0].shape.tile_index(tile.tx, tile.ty);
                e.at(Place {
                    map: Some(map as u32),
                    tile: Some(index),
                    ..Place::default()
                })
            })?;
        }
        let result = self.write_tiles(map, tiles);
        self.failed |= result.is_err();
        result
    }

    fn write_tiles(&mut self, map: usize, tiles: Vec<TileInput>) -> Result<()> {
        let state = &self.maps[map];
        let encoded = in_parallel(tiles, |tile| {
            let place = (0, tile.tx, tile.ty);
            state.encode_base(tile).map(|encoded| (place, encoded))
        })?;
        self.write_encoded(map, encoded)
    }

    /// Writes tiles, then whatever tiles of the levels above are complete with them.
    fn write_encoded(
        &mut self,
        map: usize,
        mut encoded: Vec<((usize, u32, u32), Encoded)>,
    ) -> Result<()> {
        while !encoded.is_empty() {
            let mut ready = Vec::new();
            for (place, tile) in encoded {
                self.write_tile(map, place, tile.entry, &tile.payload)?;
                if let Some(quarter) = tile.quarter {
                    let budget = self.budget;
                    let state = &mut self.maps[map];
                    ready.extend(state.pyramid.deposit(&state.plan, place, quarter, budget)?);
                }
            }
            let state = &self.maps[map];
            encoded = in_parallel(ready, |ready| state.encode_parent(ready))?;
        }
        Ok(())
    }

    fn write_tile(
        &mut self,
        map: usize,
        (level, tx, ty): (usize, u32, u32),
        mut entry: Entry,
        payload: &[u8],
    ) -> Result<()> {
        if entry.kind == TileKind::Data {
            entry.offset = self.offset;
            self.put(payload)?;
        }
        self.maps[map].levels[level].set(tx, ty, entry);
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
        self.out
            .write_all(bytes)
            .map_err(|e| Error::io("cannot write the file", e))?;
        self.offset += bytes.len() as u64;
        Ok(())
    }

    /// Writes what is left, the directory and the footer, and makes the file visible.
    ///
    /// # Errors
    /// As [`Writer::tiles`]; `Input` for attributes and groups that the format does not allow, and for a file without maps.
    pub fn finish(mut self) -> Result<Summary> {
        for map in 0..self.maps.len() {
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
            let mut promises = map.plan.promises;
            if let Some(promise) = map.promise {
                promises[0] = promise;
            }
            let mut levels = Vec::new();
            for (level, promise) in map.levels.iter().zip(promises) {
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
                    max_error: promise.min(1.0),
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
        self.out.commit()?;
        Ok(summary)
    }

    fn finish_map(&mut self, map: usize) -> Result<()> {
        let complete = std::mem::take(&mut self.maps[map].complete);
        self.write_tiles(map, complete)?;
        for keys in self.maps[map].open.keys().chunks(batch()) {
            let state = &mut self.maps[map];
            let close = |&(tx, ty): &(u32, u32)| {
                state.open.close((tx, ty)).map(|curves| TileInput {
                    tx,
                    ty,
                    pixels: Pixels::Curves(curves),
                })
            };
            let tiles = keys.iter().filter_map(close).collect();
            self.tiles(map, tiles)?;
        }
        // What was never given is lit: tiles above it are complete without it.
        for level in 0..self.maps[map].levels.len() - 1 {
            loop {
                let state = &mut self.maps[map];
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
                let state = &self.maps[map];
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
