//! Line plots with logarithmic axes, as SVG.

use std::path::Path;

use plotters::prelude::*;

/// One line: its name and its points.
pub type Series<'a> = (&'a str, Vec<(f64, f64)>);

/// Blue, orange, green, purple: told apart by everybody.
const COLOURS: [RGBColor; 4] = [
    RGBColor(31, 119, 180),
    RGBColor(230, 126, 20),
    RGBColor(34, 139, 84),
    RGBColor(136, 66, 157),
];

/// Draws `series` into the file at `path`.
pub fn lines(path: &Path, title: &str, x: &str, y: &str, series: &[Series<'_>]) {
    draw(path, title, x, y, series).expect("a plot");
}

fn draw(
    path: &Path,
    title: &str,
    x: &str,
    y: &str,
    series: &[Series<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    let points = || series.iter().flat_map(|s| &s.1);
    let range = |of: fn(&(f64, f64)) -> f64, room: f64| {
        let least = points().map(of).fold(f64::INFINITY, f64::min);
        let most = points().map(of).fold(0.0, f64::max);
        least / room..most * room
    };
    let root = SVGBackend::new(path, (760, 480)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(76)
        .build_cartesian_2d(
            range(|p| p.0, 1.0).log_scale(),
            range(|p| p.1, 1.5).log_scale(),
        )?;
    let number = |v: &f64| format!("{v}");
    chart
        .configure_mesh()
        .x_labels(6)
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&number)
        .y_label_formatter(&number)
        .light_line_style(TRANSPARENT)
        .draw()?;
    for (i, (name, points)) in series.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        chart
            .draw_series(
                LineSeries::new(points.iter().copied(), colour.stroke_width(2)).point_size(3),
            )?
            .label(*name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    root.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_plot_names_its_lines() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plot.svg");
        let series = [("deep", vec![(1.0, 20.0), (10.0, 30.0)])];
        super::lines(&path, "title", "samples", "ns", &series);
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.contains("deep") && text.contains("samples"));
    }
}
