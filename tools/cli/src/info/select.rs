//! The maps and levels that `--map` and `--level` select.

use deepshadow::{DsmFile, LevelId, MapId};

use deepshadow_frame::Result;

use crate::inputs::find_map;

/// Returns the map called `which`, else the map with this index.
///
/// # Errors
/// `Failed`, listing the maps of the file.
pub fn map(file: &DsmFile, which: &str) -> Result<MapId> {
    find_map(file, Some(which))
}

/// Returns the map that `which` selects, or all maps.
///
/// # Errors
/// As [`map`].
pub fn maps(file: &DsmFile, which: Option<&str>) -> Result<Vec<MapId>> {
    match which {
        Some(which) => Ok(vec![map(file, which)?]),
        None => Ok((0..file.maps().len() as u32).map(MapId).collect()),
    }
}

/// Returns the level of `map` that `which` selects, or all its levels.
///
/// # Errors
/// `Failed` for a level that the map does not have.
pub fn levels(file: &DsmFile, map: MapId, which: Option<u32>) -> Result<Vec<LevelId>> {
    match which {
        Some(level) => {
            file.level(map.level(level))?;
            Ok(vec![map.level(level)])
        }
        None => {
            let count = file.map(map)?.levels.len() as u32;
            Ok((0..count).map(|level| map.level(level)).collect())
        }
    }
}
