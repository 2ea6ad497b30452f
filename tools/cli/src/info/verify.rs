//! Every rule of the format over a whole file.

use deepshadow::{DsmFile, Report};
use serde_json::{Value, json};

use super::text::{counted, grouped};
use super::watch;
use crate::progress::Bar;

/// Checks every byte and every rule, with a progress bar.
///
/// # Errors
/// As [`DsmFile::verify`].
pub fn verify(file: &DsmFile) -> deepshadow::Result<Report> {
    let mut bar = Bar::new("verifying");
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
