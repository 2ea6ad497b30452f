//! The description of a map: header, levels, groups, ids, camera. Everything but its pixels.
//!
//! | module | contents |
//! |---|---|
//! | [`ids`] | ids of maps, levels, tiles and pixels |
//! | [`kinds`] | enums of the header with their names and bytes; attributes |
//! | [`camera`] | the matrices of a light, and constructors for them |
//! | [`header`] | the header of a map |
//! | [`level`] | the shape of a level; the maps and groups of a file |

mod camera;
mod header;
mod ids;
mod kinds;
mod level;

pub use camera::Camera;
pub use header::{MAX_SIDE, MapHeader};
pub use ids::{LevelId, MapId, Pixel, TileId};
pub use kinds::{Attribute, DepthKind, GroupRole, Interpretation};
pub use level::{Group, LevelInfo, LevelShape, MapInfo};
