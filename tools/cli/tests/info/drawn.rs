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

#[test]
fn a_png_shows_the_same_plot() {
    let f = rich();
    let [png, svg] = ["p.PNG", "p.svg"].map(|name| f.beside(name));
    for path in [&png, &svg] {
        assert_eq!(
            output(&f.path, &["--plot", "3,4", "-o", path.to_str().unwrap()]),
            ""
        );
    }
    let file = std::io::BufReader::new(std::fs::File::open(&png).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.width, info.height), (1520, 880));
    let pixel = |x: usize, y: usize| &bytes[3 * (y * 1520 + x)..][..3];
    // Every corner of the curve in the SVG has the colour of the curve in the PNG, two pixels a
    // unit, unless the white middle of a vertex is there.
    let text = std::fs::read_to_string(&svg).unwrap();
    let line = points(&text, "polyline");
    let between = |i: usize| {
        let (a, b) = (line[i], line[i + 1]);
        ((a.0 + b.0) as usize, (a.1 + b.1) as usize)
    };
    for i in 0..line.len() - 1 {
        let ((x, y), [a, b]) = (between(i), [line[i], line[i + 1]]);
        if (a.0 - b.0).hypot(a.1 - b.1) > 20.0 {
            assert_eq!(pixel(x, y), [0x1f, 0x4e, 0x79], "piece {i} at {x},{y}");
        }
    }
    assert_eq!(pixel(1519, 0), [255; 3]);
    // The heading is black on white.
    let dark = |x0: usize, x1: usize, y0: usize, y1: usize| {
        let all = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
        all.filter(|&(x, y)| pixel(x, y)[0] < 100).count()
    };
    assert!(dark(144, 600, 40, 66) > 200 && dark(0, 140, 0, 140) == 0);
}

#[test]
fn a_plot_of_another_kind_is_refused() {
    let f = rich();
    let wrong = f.beside("p.pdf");
    let (code, _, stderr) = run(info().args(["--plot", "0,0", "-o"]).args([&wrong, &f.path]));
    assert_eq!(code, 2);
    assert!(stderr.contains("a plot is a .svg or .png file"), "{stderr}");
    assert!(!wrong.exists());
}
