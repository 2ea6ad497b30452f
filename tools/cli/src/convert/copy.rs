//! `.dsm` to `.dsm`: other codecs, tiles, levels, regions, tolerances.
//!
//! By default, all levels are copied with their functions and error bounds. The levels of a region
//! differ from those of the whole map, so they are recomputed from its base. A larger tolerance
//! recomputes all functions.

use std::collections::HashMap;

use deepshadow::raw::directory::TileKind;
use deepshadow::raw::layout::BLOCK_ENTRIES;
use deepshadow::raw::{Run, TileBuilder};
use deepshadow::{
    Curve, DsmFile, Encoding, Group, LevelId, Limits, MapHeader, MapId, Mips, Pixels, TileId,
    Writer,
};
use rayon::prelude::*;

use super::args::Args;
use super::level::Level;
use crate::inputs::find_map;
use crate::runstats::{Clock, Vertices};
use crate::source::header::level_header;
use deepshadow_frame::args::Region;
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::storage::small_lattice;
use deepshadow_frame::{Failure, InFile, Result};

/// Columns in memory at once.
const COLUMNS: u32 = 4096;

/// How to convert a map.
enum Plan {
    /// Copy all functions of this many levels.
    Keep(usize),
    /// Copy the functions of the base, and recompute the levels from them.
    Remip(Encoding),
    /// Compress all functions again.
    Recompress(Encoding),
}

/// Converts the file.
///
/// # Errors
/// `Usage` for options that contradict each other; `Failed` for everything else.
pub fn convert(args: &Args, file: &DsmFile, console: Console) -> Result<()> {
    let clock = Clock::default();
    let chosen: Vec<MapId> = match &args.map {
        Some(name) => vec![find_map(file, Some(name))?],
        None => (0..file.maps().len() as u32).map(MapId).collect(),
    };
    if args.label.name.is_some() && chosen.len() > 1 {
        return Err(Failure::Failed(
            "--name needs --map: the file has several maps".into(),
        ));
    }
    let first = args.level.unwrap_or(0);
    let mut plans = Vec::new();
    for &map in &chosen {
        plans.push((map, plan(args, file, map)?, header(args, file, map)?));
    }

    let output = args.output.as_path();
    let mut writer = Writer::create(output).in_file(output)?;
    let mut bar = console.bar("copying");
    writer.on_progress(move |done, total| {
        bar.set(done, total);
        true
    });
    for (name, value) in file.attributes() {
        writer.add_attribute(name, value.clone());
    }
    for group in kept_groups(file, &chosen) {
        writer.add_group(group);
    }
    if kept_groups(file, &chosen).len() < file.groups().len() {
        console.detail("groups without all their maps are dropped");
    }
    let mut added = Vec::new();
    for (map, plan, header) in &plans {
        let levels = &file.map(*map)?.levels[first as usize..];
        let errors: Vec<f64> = levels.iter().map(|l| l.max_error).collect();
        let id = match plan {
            Plan::Keep(n) => {
                writer.add_finished_map(header.clone(), args.encoding()?.codec, &errors[..*n])
            }
            Plan::Remip(encoding) | Plan::Recompress(encoding) => {
                if encoding.mips != Mips::None && levels.len() > 1 && !args.remip {
                    let (input, name) = (args.input.display(), &header.name);
                    console.note(format_args!(
                        "{input}: the levels of map {name:?} are recomputed"
                    ));
                }
                writer.add_map(header.clone(), encoding.clone())
            }
        };
        added.push(id.in_file(output)?);
    }
    let mut vertices = Vertices::default();
    for (to, (from, plan, header)) in added.into_iter().zip(&plans) {
        match plan {
            Plan::Keep(levels) => {
                for level in 0..*levels as u32 {
                    let from = Level::new(file, from.level(first + level))?;
                    keep(&mut writer, args, to.level(level), from, header)?;
                }
            }
            Plan::Remip(encoding) | Plan::Recompress(encoding) => {
                let base = Level::new(file, from.level(first))?;
                let recompress = matches!(plan, Plan::Recompress(_));
                vertices.add(&rebuild(
                    &mut writer,
                    args,
                    to,
                    base,
                    header,
                    encoding,
                    recompress,
                )?);
            }
        }
    }
    writer.finish().in_file(output)?;
    if args.runstats {
        let vertices = (vertices.count > 0).then_some(&vertices);
        clock.report(output, vertices, Output::standard())?;
    }
    Ok(())
}

fn plan(args: &Args, file: &DsmFile, map: MapId) -> Result<Plan> {
    let info = file.map(map)?;
    let name = &info.header.name;
    let base = map.level(args.level.unwrap_or(0));
    let old = file.level(base)?.max_error;
    let levels = &info.levels[base.level as usize..];
    let tolerance = args.base.tolerance;
    let encoding = args.encoding()?;
    let (mip_tolerance, mips) = (encoding.mip_tolerance, encoding.mips);
    let above = |option: &str, e: f64| {
        if e > old + Encoding::MIN_TOLERANCE {
            return Ok(());
        }
        Err(Failure::Failed(format!(
            "--{option} {e}: not above the error {old} of map {name:?}; a copy cannot be more \
             exact than the map"
        )))
    };
    let has_levels = levels.len() > 1 || args.remip || mip_tolerance.is_some();
    if let Some(tolerance) = tolerance {
        above("tolerance", tolerance)?;
        mip_tolerance.map_or(Ok(()), |e| above("mip-tolerance", e))?;
        let left = tolerance.min(mip_tolerance.unwrap_or(1.0)) - old;
        no_level_count(args)?;
        return Ok(Plan::Recompress(
            encoding
                .tolerance(tolerance)
                .precision(args.lattice.precision(left)?.or(Some(small_lattice(left))))
                .mips(if has_levels { mips } else { Mips::None }),
        ));
    }
    if args.region.is_some() || args.remip || mip_tolerance.is_some() {
        no_level_count(args)?;
        let own = old.max(Encoding::MIN_TOLERANCE);
        let mip_tolerance = mip_tolerance.unwrap_or(own).max(Encoding::MIN_TOLERANCE);
        let kept = Level::new(file, base)?.lattice()?;
        let fits = |p: &deepshadow::raw::Precision| match p {
            deepshadow::raw::Precision::Lattice(l) => f64::from(*l) * mip_tolerance.min(own) >= 1.0,
            deepshadow::raw::Precision::F32 => true,
        };
        let precision = match args.lattice.precision(mip_tolerance)? {
            None => kept.filter(fits).or(Some(deepshadow::raw::Precision::F32)),
            given => given,
        };
        let made = has_levels && mips != Mips::None;
        return Ok(Plan::Remip(
            encoding
                .tolerance(own)
                .mip_tolerance(mip_tolerance)
                .precision(precision)
                .mips(if made { Mips::Halved } else { Mips::None })
                .source_error(old),
        ));
    }
    if args.storage.compressor.is_some() || args.lattice.lattice.is_some() {
        let line = "--compressor and --lattice need --tolerance, --remip or --mip-tolerance: \
                    other copies compress nothing";
        return Err(Failure::Usage(line.into()));
    }
    let most = if args.storage.nomipmap {
        1
    } else {
        args.levels.unwrap_or(usize::MAX)
    };
    Ok(Plan::Keep(levels.len().min(most)))
}

fn no_level_count(args: &Args) -> Result<()> {
    match args.levels {
        None => Ok(()),
        Some(_) => Err(Failure::Usage(
            "--levels applies to copied levels only; for recomputed levels, use --nomipmap or all"
                .into(),
        )),
    }
}

/// Returns the new header of a map.
fn header(args: &Args, file: &DsmFile, map: MapId) -> Result<MapHeader> {
    let base = Level::new(file, map.level(args.level.unwrap_or(0)))?;
    let mut header = match base.id.level {
        0 => file.map(map)?.header.clone(),
        level => level_header(&file.map(map)?.header, level),
    };
    let [x, y, width, height] = base.region(args.region)?;
    header.data_origin[0] = header.data_origin[0].saturating_add_unsigned(x);
    header.data_origin[1] = header.data_origin[1].saturating_add_unsigned(y);
    (header.width, header.height) = (width, height);
    args.describe(&mut header);
    Ok(header)
}

/// Returns the groups whose maps are all chosen, with their new indices.
fn kept_groups(file: &DsmFile, chosen: &[MapId]) -> Vec<Group> {
    let new: HashMap<_, _> = chosen.iter().copied().zip((0..).map(MapId)).collect();
    let renumber = |g: &Group| {
        let maps = g.maps.iter().map(|m| new.get(m).copied());
        let maps = maps.collect::<Option<_>>()?;
        Some(Group::new(&g.name, g.role, maps))
    };
    file.groups().iter().filter_map(renumber).collect()
}

/// Returns the rectangles of an output level that are read at once, row by row. Each is a number of
/// whole tiles of both files.
fn bands(width: u32, height: u32, unit: u32) -> impl Iterator<Item = Region> {
    let tops = (0..height).step_by(unit as usize);
    tops.flat_map(move |y| {
        let lefts = (0..width).step_by(COLUMNS as usize);
        lefts.map(move |x| [x, y, COLUMNS.min(width - x), unit.min(height - y)])
    })
}

/// Returns the tiles of side `tile` in a band: column, row, and rectangle in pixels.
fn tiles_of([x, y, w, h]: Region, tile: u32) -> Vec<(u32, u32, Region)> {
    let mut tiles = Vec::new();
    for top in (y..y + h).step_by(tile as usize) {
        for left in (x..x + w).step_by(tile as usize) {
            let area = [left, top, tile.min(x + w - left), tile.min(y + h - top)];
            tiles.push((left / tile, top / tile, area));
        }
    }
    tiles
}

/// Returns the indices of the pixels of `area` among those of `square`.
fn places(square: Region, area: Region) -> impl Iterator<Item = usize> {
    let [x, y, w, _] = square;
    let [left, top, width, height] = area;
    let row = move |j: u32| (j as usize) * w as usize;
    (top - y..top - y + height)
        .flat_map(move |j| (left - x..left - x + width).map(move |i| row(j) + i as usize))
}

/// Copies a level without a change of its functions.
fn keep(
    writer: &mut Writer,
    args: &Args,
    to: LevelId,
    level: Level<'_>,
    header: &MapHeader,
) -> Result<()> {
    let (old, new) = (level.shape.tile_size, header.tile_size);
    if old == new {
        return copy_tiles(writer, args, to, level);
    }
    check_content(level)?;
    for band in bands(level.shape.width, level.shape.height, old.max(new)) {
        // Each square of the larger tile size is one piece of work.
        for squares in level.parts(tiles_of(band, old.max(new)), |square| square.2)? {
            let made: Result<Vec<_>> = squares
                .par_iter()
                .map(|&(_, _, square)| {
                    let (functions, precision) = level.functions(square)?;
                    let tiles = tiles_of(square, new).into_iter().map(|(tx, ty, area)| {
                        let mut builder = TileBuilder::new(area[2], precision);
                        let places = places(square, area);
                        places.for_each(|i| builder.push(&functions[i]));
                        (TileId::new(tx, ty), builder.finish())
                    });
                    Ok(tiles.collect::<Vec<_>>())
                })
                .collect();
            let tiles = made?.into_iter().flatten().collect();
            writer.finished_tiles(to, tiles).in_file(&args.output)?;
        }
    }
    Ok(())
}

/// Copies the tiles of a level. Whole blocks of tiles without a vertex need not be given.
fn copy_tiles(writer: &mut Writer, args: &Args, to: LevelId, level: Level<'_>) -> Result<()> {
    let Level { file, id, shape } = level;
    for batch in file.batches(id)? {
        let batch = batch?;
        let data = batch.par_iter().filter(|r| r.entry.kind == TileKind::Data);
        let data = data.map(|run| {
            let tile = shape.tile_at(run.first);
            Ok((tile, file.tile(id, tile)?))
        });
        let data = data.collect::<Result<_>>()?;
        writer.finished_tiles(to, data).in_file(&args.output)?;
        let is_skipped = |r: &Run| r.entry.kind == TileKind::Empty && r.tiles == BLOCK_ENTRIES;
        let others = batch.iter().filter(|r| r.entry.kind != TileKind::Data);
        for run in others.filter(|r| !is_skipped(r)) {
            let tiles = (run.first..run.first + run.tiles).map(|i| shape.tile_at(i));
            let stored = tiles.map(|tile| Ok((tile, file.stored_tile(id, tile)?)));
            let stored = stored.collect::<Result<_>>()?;
            writer.stored_tiles(to, stored).in_file(&args.output)?;
        }
    }
    Ok(())
}

/// Refuses a level with more pixels than a pass over each of them can take in a day.
fn check_content(level: Level<'_>) -> Result<()> {
    let vertices = level.file.level(level.id)?.vertices;
    Ok(Limits::check_content(
        16 * (level.pixels() + vertices),
        "a level",
    )?)
}

/// Passes the functions of the base to the writer, which computes the levels. Compresses them again
/// if `recompress` is set.
fn rebuild(
    writer: &mut Writer,
    args: &Args,
    to: MapId,
    base: Level<'_>,
    header: &MapHeader,
    encoding: &Encoding,
    recompress: bool,
) -> Result<Vertices> {
    let [left, top, ..] = args.region.unwrap_or_default();
    let new = header.tile_size;
    let old_error = base.file.level(base.id)?.max_error;
    check_content(base)?;
    let mut vertices = Vertices::default();
    let unit = base.shape.tile_size.max(new);
    for band in bands(header.width, header.height, unit) {
        let source = |[x, y, w, h]: Region| [left + x, top + y, w, h];
        for squares in base.parts(tiles_of(band, unit), |square| source(square.2))? {
            let made: Result<Vec<_>> = squares
                .par_iter()
                .map(|&(_, _, square)| {
                    let (functions, _) = base.functions(source(square))?;
                    let mut counted = Vertices::default();
                    let mut tiles = Vec::new();
                    for (tx, ty, area) in tiles_of(square, new) {
                        let functions = places(square, area).map(|i| &functions[i]);
                        let pixels = if recompress {
                            let curves = functions.map(|f| {
                                let mut curve = Curve::lit(1);
                                // Lit pixels may have an error too.
                                curve.assign(f, old_error);
                                counted.count_curve(&curve, encoding.tolerance - old_error);
                                curve
                            });
                            Pixels::Curves(curves.collect())
                        } else {
                            Pixels::Functions(functions.cloned().collect())
                        };
                        tiles.push((TileId::new(tx, ty), pixels));
                    }
                    Ok((tiles, counted))
                })
                .collect();
            let mut tiles = Vec::new();
            for (made, counted) in made? {
                vertices.add(&counted);
                tiles.extend(made);
            }
            writer.tiles(to, tiles).in_file(&args.output)?;
        }
    }
    Ok(vertices)
}
