//! Lines, areas, circles and text, written as SVG or as PNG.

use std::fmt::Write;

use deepshadow_frame::output::is_control;
use deepshadow_frame::{Failure, Result};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

/// Width of a curve.
const STROKE: f64 = 1.8;
/// Opacity of an area.
const OPACITY: f64 = 0.16;
/// Radius and line width of a circle.
const CIRCLE: [f64; 2] = [2.6, 1.3];
/// Colour of text.
const TEXT: u32 = 0x333333;
/// Pixels of a PNG in a unit of the drawing.
const SCALE: f64 = 2.0;
/// Rows of samples in a pixel of a PNG.
const ROWS: usize = 4;

/// Position and size of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Bold and larger, from the point to the right.
    Title,
    /// From the point to the right.
    Left,
    /// Around the point.
    Middle,
    /// To the left of the point.
    Right,
    /// Around the point, turned to read upwards.
    Upward,
}

/// One thing drawn.
#[derive(Clone, Debug)]
enum Mark {
    Line([[f64; 2]; 2], u32),
    Area(Vec<[f64; 2]>, u32),
    Curve(Vec<[f64; 2]>, u32, String),
    Circle([f64; 2], u32),
    Text([f64; 2], Style, String),
}

/// A drawing on white. Colours are 0xrrggbb; y points down.
#[derive(Clone, Debug)]
pub struct Canvas {
    size: [f64; 2],
    marks: Vec<Mark>,
}

impl Canvas {
    /// An empty drawing.
    pub fn new(width: f64, height: f64) -> Self {
        Canvas {
            size: [width, height],
            marks: Vec::new(),
        }
    }

    /// Draws a thin line.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: u32) {
        self.marks.push(Mark::Line([from, to], colour));
    }

    /// Fills a polygon, mostly transparent.
    pub fn area(&mut self, corners: Vec<[f64; 2]>, colour: u32) {
        self.marks.push(Mark::Area(corners, colour));
    }

    /// Draws a curve of straight pieces.
    pub fn curve(&mut self, points: Vec<[f64; 2]>, colour: u32, name: &str) {
        self.marks.push(Mark::Curve(points, colour, name.into()));
    }

    /// Draws a small white circle with a border.
    pub fn circle(&mut self, centre: [f64; 2], colour: u32) {
        self.marks.push(Mark::Circle(centre, colour));
    }

    /// Writes text with its base line at a point.
    pub fn text(&mut self, at: [f64; 2], style: Style, text: String) {
        self.marks.push(Mark::Text(at, style, text));
    }

    /// The drawing as SVG.
    pub fn svg(&self) -> String {
        let [width, height] = self.size;
        let mut out = format!(
            concat!(
                r##"<svg xmlns="http://www.w3.org/2000/svg" width="{0}" height="{1}" "##,
                r##"viewBox="0 0 {0} {1}" font-family="Helvetica, Arial, sans-serif" "##,
                r##"font-size="13" fill="#{2:06x}">"##
            ),
            width, height, TEXT
        );
        out.push_str("\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n");
        for mark in &self.marks {
            mark.svg(&mut out);
            out.push('\n');
        }
        out.push_str("</svg>\n");
        out
    }

    /// The drawing as PNG, with two pixels a unit.
    ///
    /// # Errors
    /// `Failed` if the encoder fails.
    pub fn png(&self) -> Result<Vec<u8>> {
        let [width, height] = self.size.map(|side| (side * SCALE) as usize);
        let mut raster = Raster {
            width,
            height,
            pixels: vec![[255.0; 3]; width * height],
        };
        self.marks.iter().for_each(|mark| mark.raster(&mut raster));
        let failed =
            |e: png::EncodingError| Failure::Failed(format!("cannot encode the image: {e}"));
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let data: Vec<u8> = raster
            .pixels
            .iter()
            .flatten()
            .map(|v| v.round() as u8)
            .collect();
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&data).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }
}

impl Mark {
    fn svg(&self, out: &mut String) {
        let points = |points: &[[f64; 2]]| {
            let all = points.iter().map(|[x, y]| format!("{x:.2},{y:.2}"));
            all.collect::<Vec<_>>().join(" ")
        };
        let _ = match self {
            Mark::Line([[x1, y1], [x2, y2]], colour) => write!(
                out,
                r##"<path d="M{x1:.2} {y1:.2}L{x2:.2} {y2:.2}" stroke="#{colour:06x}"/>"##
            ),
            Mark::Area(corners, colour) => write!(
                out,
                r##"<polygon points="{}" fill="#{colour:06x}" fill-opacity="{OPACITY}"/>"##,
                points(corners)
            ),
            Mark::Curve(curve, colour, name) => write!(
                out,
                concat!(
                    r##"<polyline points="{}" fill="none" stroke="#{:06x}" stroke-width="{}" "##,
                    r##"stroke-linejoin="round"><title>{}</title></polyline>"##
                ),
                points(curve),
                colour,
                STROKE,
                name
            ),
            Mark::Circle([x, y], colour) => write!(
                out,
                concat!(
                    r##"<circle cx="{:.2}" cy="{:.2}" r="{}" fill="#fff" stroke="#{:06x}" "##,
                    r##"stroke-width="{}"/>"##
                ),
                x, y, CIRCLE[0], colour, CIRCLE[1]
            ),
            Mark::Text([x, y], style, text) => {
                let text = escaped(text);
                let place = match style {
                    Style::Upward => {
                        format!(r##"transform="translate({x:.2} {y:.2}) rotate(-90)""##)
                    }
                    _ => format!(r##"x="{x:.2}" y="{y:.2}""##),
                };
                let look = match style {
                    Style::Title => r##" font-size="16" font-weight="bold""##,
                    Style::Left => "",
                    Style::Middle | Style::Upward => r##" text-anchor="middle""##,
                    Style::Right => r##" text-anchor="end""##,
                };
                write!(out, "<text {place}{look}>{text}</text>")
            }
        };
    }

    fn raster(&self, raster: &mut Raster) {
        match self {
            Mark::Line(ends, colour) => raster.stroke(ends, 1.0, *colour),
            Mark::Area(corners, colour) => raster.fill(corners, *colour, OPACITY),
            Mark::Curve(points, colour, _) => raster.stroke(points, STROKE, *colour),
            Mark::Circle(centre, colour) => {
                raster.fill(&disc(*centre, CIRCLE[0] + CIRCLE[1] / 2.0), *colour, 1.0);
                raster.fill(&disc(*centre, CIRCLE[0] - CIRCLE[1] / 2.0), 0xffffff, 1.0);
            }
            Mark::Text(at, style, text) => raster.text(*at, *style, text),
        }
    }
}

/// A polygon around a circle.
fn disc([x, y]: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    let corner = |i: u32| {
        let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 24.0).sin_cos();
        [x + radius * cos, y + radius * sin]
    };
    (0..24).map(corner).collect()
}

/// The pixels of a PNG, row by row.
struct Raster {
    width: usize,
    height: usize,
    pixels: Vec<[f64; 3]>,
}

impl Raster {
    /// Mixes a colour into a pixel.
    fn mix(&mut self, x: usize, y: usize, colour: u32, opacity: f64) {
        let pixel = &mut self.pixels[y * self.width + x];
        for (old, shift) in pixel.iter_mut().zip([16, 8, 0]) {
            let new = f64::from(colour >> shift & 0xff);
            *old += (new - *old) * opacity.clamp(0.0, 1.0);
        }
    }

    /// Draws the pieces of a curve as rectangles that overlap at the corners.
    fn stroke(&mut self, points: &[[f64; 2]], width: f64, colour: u32) {
        let half = width / 2.0;
        for ends in points.windows(2) {
            let [[x1, y1], [x2, y2]] = [ends[0], ends[1]];
            let length = (x2 - x1).hypot(y2 - y1);
            if length == 0.0 {
                continue;
            }
            let (dx, dy) = (half * (x2 - x1) / length, half * (y2 - y1) / length);
            let corners = [
                [x1 - dx - dy, y1 - dy + dx],
                [x2 + dx - dy, y2 + dy + dx],
                [x2 + dx + dy, y2 + dy - dx],
                [x1 - dx + dy, y1 - dy - dx],
            ];
            self.fill(&corners, colour, 1.0);
        }
    }

    /// Fills a polygon, with the fraction of each pixel that it covers. Where it overlaps itself,
    /// it is filled once.
    fn fill(&mut self, corners: &[[f64; 2]], colour: u32, opacity: f64) {
        let corners: Vec<_> = corners.iter().map(|p| p.map(|v| v * SCALE)).collect();
        let edges: Vec<_> = (0..corners.len())
            .map(|i| [corners[i], corners[(i + 1) % corners.len()]])
            .collect();
        let ends = corners.iter().map(|p| p[1]);
        let (top, bottom) = ends.fold((f64::MAX, f64::MIN), |(a, b), y| (a.min(y), b.max(y)));
        let rows = top.max(0.0) as usize..(bottom.ceil().max(0.0) as usize).min(self.height);
        let mut covered = vec![0.0; self.width];
        for row in rows {
            covered.fill(0.0);
            for sample in 0..ROWS {
                let y = row as f64 + (sample as f64 + 0.5) / ROWS as f64;
                self.cover(&edges, y, &mut covered);
            }
            for (x, &part) in covered.iter().enumerate() {
                if part > 0.0 {
                    self.mix(x, row, colour, opacity * part);
                }
            }
        }
    }

    /// Adds the part of each pixel that lies inside the polygon at height `y`.
    fn cover(&self, edges: &[[[f64; 2]; 2]], y: f64, covered: &mut [f64]) {
        let mut crossings: Vec<(f64, i32)> = Vec::new();
        for &[[x1, y1], [x2, y2]] in edges {
            if (y1 <= y) != (y2 <= y) {
                let x = x1 + (x2 - x1) * (y - y1) / (y2 - y1);
                crossings.push((x, if y1 < y2 { 1 } else { -1 }));
            }
        }
        crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut winding = 0;
        for pair in crossings.windows(2) {
            winding += pair[0].1;
            let [left, right] = [pair[0].0, pair[1].0].map(|x| x.clamp(0.0, self.width as f64));
            if winding == 0 || left >= right {
                continue;
            }
            let columns = left as usize..(right.ceil() as usize).min(self.width);
            for x in columns {
                let part = right.min(x as f64 + 1.0) - left.max(x as f64);
                covered[x] += part / ROWS as f64;
            }
        }
    }

    /// Writes text in a font of fixed width. Characters that it lacks become question marks.
    fn text(&mut self, [x, y]: [f64; 2], style: Style, text: &str) {
        let (weight, height) = match style {
            Style::Title => (FontWeight::Bold, RasterHeight::Size32),
            _ => (FontWeight::Regular, RasterHeight::Size24),
        };
        let across = get_raster_width(weight, height);
        let length = (across * text.chars().count()) as f64;
        let before = match style {
            Style::Title | Style::Left => 0.0,
            Style::Middle | Style::Upward => length / 2.0,
            Style::Right => length,
        };
        // The base line of a glyph is at about three quarters of its box.
        let above = 0.77 * height.val() as f64;
        for (i, c) in text.chars().enumerate() {
            let glyph = get_raster(c, weight, height).or_else(|| get_raster('?', weight, height));
            let rows = glyph.iter().flat_map(|g| g.rows().enumerate());
            for (j, row) in rows {
                for (k, &part) in row.iter().enumerate() {
                    let right = (i * across + k) as f64 - before;
                    let down = j as f64 - above;
                    let [px, py] = match style {
                        Style::Upward => [x * SCALE + down, y * SCALE - right],
                        _ => [x * SCALE + right, y * SCALE + down],
                    };
                    let inside = |v: f64, side: usize| v >= 0.0 && v < side as f64;
                    if part > 0 && inside(px, self.width) && inside(py, self.height) {
                        let opacity = f64::from(part) / 255.0;
                        self.mix(px as usize, py as usize, TEXT, opacity);
                    }
                }
            }
        }
    }
}

fn escaped(text: &str) -> String {
    text.chars().fold(String::new(), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c if is_control(c) || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
        out
    })
}
