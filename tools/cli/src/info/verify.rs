//! Every rule of the format over a whole file, and the promise of a map against the image that it was made from.

use std::path::Path;

use deepshadow::{DsmFile, Interpretation, Report};
use serde_json::{Value, json};

use super::compare::{place, side};
use super::text::{Table, counted, grouped, quoted, ratio, short};
use super::{point, select, watch};
use crate::source::{self, DeepSource, LevelDeviation, SourceArgs};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, Result};

/// Checks every byte and every rule, with a progress bar.
///
/// # Errors
/// As [`DsmFile::verify`].
pub fn verify(file: &DsmFile, console: Console) -> deepshadow::Result<Report> {
    let mut bar = console.bar("verifying");
    file.verify(|p| watch(&mut bar, p))
}

/// What a check found, on a line.
pub fn line(report: &Report) -> String {
    format!(
        "ok, {} ({} empty, {} constant), {}, {} of payload",
        counted(report.tiles, "tile"),
        grouped(report.empty_tiles),
        grouped(report.constant_tiles),
        if report.vertices == 1 {
            "1 vertex".into()
        } else {
            format!("{} vertices", grouped(report.vertices))
        },
        counted(report.payload_bytes, "byte"),
    )
}

/// What a check found, as JSON.
pub fn json(result: &deepshadow::Result<Report>) -> Value {
    match result {
        Ok(report) => json!({
            "ok": true,
            "tiles": report.tiles,
            "empty_tiles": report.empty_tiles,
            "constant_tiles": report.constant_tiles,
            "vertices": report.vertices,
            "payload_bytes": report.payload_bytes,
        }),
        Err(e) => json!({ "ok": false, "rule": e.rule(), "error": e.to_string() }),
    }
}

/// A map measured against its source.
#[derive(Clone, Debug)]
pub struct Measured {
    map: usize,
    name: String,
    levels: Vec<LevelDeviation>,
}

impl Measured {
    /// Measures the map called `which`, else the first, against the image at `path`.
    ///
    /// # Errors
    /// `Failed` if either cannot be read, or their sizes differ.
    pub fn of(
        file: &DsmFile,
        which: Option<&str>,
        path: &Path,
        args: &SourceArgs,
        console: Console,
    ) -> Result<Self> {
        let map = which.map_or(Ok(0), |which| select::map(file, which))?;
        let header = &file.maps()[map].header;
        let mut options = args.options()?;
        options.discrete |= header.interpretation == Interpretation::Discrete;
        let source = DeepSource::open(path, &options)?;
        let mut bar = console.bar("measuring");
        let levels = source::against(file, map, &source, |done, total| bar.set(done, total))?;
        Ok(Measured {
            map,
            name: header.name.clone(),
            levels,
        })
    }

    /// # Errors
    /// `Failed` if a level breaks its promise.
    pub fn verdict(&self) -> Result<()> {
        let Some(broken) = self.levels.iter().find(|l| !l.is_kept()) else {
            return Ok(());
        };
        let (x, y) = broken.pixel;
        Err(Failure::Failed(format!(
            "map {} breaks the promise of level {}: an error of {} at pixel {x},{y}, {}, where {} is promised",
            quoted(&self.name, 40),
            broken.level,
            short(broken.worst.error),
            place(&broken.worst),
            short(broken.promise)
        )))
    }

    /// Prints the largest error of each level.
    pub fn print(&self, path: &Path, out: &mut Output) {
        let path = path.display();
        let name = quoted(&self.name, 40);
        out.line(format_args!("map {} {name} against {path}", self.map));
        let mut table = Table::new(&["level", "promise", "error", "of it", "<pixel", "<at", "<"]);
        for l in &self.levels {
            let at = if l.worst.error == 0.0 {
                ["-".into(), "-".into()]
            } else {
                [format!("{},{}", l.pixel.0, l.pixel.1), place(&l.worst)]
            };
            let [pixel, at] = at;
            table.row(vec![
                l.level.to_string(),
                short(l.promise),
                short(l.worst.error),
                ratio(l.worst.error, l.promise),
                pixel,
                at,
                if l.is_kept() { "kept" } else { "BROKEN" }.into(),
            ]);
        }
        table.lines().for_each(|line| out.line(line));
    }

    /// The same as a JSON object.
    pub fn json(&self, path: &Path) -> Value {
        let levels = self.levels.iter().map(|l| {
            json!({
                "level": l.level,
                "promise": l.promise,
                "error": l.worst.error,
                "slack": l.slack,
                "kept": l.is_kept(),
                "pixel": point(l.pixel),
                "z": l.worst.depth,
                "side": side(&l.worst),
                "channel": l.worst.channel,
            })
        });
        json!({
            "source": path.to_string_lossy(),
            "map": self.map,
            "name": self.name,
            "kept": self.levels.iter().all(LevelDeviation::is_kept),
            "levels": levels.collect::<Vec<_>>(),
        })
    }
}
