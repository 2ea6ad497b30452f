//! One filtered lookup, as a renderer makes it, and the pixels that it used.

use std::path::Path;
use std::sync::Arc;

use deepshadow::raw::{LevelShape, Tap};
use deepshadow::{
    Border, DsmFile, Filter, LevelChoice, MapId, Query, Sampler, SamplerOptions, TileCache,
};
use serde_json::{Value, json};

use super::select;
use super::text::{Table, counted, exact, grouped, quoted, short};
use deepshadow_frame::args::{number, numbers, width};
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, Result, choice};

/// Options of a lookup.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "Options of --lookup")]
pub struct LookupArgs {
    /// Width of the footprint, in pixels of level 0
    #[arg(
        long,
        value_name = "W",
        default_value = "1",
        value_parser = width,
        allow_hyphen_values = true,
        requires = "lookup"
    )]
    pub width: f32,

    /// Filter over the footprint
    #[arg(
        long,
        value_parser = choice(Filter::ALL),
        default_value = "triangle",
        value_name = "NAME",
        requires = "lookup"
    )]
    pub filter: Filter,

    /// Levels to read for the width of the footprint
    #[arg(
        long,
        value_parser = choice(LevelChoice::ALL),
        default_value = "blend",
        value_name = "NAME",
        requires = "lookup"
    )]
    pub levels: LevelChoice,

    /// Values outside the map
    #[arg(
        long,
        value_parser = choice(Border::ALL),
        default_value = "lit",
        value_name = "NAME",
        requires = "lookup"
    )]
    pub border: Border,

    /// Bias subtracted from the depth, in units of depth
    #[arg(
        long,
        value_name = "B",
        default_value = "0",
        value_parser = bias,
        allow_hyphen_values = true,
        requires = "lookup"
    )]
    pub bias: f32,
}

/// Most pixels that a lookup may read.
const MOST: u64 = 1 << 24;

/// Capacity of the tile cache in bytes.
const BUDGET: usize = 256 << 20;

/// Most pixels in the table, and in JSON.
const SHOWN: [usize; 2] = [16, 1024];

/// A lookup and its answer.
#[derive(Clone, Debug)]
pub struct Lookup {
    /// The map.
    pub map: MapId,
    /// Its name.
    pub name: String,
    /// Its options.
    pub how: LookupArgs,
    /// Point and footprint.
    pub query: Query,
    /// Visibility: one number, or red, green and blue for a map with colour.
    pub visibility: Vec<f32>,
    /// Opacity behind all vertices.
    pub opacity: Vec<f32>,
    /// First and last depth of the pixels under the footprint; `None` if all are lit.
    pub depths: Option<[f32; 2]>,
    /// Depth at which visibility falls below one half, per channel; `None` if it does not.
    pub half: Vec<Option<f32>>,
    /// The pixels used, each once, with their weights: level by level, row by row.
    pub taps: Vec<Tap>,
}

/// A level that a lookup read.
struct Used {
    level: usize,
    pixels: u64,
    weight: f64,
}

impl Lookup {
    /// Looks up the point (x, y, depth) in the map called `map`, or in the first map.
    ///
    /// # Errors
    /// `Failed` for an unknown map, for a damaged tile, and for a footprint over more than 2^24
    /// pixels.
    pub fn of(
        file: &Arc<DsmFile>,
        map: Option<&str>,
        how: LookupArgs,
        [x, y, depth]: [f32; 3],
    ) -> Result<Self> {
        let map = map.map_or(Ok(MapId(0)), |which| select::map(file, which))?;
        let info = file.map(map)?;
        let (name, channels) = (info.header.name.clone(), info.header.channels);
        let shapes: Vec<LevelShape> = info.levels.iter().map(|l| l.shape).collect();
        how.check_pixels(&shapes)?;
        let light = TileCache::new(BUDGET).add(file.clone());
        let mut sampler = Sampler::with_options(&light, map, how.options())?;
        let query = Query::new(x, y, depth).width(how.width).bias(how.bias);
        let behind = query.depth(f32::INFINITY).bias(0.0);
        let channels = if channels == 1 { 1 } else { 3 };
        let visibility = sampler.visibility_rgb(&query)?;
        let opacity = sampler.visibility_rgb(&behind)?.map(|v| 1.0 - v);
        let depths = sampler.depth_range(&query)?;
        let half = (0..channels).map(|c| below_half(&mut sampler, &query, c, depths));
        Ok(Lookup {
            map,
            name,
            how,
            query,
            visibility: visibility[..channels].to_vec(),
            opacity: opacity[..channels].to_vec(),
            depths,
            half: half.collect::<Result<_>>()?,
            taps: tidy(sampler.taps(&query)?),
        })
    }

    /// The levels used, with pixel counts and weights.
    fn levels(&self) -> Vec<Used> {
        let levels = self.taps.chunk_by(|a, b| a.level == b.level);
        levels
            .map(|taps| Used {
                level: taps[0].level,
                pixels: taps.len() as u64,
                weight: taps.iter().map(|v| v.weight).sum(),
            })
            .collect()
    }

    /// Weight of the area outside the map; 0 if it is within rounding.
    fn outside(&self) -> f64 {
        let outside = 1.0 - self.taps.iter().map(|v| v.weight).sum::<f64>();
        if outside.abs() < 1e-6 { 0.0 } else { outside }
    }

    /// Prints the answer.
    pub fn print(&self, path: &Path, out: &mut Output) {
        let Query { x, y, depth, .. } = self.query;
        let how = &self.how;
        out.line(format_args!(
            "{}: map {} {}, lookup at {},{}, depth {}",
            path.display(),
            self.map,
            quoted(&self.name, 40),
            exact(x),
            exact(y),
            exact(depth)
        ));
        let mut field = |name: &str, value: String| out.line(format_args!("  {name:<16}{value}"));
        let width = match how.width {
            1.0 => "1 pixel".into(),
            w => format!("{} pixels", exact(w)),
        };
        field(
            "footprint",
            format!(
                "{width} wide, filter {}, levels {}, border {}, bias {}",
                how.filter,
                how.levels,
                how.border,
                exact(how.bias)
            ),
        );
        field("visibility", named(&self.visibility, |&v| exact(v)));
        field("opacity", named(&self.opacity, |&v| exact(v)));
        field(
            "depths",
            match self.depths {
                Some([near, far]) => format!("{} to {}", exact(near), exact(far)),
                None => "none, lit at every depth".into(),
            },
        );
        field(
            "below one half",
            named(&self.half, |z| match z {
                Some(z) => format!("behind {}", exact(*z)),
                None => "nowhere".into(),
            }),
        );
        for used in self.levels() {
            field(
                &format!("level {}", used.level),
                format!(
                    "{}, weight {}",
                    counted(used.pixels, "pixel"),
                    short(used.weight)
                ),
            );
        }
        let outside = self.outside();
        if outside != 0.0 {
            field("outside", format!("lit, weight {}", short(outside)));
        }
        if self.taps.is_empty() {
            return;
        }
        let mut table = Table::new(&["level", "x", "y", "weight"]);
        for v in self.taps.iter().take(SHOWN[0]) {
            table.row(vec![
                v.level.to_string(),
                v.x.to_string(),
                v.y.to_string(),
                short(v.weight),
            ]);
        }
        table.lines().for_each(|line| out.line(line));
        if self.taps.len() > SHOWN[0] {
            let all = grouped(self.taps.len() as u64);
            out.line(format_args!("  the first {} of {all} pixels", SHOWN[0]));
        }
    }

    /// Returns the answer as a JSON object, with the first 1024 pixels.
    pub fn json(&self) -> Value {
        let Query { x, y, depth, .. } = self.query;
        let how = &self.how;
        let levels = self.levels().into_iter().map(
            |used| json!({ "level": used.level, "pixels": used.pixels, "weight": used.weight }),
        );
        let taps = self
            .taps
            .iter()
            .take(SHOWN[1])
            .map(|v| json!({ "level": v.level, "pixel": [v.x, v.y], "weight": v.weight }));
        json!({
            "map": self.map.0,
            "name": self.name,
            "at": [x, y],
            "depth": if depth.is_finite() { json!(depth) } else { depth.to_string().into() },
            "width": how.width,
            "filter": how.filter.to_string(),
            "levels": how.levels.to_string(),
            "border": how.border.to_string(),
            "bias": how.bias,
            "visibility": self.visibility,
            "opacity": self.opacity,
            "depths": self.depths,
            "below_half": self.half,
            "used": levels.collect::<Vec<_>>(),
            "outside": self.outside(),
            "pixel_count": self.taps.len(),
            "pixels": taps.collect::<Vec<_>>(),
        })
    }
}

impl LookupArgs {
    fn options(&self) -> SamplerOptions {
        SamplerOptions::new(self.filter)
            .levels(self.levels)
            .border(self.border)
    }

    /// Rejects footprints over more than [`MOST`] pixels.
    fn check_pixels(&self, levels: &[LevelShape]) -> Result<()> {
        let last = match self.levels {
            LevelChoice::Base => 0,
            _ => levels.len() - 1,
        };
        let level = (self.width.max(1.0).log2() as usize).min(last);
        let shape = &levels[level];
        let across = 2.0 * self.filter.radius() * self.width / 2f32.powi(level as i32);
        let side = |n: u32| u64::from(n).min((across as u64).saturating_add(2));
        let pixels = side(shape.width) * side(shape.height);
        if pixels <= MOST {
            return Ok(());
        }
        Err(Failure::Failed(format!(
            "the footprint covers {} pixels of level {level}, more than {}: use a smaller --width, \
             or --levels blend if the map has more levels",
            grouped(pixels),
            grouped(MOST)
        )))
    }
}

/// Sorts the taps and merges those of one pixel: a clamped border repeats pixels. Drops taps with
/// weight 0.
fn tidy(mut taps: Vec<Tap>) -> Vec<Tap> {
    taps.sort_by_key(|v| (v.level, v.y, v.x));
    taps.dedup_by(|next, kept| {
        let same = (next.level, next.x, next.y) == (kept.level, kept.x, kept.y);
        if same {
            kept.weight += next.weight;
        }
        same
    });
    taps.retain(|v| v.weight != 0.0);
    taps
}

/// Returns the depth behind which visibility is below one half.
///
/// [`Sampler::depth_below`] answers for the first channel. For other channels, this function
/// bisects between the first and the last depth.
fn below_half(
    sampler: &mut Sampler,
    query: &Query,
    channel: usize,
    depths: Option<[f32; 2]>,
) -> Result<Option<f32>> {
    let mut is_below = |depth: f32| -> Result<bool> {
        let at = query.depth(depth).bias(0.0);
        Ok(sampler.visibility_rgb(&at)?[channel] < 0.5)
    };
    let (true, Some([mut lit, mut dark])) = (is_below(f32::INFINITY)?, depths) else {
        return Ok(None);
    };
    if channel == 0 {
        return Ok(sampler.depth_below(query, 0.5)?);
    }
    if !is_below(dark)? {
        return Ok(Some(dark));
    }
    loop {
        let middle = f32::midpoint(lit, dark);
        if middle == lit || middle == dark {
            return Ok(Some(lit));
        }
        match is_below(middle)? {
            true => dark = middle,
            false => lit = middle,
        }
    }
}

/// Formats one value, or three values with the names of their channels.
fn named<T>(values: &[T], text: impl Fn(&T) -> String) -> String {
    if let [one] = values {
        return text(one);
    }
    let names = ["red", "green", "blue"].iter().zip(values);
    let named: Vec<_> = names.map(|(n, v)| format!("{n} {}", text(v))).collect();
    named.join(", ")
}

/// Parses the point of a lookup: x, y, depth.
///
/// # Errors
/// The text is not three numbers, x or y is not finite, or the depth is NaN.
pub fn place(text: &str) -> std::result::Result<[f32; 3], String> {
    match numbers::<3, f32>(text, ',') {
        Some([x, y, z]) if x.is_finite() && y.is_finite() && !z.is_nan() => Ok([x, y, z]),
        _ => Err("not three numbers X,Y,Z, such as 12.5,7.5,3; Z may be inf".into()),
    }
}

fn bias(text: &str) -> std::result::Result<f32, String> {
    let fits = |b: &f32| b.is_finite();
    number(text, fits, "a finite number, in units of depth")
}
