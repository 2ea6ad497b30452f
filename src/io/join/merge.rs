//! [`Merge`]: multiplies the maps of several objects that one camera sees.

use super::Parts;
use crate::function::compress::MIN_TOLERANCE;
use crate::io::writer::{in_parallel, threads, up};
use crate::io::{Band, DsmFile, Encoding, Pixels, Writer};
use crate::map::{Interpretation, LevelShape, MapHeader, MapId, Pixel, TileId};
use crate::{Curve, Error, Precision, Result};

/// Pixels in memory at once before compression: 64 tiles of the default size.
const PIXELS: u32 = 64 * 32 * 32;

/// The least share of [`Merge::default_tolerance`] for compression.
const LEAST_SHARE: f64 = 0.001;

/// Multiplies the maps of several objects that one camera sees, hair and smoke for instance.
///
/// Each function of the result is the product of the functions of that pixel in all files: light
/// passes all objects. The files hold averages over a pixel, so nothing tells whether two objects
/// that each cover half of a pixel cover the same half. The product assumes that they are
/// independent.
///
/// For values from 0 to 1, `|a b - a' b'| <= |a - a'| b + a' |b - b'|`, so the largest errors of
/// the files add up to [`Merge::source_error`]. The product of two linear segments is quadratic. It
/// is flattened within a 64th of the rest of the tolerance; compression spends the remainder. So
/// the result is within the tolerance of the exact functions that the files stand for.
///
/// ```
/// use deepshadow::{Curve, DsmFile, Encoding, MapHeader, MapId, Merge, Pixel, Writer};
/// # fn main() -> deepshadow::Result<()> {
/// let pane = |z: f32, v: f64| {
///     let mut writer = Writer::in_memory();
///     let map = writer.add_map(MapHeader::new("key", 8, 8), Encoding::new(0.001))?;
///     writer.pixel(map, Pixel::new(0, 0), &Curve::mono(vec![z], vec![v])?)?;
///     DsmFile::from_bytes(writer.into_bytes()?)
/// };
/// let panes = vec![("red".into(), pane(1.0, 0.5)?), ("blue".into(), pane(2.0, 0.25)?)];
/// let mut writer = Writer::in_memory();
/// Merge::new(panes)?.write(&mut writer, &[Encoding::new(0.003)])?;
/// let both = DsmFile::from_bytes(writer.into_bytes()?)?;
/// let function = both.function(MapId(0).level(0), Pixel::new(0, 0))?;
/// assert!((function.end() - 0.125).abs() <= 0.003);
/// # Ok(()) }
/// ```
#[derive(Debug)]
pub struct Merge {
    parts: Parts,
    headers: Vec<MapHeader>,
}

impl Merge {
    /// Takes the files, each with its name for errors. Merges the maps of equal names, or the only
    /// maps if each file has one.
    ///
    /// # Errors
    /// `Input`, with the name of the file that does not fit ([`Error::file`]): merged maps must
    /// have the same size, data origin, camera, display window, and kind and unit of depth.
    /// Channels, tile size and interpretation may differ.
    pub fn new(files: Vec<(String, DsmFile)>) -> Result<Self> {
        if files.iter().all(|(_, f)| f.maps().len() == 1) {
            let maps = vec![MapId(0); files.len()];
            return Self::of_maps(files, maps);
        }
        Self::checked(Parts::by_name(files)?)
    }

    /// Merges one map of each file into one map, which gets the name of the first.
    ///
    /// # Errors
    /// As [`Merge::new`]; `Input` if there is no such map.
    pub fn of_maps(files: Vec<(String, DsmFile)>, maps: Vec<MapId>) -> Result<Self> {
        if files.is_empty() || files.len() != maps.len() {
            return Err(Error::input(format!(
                "{} maps of {} files to merge",
                maps.len(),
                files.len()
            )));
        }
        for ((name, file), &map) in files.iter().zip(&maps) {
            file.map(map).map_err(|e| e.in_file(name))?;
        }
        Self::checked(Parts::new(files, vec![maps])?)
    }

    fn checked(mut parts: Parts) -> Result<Self> {
        if parts.differ(|p, f| p.groups(f)) {
            parts.note("the groups of maps differ");
        }
        let mut headers = Vec::new();
        for map in 0..parts.maps.len() {
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
            headers.push(merged);
        }
        Ok(Merge { parts, headers })
    }

    /// The headers of the resulting maps.
    pub fn headers(&self) -> &[MapHeader] {
        &self.headers
    }

    /// The same, to change names, attributes or tile sizes.
    pub fn headers_mut(&mut self) -> &mut [MapHeader] {
        &mut self.headers
    }

    /// The sum of the largest errors of the files in the base of a map; `map` is an index of
    /// [`Merge::headers`]. The tolerance of the result must be larger.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn source_error(&self, map: MapId) -> f64 {
        self.parts.max_errors(map.index()).fold(0.0, up)
    }

    /// A suitable tolerance for a map: the sum of the errors of its files, and for compression the
    /// largest of them again, at least 0.001.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn default_tolerance(&self, map: MapId) -> f64 {
        let max_errors = self.parts.max_errors(map.index());
        self.source_error(map) + max_errors.fold(LEAST_SHARE, f64::max)
    }

    /// Harmless differences between the files, a line for each.
    pub fn notes(&self) -> &[String] {
        &self.parts.notes
    }

    /// Gives all maps, groups and attributes to `writer`; the caller finishes it. Works tile by
    /// tile, on all cores.
    ///
    /// `encodings` holds one encoding for each map. `source_error` is ignored. A `precision` of
    /// `None` follows from the share of the tolerance that is left for compression.
    ///
    /// # Errors
    /// `Input` for a tolerance that is not above [`Merge::source_error`], and for another number of
    /// encodings than of maps; as [`Writer::add_map`] and [`Writer::tiles`]. Errors of a file have
    /// its name ([`Error::file`]).
    pub fn write(&self, writer: &mut Writer, encodings: &[Encoding]) -> Result<()> {
        if encodings.len() != self.headers.len() {
            let (n, maps) = (encodings.len(), self.headers.len());
            return Err(Error::input(format!("{n} encodings for {maps} maps")));
        }
        let (mut added, mut chords) = (Vec::new(), Vec::new());
        for (map, encoding) in encodings.iter().enumerate() {
            let share = self.share(MapId::from_index(map), encoding)?;
            let chord = share / 64.0;
            let header = self.headers[map].clone();
            let precision = encoding
                .precision
                .unwrap_or(Precision::for_tolerance(share - chord));
            let encoding = encoding.clone().precision(precision).source_error(0.0);
            added.push(writer.add_map(header, encoding)?);
            chords.push(chord);
        }
        self.parts.describe(writer, &added);
        for (map, (to, chord)) in added.into_iter().zip(chords).enumerate() {
            self.multiply(map, writer, to, chord)?;
        }
        Ok(())
    }

    /// The part of the tolerances of a map that the errors of the files leave.
    fn share(&self, map: MapId, encoding: &Encoding) -> Result<f64> {
        let given = self.source_error(map);
        let least = encoding.mip_tolerance.unwrap_or(1.0);
        let share = encoding.tolerance.max(MIN_TOLERANCE).min(least) - given;
        if share >= MIN_TOLERANCE {
            return Ok(share);
        }
        Err(Error::input(format!(
            "a tolerance of {} for map {:?} is not above the sum of the largest errors, {given}",
            encoding.tolerance.min(least),
            self.headers[map.index()].name
        )))
    }

    /// Multiplies the functions of a map, in squares as large as the largest tiles.
    fn multiply(&self, map: usize, writer: &mut Writer, to: MapId, chord: f64) -> Result<()> {
        let header = &self.headers[map];
        let files = 0..self.parts.files.len();
        let sides = files.map(|f| self.parts.header(map, f).tile_size);
        let squares = LevelShape {
            tile_size: sides.fold(header.tile_size, u32::max),
            ..LevelShape::of(header, 0)
        };
        let square = squares.tile_size * squares.tile_size;
        let at_once = ((PIXELS / square) as usize).max(threads());
        let limits = self.parts.files.iter().map(|(_, file)| file.limits());
        let room: u64 = limits.map(|limits| limits.memory).sum();
        let mut ids = squares.tile_ids().peekable();
        loop {
            let (mut next, mut bytes) = (Vec::new(), 0);
            while let Some(&square) = ids.peek() {
                bytes += self.unpacked_bytes(map, squares, square)?;
                if !next.is_empty() && (bytes > room || next.len() == at_once) {
                    break;
                }
                next.extend(ids.next());
            }
            if next.is_empty() {
                return Ok(());
            }
            let made = in_parallel(next, |square| self.square(map, squares, square, chord))?;
            writer.tiles(to, made.into_iter().flatten().collect())?;
        }
    }

    /// Bytes that the functions of all files in a square take at most.
    ///
    /// # Errors
    /// `Limit` if those of a file exceed its limits.
    fn unpacked_bytes(&self, map: usize, squares: LevelShape, square: TileId) -> Result<u64> {
        let Pixel { x, y } = squares.first_pixel(square);
        let (width, height) = squares.tile_extent(square);
        let mut all = 0;
        for (file, (name, dsm)) in self.parts.files.iter().enumerate() {
            let bytes = dsm.unpacked_bytes(self.parts.base(map, file), [x, y, width, height]);
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
        &self,
        map: usize,
        squares: LevelShape,
        square: TileId,
        chord: f64,
    ) -> Result<Vec<(TileId, Pixels)>> {
        let Pixel { x: left, y: top } = squares.first_pixel(square);
        let (width, height) = squares.tile_extent(square);
        let read = |(file, (name, dsm)): (usize, &(String, DsmFile))| {
            let band = dsm.band(self.parts.base(map, file), [left, top, width, height]);
            let band = band.map_err(|e| e.in_file(name))?;
            Ok((band, self.parts.max_error(map, file)))
        };
        let files = self.parts.files.iter().enumerate().map(read);
        let files: Vec<(Band, f64)> = files.collect::<Result<_>>()?;
        let chord = chord / (files.len() - 1).max(1) as f64;
        let shape = LevelShape::of(&self.headers[map], 0);
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
