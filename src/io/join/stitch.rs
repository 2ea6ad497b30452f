//! Puts parts of a map side by side: copies their base tiles.

use super::parts::Parts;
use crate::format::layout::MAX_SIDE;
use crate::io::writer::{batch, in_parallel};
use crate::io::{Pixels, Writer};
use crate::map::{LevelId, MapHeader, MapId, Pixel, TileId};
use crate::{Error, Result};

/// The places of the parts in one map of the result.
#[derive(Debug)]
pub(super) struct Layout {
    /// Sorted from left to right.
    pieces: Vec<Piece>,
    /// Pixels outside all parts.
    pub lit: u64,
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

impl Layout {
    /// The layout and the header of a map of the result. Checks that the parts fit.
    pub fn new(parts: &Parts, map: usize) -> Result<(Self, MapHeader)> {
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
        let header = MapHeader {
            width: width as u32,
            height: height as u32,
            data_origin: [all[0] as i32, all[1] as i32],
            ..first.clone()
        };
        Ok((Layout { pieces, lit }, header))
    }

    /// Copies the base tiles of the map, row by row. `header` is that of the map.
    pub fn copy(
        &self,
        parts: &Parts,
        header: &MapHeader,
        writer: &mut Writer,
        to: MapId,
    ) -> Result<()> {
        let (mut waiting, mut bytes) = (Vec::new(), 0);
        for ty in 0..header.height.div_ceil(header.tile_size) {
            let pieces = self.pieces.iter();
            for piece in pieces.filter(|p| (p.top..p.top + p.down).contains(&ty)) {
                let (name, file) = &parts.files[piece.file];
                let shape = file.level(piece.base)?.shape;
                for tx in 0..piece.across {
                    let tile = TileId::new(tx, ty - piece.top);
                    let (Pixel { x, y }, (w, h)) =
                        (shape.first_pixel(tile), shape.tile_extent(tile));
                    let unpacked = file.unpacked_bytes(piece.base, [x, y, w, h]);
                    bytes += unpacked.map_err(|e| e.in_file(name))?;
                    let room = bytes <= file.limits().memory && waiting.len() < batch();
                    if !room && !waiting.is_empty() {
                        writer.tiles(to, read(parts, std::mem::take(&mut waiting))?)?;
                        bytes = 0;
                    }
                    waiting.push((*piece, tile));
                }
            }
        }
        writer.tiles(to, read(parts, waiting)?)
    }
}

fn read(parts: &Parts, places: Vec<(Piece, TileId)>) -> Result<Vec<(TileId, Pixels)>> {
    in_parallel(places, |(piece, tile)| {
        let (name, file) = &parts.files[piece.file];
        let mut stored = file
            .stored_tile(piece.base, tile)
            .map_err(|e| e.in_file(name))?;
        stored.name_file(name);
        let place = TileId::new(piece.left + tile.x, piece.top + tile.y);
        Ok((place, Pixels::Stored(stored)))
    })
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
