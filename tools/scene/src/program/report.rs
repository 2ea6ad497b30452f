//! Prints the statistics of `--runstats`.

use std::path::Path;
use std::time::Duration;

use deepshadow::DsmFile;
use deepshadow_frame::output::Output;
use deepshadow_frame::{InFile, Result};

use crate::build::Report;
use crate::scene::Scene;

/// Prints times, counts, and the maps of the file.
///
/// # Errors
/// `Failed` if the file cannot be read.
pub fn print(
    scene: &Scene,
    report: &Report,
    path: &Path,
    [read, all]: [Duration; 2],
) -> Result<()> {
    let seconds = |d: Duration| format!("{:.3} s", d.as_secs_f64());
    let mut out = Output::standard();
    out.line(format_args!("time            {}", seconds(all)));
    out.line(format_args!("  reading       {}", seconds(read)));
    out.line(format_args!(
        "  placing       {} (triangles in the views, tiles that see them)",
        seconds(report.placing)
    ));
    out.line(format_args!(
        "  shooting      {} of all threads (rays and what they meet)",
        seconds(report.shooting)
    ));
    out.line(format_args!(
        "  summing       {} of all threads (transmittance functions, weighted sums)",
        seconds(report.summing)
    ));
    out.line(format_args!(
        "  writing       {} (compression, levels, file)",
        seconds(report.writing)
    ));
    out.line(format_args!("objects         {}", scene.objects.len()));
    out.line(format_args!("triangles       {}", report.triangles));
    let [all, covered] = report.tiles;
    out.line(format_args!(
        "tiles           {all}, of which {covered} see something"
    ));
    out.line(format_args!("rays            {}", report.rays));
    out.line(format_args!(
        "hits            {} ({:.2} a ray)",
        report.hits,
        report.hits as f64 / report.rays.max(1) as f64
    ));
    out.line(format_args!("vertices in     {}", report.vertices));
    let file = DsmFile::open(path).in_file(path)?;
    out.line(format_args!("file            {} bytes", file.length()));
    for map in file.maps() {
        let base = &map.levels[0];
        let pixels = u64::from(base.shape.width) * u64::from(base.shape.height);
        let bytes =
            |levels: &[deepshadow::LevelInfo]| levels.iter().map(|l| l.payload_bytes).sum::<u64>();
        out.line(format_args!(
            "map             {:?}: {} x {}, {:.2} vertices a pixel, \
             {} bytes, with all levels {} bytes, within {:.6}",
            map.header.name,
            base.shape.width,
            base.shape.height,
            base.vertices as f64 / pixels as f64,
            base.payload_bytes,
            bytes(&map.levels),
            base.max_error
        ));
    }
    out.flush()
}
