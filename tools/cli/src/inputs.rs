//! Input files: their kinds, and their maps by name.

use std::path::Path;

use deepshadow::{DsmFile, Limits, MapId};
use deepshadow_frame::{Failure, InFile, Result};

use crate::info::text::quoted;
use crate::source::FileKind;

/// Opens a `.dsm` file.
///
/// # Errors
/// `Failed`, naming the file.
pub fn open_dsm(path: &Path, limits: Limits) -> Result<DsmFile> {
    match recognise(path)? {
        FileKind::Dsm => DsmFile::open_within(path, limits).in_file(path),
        kind => {
            let line = format!("not a .dsm file, but {kind}");
            Err(Failure::Failed(line)).in_file(path)
        }
    }
}

/// Returns the kind of an input by its content. An extension of another kind is an error.
///
/// # Errors
/// `Failed`, naming the file.
pub fn recognise(path: &Path) -> Result<FileKind> {
    if path.is_dir() {
        return Err(Failure::Failed("a folder, not a file".into())).in_file(path);
    }
    let kind = FileKind::of(path).in_file(path)?;
    let extension = path.extension().map(|e| e.to_ascii_lowercase());
    let expected = match extension.as_ref().and_then(|e| e.to_str()) {
        Some("exr") => Some((FileKind::OpenExr, "an OpenEXR file")),
        Some("dsm") => Some((FileKind::Dsm, "a .dsm file")),
        _ => None,
    };
    match (kind, expected) {
        (kind, Some((expected, name))) if kind != expected => {
            Err(Failure::Failed(format!("not {name}, but {kind}"))).in_file(path)
        }
        (FileKind::OpenExr | FileKind::Dsm, _) => Ok(kind),
        (kind, _) => {
            let line = format!("neither an OpenEXR nor a .dsm file, but {kind}");
            Err(Failure::Failed(line)).in_file(path)
        }
    }
}

/// Returns the map with this name, else with this index. Without a name, returns the only map.
///
/// # Errors
/// `Failed`, listing the maps, for an unknown map, and for several maps without a name.
pub fn find_map(file: &DsmFile, name: Option<&str>) -> Result<MapId> {
    let names = || {
        let all = file.maps().iter().map(|m| quoted(&m.header.name, 40));
        let mut shown: Vec<_> = all.take(9).collect();
        if let Some(ninth) = shown.get_mut(8) {
            *ninth = "...".into();
        }
        shown.join(", ")
    };
    let Some(name) = name else {
        return match file.maps().len() {
            1 => Ok(MapId(0)),
            n => Err(Failure::Failed(format!(
                "the file has {n} maps: choose one with --map: {}",
                names()
            ))),
        };
    };
    let numbered = || {
        name.parse()
            .ok()
            .map(MapId)
            .filter(|m| file.map(*m).is_ok())
    };
    file.find(name).or_else(numbered).ok_or_else(|| {
        let line = format!("no map {}; the file has {}", quoted(name, 40), names());
        Failure::Failed(line)
    })
}
