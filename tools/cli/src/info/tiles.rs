//! The tile directory, a line a tile.

use deepshadow::raw::directory::{Entry, TileKind};
use deepshadow::raw::{codec, transform};
use deepshadow::{DsmFile, MapId, TileId};
use serde_json::{Value, json};

use super::select;
use super::text::exact;
use deepshadow_frame::Result;
use deepshadow_frame::output::Output;

/// Name of a transform's id.
pub fn transform_name(id: u8) -> &'static str {
    match id {
        transform::NONE => "none",
        transform::DELTA_PLANES => "delta",
        128.. => "private",
        _ => "unknown",
    }
}

/// Calls `see` with map, level, column, row and entry of every tile that is selected.
fn each(
    file: &DsmFile,
    map: Option<&str>,
    level: Option<usize>,
    mut see: impl FnMut([u64; 4], &Entry) -> bool,
) -> Result<()> {
    for m in select::maps(file, map)? {
        for l in select::levels(file, m, level)? {
            let shape = file.level(MapId(m as u32).level(l as u32))?.shape;
            for ty in 0..shape.tiles_y() {
                for tx in 0..shape.tiles_x() {
                    let place = [m as u64, l as u64, u64::from(tx), u64::from(ty)];
                    if !see(
                        place,
                        &file.entry(MapId(m as u32).level(l as u32), TileId::new(tx, ty))?,
                    ) {
                        return Ok(());
                    }
                }
            }
        }
    }
    Ok(())
}

/// Prints the tiles of the maps and levels that are selected.
///
/// # Errors
/// `Failed` for a damaged tile directory, and a map or level that is not there.
pub fn print(
    file: &DsmFile,
    map: Option<&str>,
    level: Option<usize>,
    out: &mut Output,
) -> Result<()> {
    out.line(format_args!(
        "{:>3} {:>5} {:>4} {:>4}  {:<8} {:<6} {:<6} {:>7} {:>8} {:>9} {:>9}  {:<22} {:<19} {:<8} {:>12}",
        "map", "level", "tx", "ty", "kind", "codec", "transf", "lattice", "vertices", "stored",
        "decoded", "depths", "ends", "crc", "offset"
    ));
    each(file, map, level, |[m, l, tx, ty], e| {
        let place = format!("{m:>3} {l:>5} {tx:>4} {ty:>4}  {:<8}", e.kind);
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
                "{place} {:<6} {:<6} {:>7} {:>8} {:>9} {:>9}  {depths:<22} {ends:<19} {:08x} {:>12}",
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
    })
}

/// `f32`, or the L of visibilities k / L.
pub fn lattice_name(lattice: u16) -> String {
    match lattice {
        0 => "f32".into(),
        l => l.to_string(),
    }
}

/// The same as a JSON array.
///
/// # Errors
/// As [`print()`].
pub fn json(file: &DsmFile, map: Option<&str>, level: Option<usize>) -> Result<Value> {
    let mut tiles = Vec::new();
    each(file, map, level, |[m, l, tx, ty], e| {
        let mut tile = json!({
            "map": m, "level": l, "tx": tx, "ty": ty,
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
        tiles.push(tile);
        true
    })?;
    Ok(tiles.into())
}
