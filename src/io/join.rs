//! Joins several files into one: parts of a map side by side, or the product of several maps of one
//! camera.
//!
//! | module | contents |
//! |---|---|
//! | [`parts`] | the files, matched map by map |
//! | [`stitch`] | parts side by side |
//! | [`merge`] | products |

mod merge;
mod parts;
mod stitch;

use super::writer::up;
use super::{DsmFile, Encoding, Writer};
use crate::function::compress::{MIN_TOLERANCE, Precision};
use crate::map::{MapHeader, MapId};
use crate::{Error, Result};
use parts::Parts;
use stitch::Layout;

/// The least share of [`Join::default_tolerance`] for the compression of a product.
const LEAST_SHARE: f64 = 0.001;

/// Joins several files into one: [`Join::stitch`] puts parts of a map side by side, and
/// [`Join::merge`] multiplies the maps of several objects that one camera sees.
///
/// [`Join::write`] gives the result to a [`Writer`].
#[derive(Debug)]
pub struct Join {
    parts: Parts,
    headers: Vec<MapHeader>,
    /// For each map that is stitched; `None` for products.
    layouts: Option<Vec<Layout>>,
}

impl Join {
    /// Joins maps that were made in parts.
    ///
    /// Takes the parts, each with its name for errors, and checks that they fit together.
    ///
    /// Each file holds a rectangle of every map: `data_origin` is its position, `width` and
    /// `height` its size. The result covers the smallest rectangle that holds all parts. Pixels
    /// outside all parts are lit. Base tiles are copied byte for byte, so they are the same as if
    /// one writer had written the whole map. The levels above are built from them.
    ///
    /// The base has the largest error of its parts, [`Join::source_error`]. The levels add to it by
    /// the schedule of [`Encoding::mips`], by default to at most twice that error. With
    /// [`Mips::Full`](crate::Mips::Full) every level has this error, and the file is about as large
    /// as that of one writer for the whole map. With [`Mips::Halved`](crate::Mips::Halved) the
    /// error grows level by level, and the file is larger.
    ///
    /// ```
    /// use deepshadow::{Curve, DsmFile, Encoding, Join, MapHeader, MapId, Pixel, Writer};
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
    /// let stitch = Join::stitch(parts)?;
    /// let mut writer = Writer::in_memory();
    /// stitch.write(&mut writer, &[Encoding::default()])?;
    /// let whole = DsmFile::from_bytes(writer.into_bytes()?)?;
    /// assert_eq!((whole.maps()[0].header.width, whole.maps()[0].levels.len()), (64, 7));
    /// let stored = whole.function(MapId(0).level(0), Pixel::new(32, 0))?;
    /// assert_eq!(stored.visibility_behind(5.0), 0.0);
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// `Input`, with the name of the file that does not fit ([`Error::file`]), or if the whole
    /// exceeds the format. All files must hold the same maps by name, and the same groups. A map
    /// must have the same camera, display window, kind and unit of depth, interpretation, channels
    /// and tile size everywhere. Its rectangles must lie whole tiles apart, end at whole tiles or
    /// at the border of the whole, and not overlap.
    pub fn stitch(files: Vec<(String, DsmFile)>) -> Result<Self> {
        let parts = Parts::by_name(files)?;
        for file in 1..parts.files.len() {
            if parts.groups(file) != parts.groups(0) {
                let first = &parts.files[0].0;
                let what = format!("its groups of maps are not those of {first}");
                return Err(Error::input(what).in_file(&parts.files[file].0));
            }
        }
        let maps = (0..parts.maps.len()).map(|map| Layout::new(&parts, map));
        let (layouts, headers) = maps.collect::<Result<_>>()?;
        Ok(Join {
            parts,
            headers,
            layouts: Some(layouts),
        })
    }

    /// Multiplies the maps of several objects that one camera sees, hair and smoke for instance.
    ///
    /// Takes the files, each with its name for errors. Merges the maps of equal names, or the only
    /// maps if each file has one.
    ///
    /// Each function of the result is the product of the functions of that pixel in all files:
    /// light passes all objects. The files hold averages over a pixel, so nothing tells whether two
    /// objects that each cover half of a pixel cover the same half. The product assumes that they
    /// are independent.
    ///
    /// For values from 0 to 1, `|a b - a' b'| <= |a - a'| b + a' |b - b'|`, so the largest errors
    /// of the files add up to [`Join::source_error`]. The product of two linear segments is
    /// quadratic. It is flattened within a 64th of the rest of the tolerance; compression spends
    /// the remainder. So the result is within the tolerance of the exact functions that the files
    /// stand for.
    ///
    /// ```
    /// use deepshadow::{Curve, DsmFile, Encoding, Join, MapHeader, MapId, Pixel, Writer};
    /// # fn main() -> deepshadow::Result<()> {
    /// let pane = |z: f32, v: f64| {
    ///     let mut writer = Writer::in_memory();
    ///     let map = writer.add_map(MapHeader::new("key", 8, 8), Encoding::new(0.001))?;
    ///     writer.pixel(map, Pixel::new(0, 0), &Curve::mono(vec![z], vec![v])?)?;
    ///     DsmFile::from_bytes(writer.into_bytes()?)
    /// };
    /// let panes = vec![("red".into(), pane(1.0, 0.5)?), ("blue".into(), pane(2.0, 0.25)?)];
    /// let mut writer = Writer::in_memory();
    /// Join::merge(panes)?.write(&mut writer, &[Encoding::new(0.003)])?;
    /// let both = DsmFile::from_bytes(writer.into_bytes()?)?;
    /// let function = both.function(MapId(0).level(0), Pixel::new(0, 0))?;
    /// assert!((function.end() - 0.125).abs() <= 0.003);
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// `Input`, with the name of the file that does not fit ([`Error::file`]): merged maps must
    /// have the same size, data origin, camera, display window, and kind and unit of depth.
    /// Channels, tile size and interpretation may differ.
    pub fn merge(files: Vec<(String, DsmFile)>) -> Result<Self> {
        if files.iter().all(|(_, f)| f.maps().len() == 1) {
            let maps = vec![MapId(0); files.len()];
            return Self::merge_maps(files, maps);
        }
        Self::product(Parts::by_name(files)?)
    }

    /// [`Join::merge`] of one map of each file into one map, which gets the name of the first.
    ///
    /// # Errors
    /// As [`Join::merge`]; `Input` if there is no such map.
    pub fn merge_maps(files: Vec<(String, DsmFile)>, maps: Vec<MapId>) -> Result<Self> {
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
        Self::product(Parts::new(files, vec![maps])?)
    }

    fn product(mut parts: Parts) -> Result<Self> {
        if parts.differ(|p, f| p.groups(f)) {
            parts.note("the groups of maps differ");
        }
        let headers = (0..parts.maps.len()).map(|map| merge::header(&parts, map));
        Ok(Join {
            headers: headers.collect::<Result<_>>()?,
            parts,
            layouts: None,
        })
    }

    /// The headers of the resulting maps.
    pub fn headers(&self) -> &[MapHeader] {
        &self.headers
    }

    /// The same, to change names and attributes; those of a product also to change tile sizes.
    pub fn headers_mut(&mut self) -> &mut [MapHeader] {
        &mut self.headers
    }

    /// The error that the base of a map inherits: for parts side by side the largest error of a
    /// part; for a product the sum of the largest errors of the files, which the tolerance of the
    /// result must exceed. `map` is an index of [`Join::headers`].
    ///
    /// # Panics
    /// If there is no such map.
    pub fn source_error(&self, map: MapId) -> f64 {
        let add = if self.layouts.is_some() { f64::max } else { up };
        self.parts.max_errors(map.index()).fold(0.0, add)
    }

    /// A suitable tolerance for a map. For parts side by side [`Join::source_error`]; for a product
    /// the sum of the errors of its files, and for compression the largest of them again, at least
    /// 0.001.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn default_tolerance(&self, map: MapId) -> f64 {
        let share = match self.layouts {
            Some(_) => 0.0,
            None => (self.parts.max_errors(map.index())).fold(LEAST_SHARE, f64::max),
        };
        self.source_error(map) + share
    }

    /// Number of pixels of a map outside all parts, which are lit; 0 for a product.
    ///
    /// # Panics
    /// If there is no such map.
    pub fn lit_pixels(&self, map: MapId) -> u64 {
        let layouts = self.layouts.as_ref();
        layouts.map_or(0, |layouts| layouts[map.index()].lit)
    }

    /// Harmless differences between the files, a line for each.
    pub fn notes(&self) -> &[String] {
        &self.parts.notes
    }

    /// Gives all maps, groups and attributes to `writer`; the caller finishes it. Works tile by
    /// tile, on all cores.
    ///
    /// `encodings` holds one encoding for each map, or one for all. Its `source_error` is ignored.
    /// Parts side by side take from it the codec of levels and directories, and for the levels
    /// `mips`, `compressor`, `precision` and `mip_tolerance` (`None` for the error of the base).
    /// For a product, a `precision` of `None` follows from the share of the tolerance that is left
    /// for compression.
    ///
    /// # Errors
    /// `Input` for a tolerance of a product that is not above [`Join::source_error`], and for
    /// another number of encodings than of maps; as [`Writer::add_map`] and [`Writer::tiles`].
    /// Errors of a file have its name ([`Error::file`]).
    pub fn write(&self, writer: &mut Writer, encodings: &[Encoding]) -> Result<()> {
        let (n, maps) = (encodings.len(), self.headers.len());
        if n != 1 && n != maps {
            return Err(Error::input(format!("{n} encodings for {maps} maps")));
        }
        if self.layouts.is_some() {
            for (name, file) in &self.parts.files {
                file.check_layout().map_err(|e| e.in_file(name))?;
            }
        }
        let encoding = |map: usize| &encodings[map.min(n - 1)];
        writer.attempt(|writer| {
            let mut added = Vec::new();
            for (map, header) in self.headers.iter().enumerate() {
                let encoding = self.encoding(MapId::from_index(map), encoding(map))?;
                added.push(writer.add_map(header.clone(), encoding)?);
            }
            self.parts.describe(writer, &added);
            for (map, (to, header)) in added.into_iter().zip(&self.headers).enumerate() {
                if let Some(layouts) = &self.layouts {
                    layouts[map].copy(&self.parts, header, writer, to)?;
                } else {
                    let chord = self.share(MapId::from_index(map), encoding(map))? / 64.0;
                    merge::multiply(&self.parts, map, header, chord, writer, to)?;
                }
            }
            Ok(())
        })
    }

    /// The encoding of a map of the result.
    fn encoding(&self, map: MapId, given: &Encoding) -> Result<Encoding> {
        let encoding = given.clone();
        if self.layouts.is_some() {
            let source_error = self.source_error(map);
            let own = source_error.max(MIN_TOLERANCE);
            let mip_tolerance = given.mip_tolerance.unwrap_or(own).max(MIN_TOLERANCE);
            let encoding = encoding.tolerance(own).mip_tolerance(mip_tolerance);
            return Ok(encoding.source_error(source_error));
        }
        let share = self.share(map, given)?;
        let chosen = || Precision::for_tolerance(share - share / 64.0);
        let precision = given.precision.unwrap_or_else(chosen);
        Ok(encoding.precision(precision).source_error(0.0))
    }

    /// The part of the tolerances of a product that the errors of the files leave.
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
}
