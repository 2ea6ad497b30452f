//! Converts the header of a deep image to that of a map, and back.

use deepshadow::raw::LevelShape;
use deepshadow::{Attribute, Camera, DepthKind, MapHeader};
use deepshadow_exr::samples::SampleChannels;
use deepshadow_exr::{Attribute as ExrAttribute, Part, Rect};

use deepshadow_frame::{Failure, Result};

/// Attributes that describe the structure of an OpenEXR file, not its content.
const STRUCTURAL: &[&str] = &[
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "tiles",
    "type",
    "version",
    "chunkCount",
    "maxSamplesPerPixel",
    "name",
];

/// The largest side of a map.
const MAX_SIDE: u32 = 1 << 20;

/// Returns the header of a map with the size, name, windows, camera and attributes of `part`.
///
/// `worldToCamera` and `worldToNDC` become the camera. Other attributes, except those of the file's
/// structure, are kept byte for byte with the type `exr:TYPE`. Depths are planar if the image has a
/// camera, else unspecified.
///
/// # Errors
/// `Failed` if the image is larger than a map may be.
pub fn map_header(part: &Part, channels: &SampleChannels) -> Result<MapHeader> {
    let window = part.data_window;
    if window.width > MAX_SIDE || window.height > MAX_SIDE {
        return Err(Failure::Failed(format!(
            "{} x {} pixels: a map has at most {MAX_SIDE} on a side",
            window.width, window.height
        )));
    }
    let name = match (&part.name, channels.layer()) {
        (Some(name), _) if !name.is_empty() => name,
        (_, "") => "main",
        (_, layer) => layer,
    };
    let mut header = MapHeader::new(tidy(name), window.width, window.height);
    header.channels = if channels.is_coloured() { 3 } else { 1 };
    header.data_origin = [window.x, window.y];
    let display = part.display_window;
    let last = |end: i64| i32::try_from(end - 1).unwrap_or(i32::MAX);
    if display.pixels() > 0 {
        header.display_window = [
            display.x,
            display.y,
            last(display.x_end()),
            last(display.y_end()),
        ];
    } else {
        header.display_window = [
            window.x,
            window.y,
            last(window.x_end()),
            last(window.y_end()),
        ];
    }
    for attribute in &part.attributes {
        let name = attribute.name.as_str();
        if STRUCTURAL.contains(&name) || !is_name(name) || !is_name(&attribute.type_name) {
            continue;
        }
        let matrix = attribute
            .as_m44f()
            .filter(|m| m.iter().all(|v| v.is_finite()));
        match (name, matrix) {
            ("worldToCamera", Some(m)) => header.camera.camera_from_world = Some(m.map(f64::from)),
            ("worldToNDC", Some(m)) => header.camera.ndc_from_world = Some(m.map(f64::from)),
            _ => {
                let value = Attribute::Opaque {
                    type_name: format!("exr:{}", attribute.type_name),
                    bytes: attribute.value.clone(),
                };
                header.attributes.push((name.into(), value));
            }
        }
    }
    if header.camera != Camera::default() {
        header.depth_kind = DepthKind::Planar;
    }
    Ok(header)
}

/// Whether a map may have an attribute of this name.
fn is_name(name: &str) -> bool {
    (1..=240).contains(&name.len()) && !name.chars().any(char::is_control)
}

/// Changes `name` to a legal name of a map.
fn tidy(name: &str) -> String {
    let clean = |c: char| if c.is_control() { '_' } else { c };
    let mut name: String = name.chars().map(clean).collect();
    while name.len() > 255 {
        name.pop();
    }
    name
}

/// Converts the camera and the attributes of a map to OpenEXR. Also returns the names of attributes
/// that cannot be converted.
///
/// Attributes of type `exr:TYPE` keep their bytes. Text becomes `string`, one integer of 32 bits
/// becomes `int`, and one number becomes `float`, or `double` if f32 does not hold it exactly.
pub fn exr_attributes(header: &MapHeader) -> (Vec<ExrAttribute>, Vec<String>) {
    let mut kept = Vec::new();
    let mut lost = Vec::new();
    for (name, value) in &header.attributes {
        let structural = STRUCTURAL.contains(&name.as_str()) || name.contains('\0');
        let int = |v: &[i64]| match v {
            [v] => i32::try_from(*v).ok(),
            _ => None,
        };
        let made = match value {
            _ if structural => None,
            Attribute::Text(text) => Some(ExrAttribute::text(name, text)),
            Attribute::Integers(v) => int(v).map(|v| ExrAttribute::int(name, v)),
            Attribute::Numbers(v) if v.len() == 1 => Some(match f64::from(v[0] as f32) == v[0] {
                true => ExrAttribute::float(name, v[0] as f32),
                false => ExrAttribute::new(name, "double", v[0].to_le_bytes().to_vec()),
            }),
            Attribute::Opaque { type_name, bytes } => type_name
                .strip_prefix("exr:")
                .filter(|t| !t.is_empty())
                .map(|t| ExrAttribute::new(name, t, bytes.clone())),
            _ => None,
        };
        match made {
            Some(attribute) => kept.push(attribute),
            None => lost.push(name.clone()),
        }
    }
    let single = |m: [f64; 16]| m.map(|v| v as f32);
    let camera = [
        ("worldToCamera", header.camera.camera_from_world),
        ("worldToNDC", header.camera.ndc_from_world),
    ];
    for (name, matrix) in camera {
        if let Some(matrix) = matrix {
            kept.retain(|a| a.name != name);
            kept.push(ExrAttribute::m44f(name, single(matrix)));
        }
    }
    (kept, lost)
}

/// Returns the header of a map whose base is a level of another map. Points in the world fall on
/// the same parts of the pixels, also where the sizes are odd and pixels at the border are cut off.
pub fn level_header(header: &MapHeader, level: u32) -> MapHeader {
    let shape = LevelShape::of(header, level);
    let (data, display) = windows(header, level, shape.width, shape.height);
    let mut new = header.clone();
    (new.width, new.height) = (shape.width, shape.height);
    new.data_origin = [data.x, data.y];
    let last = |first: i32, side: u32| i32::try_from(i64::from(first) + i64::from(side) - 1);
    new.display_window = [
        display.x,
        display.y,
        last(display.x, display.width).unwrap_or(i32::MAX),
        last(display.y, display.height).unwrap_or(i32::MAX),
    ];
    let Some(ndc) = &mut new.camera.ndc_from_world else {
        return new;
    };
    // Pixels of the window are `ndc * side + first`; those of the level are 2^level times as wide,
    // and both count from the data origin.
    let ratio = f64::from(1u32 << level);
    let [x0, y0, x1, y1] = header.display_window.map(f64::from);
    let axes = [
        (
            x0,
            x1,
            header.data_origin[0],
            display.x,
            display.width,
            data.x,
        ),
        (
            y0,
            y1,
            header.data_origin[1],
            display.y,
            display.height,
            data.y,
        ),
    ];
    for (axis, (first, last, origin, new_first, side, new_origin)) in axes.into_iter().enumerate() {
        let side = f64::from(side);
        let scale = (last - first + 1.0) / (ratio * side);
        let moved = (first - f64::from(origin)) / ratio + f64::from(new_origin);
        let shift = (moved - f64::from(new_first)) / side;
        for row in ndc.chunks_exact_mut(4) {
            row[axis] = scale * row[axis] + shift * row[3];
        }
    }
    new
}

/// Returns the data window and the display window of a level: those of the map, halved per level.
pub fn windows(header: &MapHeader, level: u32, width: u32, height: u32) -> (Rect, Rect) {
    let down = |v: i32| (i64::from(v) >> level) as i32;
    let data = Rect {
        x: down(header.data_origin[0]),
        y: down(header.data_origin[1]),
        width,
        height,
    };
    let [x0, y0, x1, y1] = header.display_window;
    let side = |first: i32, last: i32| {
        let n = i64::from(last) - i64::from(first) + 1;
        u32::try_from((n + (1 << level) - 1) >> level).unwrap_or(u32::MAX)
    };
    let display = Rect {
        x: down(x0),
        y: down(y0),
        width: side(x0, x1),
        height: side(y0, y1),
    };
    (data, display)
}
