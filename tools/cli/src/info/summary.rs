//! The summary of a file: maps, levels, groups and attributes. It reads no tile.

use std::path::Path;
use std::sync::Arc;

use deepshadow::{Attribute, Camera, DepthKind, DsmFile, GroupRole, MapHeader, MapId, MapInfo};
use serde_json::{Map, Value, json};

use super::document::{Items, Part};
use super::text::{self, Table, counted, grouped, hex, quoted, short};
use deepshadow_frame::Result;
use deepshadow_frame::output::Output;

/// The version of the format. This reader opens files of this version only.
const VERSION: u16 = deepshadow::raw::layout::VERSION;

/// Attributes that are printed without `--all-metadata`.
const SHOWN: usize = 8;

/// Longest line, in columns.
const COLUMNS: usize = 100;

/// Prints the summary, with matrices and attributes in full if `all` is set.
///
/// # Errors
/// `Failed` for a damaged tile directory.
pub fn print(file: &DsmFile, path: &Path, all: bool, out: &mut Output) -> Result<()> {
    let maps = file.maps();
    let mut head = format!(
        "{}: deep shadow map, version {VERSION}, {}, {}",
        path.display(),
        counted(file.length(), "byte"),
        counted(maps.len() as u64, "map")
    );
    if !file.groups().is_empty() {
        head += &format!(", {}", counted(file.groups().len() as u64, "group"));
    }
    out.line(head);
    attributes(file.attributes(), all, out);
    for (m, map) in (0..).map(MapId).zip(maps) {
        out.line("");
        out.line(format_args!(
            "map {m} {}",
            quoted(&map.header.name, COLUMNS - 20)
        ));
        header(&map.header, all, out);
        let table = levels(file, m, map)?;
        out.line("");
        table.lines().for_each(|line| out.line(line));
    }
    if !file.groups().is_empty() {
        out.line("");
    }
    for group in file.groups() {
        let members = group.maps.iter().map(|m| m.to_string());
        let mut members = members.collect::<Vec<_>>().join(", ");
        if !all && members.len() > 40 {
            members.truncate(members[..40].rfind(',').unwrap_or(0));
            members += ", ...";
        }
        out.line(format_args!(
            "group {}: {} ({}), maps {members}",
            quoted(&group.name, 30),
            group.role,
            if group.role == GroupRole::Faces {
                "a lookup reads one"
            } else {
                "a lookup multiplies all"
            }
        ));
    }
    Ok(())
}

fn header(h: &MapHeader, all: bool, out: &mut Output) {
    let mut field = |name: &str, value: String| out.line(format_args!("  {name:<16}{value}"));
    let channels = if h.channels == 1 {
        "1 channel"
    } else {
        "up to 3 channels"
    };
    let size = format!("{} x {} pixels", h.width, h.height);
    field(
        "size",
        format!(
            "{size}, {channels}, tiles of {} x {}",
            h.tile_size, h.tile_size
        ),
    );
    let unit = if h.depth_unit == 0.0 {
        "unit not stated".into()
    } else {
        format!("unit {} m", short(h.depth_unit))
    };
    let kind = match h.depth_kind {
        DepthKind::Unspecified => "of unspecified kind",
        DepthKind::Planar => "planar (camera z)",
        DepthKind::RayDistance => "distance along the ray",
    };
    field("depth", format!("{kind}, {unit}"));
    field("interpretation", h.interpretation.to_string());
    let camera = match h.camera {
        Camera {
            camera_from_world: Some(_),
            ndc_from_world: Some(_),
        } => "worldToCamera and worldToNDC",
        Camera {
            camera_from_world: Some(_),
            ..
        } => "worldToCamera",
        Camera {
            ndc_from_world: Some(_),
            ..
        } => "worldToNDC",
        _ => "unknown",
    };
    field("camera", camera.into());
    let [x, y] = h.data_origin;
    let [x0, y0, x1, y1] = h.display_window;
    let window = format!("origin {x},{y} in a display window of {x0},{y0} to {x1},{y1}");
    field("data", window);
    if all {
        for (name, matrix) in [
            ("worldToCamera", &h.camera.camera_from_world),
            ("worldToNDC", &h.camera.ndc_from_world),
        ] {
            if let Some(matrix) = matrix {
                print_matrix(name, matrix, out);
            }
        }
    }
    attributes(&h.attributes, all, out);
}

fn print_matrix(name: &str, matrix: &[f64; 16], out: &mut Output) {
    let cells: Vec<String> = matrix.iter().map(|&v| short(v)).collect();
    let width = cells.iter().map(String::len).max().unwrap_or(0);
    for (i, row) in cells.chunks(4).enumerate() {
        let row: Vec<String> = row.iter().map(|c| format!("{c:>width$}")).collect();
        let name = if i == 0 { name } else { "" };
        out.line(format_args!("  {name:<16}{}", row.join("  ")));
    }
}

fn attributes(attributes: &[(String, Attribute)], all: bool, out: &mut Output) {
    let shown = if all { attributes.len() } else { SHOWN };
    for (name, attribute) in attributes.iter().take(shown) {
        let name = quoted(name, if all { usize::MAX } else { 40 });
        let name = name.trim_matches('"');
        let room = COLUMNS - 24 - name.chars().count().max(14);
        let value = value(attribute, if all { usize::MAX } else { room });
        out.line(format_args!("  {name:<14}  {value}"));
    }
    if attributes.len() > shown {
        let more = counted((attributes.len() - shown) as u64, "more attribute");
        out.line(format_args!("  and {more} (-a prints all)"));
    }
}

/// Formats the value of an attribute in about `most` characters.
fn value(value: &Attribute, most: usize) -> String {
    let list = |items: &mut dyn Iterator<Item = String>| {
        let mut out = String::new();
        for item in items {
            if out.len() + item.len() > most {
                return out + " ...";
            }
            if !out.is_empty() {
                out.push(' ');
            }
            out.push_str(&item);
        }
        out
    };
    let bytes = |bytes: &[u8]| match most {
        usize::MAX => format!("{}: {}", counted(bytes.len() as u64, "byte"), hex(bytes)),
        _ => counted(bytes.len() as u64, "byte"),
    };
    if let Some(text) = as_text(value) {
        return quoted(text, most);
    }
    match value {
        Attribute::Integers(v) => list(&mut v.iter().map(|v| v.to_string())),
        Attribute::Numbers(v) => list(&mut v.iter().map(|&v| short(v))),
        Attribute::Opaque {
            type_name,
            bytes: b,
        } => {
            format!("{} ({})", quoted(type_name, 30).trim_matches('"'), bytes(b))
        }
        Attribute::Unknown { kind, bytes: b } => format!("unknown kind {kind} ({})", bytes(b)),
        _ => "unknown kind".into(),
    }
}

/// The text of an attribute; a `string` of OpenEXR is text if it is UTF-8.
fn as_text(value: &Attribute) -> Option<&str> {
    match value {
        Attribute::Text(text) => Some(text),
        Attribute::Opaque { type_name, bytes } if type_name == "exr:string" => {
            std::str::from_utf8(bytes).ok()
        }
        _ => None,
    }
}

fn levels(file: &DsmFile, id: MapId, map: &MapInfo) -> Result<Table> {
    let mut table = Table::new(&[
        "level", "size", "promise", "vertices", "a pixel", "tiles", "empty", "const.", "data",
        "bytes",
    ]);
    for (l, level) in (0..).zip(&map.levels) {
        let shape = level.shape;
        let mut kinds = [0u64; 3];
        for run in file.runs(id.level(l))? {
            let run = run?;
            kinds[run.entry.kind as usize] += run.tiles;
        }
        let pixels = f64::from(shape.width) * f64::from(shape.height);
        table.row(vec![
            l.to_string(),
            format!("{} x {}", shape.width, shape.height),
            short(level.max_error),
            grouped(level.vertices),
            text::ratio(level.vertices as f64, pixels),
            grouped(shape.tiles()),
            grouped(kinds[0]),
            grouped(kinds[1]),
            grouped(kinds[2]),
            grouped(level.payload_bytes),
        ]);
    }
    Ok(table)
}

/// Returns the fields of the summary for a JSON document, with the bytes of opaque attributes if
/// `all` is set.
pub fn json(file: &Arc<DsmFile>, all: bool) -> [(&'static str, Part); 5] {
    let groups = file.groups().iter().map(|group| {
        let maps: Vec<u32> = group.maps.iter().map(|m| m.0).collect();
        json!({ "name": group.name, "role": group.role.to_string(), "maps": maps })
    });
    let groups: Value = groups.collect();
    let attributes = attributes_json(file.attributes(), all);
    let (version, bytes, file) = (json!(VERSION), json!(file.length()), file.clone());
    let maps: Items = Box::new(move |item| {
        let maps = file.maps().iter();
        maps.for_each(|map| item(map_json(map, all)));
    });
    [
        ("version", version.into()),
        ("file_bytes", bytes.into()),
        ("maps", Part::List(maps)),
        ("groups", groups.into()),
        ("attributes", attributes.into()),
    ]
}

fn map_json(map: &MapInfo, all: bool) -> Value {
    let h = &map.header;
    let levels = map.levels.iter().map(|level| {
        json!({
            "width": level.shape.width,
            "height": level.shape.height,
            "max_error": level.max_error,
            "vertices": level.vertices,
            "tiles": level.shape.tiles(),
            "bytes": level.payload_bytes,
        })
    });
    json!({
        "name": h.name,
        "width": h.width,
        "height": h.height,
        "channels": h.channels,
        "tile_size": h.tile_size,
        "depth_kind": h.depth_kind.to_string(),
        "depth_unit": (h.depth_unit != 0.0).then_some(h.depth_unit),
        "interpretation": h.interpretation.to_string(),
        "worldToCamera": h.camera.camera_from_world,
        "worldToNDC": h.camera.ndc_from_world,
        "data_origin": h.data_origin,
        "display_window": h.display_window,
        "attributes": attributes_json(&h.attributes, all),
        "levels": levels.collect::<Vec<_>>(),
    })
}

fn attributes_json(attributes: &[(String, Attribute)], all: bool) -> Value {
    let opaque = |kind: Value, bytes: &[u8]| {
        let mut value = json!({ "type": kind, "bytes": bytes.len() });
        if all {
            value["hex"] = hex(bytes).into();
        }
        value
    };
    // JSON has no numbers that are not finite: write them as text.
    let number = |&v: &f64| {
        if v.is_finite() {
            json!(v)
        } else {
            json!(v.to_string())
        }
    };
    let mut out = Map::new();
    for (name, attribute) in attributes {
        let value = match attribute {
            value if as_text(value).is_some() => json!(as_text(value)),
            Attribute::Integers(v) => json!(v),
            Attribute::Numbers(v) => v.iter().map(number).collect(),
            Attribute::Opaque { type_name, bytes } => opaque(json!(type_name), bytes),
            Attribute::Unknown { kind, bytes } => opaque(json!(kind), bytes),
            _ => Value::Null,
        };
        out.insert(name.clone(), value);
    }
    Value::Object(out)
}
