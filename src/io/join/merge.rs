//! Multiplies the maps of several objects that one camera sees.

use super::parts::Parts;
use crate::io::writer::{in_parallel, threads};
use crate::io::{Band, DsmFile, Pixels, Writer};
use crate::map::{Interpretation, LevelShape, MapHeader, MapId, Pixel, TileId};
use crate::{Curve, Result};

/// Pixels in memory at once before compression: 64 tiles of the default size.
const PIXELS: u32 = 64 * 32 * 32;

/// The header of the product of a map. Checks that the maps fit.
pub(super) fn header(parts: &Parts, map: usize) -> Result<MapHeader> {
    parts.check_same(map, |a, b| {
        let size = (a.width, a.height) == (b.width, b.height);
        [
            (size, "size"),
            (a.data_origin == b.data_origin, "data origin"),
        ]
    })?;
    let mut merged = parts.header(map, 0).clone();
    for file in 1..parts.files.len() {
        let h = parts.header(map, file);
        merged.channels = merged.channels.max(h.channels);
        if h.interpretation != merged.interpretation {
            merged.interpretation = Interpretation::Unspecified;
        }
    }
    Ok(merged)
}

/// Multiplies the functions of a map, in squares as large as the largest tiles.
pub(super) fn multiply(
    parts: &Parts,
    map: usize,
    header: &MapHeader,
    chord: f64,
    writer: &mut Writer,
    to: MapId,
) -> Result<()> {
    let files = 0..parts.files.len();
    let sides = files.map(|f| parts.header(map, f).tile_size);
    let squares = LevelShape {
        tile_size: sides.fold(header.tile_size, u32::max),
        ..LevelShape::of(header, 0)
    };
    let pixels = squares.tile_size * squares.tile_size;
    let at_once = ((PIXELS / pixels) as usize).max(threads());
    let limits = parts.files.iter().map(|(_, file)| file.limits());
    let room: u64 = limits.map(|limits| limits.memory).sum();
    let mut ids = squares.tile_ids().peekable();
    loop {
        let (mut next, mut bytes) = (Vec::new(), 0);
        while let Some(&id) = ids.peek() {
            bytes += unpacked_bytes(parts, map, squares, id)?;
            if !next.is_empty() && (bytes > room || next.len() == at_once) {
                break;
            }
            next.extend(ids.next());
        }
        if next.is_empty() {
            return Ok(());
        }
        let made = in_parallel(next, |id| square(parts, map, header, squares, id, chord))?;
        writer.tiles(to, made.into_iter().flatten().collect())?;
    }
}

/// Bytes that the functions of all files in a square take at most.
///
/// # Errors
/// `Limit` if those of a file exceed its limits.
fn unpacked_bytes(parts: &Parts, map: usize, squares: LevelShape, id: TileId) -> Result<u64> {
    let Pixel { x, y } = squares.first_pixel(id);
    let (width, height) = squares.tile_extent(id);
    let mut all = 0;
    for (file, (name, dsm)) in parts.files.iter().enumerate() {
        let bytes = dsm.unpacked_bytes(parts.base(map, file), [x, y, width, height]);
        let checked = bytes.and_then(|bytes| {
            dsm.limits().check(bytes, "a square of tiles")?;
            Ok(bytes)
        });
        all += checked.map_err(|e| e.in_file(name))?;
    }
    Ok(all)
}

/// The tiles of the result in a square.
fn square(
    parts: &Parts,
    map: usize,
    header: &MapHeader,
    squares: LevelShape,
    id: TileId,
    chord: f64,
) -> Result<Vec<(TileId, Pixels)>> {
    let Pixel { x: left, y: top } = squares.first_pixel(id);
    let (width, height) = squares.tile_extent(id);
    let read = |(file, (name, dsm)): (usize, &(String, DsmFile))| {
        let band = dsm.band(parts.base(map, file), [left, top, width, height]);
        let band = band.map_err(|e| e.in_file(name))?;
        Ok((band, parts.max_error(map, file)))
    };
    let files = parts.files.iter().enumerate().map(read);
    let files: Vec<(Band, f64)> = files.collect::<Result<_>>()?;
    let chord = chord / (files.len() - 1).max(1) as f64;
    let shape = LevelShape::of(header, 0);
    let side = shape.tile_size;
    let mut scratch = [Curve::lit(1), Curve::lit(1)];
    let mut tiles = Vec::new();
    for ty in top / side..(top + height).div_ceil(side) {
        for tx in left / side..(left + width).div_ceil(side) {
            let tile = TileId::new(tx, ty);
            let (w, h) = shape.tile_extent(tile);
            let (x0, y0) = (tx * side, ty * side);
            let mut curves = Vec::with_capacity((w * h) as usize);
            for y in y0..y0 + h {
                for x in x0..x0 + w {
                    curves.push(pixel(&files, x, y, chord, &mut scratch));
                }
            }
            tiles.push((tile, Pixels::Curves(curves)));
        }
    }
    Ok(tiles)
}

/// The product of the functions of one pixel.
fn pixel(files: &[(Band, f64)], x: u32, y: u32, chord: f64, scratch: &mut [Curve; 2]) -> Curve {
    let [next, out] = scratch;
    let mut all = Curve::lit(1);
    for (i, (band, max_error)) in files.iter().enumerate() {
        let f = band.function(x, y);
        // Lit pixels have this error too.
        if i == 0 {
            all.assign(f, *max_error);
            continue;
        }
        next.assign(f, *max_error);
        all.product(next, chord, out);
        std::mem::swap(&mut all, out);
    }
    all
}
