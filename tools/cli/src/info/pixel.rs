//! One visibility function as a table.

use std::path::Path;

use deepshadow::{DepthKind, DsmFile, MapId, Visibility};
use serde_json::{Value, json};

use super::text::{Table, exact, grouped, quoted, short};
use super::{point, select};
use deepshadow_frame::Result;
use deepshadow_frame::output::Output;

/// The visibility function of a pixel, and where it is from.
#[derive(Clone, Debug)]
pub struct PixelFunction {
    /// Index of the map.
    pub map: usize,
    /// Its name.
    pub name: String,
    /// Level of the map.
    pub level: usize,
    /// The pixel, in coordinates of the level.
    pub at: (u32, u32),
    /// What the level promises.
    pub max_error: f64,
    /// What depths measure.
    pub depth_kind: DepthKind,
    /// Metres in one unit of depth; 0 if not stated.
    pub depth_unit: f64,
    /// The function.
    pub function: Visibility,
}

/// How the function comes to the value of a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// The first vertex, at which the light is still whole: a ramp begins.
    Start,
    /// It falls at this very depth.
    Step,
    /// It falls all the way from the vertex before it.
    Ramp,
    /// It is what it was.
    Level,
}

impl Arrival {
    /// In a word.
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
    /// PixelFunction `at` of a level; the first map and level 0 if none is named.
    ///
    /// # Errors
    /// `Failed` if there is no such pixel, and for a damaged tile.
    pub fn of(
        file: &DsmFile,
        map: Option<&str>,
        level: Option<usize>,
        at: (u32, u32),
    ) -> Result<Self> {
        let map = map.map_or(Ok(0), |which| select::map(file, which))?;
        let level = level.unwrap_or(0);
        let max_error = file.level(MapId(map as u32).level(level as u32))?.max_error;
        let header = &file.maps()[map].header;
        Ok(PixelFunction {
            map,
            name: header.name.clone(),
            level,
            at,
            max_error,
            depth_kind: header.depth_kind,
            depth_unit: header.depth_unit,
            function: file.function(
                MapId(map as u32).level(level as u32),
                deepshadow::Pixel::new(at.0, at.1),
            )?,
        })
    }

    /// The visibilities of vertex `i`, one or three.
    pub fn values(&self, i: usize) -> Vec<f32> {
        let f = &self.function;
        (0..f.channels()).map(|c| f.values(c)[i]).collect()
    }

    /// How the function comes to the value of vertex `i`.
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
        let (x, y) = self.at;
        let f = &self.function;
        let place = format!(
            "{}: map {} {}, level {}, pixel {x},{y}",
            path.display(),
            self.map,
            quoted(&self.name, 40),
            self.level
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
        for (i, &z) in f.depths().iter().enumerate() {
            let mut row = vec![i.to_string(), exact(z)];
            row.extend(self.values(i).iter().map(|&v| exact(v)));
            row.push(self.arrival(i).name().into());
            table.row(row);
        }
        table.lines().for_each(|line| out.line(line));
    }

    /// The function as a JSON object.
    pub fn json(&self) -> Value {
        let f = &self.function;
        let vertices = f.depths().iter().enumerate().map(
            |(i, z)| json!({ "z": z, "visibility": self.values(i), "kind": self.arrival(i).name() }),
        );
        json!({
            "map": self.map,
            "name": self.name,
            "level": self.level,
            "pixel": point(self.at),
            "channels": f.channels(),
            "max_error": self.max_error,
            "lit": f.is_empty(),
            "vertices": vertices.collect::<Vec<_>>(),
        })
    }
}
