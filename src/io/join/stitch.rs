//! Parts of a map, put beside each other: base tiles copied byte for byte, levels made anew from them.

use super::Parts;
use crate::format::layout::MAX_SIDE;
use crate::function::compress::MIN_TOLERANCE;
use crate::io::writer::{batch, in_parallel};
use crate::io::{DsmFile, Encoding, Mips, Pixels, Writer};
use crate::map::{LevelId, MapHeader, MapId, TileId};
use crate::{Error, Result};

/// Maps that were made in parts, to be joined.
///
/// Each part is a file that holds a rectangle of every map: its width and height are the rectangle's, its `data_origin` says where the
/// rectangle lies. The whole covers the smallest rectangle that holds all parts; what no part covers is lit. Base tiles are
/// copied byte for byte, so they are those that one writer would have written for the whole. The levels are made from them.
///
/// The base has the largest error of its parts: [`Stitch::source_error`]. The levels add to it by the
/// schedule of [`Encoding::mips`]; their error is at most twice that of the base if nothing else is
/// asked for. [`Mips::Full`], where every level has that error, makes files about as large as those
/// of one writer for the whole; [`Mips::Halved`], where it grows level by level, larger ones.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, MapId, Pixel, Stitch, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// // One tile each; the second lies to the right of the first.
/// let part = |x: i32, v: f64| {
///     let mut writer = Writer::in_memory();
///     let header = MapHeader::new("key", 32, 32).data_origin([x, 0]);
///     let map = writer.add_map(header.display_window([0, 0, 63, 31]), Encoding::default())?;
///     writer.pixel(map, Pixel::new(0, 0), &Curve::mono(vec![5.0], vec![v])?)?;
///     DsmFile::from_bytes(writer.into_bytes()?)
/// };
/// let parts = vec![("left".into(), part(0, 0.5)?), ("right".into(), part(32, 0.0)?)];
/// let stitch = Stitch::new(parts)?;
/// let mut writer = Writer::in_memory();
/// stitch.write(&mut writer, &Encoding::default())?;
/// let whole = DsmFile::from_bytes(writer.into_bytes()?)?;
/// assert_eq!((whole.maps()[0].header.width, whole.maps()[0].levels.len()), (64, 7));
/// assert_eq!(whole.function(MapId(0).level(0), Pixel::new(32, 0))?.visibility_behind(5.0), 0.0);
/// # Ok(()) }
/// ```
#[derive(Debug)]
pub struct Stitch {
    parts: Parts,
    wholes: Vec<Whole>,
}

/// One map, put together.
#[derive(Debug)]
struct Whole {
    header: MapHeader,
    given: f64,
    /// From left to right.
    pieces: Vec<Piece>,
    lit: u64,
}

/// What one file has of a map, in tiles of the whole.
#[derive(Clone, Copy, Debug)]
struct Piece {
    file: usize,
    base: LevelId,
    left: u32,
    top: u32,
    across: u32,
    down: u32,
}

/// A rectangle of pixels of the display window: left, top, right, bottom, the last two outside.
type Area = [i64; 4];

fn area(header: &MapHeader) -> Area {
    let [x, y] = header.data_origin.map(i64::from);
    [
        x,
        y,
        x + i64::from(header.width),
        y + i64::from(header.height),
    ]
}

impl Stitch {
    /// Takes the parts, each with the name by which errors shall call it, and sees whether they fit together.
    ///
    /// # Errors
    /// `Input`, said of the file that does not fit ([`Error::file`]): all files must hold the same maps by name and the same groups; a map must have
    /// the same camera, display window, kind and unit of depth, interpretation, channels and tile size everywhere; its rectangles must lie whole tiles apart, end at
    /// whole tiles or at the border of the whole, and not overlap. And for a whole beyond what a file can hold.
    pub fn new(parts: Vec<(String, DsmFile)>) -> Result<Self> {
        let parts = Parts::by_name(parts)?;
        for file in 1..parts.files.len() {
            if parts.groups(file) != parts.groups(0) {
                let first = &parts.files[0].0;
                let what = format!("its groups of maps are not those of {first}");
                return Err(Error::input(what).in_file(&parts.files[file].0));
            }
        }
        let maps = 0..parts.maps.len();
        let wholes = maps.map(|m| Whole::new(&parts, m)).collect::<Result<_>>()?;
        Ok(Stitch { parts, wholes })
    }

    /// The headers of the maps as they will be.
    pub fn headers(&self) -> impl Iterator<Item = &MapHeader> {
        self.wholes.iter().map(|w| &w.header)
    }

    /// The largest error of any part of the base of a map, which is that of the result. Maps are
    /// numbered as [`Stitch::headers`] are.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn source_error(&self, map: MapId) -> f64 {
        self.wholes[map.index()].given
    }

    /// How many pixels of a map are in no part, and will be lit.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn lit_pixels(&self, map: MapId) -> u64 {
        self.wholes[map.index()].lit
    }

    /// What the parts do not agree in without harm, a line for each.
    pub fn notes(&self) -> &[String] {
        &self.parts.notes
    }

    /// Gives all maps, groups and attributes to `writer`, which the caller finishes. Of `encoding` count the codec of the levels' tiles and of the directories, and
    /// for the levels `mips`, `compressor`, `precision` and `mip_tolerance` (if `None`, the error of the base).
    ///
    /// # Errors
    /// As [`Writer::add_map`] and [`Writer::tiles`]; those of a part are said of it ([`Error::file`]).
    pub fn write(&self, writer: &mut Writer, encoding: &Encoding) -> Result<()> {
        let mut added = Vec::new();
        for whole in &self.wholes {
            let own = whole.given.max(MIN_TOLERANCE);
            let mip_tolerance = encoding.mip_tolerance.unwrap_or(own).max(MIN_TOLERANCE);
            let encoding = encoding.clone().tolerance(own).mip_tolerance(mip_tolerance);
            let encoding = encoding.source_error(whole.given);
            added.push(writer.add_map(whole.header.clone(), encoding)?);
        }
        self.parts.describe(writer, &added);
        for (whole, map) in self.wholes.iter().zip(added) {
            self.copy(whole, writer, map, encoding.mips != Mips::None)?;
        }
        Ok(())
    }

    /// Copies the base tiles of a map, row by row.
    fn copy(&self, whole: &Whole, writer: &mut Writer, map: MapId, decode: bool) -> Result<()> {
        let mut waiting = Vec::new();
        let rows = whole.header.height.div_ceil(whole.header.tile_size);
        for ty in 0..rows {
            let pieces = whole.pieces.iter();
            for piece in pieces.filter(|p| (p.top..p.top + p.down).contains(&ty)) {
                for tx in 0..piece.across {
                    waiting.push((*piece, TileId::new(tx, ty - piece.top)));
                    if waiting.len() == batch() {
                        writer.tiles(map, self.read(std::mem::take(&mut waiting), decode)?)?;
                    }
                }
            }
        }
        writer.tiles(map, self.read(waiting, decode)?)
    }

    fn read(&self, places: Vec<(Piece, TileId)>, decode: bool) -> Result<Vec<(TileId, Pixels)>> {
        in_parallel(places, |(piece, tile)| {
            let (name, file) = &self.parts.files[piece.file];
            let read = || {
                let mut stored = file.stored_tile(piece.base, tile)?;
                if decode {
                    stored.decode()?;
                }
                Ok(stored)
            };
            let stored = read().map_err(|e: Error| e.in_file(name))?;
            let place = TileId::new(piece.left + tile.x, piece.top + tile.y);
            Ok((place, Pixels::Stored(stored)))
        })
    }
}

impl Whole {
    fn new(parts: &Parts, map: usize) -> Result<Self> {
        parts.check_view(map)?;
        let files = 0..parts.files.len();
        let first = parts.header(map, 0);
        for file in files.clone() {
            let h = parts.header(map, file);
            let same = [
                (h.interpretation == first.interpretation, "interpretation"),
                (h.channels == first.channels, "number of channels"),
                (h.tile_size == first.tile_size, "tile size"),
            ];
            parts.check_same(map, file, &same)?;
        }
        let areas: Vec<Area> = files.clone().map(|f| area(parts.header(map, f))).collect();
        let mut all = areas[0];
        for [x0, y0, x1, y1] in areas.iter().copied() {
            all = [
                all[0].min(x0),
                all[1].min(y0),
                all[2].max(x1),
                all[3].max(y1),
            ];
        }
        let (width, height) = (all[2] - all[0], all[3] - all[1]);
        if width.max(height) > i64::from(MAX_SIDE) {
            return Err(Error::input(format!(
                "the parts of map {:?} span {width} x {height} pixels, of at most {MAX_SIDE} (MAP-SIZE)",
                first.name
            )));
        }
        let mut lit = (width * height) as u64;
        let mut pieces = Vec::new();
        for file in files {
            let [x0, y0, x1, y1] = areas[file];
            let of_file = |what| Error::input(what).in_file(&parts.files[file].0);
            check_grid(parts, map, file, [areas[0], areas[file], all]).map_err(of_file)?;
            let overlap = |a: &Area| x0 < a[2] && a[0] < x1 && y0 < a[3] && a[1] < y1;
            if let Some(other) = areas[..file].iter().position(overlap) {
                let [ax, ay, ..] = areas[other];
                return Err(of_file(format!(
                    "map {:?} overlaps that of {} from pixel {},{} on",
                    first.name,
                    parts.files[other].0,
                    x0.max(ax),
                    y0.max(ay)
                )));
            }
            lit -= ((x1 - x0) * (y1 - y0)) as u64;
            let tiles = |pixels: i64| (pixels as u32).div_ceil(first.tile_size);
            pieces.push(Piece {
                file,
                base: parts.base(map, file),
                left: tiles(x0 - all[0]),
                top: tiles(y0 - all[1]),
                across: tiles(x1 - x0),
                down: tiles(y1 - y0),
            });
        }
        // Those that share a row come from left to right.
        pieces.sort_by_key(|p| p.left);
        let max_errors = (0..parts.files.len()).map(|f| parts.max_error(map, f));
        Ok(Whole {
            header: MapHeader {
                width: width as u32,
                height: height as u32,
                data_origin: [all[0] as i32, all[1] as i32],
                ..first.clone()
            },
            given: max_errors.fold(0.0, f64::max),
            pieces,
            lit,
        })
    }
}

/// Whether the rectangle of a file lies on the tiles of the whole.
fn check_grid(
    parts: &Parts,
    map: usize,
    file: usize,
    [first, own, all]: [Area; 3],
) -> std::result::Result<(), String> {
    let header = parts.header(map, file);
    let (name, side) = (&header.name, i64::from(header.tile_size));
    for axis in 0..2 {
        if (own[axis] - first[axis]) % side != 0 {
            return Err(format!(
                "map {name:?} begins at {},{}: no whole tiles of {side} from {},{}, where that of {} begins",
                own[0], own[1], first[0], first[1], parts.files[0].0
            ));
        }
        let long = own[axis + 2] - own[axis];
        if long % side != 0 && own[axis + 2] != all[axis + 2] {
            return Err(format!(
                "map {name:?} is {long} pixels {}: no whole tiles of {side}, though others go on beyond it",
                ["wide", "high"][axis]
            ));
        }
    }
    Ok(())
}
