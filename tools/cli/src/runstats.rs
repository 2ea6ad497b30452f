//! The times and counts that `--runstats` prints, for dsm-convert and dsm-join.

use std::path::Path;
use std::time::Instant;

use deepshadow::{Curve, DsmFile};

use deepshadow_frame::output::Output;
use deepshadow_frame::{InFile, Result};

/// Counts of the vertices that a compressor reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Vertices {
    /// All vertices.
    pub count: u64,
    /// Steps, that is surfaces.
    pub steps: u64,
    /// Steps above twice the tolerance. No compressor can remove these: each costs two vertices, or
    /// one if it is the first of a pixel.
    pub forced: u64,
}

impl Vertices {
    /// Adds the vertices of `curve`, which will be compressed within `tolerance`.
    pub fn count_curve(&mut self, curve: &Curve, tolerance: f64) {
        let (z, f) = (curve.depths(), curve.function());
        self.count += z.len() as u64;
        for i in 0..z.len() {
            let fall = |c: usize| match i {
                0 => 1.0 - f.value(0, c),
                _ => f.value(i - 1, c) - f.value(i, c),
            };
            if i > 0 && z[i] != z[i - 1] {
                continue;
            }
            let fall = (0..f.channels()).map(fall).fold(0.0, f64::max);
            self.steps += u64::from(fall > 0.0);
            self.forced += u64::from(fall > 2.0 * tolerance);
        }
    }

    /// Adds the counts of `other`.
    pub fn add(&mut self, other: &Vertices) {
        self.count += other.count;
        self.steps += other.steps;
        self.forced += other.forced;
    }
}

/// Measures the time since its creation.
#[derive(Debug)]
pub struct Clock(Instant);

impl Default for Clock {
    fn default() -> Self {
        Clock(Instant::now())
    }
}

impl Clock {
    /// Prints the time, the counts of vertices, and the levels of the `.dsm` file at `path`.
    ///
    /// # Errors
    /// `Failed` if the file cannot be read.
    pub fn report(&self, path: &Path, vertices: Option<&Vertices>, mut out: Output) -> Result<()> {
        out.line(format_args!(
            "time            {:.3} s",
            self.0.elapsed().as_secs_f64()
        ));
        if let Some(v) = vertices {
            let share = 100.0 * v.forced as f64 / v.steps.max(1) as f64;
            out.line(format_args!(
                "vertices in     {} ({} steps)",
                v.count, v.steps
            ));
            out.line(format_args!(
                "forced steps    {} ({share:.1} % of the steps are above twice the tolerance)",
                v.forced
            ));
        }
        levels(path, &mut out)?;
        out.flush()
    }

    /// Prints the time and the size of the file at `path`.
    ///
    /// # Errors
    /// `Failed` if the file does not exist.
    pub fn report_file(&self, path: &Path, mut out: Output) -> Result<()> {
        out.line(format_args!(
            "time            {:.3} s",
            self.0.elapsed().as_secs_f64()
        ));
        out.line(format_args!(
            "file            {} bytes",
            std::fs::metadata(path).in_file(path)?.len()
        ));
        out.flush()
    }
}

fn levels(path: &Path, out: &mut Output) -> Result<()> {
    let file = DsmFile::open(path).in_file(path)?;
    out.line(format_args!("file            {} bytes", file.length()));
    for map in file.maps() {
        out.line(format_args!("map             {:?}", map.header.name));
        for (l, level) in map.levels.iter().enumerate() {
            let pixels = u64::from(level.shape.width) * u64::from(level.shape.height);
            out.line(format_args!(
                "level {l:<2}        {} x {}: {} vertices ({:.2} a pixel), {} bytes, within {:.6}",
                level.shape.width,
                level.shape.height,
                level.vertices,
                level.vertices as f64 / pixels as f64,
                level.payload_bytes,
                level.max_error
            ));
        }
    }
    Ok(())
}
