//! Which maps and levels an option speaks of.

use deepshadow::{DsmFile, MapId};

use deepshadow_frame::Result;

use crate::inputs::find_map;

/// The map called `which`, else the map with this index.
///
/// # Errors
/// `Failed`, naming the maps that there are.
pub fn map(file: &DsmFile, which: &str) -> Result<usize> {
    Ok(find_map(file, Some(which))?.index())
}

/// The maps that `which` selects; all if it is not given.
///
/// # Errors
/// As [`map`].
pub fn maps(file: &DsmFile, which: Option<&str>) -> Result<Vec<usize>> {
    match which {
        Some(which) => Ok(vec![map(file, which)?]),
        None => Ok((0..file.maps().len()).collect()),
    }
}

/// The levels of map `m` that `which` selects; all if it is not given.
///
/// # Errors
/// `Failed` if there is no such level.
pub fn levels(file: &DsmFile, m: usize, which: Option<usize>) -> Result<Vec<usize>> {
    match which {
        Some(level) => {
            file.level(MapId(m as u32).level(level as u32))?;
            Ok(vec![level])
        }
        None => Ok((0..file.maps()[m].levels.len()).collect()),
    }
}
