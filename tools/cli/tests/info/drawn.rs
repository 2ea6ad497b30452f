//! `--plot`.

use super::files::{info, json, output, rich, run};

/// The points of the attribute `points` of the first `element`.
fn points(svg: &str, element: &str) -> Vec<(f64, f64)> {
    let at = svg.find(&format!("<{element} points=\"")).unwrap();
    let text = svg[at..].split('"').nth(1).unwrap();
    let point = |p: &str| {
        let (x, y) = p.split_once(',').unwrap();
        (x.parse().unwrap(), y.parse().unwrap())
    };
    text.split(' ').map(point).collect()
}

#[test]
fn the_line_falls_and_its_step_is_vertical() {
    let f = rich();
    let svg = output(&f.path, &["--plot", "3,4"]);
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    assert!(
        svg.contains("key, pixel 3,4") && svg.contains("camera z"),
        "{svg}"
    );
    let line = points(&svg, "polyline");
    assert_eq!(line.len(), 7); // the first vertex is there twice, and both ends
    assert!(
        line.windows(2)
            .all(|p| p[0].0 <= p[1].0 && p[0].1 <= p[1].1)
    );
    let steps = line
        .windows(2)
        .filter(|p| p[0].0 == p[1].0 && p[0].1 < p[1].1);
    assert_eq!(steps.count(), 1);
    let band = points(&svg, "polygon");
    assert_eq!(band.len(), 14);
    assert!(
        band.iter()
            .zip(&line)
            .all(|(b, l)| b.0 == l.0 && b.1 <= l.1)
    );
}

#[test]
fn colours_have_a_line_each_and_lit_pixels_one_at_the_top() {
    let f = rich();
    let svg = output(&f.path, &["--plot", "7,0", "--map", "fill"]);
    assert_eq!(svg.matches("<polyline").count(), 3);
    let svg = output(&f.path, &["--plot", "0,0", "--map", "lit"]);
    let line = points(&svg, "polyline");
    assert!(line.iter().all(|p| p.1 == line[0].1));
    assert!(svg.contains("lit at every depth"));
}

#[test]
fn the_picture_goes_where_it_is_told() {
    let f = rich();
    let svg = f.beside("p.svg");
    let to = svg.to_str().unwrap();
    assert_eq!(output(&f.path, &["--plot", "3,4", "-o", to]), "");
    let there = std::fs::read_to_string(&svg).unwrap();
    assert_eq!(there, output(&f.path, &["--plot", "3,4"]));
    let j = json(&f.path, &["--plot", "3,4", "-o", to, "--hash"]);
    assert!(j["hash"].is_string());
    let nowhere = f.beside("none").join("p.svg");
    let (code, _, stderr) = run(info()
        .args(["--plot", "0,0", "-o"])
        .args([&nowhere, &f.path]));
    assert_eq!(code, 1);
    assert!(stderr.contains("none/p.svg"), "{stderr}");
}
