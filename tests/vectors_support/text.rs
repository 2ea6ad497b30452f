//! The decoded values of a file as text: the same bytes as `spec/reader.py --dump` prints.

use std::fmt::Write;

use deepshadow::raw::footer::Footer;
use deepshadow::*;

/// Rewrites the digits of `{:e}` as Python prints a float, but without a trailing `.0`.
fn number(digits: &str) -> String {
    let (sign, digits) = match digits.strip_prefix('-') {
        Some(rest) => ("-", rest),
        None => ("", digits),
    };
    let (mantissa, exponent) = digits.split_once('e').expect("written with {:e}");
    let exponent: i32 = exponent.parse().unwrap();
    let figures = mantissa.replace('.', "");
    let body = match exponent {
        -4..0 => format!("0.{}{figures}", "0".repeat((-exponent - 1) as usize)),
        0..16 if figures.len() <= exponent as usize + 1 => {
            figures.clone() + &"0".repeat(exponent as usize + 1 - figures.len())
        }
        0..16 => format!(
            "{}.{}",
            &figures[..exponent as usize + 1],
            &figures[exponent as usize + 1..]
        ),
        _ => format!(
            "{mantissa}e{}{:02}",
            if exponent < 0 { '-' } else { '+' },
            exponent.abs()
        ),
    };
    sign.to_owned() + &body
}

/// An f32, with the fewest digits that identify it among all f32.
pub fn short(v: f32) -> String {
    number(&format!("{v:e}"))
}

/// An f64, with the fewest digits that identify it among all f64.
pub fn long(v: f64) -> String {
    number(&format!("{v:e}"))
}

/// An f64 as Python's `repr` prints it.
fn repr(v: f64) -> String {
    let text = long(v);
    if text.contains(['.', 'e']) {
        text
    } else {
        text + ".0"
    }
}

/// A JSON string in ASCII.
fn json(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            '\t' => out.push_str("\\t"),
            ' '..='~' => out.push(c),
            _ => c
                .encode_utf16(&mut [0; 2])
                .iter()
                .for_each(|u| write!(out, "\\u{u:04x}").unwrap()),
        }
    }
    out + "\""
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn joined<T>(values: &[T], separator: &str, f: impl Fn(&T) -> String) -> String {
    values.iter().map(f).collect::<Vec<_>>().join(separator)
}

fn attribute((name, value): &(String, Attribute)) -> String {
    let value = match value {
        Attribute::Text(text) => format!("text {}", json(text)),
        Attribute::Integers(v) => format!("i64 {}", joined(v, " ", i64::to_string)),
        Attribute::Numbers(v) => format!("f64 {}", joined(v, " ", |v| repr(*v))),
        Attribute::Opaque { type_name, bytes } => {
            format!("opaque {} {}", json(type_name), hex(bytes))
        }
        Attribute::Unknown { kind, bytes } => format!("kind {kind} {}", hex(bytes)),
        _ => unreachable!(),
    };
    format!("attribute {} {}\n", json(name), value).replace(" \n", "\n")
}

/// All decoded values of a file, one line for each map, level, pixel, group and attribute.
pub fn dump(bytes: &[u8]) -> Result<String> {
    let file = DsmFile::from_bytes(bytes.to_vec())?;
    let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let footer = number(bytes.len() - 48);
    let features = Footer::parse(&bytes[footer..bytes.len() - 64], 0, u64::MAX)?.optional_features;
    let mut out = format!(
        "dsm 1 maps {} groups {} attributes {} optional_features {features:#x}\n",
        file.maps().len(),
        file.groups().len(),
        file.attributes().len()
    );
    for (m, map) in file.maps().iter().enumerate() {
        let h = &map.header;
        let depth = match h.depth_kind {
            DepthKind::Unspecified => "unspecified",
            DepthKind::Planar => "planar",
            DepthKind::RayDistance => "ray",
        };
        let interpretation = match h.interpretation {
            Interpretation::Unspecified => "unspecified",
            Interpretation::Discrete => "discrete",
            Interpretation::Continuous => "continuous",
        };
        out += &format!(
            "map {m} {} {}x{} channels {} tile {} levels {} depth {depth} unit {} \
             interpretation {interpretation} origin {},{} window {} attributes {}\n",
            json(&h.name),
            h.width,
            h.height,
            h.channels,
            h.tile_size,
            map.levels.len(),
            long(h.depth_unit),
            h.data_origin[0],
            h.data_origin[1],
            joined(&h.display_window, ",", i32::to_string),
            h.attributes.len()
        );
        for (name, matrix) in [
            ("worldToCamera", h.camera.camera_from_world),
            ("worldToNDC", h.camera.ndc_from_world),
        ] {
            if let Some(matrix) = matrix {
                out += &format!("{name} {}\n", joined(&matrix, " ", |v| repr(*v)));
            }
        }
        h.attributes.iter().for_each(|a| out += &attribute(a));
        for (l, level) in map.levels.iter().enumerate() {
            let (w, h) = (level.shape.width, level.shape.height);
            out += &format!("level {l} {w}x{h} max_error {}\n", long(level.max_error));
            for y in 0..h {
                for x in 0..w {
                    let f = file.function(MapId(m as u32).level(l as u32), Pixel::new(x, y))?;
                    if f.is_empty() {
                        continue;
                    }
                    let kind = if f.channels() == 1 { "mono" } else { "rgb" };
                    out += &format!("pixel {x},{y} {kind}");
                    for (i, z) in f.depths().iter().enumerate() {
                        let v: Vec<f32> = (0..f.channels()).map(|c| f.values(c)[i]).collect();
                        out += &format!(" {}:{}", short(*z), joined(&v, ",", |v| short(*v)));
                    }
                    out += "\n";
                }
            }
        }
    }
    for (i, g) in file.groups().iter().enumerate() {
        let role = match g.role {
            GroupRole::Faces => "faces",
            GroupRole::Clusters => "clusters",
        };
        out += &format!(
            "group {i} {} {role} maps {}\n",
            json(&g.name),
            joined(&g.maps, " ", MapId::to_string)
        );
    }
    file.attributes().iter().for_each(|a| out += &attribute(a));
    Ok(out)
}
