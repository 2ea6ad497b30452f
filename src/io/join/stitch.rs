//! [`Stitch`]: puts parts of a map side by side. Copies base tiles and builds the levels from them.

use super::Parts;
use crate::format::layout::MAX_SIDE;
use crate::function::compress::MIN_TOLERANCE;
use crate::io::writer::{batch, in_parallel};
use crate::io::{DsmFile, Encoding, Mips, Pixels, Writer};
use crate::map::{LevelId, MapHeader, MapId, Pixel, TileId};
use crate::{Error, Result};

/// Joins maps that were made in parts.
///
/// Each file holds a rectangle of every map: `data_origin` is its position, `width` and `height`
/// its size. The result covers the smallest rectangle that holds all parts. Pixels outside all
/// parts are lit. Base tiles are copied byte for byte, so they are the same as if one writer had
/// written the whole map. The levels above are built from them.
///
/// The base has the largest error of its parts, [`Stitch::source_error`]. The levels add to it by
/// the schedule of [`Encoding::mips`], by default to at most twice that error. With [`Mips::Full`]
/// every level has this error, and the file is about as large as that of one writer for the whole
/// map. With [`Mips::Halved`] the error grows level by level, and the file is larger.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, MapId, Pixel, Stitch, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// // Parts of one tile each, the second to the right of the first.
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

/// One map of the result.
#[derive(Debug)]
struct Whole {
    header: MapHeader,
    /// Largest error of its parts.
    source_error: f64,
    /// Sorted from left to right.
    pieces: Vec<Piece>,
    /// Pixels outside all parts.
    lit: u64,
}

/// The part of a map in one file. Position and size are in tiles of the whole map.
#[derive(Clone, Copy, Debug)]
struct Piece {
    file: usize,
    base: LevelId,
    left: u32,
    top: u32,
    across: u32,
    down: u32,
}

/// A rectangle of pixels of the display window: left, top, right, bottom; right and bottom are
/// exclusive.
type Area = [i64; 4];

fn area(header: &MapHeader) -> Area {
    let [x, y] = header.data_origin.map(i64::from);
    let [width, height] = [header.width, header.height].map(i64::from);
    [x, y, x + width, y + height]
}

impl Stitch {
    /// Takes the parts, each with its name for errors, and checks that they fit together.
    ///
    /// # Errors
    /// `Input`, with the name of the file that does not fit ([`Error::file`]), or if the whole
    /// exceeds the format. All files must hold the same maps by name, and the same groups. A map
    /// must have the same camera, display window, kind and unit of depth, interpretation, channels
    /// and tile size everywhere. Its rectangles must lie whole tiles apart, end at whole tiles or
    /// at the border of the whole, and not overlap.
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

    /// The headers of the resulting maps.
    pub fn headers(&self) -> impl Iterator<Item = &MapHeader> {
        self.wholes.iter().map(|w| &w.header)
    }

    /// Largest error of the base of a map, over all parts; `map` is an index of
    /// [`Stitch::headers`].
    ///
    /// # Panics
    /// If there is no such map.
    pub fn source_error(&self, map: MapId) -> f64 {
        self.wholes[map.index()].source_error
    }

    /// Number of pixels of a map outside all parts, which are lit.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn lit_pixels(&self, map: MapId) -> u64 {
        self.wholes[map.index()].lit
    }

    /// Harmless differences between the parts, a line for each.
    pub fn notes(&self) -> &[String] {
        &self.parts.notes
    }

    /// Gives all maps, groups and attributes to `writer`; the caller finishes it.
    ///
    /// From `encoding` come the codec of levels and directories, and for the levels `mips`,
    /// `compressor`, `precision` and `mip_tolerance` (`None` for the error of the base).
    ///
    /// # Errors
    /// As [`Writer::add_map`] and [`Writer::tiles`]. Errors of a part have its name
    /// ([`Error::file`]).
    pub fn write(&self, writer: &mut Writer, encoding: &Encoding) -> Result<()> {
        for (name, file) in &self.parts.files {
            file.check_layout().map_err(|e| e.in_file(name))?;
        }
        let mut added = Vec::new();
        for whole in &self.wholes {
            let own = whole.source_error.max(MIN_TOLERANCE);
            let mip_tolerance = encoding.mip_tolerance.unwrap_or(own).max(MIN_TOLERANCE);
            let encoding = encoding.clone().tolerance(own).mip_tolerance(mip_tolerance);
            let encoding = encoding.source_error(whole.source_error);
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
        let (mut waiting, mut bytes) = (Vec::new(), 0);
        let rows = whole.header.height.div_ceil(whole.header.tile_size);
        for ty in 0..rows {
            let pieces = whole.pieces.iter();
            for piece in pieces.filter(|p| (p.top..p.top + p.down).contains(&ty)) {
                let (name, file) = &self.parts.files[piece.file];
                let shape = file.level(piece.base)?.shape;
                for tx in 0..piece.across {
                    let tile = TileId::new(tx, ty - piece.top);
                    let (Pixel { x, y }, (w, h)) =
                        (shape.first_pixel(tile), shape.tile_extent(tile));
                    let unpacked = file.unpacked_bytes(piece.base, [x, y, w, h]);
                    bytes += unpacked.map_err(|e| e.in_file(name))?;
                    let room = bytes <= file.limits().memory && waiting.len() < batch();
                    if !room && !waiting.is_empty() {
                        writer.tiles(map, self.read(std::mem::take(&mut waiting), decode)?)?;
                        bytes = 0;
                    }
                    waiting.push((*piece, tile));
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
        parts.check_same(map, |a, b| {
            [
                (a.interpretation == b.interpretation, "interpretation"),
                (a.channels == b.channels, "number of channels"),
                (a.tile_size == b.tile_size, "tile size"),
            ]
        })?;
        let files = 0..parts.files.len();
        let first = parts.header(map, 0);
        let areas: Vec<Area> = files.clone().map(|f| area(parts.header(map, f))).collect();
        let all = areas.iter().fold(areas[0], |a, b| {
            [
                a[0].min(b[0]),
                a[1].min(b[1]),
                a[2].max(b[2]),
                a[3].max(b[3]),
            ]
        });
        let (width, height) = (all[2] - all[0], all[3] - all[1]);
        if width.max(height) > i64::from(MAX_SIDE) {
            return Err(Error::input(format!(
                "the parts of map {:?} span {width} x {height} pixels, \
                 of at most {MAX_SIDE} (MAP-SIZE)",
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
        // `copy` takes the pieces of a row from left to right.
        pieces.sort_by_key(|p| p.left);
        Ok(Whole {
            header: MapHeader {
                width: width as u32,
                height: height as u32,
                data_origin: [all[0] as i32, all[1] as i32],
                ..first.clone()
            },
            source_error: parts.max_errors(map).fold(0.0, f64::max),
            pieces,
            lit,
        })
    }
}

/// Checks that the rectangle of a file consists of whole tiles of the result.
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
                "map {name:?} begins at {},{}: no whole tiles of {side} from {},{}, \
                 where that of {} begins",
                own[0], own[1], first[0], first[1], parts.files[0].0
            ));
        }
        let long = own[axis + 2] - own[axis];
        if long % side != 0 && own[axis + 2] != all[axis + 2] {
            return Err(format!(
                "map {name:?} is {long} pixels {}: no whole tiles of {side}, \
                 though others go on beyond it",
                ["wide", "high"][axis]
            ));
        }
    }
    Ok(())
}
