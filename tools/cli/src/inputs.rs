//! The maps of an input by name.

use deepshadow::{DsmFile, MapId};
use deepshadow_frame::{Failure, Result};

use crate::info::text::quoted;

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
