//! The differences between the maps of two files.

use std::path::Path;

use deepshadow::raw::{Deviation, LevelShape};
use deepshadow::{DsmFile, MapHeader, MapId, Pixel};
use serde_json::{Value, json};

use super::difference::compare_level;
use super::text::{Table, counted, exact, grouped, quoted, short};
use super::{point, select};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, Result};

/// The comparison of two files.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// Reasons why maps cannot be compared.
    pub obstacles: Vec<String>,
    /// Differences of metadata.
    pub differences: Vec<String>,
    /// The levels of maps that both files have.
    pub levels: Vec<LevelPair>,
}

/// A level of a map in both files. The second item of each pair belongs to the other file.
#[derive(Clone, Debug)]
pub struct LevelPair {
    /// The map in each file.
    pub maps: [MapId; 2],
    /// Name of the map in the first file.
    pub name: String,
    /// The level.
    pub level: u32,
    /// Its shape in the first file.
    pub shape: LevelShape,
    /// Number of pixels whose functions differ.
    pub differing: u64,
    /// The largest difference and its pixel, if any functions differ.
    pub largest: Option<(Pixel, Deviation)>,
    /// Vertices of the level.
    pub vertices: [u64; 2],
    /// Payload bytes of the level.
    pub bytes: [u64; 2],
}

impl Comparison {
    /// Compares all maps, or the one called `which`, with the maps of the same name in the other
    /// file, else of the same index.
    ///
    /// # Errors
    /// `Failed` for damage in either file, and for an unknown map.
    pub fn of(
        here: &DsmFile,
        there: &DsmFile,
        which: Option<&str>,
        console: Console,
    ) -> Result<Self> {
        let mut all = Comparison::default();
        let maps = select::maps(here, which)?;
        if which.is_none() {
            all.compare_files(here, there);
        }
        let mut pairs = Vec::new();
        for m in maps {
            let name = &here.map(m)?.header.name;
            let other = there.find(name).or(there.map(m).is_ok().then_some(m));
            match other {
                Some(o) if all.compare_headers(here, there, m, o) => pairs.push((m, o)),
                Some(_) => {}
                None => all
                    .obstacles
                    .push(format!("the other file has no map {}", quoted(name, 40))),
            }
        }
        let levels = |&(m, o): &(MapId, MapId)| {
            let [a, b] = [&here.maps()[m.index()], &there.maps()[o.index()]];
            a.levels.len().min(b.levels.len())
        };
        let rows = |p: &(MapId, MapId)| -> u64 {
            let heights = here.maps()[p.0.index()].levels[..levels(p)]
                .iter()
                .map(|l| l.shape.height);
            heights.map(u64::from).sum()
        };
        let total = pairs.iter().map(rows).sum();
        let (mut bar, mut done) = (console.bar("comparing"), 0);
        for pair in &pairs {
            for level in 0..levels(pair) as u32 {
                all.levels.push(compare_level(
                    [here, there],
                    [pair.0, pair.1],
                    level,
                    |rows| {
                        done += rows;
                        bar.set(done, total);
                    },
                )?);
            }
        }
        Ok(all)
    }

    fn compare_files(&mut self, here: &DsmFile, there: &DsmFile) {
        let counts = [here, there].map(|f| f.maps().len());
        if counts[0] != counts[1] {
            self.obstacles.push(format!(
                "{}, {} in the other file",
                counted(counts[0] as u64, "map"),
                counts[1]
            ));
        }
        if here.groups() != there.groups() {
            self.differences.push("the groups differ".into());
        }
        if here.attributes() != there.attributes() {
            self.differences
                .push("the attributes of the files differ".into());
        }
    }

    /// Compares the headers of two maps. Returns whether their functions can be compared.
    fn compare_headers(&mut self, here: &DsmFile, there: &DsmFile, m: MapId, o: MapId) -> bool {
        let (a, b) = (&here.maps()[m.index()], &there.maps()[o.index()]);
        let name = quoted(&a.header.name, 40);
        let (ha, hb) = (&a.header, &b.header);
        let size = |h: &MapHeader| format!("{} x {} pixels", h.width, h.height);
        if size(ha) != size(hb) {
            self.obstacles.push(format!(
                "map {name}: {}, {} in the other file",
                size(ha),
                size(hb)
            ));
            return false;
        }
        let mut unlike = |what: &str, a: String, b: String| {
            if a != b {
                self.differences
                    .push(format!("map {name}: {what} {a}, {b} in the other file"));
            }
        };
        unlike("index", m.to_string(), o.to_string());
        unlike("name", name.clone(), quoted(&hb.name, 40));
        unlike("channels", ha.channels.to_string(), hb.channels.to_string());
        unlike(
            "tile size",
            ha.tile_size.to_string(),
            hb.tile_size.to_string(),
        );
        unlike(
            "levels",
            a.levels.len().to_string(),
            b.levels.len().to_string(),
        );
        unlike(
            "depth kind",
            ha.depth_kind.to_string(),
            hb.depth_kind.to_string(),
        );
        unlike(
            "depth unit",
            ha.depth_unit.to_string(),
            hb.depth_unit.to_string(),
        );
        let source = |h: &MapHeader| h.interpretation.to_string();
        unlike("interpretation", source(ha), source(hb));
        let promises = |m: &deepshadow::MapInfo| {
            let promises: Vec<String> = m.levels.iter().map(|l| short(l.max_error)).collect();
            promises.join(" ")
        };
        if a.levels.len() == b.levels.len() {
            unlike("promises", promises(a), promises(b));
        }
        unlike(
            "data origin",
            format!("{:?}", ha.data_origin),
            format!("{:?}", hb.data_origin),
        );
        let window = |h: &MapHeader| format!("{:?}", h.display_window);
        unlike("display window", window(ha), window(hb));
        if ha.camera != hb.camera {
            self.differences
                .push(format!("map {name}: the cameras differ"));
        }
        if ha.attributes != hb.attributes {
            self.differences
                .push(format!("map {name}: the attributes differ"));
        }
        true
    }

    /// Returns the largest difference of all levels.
    pub fn largest(&self) -> f64 {
        let errors = self.levels.iter().filter_map(|l| l.largest);
        errors.map(|(_, d)| d.error).fold(0.0, f64::max)
    }

    /// Whether structure, metadata and every vertex are equal.
    pub fn identical(&self) -> bool {
        self.obstacles.is_empty()
            && self.differences.is_empty()
            && self.levels.iter().all(|l| l.differing == 0)
    }

    /// Checks the result.
    ///
    /// # Errors
    /// `Failed` if a map cannot be compared, or if the largest difference exceeds `most`.
    pub fn verdict(&self, other: &Path, most: Option<f64>) -> Result<()> {
        let other = other.display();
        if let Some(obstacle) = self.obstacles.first() {
            let line = format!("cannot be compared with {other}: {obstacle}");
            return Err(Failure::Failed(line));
        }
        match most {
            Some(most) if self.largest() > most => Err(Failure::Failed(format!(
                "failed: differs from {other} by {}, {} more than --fail {}",
                short(self.largest()),
                short(self.largest() - most),
                short(most)
            ))),
            _ => Ok(()),
        }
    }

    /// Prints the differences, and a conclusion in the last line.
    pub fn print(&self, path: &Path, other: &Path, out: &mut Output) {
        out.line(format_args!("{} and {}", path.display(), other.display()));
        for line in self.obstacles.iter().chain(&self.differences) {
            out.line(format_args!("  {line}"));
        }
        for levels in self.levels.chunk_by(|a, b| a.maps == b.maps) {
            out.line(format_args!(
                "map {} {}",
                levels[0].maps[0],
                quoted(&levels[0].name, 60)
            ));
            let mut table = Table::new(&[
                "level",
                "size",
                "difference",
                "<pixel",
                "<at",
                "pixels",
                "vertices",
                "other",
                "bytes",
                "other",
            ]);
            for l in levels {
                let (difference, pixel, at) = match &l.largest {
                    Some((pixel, d)) => (short(d.error), pixel.to_string(), place(d)),
                    None => ("0".into(), "-".into(), "-".into()),
                };
                table.row(vec![
                    l.level.to_string(),
                    format!("{} x {}", l.shape.width, l.shape.height),
                    difference,
                    pixel,
                    at,
                    grouped(l.differing),
                    grouped(l.vertices[0]),
                    grouped(l.vertices[1]),
                    grouped(l.bytes[0]),
                    grouped(l.bytes[1]),
                ]);
            }
            table.lines().for_each(|line| out.line(line));
        }
        let same = self.levels.iter().all(|l| l.differing == 0);
        out.line(match (self.obstacles.is_empty(), self.identical(), same) {
            (false, ..) => "cannot be compared".into(),
            (_, true, _) => "identical".into(),
            (_, _, true) => "the same functions".into(),
            _ => format!("largest difference {}", short(self.largest())),
        });
    }

    /// Returns the comparison as a JSON object.
    pub fn json(&self, other: &Path) -> Value {
        let levels = self.levels.iter().map(|l| {
            let largest = l.largest.as_ref();
            json!({
                "map": l.maps[0].0,
                "other_map": l.maps[1].0,
                "name": l.name,
                "level": l.level,
                "difference": largest.map_or(0.0, |(_, d)| d.error),
                "pixel": largest.map(|&(pixel, _)| point(pixel)),
                "z": largest.map(|(_, d)| d.depth),
                "side": largest.map(|(_, d)| side(d)),
                "channel": largest.map(|(_, d)| d.channel),
                "differing_pixels": l.differing,
                "vertices": l.vertices,
                "bytes": l.bytes,
            })
        });
        json!({
            "other": other.to_string_lossy(),
            "comparable": self.obstacles.is_empty(),
            "identical": self.identical(),
            "difference": self.largest(),
            "obstacles": self.obstacles,
            "differences": self.differences,
            "levels": levels.collect::<Vec<_>>(),
        })
    }
}

/// Returns `at` or `behind`: the side of a step that a deviation is on.
pub fn side(d: &Deviation) -> &'static str {
    if d.behind { "behind" } else { "at" }
}

/// Returns the depth, side and channel of a deviation in words.
pub fn place(d: &Deviation) -> String {
    let channel = ["", " green", " blue"][d.channel.min(2)];
    let behind = if d.behind { "behind " } else { "" };
    format!("{behind}z {}{channel}", exact(d.depth))
}
