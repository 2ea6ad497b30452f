//! Dumps every part of an OpenEXR file to standard output, so that scripts can compare it.
//!
//! The first line is JSON: a list of parts with name, window, channels, number of samples and
//! attributes (name, type, value in hexadecimal). Then follow, for each part, the sample counts of
//! all pixels (u32, row by row) and the values of each channel, little-endian in its type.

use deepshadow_exr::{ChannelData, DeepReader, SampleType};
use std::io::Write;

fn main() -> std::process::ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: exr_dump FILE");
        return 2.into();
    };
    match dump(path.as_ref()) {
        Ok(()) => 0.into(),
        Err(e) => {
            eprintln!("{}: {e}", std::path::Path::new(&path).display());
            1.into()
        }
    }
}

fn quoted(s: &str) -> String {
    let escape = |c: char| match c {
        '"' | '\\' => format!("\\{c}"),
        c if c.is_ascii() && !c.is_ascii_control() => c.to_string(),
        c => {
            let mut units = [0; 2];
            let units = c.encode_utf16(&mut units).iter();
            units.map(|u| format!("\\u{u:04x}")).collect()
        }
    };
    format!("\"{}\"", s.chars().map(escape).collect::<String>())
}

fn dump(path: &std::path::Path) -> Result<(), Box<dyn std::error::Error>> {
    let reader = DeepReader::open(path)?;
    let mut parts = Vec::new();
    let mut bodies: Vec<u8> = Vec::new();
    for (index, part) in reader.parts().iter().enumerate() {
        let all = reader.read_rect(index, part.data_window)?;
        for w in all.offsets.windows(2) {
            bodies.extend((w[1] - w[0]).to_le_bytes());
        }
        for c in &all.channels {
            match c {
                ChannelData::Half(v) => bodies.extend(v.iter().flat_map(|v| v.to_le_bytes())),
                ChannelData::Float(v) => bodies.extend(v.iter().flat_map(|v| v.to_le_bytes())),
                ChannelData::Uint(v) => bodies.extend(v.iter().flat_map(|v| v.to_le_bytes())),
            }
        }
        let channels = part.channels.iter().map(|c| {
            let kind = match c.sample_type {
                SampleType::Half => "half",
                SampleType::Float => "float",
                SampleType::Uint => "uint",
            };
            format!("[{},\"{kind}\"]", quoted(&c.name))
        });
        let attributes = part.attributes.iter().map(|a| {
            let hex: String = a.value.iter().map(|b| format!("{b:02x}")).collect();
            format!("[{},{},\"{hex}\"]", quoted(&a.name), quoted(&a.type_name))
        });
        let w = part.data_window;
        parts.push(format!(
            "{{\"name\":{},\"deep\":{},\"tiled\":{},\"compression\":{},\"window\":[{},{},{},{}],\
             \"samples\":{},\"channels\":[{}],\"attributes\":[{}]}}",
            quoted(part.name.as_deref().unwrap_or_default()),
            part.deep,
            part.tiles.is_some(),
            part.compression.code(),
            w.x,
            w.y,
            w.width,
            w.height,
            all.sample_count(),
            channels.collect::<Vec<_>>().join(","),
            attributes.collect::<Vec<_>>().join(",")
        ));
    }
    let mut out = std::io::stdout().lock();
    writeln!(out, "[{}]", parts.join(","))?;
    out.write_all(&bodies)?;
    Ok(())
}
