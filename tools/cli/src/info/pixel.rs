//! One visibility function as a table.

use std::path::Path;

use deepshadow::{DepthKind, DsmFile, LevelId, MapId, Pixel, Visibility};
use serde_json::json;

use super::document::{Items, Part};
use super::text::{Table, exact, grouped, quoted, short};
use super::{point, select};
use deepshadow_frame::Result;
use deepshadow_frame::output::Output;

/// The visibility function of a pixel, with its place.
#[derive(Clone, Debug)]
pub struct PixelFunction {
    /// The level.
    pub level: LevelId,
    /// Name of its map.
    pub name: String,
    /// The pixel of the level.
    pub at: Pixel,
    /// Largest error that the file states for the level.
    pub max_error: f64,
    /// The quantity that depths measure.
    pub depth_kind: DepthKind,
    /// Metres in one unit of depth; 0 if unknown.
    pub depth_unit: f64,
    /// The function.
    pub function: Visibility,
}

/// The most vertices that are printed.
const ROWS: usize = 1000;

/// Shape of the function in front of a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// The first vertex has visibility 1: a ramp begins here.
    Start,
    /// The function falls at the depth of the vertex.
    Step,
    /// The function falls linearly from the previous vertex.
    Ramp,
    /// The function is constant from the previous vertex.
    Level,
}

impl Arrival {
    /// Returns one word for tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Arrival::Start => "start",
            Arrival::Step => "step",
            Arrival::Ramp => "ramp",
            Arrival::Level => "level",
        }
    }
}

impl PixelFunction {
    /// Reads the function of pixel `at`. The defaults are the first map and level 0.
    ///
    /// # Errors
    /// `Failed` for an unknown map, level or pixel, and for a damaged tile.
    pub fn of(file: &DsmFile, map: Option<&str>, level: Option<u32>, at: Pixel) -> Result<Self> {
        let map = map.map_or(Ok(MapId(0)), |which| select::map(file, which))?;
        let level = map.level(level.unwrap_or(0));
        let max_error = file.level(level)?.max_error;
        let header = &file.map(map)?.header;
        Ok(PixelFunction {
            name: header.name.clone(),
            level,
            at,
            max_error,
            depth_kind: header.depth_kind,
            depth_unit: header.depth_unit,
            function: file.function(level, at)?,
        })
    }

    /// Returns the visibilities of vertex `i`, one or three.
    pub fn values(&self, i: usize) -> Vec<f32> {
        let f = &self.function;
        (0..f.channels()).map(|c| f.values(c)[i]).collect()
    }

    /// Returns the shape of the function in front of vertex `i`.
    pub fn arrival(&self, i: usize) -> Arrival {
        let z = self.function.depths();
        if i == 0 {
            return match self.values(0).iter().any(|&v| v < 1.0) {
                true => Arrival::Step,
                false => Arrival::Start,
            };
        }
        if z[i] == z[i - 1] {
            Arrival::Step
        } else if self.values(i) == self.values(i - 1) {
            Arrival::Level
        } else {
            Arrival::Ramp
        }
    }

    /// Prints the function.
    pub fn print(&self, path: &Path, out: &mut Output) {
        let f = &self.function;
        let place = format!(
            "{}: map {} {}, level {}, pixel {}",
            path.display(),
            self.level.map,
            quoted(&self.name, 40),
            self.level.level,
            self.at
        );
        if f.is_empty() {
            out.line(format_args!("{place}: lit at every depth, no vertices"));
            return;
        }
        let vertices = if f.len() == 1 { "vertex" } else { "vertices" };
        let channels = if f.channels() == 1 { "mono" } else { "rgb" };
        out.line(format_args!(
            "{place}: {} {vertices}, {channels}, promise {}",
            grouped(f.len() as u64),
            short(self.max_error)
        ));
        let mut table = match f.channels() {
            1 => Table::new(&["vertex", "z", "visibility", "<"]),
            _ => Table::new(&["vertex", "z", "red", "green", "blue", "<"]),
        };
        for (i, &z) in f.depths().iter().enumerate().take(ROWS) {
            let mut row = vec![i.to_string(), exact(z)];
            row.extend(self.values(i).iter().map(|&v| exact(v)));
            row.push(self.arrival(i).name().into());
            table.row(row);
        }
        table.lines().for_each(|line| out.line(line));
        if f.len() > ROWS {
            let more = grouped((f.len() - ROWS) as u64);
            out.line(format_args!(
                "  and {more} more vertices (--json lists all)"
            ));
        }
    }

    /// Returns the function for a JSON document.
    pub fn json(self) -> Part {
        let f = &self.function;
        let fields = [
            ("map", json!(self.level.map.0)),
            ("name", json!(self.name)),
            ("level", json!(self.level.level)),
            ("pixel", point(self.at)),
            ("channels", json!(f.channels())),
            ("max_error", json!(self.max_error)),
            ("lit", json!(f.is_empty())),
        ];
        let fields = fields.map(|(name, value)| (name.to_owned(), value.into()));
        let mut fields = Vec::from(fields);
        let vertices: Items = Box::new(move |item| {
            for (i, z) in self.function.depths().iter().enumerate() {
                let kind = self.arrival(i).name();
                item(json!({ "z": z, "visibility": self.values(i), "kind": kind }));
            }
        });
        fields.push(("vertices".into(), Part::List(vertices)));
        Part::Object(fields)
    }
}
