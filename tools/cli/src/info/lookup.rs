//! One filtered lookup, as a renderer makes it, with all that went into it.

use std::path::Path;
use std::sync::Arc;

use deepshadow::raw::LevelShape;
use deepshadow::{
    Border, DsmFile, Filter, Footprint, LevelChoice, MapId, Query, Sampler, SamplerOptions, Tap,
    TileCache,
};
use serde_json::{Value, json};

use super::text::{Table, counted, exact, grouped, quoted, short};
use super::{point, select};
use deepshadow_frame::args::width;
use deepshadow_frame::output::Output;
use deepshadow_frame::{Failure, Result, choice};

/// How a lookup is made.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "How --lookup is made")]
pub struct LookupArgs {
    /// Width of the footprint, in pixels of level 0
    #[arg(long, value_name = "W", default_value = "1", value_parser = width, allow_hyphen_values = true, requires = "lookup")]
    pub width: f32,

    /// The filter over the footprint
    #[arg(
        long,
        value_parser = choice(Filter::ALL),
        default_value = "triangle",
        hide_possible_values = true,
        value_name = "nearest|box|triangle|gaussian|catmull-rom",
        requires = "lookup"
    )]
    pub filter: Filter,

    /// The levels that are used: the two around the footprint's width, blended; the one whose pixels are at most as wide; or
    /// level 0 with a wide filter
    #[arg(
        long,
        value_parser = choice(LevelChoice::ALL),
        default_value = "blend",
        hide_possible_values = true,
        value_name = "blend|one|base",
        requires = "lookup"
    )]
    pub levels: LevelChoice,

    /// What is outside the map: light, or the pixels at its border
    #[arg(
        long,
        value_parser = choice(Border::ALL),
        default_value = "lit",
        hide_possible_values = true,
        value_name = "lit|clamp",
        requires = "lookup"
    )]
    pub border: Border,

    /// Taken off the depth
    #[arg(long, value_name = "B", default_value = "0", value_parser = bias, allow_hyphen_values = true, requires = "lookup")]
    pub bias: f32,
}

/// The most pixels that a lookup may look at.
const MOST: u64 = 1 << 24;

/// Bytes of tiles that are kept.
const BUDGET: usize = 256 << 20;

/// How many pixels are listed for people, and in JSON.
const SHOWN: [usize; 2] = [16, 1024];

/// A lookup and its answer.
#[derive(Clone, Debug)]
pub struct Lookup {
    /// Index of the map.
    pub map: usize,
    /// Its name.
    pub name: String,
    /// How it was made.
    pub how: LookupArgs,
    /// The question.
    pub query: Query,
    /// Visibility: one number, or red, green and blue for a map that may be coloured.
    pub visibility: Vec<f32>,
    /// Opacity of all that is there.
    pub opacity: Vec<f32>,
    /// First and last depth of the pixels under the footprint; `None` if they are all lit.
    pub depths: Option<[f32; 2]>,
    /// Where visibility falls below one half; `None` if it does not.
    pub half: Vec<Option<f32>>,
    /// The pixels that were used, and their weights: level by level, row by row, each once.
    pub taps: Vec<Tap>,
}

/// A level that a lookup used.
struct Used {
    level: usize,
    pixels: u64,
    weight: f64,
}

impl Lookup {
    /// Makes the lookup at `at`; in the first map if none is named.
    ///
    /// # Errors
    /// `Failed` if there is no such map, for a damaged tile, and for a footprint over more than 2^24 pixels.
    pub fn of(
        file: &Arc<DsmFile>,
        map: Option<&str>,
        how: LookupArgs,
        [x, y, depth]: [f32; 3],
    ) -> Result<Self> {
        let map = map.map_or(Ok(0), |which| select::map(file, which))?;
        let info = &file.maps()[map];
        let (name, channels) = (info.header.name.clone(), info.header.channels);
        let shapes: Vec<LevelShape> = info.levels.iter().map(|l| l.shape).collect();
        how.check_pixels(&shapes)?;
        let light = TileCache::new(BUDGET).add(file.clone());
        let mut sampler = Sampler::with_options(&light, MapId(map as u32), how.options())?;
        let query = Query {
            x,
            y,
            depth,
            bias: how.bias,
            footprint: Footprint::Width(how.width),
        };
        let behind = Query {
            depth: f32::INFINITY,
            bias: 0.0,
            ..query
        };
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

    /// The levels that were used.
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

    /// The weight of what is outside the map; what rounding leaves is nothing.
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
        field("visibility", numbers(&self.visibility, |&v| exact(v)));
        field("opacity", numbers(&self.opacity, |&v| exact(v)));
        field(
            "depths",
            match self.depths {
                Some([near, far]) => format!("{} to {}", exact(near), exact(far)),
                None => "none, lit at every depth".into(),
            },
        );
        field(
            "below one half",
            numbers(&self.half, |z| match z {
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

    /// The answer as a JSON object; of the pixels the first 1024.
    pub fn json(&self) -> Value {
        let Query { x, y, depth, .. } = self.query;
        let how = &self.how;
        let levels = self.levels().into_iter().map(
            |used| json!({ "level": used.level, "pixels": used.pixels, "weight": used.weight }),
        );
        let taps =
            self.taps.iter().take(SHOWN[1]).map(
                |v| json!({ "level": v.level, "pixel": point((v.x, v.y)), "weight": v.weight }),
            );
        json!({
            "map": self.map,
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

    /// Refuses what would look at more pixels than can be listed.
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
            "the footprint covers {} pixels of level {level}, more than {}: a smaller --width, or --levels blend if the map has more levels, would do",
            grouped(pixels),
            grouped(MOST)
        )))
    }
}

/// Each pixel once and in order: with a clamped border one stands for many. Those that add nothing are left out.
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

/// The depth behind which visibility is below one half.
///
/// [`Sampler::depth_below`] answers for the first channel. For others the search is made here, between the first and the last depth.
fn below_half(
    sampler: &mut Sampler,
    query: &Query,
    channel: usize,
    depths: Option<[f32; 2]>,
) -> Result<Option<f32>> {
    let mut is_below = |depth: f32| -> Result<bool> {
        let at = Query {
            depth,
            bias: 0.0,
            ..*query
        };
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

/// One value, or those of three channels with their names.
fn numbers<T>(values: &[T], text: impl Fn(&T) -> String) -> String {
    if let [one] = values {
        return text(one);
    }
    let names = ["red", "green", "blue"].iter().zip(values);
    let named: Vec<_> = names.map(|(n, v)| format!("{n} {}", text(v))).collect();
    named.join(", ")
}

/// The point of a lookup from the command line: x, y, depth.
///
/// # Errors
/// What is wrong with it.
pub fn place(text: &str) -> std::result::Result<[f32; 3], String> {
    let numbers: std::result::Result<Vec<f32>, _> =
        text.split(',').map(|n| n.trim().parse()).collect();
    match numbers.ok().and_then(|n| <[f32; 3]>::try_from(n).ok()) {
        Some([x, y, z]) if x.is_finite() && y.is_finite() && !z.is_nan() => Ok([x, y, z]),
        _ => Err("a lookup is three numbers x,y,z, as in 12.5,7.5,3; z may be inf".into()),
    }
}

fn bias(text: &str) -> std::result::Result<f32, String> {
    let bias = text.trim().parse().ok();
    bias.filter(|b: &f32| b.is_finite())
        .ok_or_else(|| "a bias is a number, in units of depth".into())
}
