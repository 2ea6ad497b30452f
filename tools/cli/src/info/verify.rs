//! Verification: every rule of the format, and the true error of a map against its source image.

use std::path::Path;

use deepshadow::raw::Report;
use deepshadow::{DsmFile, Interpretation, MapId};
use serde_json::{Value, json};

use super::compare::{place, side};
use super::text::{Table, counted, grouped, quoted, ratio, short};
use super::{point, select, watch};
use crate::source::{self, DeepSource, LevelDeviation, SourceArgs};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, Result};

/// Checks every byte and every rule of the format, with a progress bar.
///
/// # Errors
/// As [`DsmFile::verify`].
pub fn verify(file: &DsmFile, console: Console) -> deepshadow::Result<Report> {
    let mut bar = console.bar("verifying");
    file.verify(|done, total| watch(&mut bar, done, total))
}

/// Returns the counts of a verification on one line.
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

/// Returns the result of a verification as JSON.
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

/// The true errors of a map against its source image.
#[derive(Clone, Debug)]
pub struct Measured {
    map: MapId,
    name: String,
    levels: Vec<LevelDeviation>,
}

impl Measured {
    /// Measures the map called `which`, or the first map, against the image at `path`.
    ///
    /// # Errors
    /// `Failed` if map or image cannot be read, or if their sizes differ.
    pub fn of(
        file: &DsmFile,
        which: Option<&str>,
        path: &Path,
        args: &SourceArgs,
        console: Console,
    ) -> Result<Self> {
        let map = which.map_or(Ok(MapId(0)), |which| select::map(file, which))?;
        let header = &file.map(map)?.header;
        let mut options = args.options();
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

    /// Checks the errors.
    ///
    /// # Errors
    /// `Failed` if the error of a level exceeds the error that the file states for it.
    pub fn verdict(&self) -> Result<()> {
        let Some(broken) = self.levels.iter().find(|l| !l.is_kept()) else {
            return Ok(());
        };
        Err(Failure::Failed(format!(
            "map {}, level {}: the error is {} at pixel {}, {}, but the file promises {}",
            quoted(&self.name, 40),
            broken.level,
            short(broken.worst.error),
            broken.pixel,
            place(&broken.worst),
            short(broken.max_error)
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
                [l.pixel.to_string(), place(&l.worst)]
            };
            let [pixel, at] = at;
            table.row(vec![
                l.level.to_string(),
                short(l.max_error),
                short(l.worst.error),
                ratio(l.worst.error, l.max_error),
                pixel,
                at,
                if l.is_kept() { "kept" } else { "BROKEN" }.into(),
            ]);
        }
        table.lines().for_each(|line| out.line(line));
    }

    /// Returns the errors as a JSON object.
    pub fn json(&self, path: &Path) -> Value {
        let levels = self.levels.iter().map(|l| {
            json!({
                "level": l.level,
                "promise": l.max_error,
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
            "map": self.map.0,
            "name": self.name,
            "kept": self.levels.iter().all(LevelDeviation::is_kept),
            "levels": levels.collect::<Vec<_>>(),
        })
    }
}
