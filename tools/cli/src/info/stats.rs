//! Statistics that need all pixels: histograms, steps and codecs. Also the bytes of each part of
//! the file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use deepshadow::raw::Run;
use deepshadow::raw::codec;
use deepshadow::raw::directory::TileKind;
use deepshadow::raw::header::Trailer;
use deepshadow::raw::layout::{HEADER_SIZE, TRAILER_SIZE};
use deepshadow::{DsmFile, FunctionRef, LevelId};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::text::{Table, exact, grouped, quoted, ratio, share};
use super::{select, tiles};
use deepshadow_frame::Result;
use deepshadow_frame::console::Console;
use deepshadow_frame::output::Output;

/// Bytes of each part of a file, and statistics of the selected levels.
#[derive(Clone, Debug)]
pub struct Stats {
    trailer: Trailer,
    /// Name of each map, and payload bytes of its levels.
    payloads: Vec<(String, Vec<u64>)>,
    levels: Vec<LevelStats>,
}

/// Statistics of a level.
#[derive(Clone, Debug)]
struct LevelStats {
    id: LevelId,
    name: String,
    counts: Counts,
    bytes: u64,
}

/// Counts. The counts of parts add up to those of the whole.
#[derive(Clone, Debug, Default)]
struct Counts {
    /// Number of pixels by histogram bin.
    histogram: BTreeMap<u32, u64>,
    pixels: u64,
    lit: u64,
    dark: u64,
    mono: u64,
    vertices: u64,
    most: usize,
    steps: u64,
    kinds: BTreeMap<String, u64>,
    /// Data tiles by codec, transform and lattice.
    stored: BTreeMap<(&'static str, &'static str, u16), u64>,
    depths: Option<[f32; 2]>,
    ends: Option<[f32; 2]>,
}

/// Returns the first number of the bin that holds `n`. As in oiiotool, 0 to 7 have bins of their
/// own, and further bins reach from one power of two to the next.
fn bin(n: usize) -> u32 {
    match n {
        0..8 => n as u32,
        _ => 1 << n.ilog2(),
    }
}

fn bin_end(first: u32) -> u64 {
    match first {
        0..8 => u64::from(first),
        _ => 2 * u64::from(first) - 1,
    }
}

fn widen(range: &mut Option<[f32; 2]>, [low, high]: [f32; 2]) {
    *range = Some(match *range {
        None => [low, high],
        Some([a, b]) => [a.min(low), b.max(high)],
    });
}

impl Counts {
    fn run(file: &DsmFile, level: LevelId, run: &Run) -> deepshadow::Result<Counts> {
        let (mut counts, entry) = (Counts::default(), &run.entry);
        *counts.kinds.entry(entry.kind.to_string()).or_default() += run.tiles;
        widen(&mut counts.ends, entry.ends);
        if entry.kind != TileKind::Empty {
            widen(&mut counts.depths, entry.depths);
        }
        if entry.kind == TileKind::Data {
            let names = (
                codec::name(entry.codec),
                tiles::transform_name(entry.transform),
                entry.lattice,
            );
            counts.stored.insert(names, 1);
        }
        let tile = file.tile(level, file.level(level)?.shape.tile_at(run.first))?;
        match entry.kind {
            TileKind::Data => tile.functions().for_each(|f| counts.count(f, 1)),
            _ => counts.count(tile.function(0), run.pixels()),
        }
        Ok(counts)
    }

    /// Counts the function of `n` pixels.
    fn count(&mut self, f: FunctionRef<'_>, n: u64) {
        *self.histogram.entry(bin(f.len())).or_default() += n;
        self.pixels += n;
        self.lit += n * u64::from(f.is_empty());
        self.dark += n * u64::from(f.end_rgb() == [0.0; 3]);
        self.mono += n * u64::from(!f.is_empty() && f.channels() == 1);
        self.vertices += n * f.len() as u64;
        self.most = self.most.max(f.len());
        let first = !f.is_empty() && (0..f.channels()).any(|c| f.value(0, c) < 1.0);
        let pairs = f.depths().windows(2).filter(|z| z[0] == z[1]).count();
        self.steps += n * (u64::from(first) + pairs as u64);
    }

    fn add(mut self, other: Counts) -> Counts {
        for (bin, n) in other.histogram {
            *self.histogram.entry(bin).or_default() += n;
        }
        for (kind, n) in other.kinds {
            *self.kinds.entry(kind).or_default() += n;
        }
        for (names, n) in other.stored {
            *self.stored.entry(names).or_default() += n;
        }
        self.pixels += other.pixels;
        self.lit += other.lit;
        self.dark += other.dark;
        self.mono += other.mono;
        self.vertices += other.vertices;
        self.most = self.most.max(other.most);
        self.steps += other.steps;
        if let Some(range) = other.depths {
            widen(&mut self.depths, range);
        }
        if let Some(range) = other.ends {
            widen(&mut self.ends, range);
        }
        self
    }
}

impl Stats {
    /// Reads `level`, or level 0, of the selected maps. Cost: decodes all their tiles, on all
    /// cores.
    ///
    /// # Errors
    /// `Failed` for damage, and for an unknown map or level.
    pub fn of(
        file: &DsmFile,
        path: &Path,
        map: Option<&str>,
        level: Option<u32>,
        console: Console,
    ) -> Result<Self> {
        let mut tail = [0; TRAILER_SIZE];
        let mut source = File::open(path)?;
        source.seek(SeekFrom::End(-(TRAILER_SIZE as i64)))?;
        source.read_exact(&mut tail)?;
        let trailer = Trailer::parse(&tail, file.length())?;
        let payloads = file.maps().iter().map(|m| {
            let bytes = m.levels.iter().map(|l| l.payload_bytes).collect();
            (m.header.name.clone(), bytes)
        });
        let maps = select::maps(file, map)?;
        let level = level.unwrap_or(0);
        let mut total = 0;
        for &m in &maps {
            total += file.level(m.level(level))?.shape.tiles();
        }
        let mut bar = console.bar("reading");
        let mut done = 0;
        let mut levels = Vec::new();
        for m in maps {
            let id = m.level(level);
            let info = file.level(id)?;
            let mut counts = Counts::default();
            for batch in file.batches(id)? {
                let batch = batch?;
                let counted = batch
                    .par_iter()
                    .map(|run| Counts::run(file, id, run))
                    .try_reduce(Counts::default, |a, b| Ok(a.add(b)))?;
                counts = counts.add(counted);
                done += batch.iter().map(|run| run.tiles).sum::<u64>();
                bar.set(done, total);
            }
            levels.push(LevelStats {
                id,
                name: file.map(m)?.header.name.clone(),
                counts,
                bytes: info.payload_bytes,
            });
        }
        Ok(Stats {
            trailer,
            payloads: payloads.collect(),
            levels,
        })
    }

    fn directory_bytes(&self) -> u64 {
        self.trailer.footer_offset - self.trailer.directory_offset
    }

    /// Prints the tables.
    pub fn print(&self, path: &Path, out: &mut Output) {
        out.line(format_args!("{}: bytes by part", path.display()));
        let whole = self.trailer.file_length;
        let mut table = Table::new(&["<part", "bytes", "share"]);
        let mut part = |name: String, bytes: u64| {
            table.row(vec![name, grouped(bytes), share(bytes, whole)]);
        };
        part("header".into(), HEADER_SIZE as u64);
        for (name, levels) in &self.payloads {
            for (l, &bytes) in levels.iter().enumerate() {
                part(format!("tiles of {}, level {l}", quoted(name, 30)), bytes);
            }
        }
        part("directory".into(), self.directory_bytes());
        part("footer".into(), self.trailer.footer_size);
        part("trailer".into(), TRAILER_SIZE as u64);
        part("file".into(), whole);
        table.lines().for_each(|line| out.line(line));
        for level in &self.levels {
            out.line("");
            level.print(out);
        }
    }

    /// Returns the statistics as a JSON object.
    pub fn json(&self) -> Value {
        let tiles: Vec<&Vec<u64>> = self.payloads.iter().map(|(_, levels)| levels).collect();
        json!({
            "bytes": {
                "header": HEADER_SIZE,
                "tiles": tiles,
                "directory": self.directory_bytes(),
                "footer": self.trailer.footer_size,
                "trailer": TRAILER_SIZE,
            },
            "maps": self.levels.iter().map(LevelStats::json).collect::<Vec<_>>(),
        })
    }
}

impl LevelStats {
    fn print(&self, out: &mut Output) {
        let c = &self.counts;
        out.line(format_args!(
            "map {} {}, level {}",
            self.id.map,
            quoted(&self.name, 60),
            self.id.level
        ));
        let mut field = |name: &str, value: String| out.line(format_args!("  {name:<18}{value}"));
        let part = |n: u64, of: u64| format!("{} ({})", grouped(n), share(n, of));
        field("pixels", grouped(c.pixels));
        field("lit pixels", part(c.lit, c.pixels));
        field("dark behind all", part(c.dark, c.pixels));
        field(
            "mono pixels",
            part(c.mono, c.pixels - c.lit) + " of the shadowed",
        );
        let (vertices, shadowed) = (c.vertices as f64, (c.pixels - c.lit) as f64);
        field(
            "vertices",
            format!(
                "{}, {} a pixel, {} a shadowed pixel, at most {}",
                grouped(c.vertices),
                ratio(vertices, c.pixels as f64),
                ratio(vertices, shadowed),
                grouped(c.most as u64)
            ),
        );
        field("bits a vertex", ratio(8.0 * self.bytes as f64, vertices));
        field("steps", grouped(c.steps));
        let range = |r: Option<[f32; 2]>| match r {
            Some([a, b]) => format!("{} to {}", exact(a), exact(b)),
            None => "none".into(),
        };
        field("depths", range(c.depths));
        field("visibility at end", range(c.ends));
        let kinds = c
            .kinds
            .iter()
            .map(|(kind, &n)| format!("{} {kind}", grouped(n)));
        field("tiles", kinds.collect::<Vec<_>>().join(", "));
        for (&(codec, transform, lattice), &n) in &c.stored {
            let lattice = match lattice {
                0 => "f32".into(),
                l => format!("lattice {l}"),
            };
            let line = format!(
                "{} of codec {codec}, transform {transform}, {lattice}",
                grouped(n)
            );
            field("", line);
        }
        out.line("  vertices a pixel");
        let mut table = Table::new(&["", "", "pixels", "share"]);
        for (&first, &n) in &c.histogram {
            let last = bin_end(first);
            let name = if last == u64::from(first) {
                first.to_string()
            } else {
                format!("{first}-{last}")
            };
            table.row(vec![String::new(), name, grouped(n), share(n, c.pixels)]);
        }
        table.lines().skip(1).for_each(|line| out.line(line));
    }

    fn json(&self) -> Value {
        let c = &self.counts;
        let histogram = c
            .histogram
            .iter()
            .map(|(&first, n)| json!({ "from": first, "to": bin_end(first), "pixels": n }));
        let stored = c.stored.iter().map(|((codec, transform, lattice), n)| {
            json!({ "codec": codec, "transform": transform, "lattice": lattice, "tiles": n })
        });
        json!({
            "map": self.id.map.0,
            "name": self.name,
            "level": self.id.level,
            "pixels": c.pixels,
            "lit_pixels": c.lit,
            "dark_pixels": c.dark,
            "mono_pixels": c.mono,
            "vertices": c.vertices,
            "most_vertices": c.most,
            "steps": c.steps,
            "depths": c.depths,
            "ends": c.ends,
            "tiles": c.kinds,
            "stored": stored.collect::<Vec<_>>(),
            "histogram": histogram.collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_are_those_of_oiiotool() {
        let bins = [0, 1, 7, 8, 15, 16, 31, 32].map(bin);
        assert_eq!(bins, [0, 1, 7, 8, 8, 16, 16, 32]);
        assert_eq!([0, 7, 8, 16].map(bin_end), [0, 7, 15, 31]);
    }
}
