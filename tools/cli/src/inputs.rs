//! Input files: of which kind they are, and which of their maps is meant.

use std::path::Path;

use deepshadow::{DsmFile, MapId};
use deepshadow_frame::{Failure, InFile, Result};

use crate::info::text::quoted;
use crate::source::FileKind;

/// Opens a file that must be a `.dsm` one.
///
/// # Errors
/// `Failed`, naming the file.
pub fn open_dsm(path: &Path) -> Result<DsmFile> {
    match recognise(path)? {
        FileKind::Dsm => DsmFile::open(path).in_file(path),
        kind => {
            let line = format!("not a .dsm file of deepshadow, but {kind}");
            Err(Failure::Failed(line)).in_file(path)
        }
    }
}

/// What the input is: its content says so, and an extension that says something else is an error.
///
/// # Errors
/// `Failed`, naming the file.
pub fn recognise(path: &Path) -> Result<FileKind> {
    if path.is_dir() {
        return Err(Failure::Failed("it is a folder".into())).in_file(path);
    }
    let kind = FileKind::of(path).in_file(path)?;
    let said = path.extension().map(|e| e.to_ascii_lowercase());
    let expected = match said.as_ref().and_then(|e| e.to_str()) {
        Some("exr") => Some((FileKind::OpenExr, "an OpenEXR file")),
        Some("dsm") => Some((FileKind::Dsm, "a .dsm file of deepshadow")),
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

/// The map that the user named, or the only one.
///
/// # Errors
/// `Failed`, naming the maps, if there is no such map, or several and none is named.
pub fn find_map(file: &DsmFile, name: Option<&str>) -> Result<MapId> {
    let names = || {
        let names = file.maps().iter().take(20);
        let names: Vec<_> = names.map(|m| m.header.name.as_str()).collect();
        names.join(", ")
    };
    let Some(name) = name else {
        return match file.maps().len() {
            1 => Ok(MapId(0)),
            n => Err(Failure::Failed(format!(
                "it holds {n} maps, name one by --map: {}",
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
        let all = file.maps().iter().map(|m| quoted(&m.header.name, 40));
        let mut shown: Vec<_> = all.take(9).collect();
        if let Some(ninth) = shown.get_mut(8) {
            *ninth = "...".into();
        }
        Failure::Failed(format!(
            "no map {}; there are {}",
            quoted(name, 40),
            shown.join(", ")
        ))
    })
}
