//! The tile directory, one line per tile.

use std::sync::Arc;

use deepshadow::raw::directory::{Entry, TileKind};
use deepshadow::raw::{codec, transform};
use deepshadow::{DsmFile, LevelId, TileId};
use serde_json::{Value, json};

use super::document::Part;
use super::select;
use super::text::exact;
use deepshadow_frame::Result;
use deepshadow_frame::output::Output;

/// Returns the name of a transform by its id.
pub fn transform_name(id: u8) -> &'static str {
    match id {
        transform::NONE => "none",
        transform::DELTA_PLANES => "delta",
        128.. => "private",
        _ => "unknown",
    }
}

/// Calls `visit` with level, tile and entry of every selected tile, until it returns false.
fn each(
    file: &DsmFile,
    map: Option<&str>,
    level: Option<u32>,
    mut visit: impl FnMut(LevelId, TileId, &Entry) -> bool,
) -> Result<()> {
    for m in select::maps(file, map)? {
        for level in select::levels(file, m, level)? {
            let shape = file.level(level)?.shape;
            for run in file.runs(level)? {
                let run = run?;
                for tile in (run.first..run.first + run.tiles).map(|i| shape.tile_at(i)) {
                    if !visit(level, tile, &run.entry) {
                        return Ok(());
                    }
                }
            }
        }
    }
    Ok(())
}

/// The most tiles that are printed.
const LINES: u64 = 100_000;

/// Prints the first tiles of the selected maps and levels.
///
/// # Errors
/// `Failed` for a damaged tile directory, and for an unknown map or level.
pub fn print(
    file: &DsmFile,
    map: Option<&str>,
    level: Option<u32>,
    out: &mut Output,
) -> Result<()> {
    out.line(format_args!(
        "{:>3} {:>5} {:>4} {:>4}  {:<8} {:<6} {:<6} {:>7} {:>8} {:>9} {:>9}  {:<22} {:<19} {:<8} \
         {:>12}",
        "map",
        "level",
        "tx",
        "ty",
        "kind",
        "codec",
        "transf",
        "lattice",
        "vertices",
        "stored",
        "decoded",
        "depths",
        "ends",
        "crc",
        "offset"
    ));
    let mut lines = 0;
    each(
        file,
        map,
        level,
        |LevelId { map, level }, TileId { x, y }, e| {
            lines += 1;
            if lines > LINES {
                out.line("and more tiles (--json lists all)");
                return false;
            }
            let place = format!("{:>3} {level:>5} {x:>4} {y:>4}  {:<8}", map.0, e.kind);
            let range = |[a, b]: [f32; 2]| {
                if a == b {
                    exact(a)
                } else {
                    format!("{}..{}", exact(a), exact(b))
                }
            };
            let (depths, ends) = (range(e.depths), range(e.ends));
            out.line(match e.kind {
                TileKind::Empty => place.trim_end().to_string(),
                TileKind::Constant => format!(
                    "{place} {:<6} {:<6} {:>7} {:>8} {:>9} {:>9}  {depths:<22} {ends}",
                    "-", "-", "-", e.vertices, "-", "-"
                ),
                TileKind::Data => format!(
                    "{place} {:<6} {:<6} {:>7} {:>8} {:>9} {:>9}  {depths:<22} {ends:<19} {:08x} \
                 {:>12}",
                    codec::name(e.codec),
                    transform_name(e.transform),
                    lattice_name(e.lattice),
                    e.vertices,
                    e.stored_size,
                    e.decoded_size,
                    e.crc,
                    e.offset
                ),
            });
            !out.is_closed()
        },
    )
}

/// Returns the number of steps of a lattice, or `f32` for 0.
pub fn lattice_name(lattice: u16) -> String {
    match lattice {
        0 => "f32".into(),
        l => l.to_string(),
    }
}

/// Returns the selected tiles for a JSON document.
///
/// # Errors
/// As [`print()`].
pub fn json(file: &Arc<DsmFile>, map: Option<&str>, level: Option<u32>) -> Result<Part> {
    // Finds every error before the first tile is written.
    for m in select::maps(file, map)? {
        for level in select::levels(file, m, level)? {
            file.runs(level)?.try_for_each(|run| run.map(drop))?;
        }
    }
    let (file, map) = (file.clone(), map.map(str::to_owned));
    Ok(Part::List(Box::new(move |item| {
        let _ = each(&file, map.as_deref(), level, |level, tile, entry| {
            item(tile_json(level, tile, entry));
            true
        });
    })))
}

fn tile_json(LevelId { map, level }: LevelId, TileId { x, y }: TileId, e: &Entry) -> Value {
    let mut tile = json!({
        "map": map.0, "level": level, "tx": x, "ty": y,
        "kind": e.kind.to_string(), "vertices": e.vertices,
    });
    if e.kind != TileKind::Empty {
        tile["depths"] = json!(e.depths);
        tile["ends"] = json!(e.ends);
    }
    if e.kind == TileKind::Data {
        tile["codec"] = codec::name(e.codec).into();
        tile["transform"] = transform_name(e.transform).into();
        tile["lattice"] = e.lattice.into();
        tile["coloured"] = e.coloured.into();
        tile["stored"] = e.stored_size.into();
        tile["decoded"] = e.decoded_size.into();
        tile["crc"] = format!("{:08x}", e.crc).into();
        tile["offset"] = e.offset.into();
    }
    tile
}
