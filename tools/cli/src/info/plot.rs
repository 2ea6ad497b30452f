//! The plot of one visibility function, on a white background.

use deepshadow::DepthKind;

use super::canvas::{Canvas, Style};
use super::pixel::PixelFunction;
use super::text::{grouped, short};

const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 440.0;
/// The frame of the plot: left, top, right, bottom.
const FRAME: [f64; 4] = [72.0, 74.0, WIDTH - 28.0, HEIGHT - 62.0];
/// Most vertices that are marked with circles.
const MARKED: usize = 120;

/// Functions with fewer vertices are drawn vertex by vertex.
const EXACT: usize = 4096;
/// Columns of the picture of a function with more vertices, four for each pixel.
const COLUMNS: f64 = 4.0 * WIDTH;

/// Colours (0xrrggbb) and names of the lines: one for a monochrome function, else three.
const MONO: [(u32, &str); 1] = [(0x1f4e79, "visibility")];
const RGB: [(u32, &str); 3] = [(0xc62828, "red"), (0x2e7d32, "green"), (0x1565c0, "blue")];
const PALE: u32 = 0xeeeeee;
const AXIS: u32 = 0x888888;
const BAND: u32 = 0x555555;

/// Draws the function of `pixel`: depth to the right, visibility from 0 to 1 upward, steps as
/// vertical lines, and a band of the level's error around each line.
pub fn draw(pixel: &PixelFunction) -> Canvas {
    let f = &pixel.function;
    let domain = domain(f.depths());
    let [left, top, right, bottom] = FRAME;
    let x = |z: f64| left + (z - domain[0]) / (domain[1] - domain[0]) * (right - left);
    let y = |v: f64| bottom - v * (bottom - top);
    let mut out = Canvas::new(WIDTH, HEIGHT);
    heading(pixel, &mut out);
    grid(domain, x, y, &mut out);
    axis_names(pixel, &mut out);
    let lines: &[(u32, &str)] = if f.channels() == 1 { &MONO } else { &RGB };
    for (c, &(colour, name)) in lines.iter().enumerate() {
        let points = outline(pixel, c, domain);
        let moved = |shift: f64| {
            let at = move |&(z, v): &(f64, f64)| [x(z), y((v + shift).clamp(0.0, 1.0))];
            points.iter().map(at).collect::<Vec<_>>()
        };
        let mut band = moved(pixel.max_error);
        band.extend(moved(-pixel.max_error).into_iter().rev());
        out.area(band, colour);
        out.curve(moved(0.0), colour, name);
        if f.len() <= MARKED {
            for (i, &z) in f.depths().iter().enumerate() {
                let v = f64::from(pixel.values(i)[c]);
                out.circle([x(f64::from(z)), y(v)], colour);
            }
        }
    }
    legend(lines, &mut out);
    out
}

/// Returns the range of depths to show: that of the vertices, with a margin.
fn domain(depths: &[f32]) -> [f64; 2] {
    let (Some(&first), Some(&last)) = (depths.first(), depths.last()) else {
        return [0.0, 1.0];
    };
    let (first, last) = (f64::from(first), f64::from(last));
    let room = match last - first {
        0.0 => (first.abs() * 0.1).max(f64::from(f32::MIN_POSITIVE)),
        span => span * 0.08,
    };
    let room = if first == 0.0 && last == 0.0 {
        1.0
    } else {
        room
    };
    [first - room, last + room]
}

/// Returns the corners of channel `c`. A step has two corners at one depth. Of a function with very
/// many vertices, only the first and the last corner of each column of the picture: between them
/// the function falls straight down.
fn outline(pixel: &PixelFunction, c: usize, domain: [f64; 2]) -> Vec<(f64, f64)> {
    let mut points = vec![(domain[0], 1.0)];
    let columns = match pixel.function.len() {
        0..EXACT => f64::INFINITY,
        _ => COLUMNS / (domain[1] - domain[0]),
    };
    let is_same = |a: f64, b: f64| (a * columns).floor() == (b * columns).floor();
    let values = pixel.function.values(c);
    for (i, (&z, &v)) in pixel.function.depths().iter().zip(values).enumerate() {
        let z = f64::from(z);
        if i == 0 {
            points.push((z, 1.0));
        }
        if let [.., (a, _), (b, last)] = &mut points[..]
            && columns.is_finite()
            && is_same(*a, *b)
            && is_same(*b, z)
        {
            (*b, *last) = (z, f64::from(v));
        } else {
            points.push((z, f64::from(v)));
        }
    }
    let end = points.last().map_or(1.0, |p| p.1);
    points.push((domain[1], end));
    points
}

fn heading(pixel: &PixelFunction, out: &mut Canvas) {
    let name: String = pixel.name.chars().take(60).collect();
    let title = format!("{name}, pixel {}", pixel.at);
    out.text([FRAME[0], 30.0], Style::Title, title);
    let vertices = match pixel.function.len() {
        0 => "no vertices: lit at every depth".into(),
        1 => "1 vertex".into(),
        n => format!("{} vertices", grouped(n as u64)),
    };
    let (level, error) = (pixel.level.level, short(pixel.max_error));
    let line = format!("level {level}, {vertices}, promise ±{error}");
    out.text([FRAME[0], 50.0], Style::Left, line);
}

fn grid(domain: [f64; 2], x: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64, out: &mut Canvas) {
    let [left, top, right, bottom] = FRAME;
    let depths = ticks(domain);
    for (z, _) in &depths {
        out.line([x(*z), top], [x(*z), bottom], PALE);
        out.line([x(*z), bottom], [x(*z), bottom + 5.0], AXIS);
    }
    for i in 0..=5 {
        let py = y(f64::from(i) / 5.0);
        out.line([left, py], [right, py], PALE);
        out.line([left - 5.0, py], [left, py], AXIS);
    }
    out.line([left, bottom], [right, bottom], AXIS);
    out.line([left, top], [left, bottom], AXIS);
    for (z, label) in depths {
        out.text([x(z), bottom + 20.0], Style::Middle, label);
    }
    for i in 0..=5 {
        let v = f64::from(i) / 5.0;
        out.text([left - 10.0, y(v) + 4.5], Style::Right, format!("{v:.1}"));
    }
}

fn axis_names(pixel: &PixelFunction, out: &mut Canvas) {
    let [left, top, right, bottom] = FRAME;
    let kind = match pixel.depth_kind {
        DepthKind::Unspecified => "depth",
        DepthKind::Planar => "depth (camera z)",
        DepthKind::RayDistance => "distance along the ray",
    };
    let unit = match pixel.depth_unit {
        0.0 => String::new(),
        1.0 => " in metres".into(),
        unit => format!(" in units of {} m", short(unit)),
    };
    let (cx, cy) = ((left + right) / 2.0, (top + bottom) / 2.0);
    out.text([cx, bottom + 44.0], Style::Middle, format!("{kind}{unit}"));
    out.text([24.0, cy], Style::Upward, "visibility".into());
}

/// Draws the legend above the frame, at the right.
fn legend(lines: &[(u32, &str)], out: &mut Canvas) {
    let mut at = FRAME[2];
    let y = 46.0;
    let mut items: Vec<(u32, &str, bool)> = lines.iter().map(|&(c, n)| (c, n, true)).collect();
    items.push((BAND, "promise", false));
    for (colour, name, is_line) in items.into_iter().rev() {
        at -= 7.0 * name.len() as f64;
        out.text([at, y + 4.5], Style::Left, name.into());
        at -= 28.0;
        if is_line {
            out.line([at, y], [at + 22.0, y], colour);
        } else {
            let [right, top, bottom] = [at + 22.0, y - 6.0, y + 6.0];
            out.area(
                vec![[at, top], [right, top], [right, bottom], [at, bottom]],
                colour,
            );
        }
        at -= 16.0;
    }
}

/// Returns round depths in the domain with their labels: about eight, fewer if labels are long.
fn ticks(domain: [f64; 2]) -> Vec<(f64, String)> {
    let span = domain[1] - domain[0];
    let mut found = Vec::new();
    for most in [8.0, 5.0, 3.0, 2.0] {
        let rough = span / most;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .map(|n| n * power)
            .find(|&s| s >= rough * (1.0 - 1e-9))
            .unwrap_or(rough);
        let (first, last) = ((domain[0] / step).ceil(), (domain[1] / step).floor());
        found = (0..=(last - first).clamp(0.0, 20.0) as u32)
            .map(|i| (first + f64::from(i)) * step)
            .map(|z| (z, label(z, step, domain)))
            .collect();
        let longest = found.iter().map(|(_, l): &(f64, String)| l.len()).max();
        let room = (FRAME[2] - FRAME[0]) * step / span;
        if longest.unwrap_or(0) as f64 * 7.5 + 8.0 <= room {
            break;
        }
    }
    found
}

fn label(z: f64, step: f64, domain: [f64; 2]) -> String {
    let largest = domain[0].abs().max(domain[1].abs());
    if z == 0.0 {
        return "0".into();
    }
    let decimals = (-step.log10().floor()).max(0.0);
    if !(1e-4..1e7).contains(&largest) {
        let digits = (largest.log10().floor() - step.log10().floor()).clamp(0.0, 12.0);
        return format!("{z:.*e}", digits as usize);
    }
    format!("{z:.*}", decimals.min(12.0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        for domain in [
            [0.0, 1.0],
            [4.6, 10.4],
            [-3e38, 3e38],
            [999.999, 1000.001],
            [1e-30, 2e-30],
        ] {
            let ticks = ticks(domain);
            assert!((1..=12).contains(&ticks.len()), "{domain:?}: {ticks:?}");
            assert!(
                ticks.iter().all(|t| domain[0] <= t.0 && t.0 <= domain[1]),
                "{ticks:?}"
            );
            let labels: std::collections::BTreeSet<_> = ticks.iter().map(|t| &t.1).collect();
            assert_eq!(labels.len(), ticks.len(), "{ticks:?}");
        }
        let labels: Vec<_> = ticks([0.0, 1.0]).into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
    }
}
