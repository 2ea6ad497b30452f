//! What `--runstats` says.

use std::path::Path;
use std::time::Duration;

use deepshadow::DsmFile;
use deepshadow_cli::{InFile, Result};

use crate::build::Report;
use crate::scene::Scene;

/// Prints times, counts, and what lies in the file.
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
    println!("time            {}", seconds(all));
    println!("  reading       {}", seconds(read));
    println!(
        "  placing       {} (triangles in the views, tiles that see them)",
        seconds(report.placing)
    );
    println!(
        "  shooting      {} of all threads (rays and what they meet)",
        seconds(report.shooting)
    );
    println!(
        "  summing       {} of all threads (transmittance functions, weighted sums)",
        seconds(report.summing)
    );
    println!(
        "  writing       {} (compression, levels, file)",
        seconds(report.writing)
    );
    println!("objects         {}", scene.objects.len());
    println!("triangles       {}", report.triangles);
    let [all, covered] = report.tiles;
    println!("tiles           {all}, of which {covered} see something");
    println!("rays            {}", report.rays);
    println!(
        "hits            {} ({:.2} a ray)",
        report.hits,
        report.hits as f64 / report.rays.max(1) as f64
    );
    println!("vertices in     {}", report.vertices);
    let file = DsmFile::open(path).in_file(path)?;
    println!("file            {} bytes", file.length());
    for map in file.maps() {
        let base = &map.levels[0];
        let pixels = u64::from(base.shape.width) * u64::from(base.shape.height);
        let bytes =
            |levels: &[deepshadow::LevelInfo]| levels.iter().map(|l| l.payload_bytes).sum::<u64>();
        println!(
            "map             {:?}: {} x {}, {:.2} vertices a pixel, {} bytes, with all levels {} bytes, within {:.6}",
            map.header.name,
            base.shape.width,
            base.shape.height,
            base.vertices as f64 / pixels as f64,
            base.payload_bytes,
            bytes(&map.levels),
            base.max_error
        );
    }
    Ok(())
}
