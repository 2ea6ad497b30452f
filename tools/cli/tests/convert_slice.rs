//! `dsm-convert --depth Z --width W`: filtered slices.

use std::path::Path;

use crate::convert_support::*;
use deepshadow::{
    Border, Curve, DsmFile, Encoding, Filter, MapHeader, MapId, Pixel, Query, Sampler,
    SamplerOptions, TileCache, Writer,
};
use deepshadow_exr::Rect;

const LOOKS: [Look; 2] = [
    Look {
        coloured: false,
        thick: true,
        tiled: false,
    },
    Look {
        coloured: true,
        thick: true,
        tiled: false,
    },
];

/// The channels of a flat OpenEXR image: Y, or R, G and B.
fn channels(path: &Path, window: Rect) -> Vec<Vec<f32>> {
    let reader = deepshadow_exr::DeepReader::open(path).unwrap();
    assert!(!reader.parts()[0].deep && reader.parts()[0].data_window == window);
    let block = reader.read_rect(0, window).unwrap();
    let pixels = 0..window.pixels() as usize;
    // They lie in the order of their names.
    let channels = block.channels.iter().rev();
    channels
        .map(|c| pixels.clone().map(|i| c.get(i)).collect())
        .collect()
}

/// A PNG image: its kind, and 16 bits of every channel of every pixel.
fn png(path: &Path) -> (png::ColorType, Vec<u16>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.bit_depth, png::BitDepth::Sixteen);
    let pair = |b: &[u8]| u16::from(b[0]) << 8 | u16::from(b[1]);
    (info.color_type, bytes.chunks_exact(2).map(pair).collect())
}

/// A map of 50 x 30 pixels that let a quarter of the light through, behind depth 2.
fn constant(path: &Path) {
    let mut writer = Writer::create(path).unwrap();
    let mut header = MapHeader::new("glass", 50, 30);
    (header.tile_size, header.channels) = (16, 1);
    let map = writer.add_map(header, Encoding::default()).unwrap();
    let glass = Curve::mono(vec![2.0], vec![0.25]).unwrap();
    for (x, y) in (0..30).flat_map(|y| (0..50).map(move |x| (x, y))) {
        writer.pixel(map, Pixel::new(x, y), &glass).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_slice_one_pixel_wide_without_a_filter_is_the_unfiltered_one() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, plain, slice, plain_png, slice_png] = [
        "in.exr",
        "map.dsm",
        "plain.exr",
        "slice.exr",
        "plain.png",
        "slice.png",
    ]
    .map(|n| folder.path().join(n));
    let nearest = ["--depth", "4.5", "--width", "1", "--filter", "nearest"];
    for (look, kind) in LOOKS
        .into_iter()
        .zip([png::ColorType::Grayscale, png::ColorType::Rgb])
    {
        image(&exr, look);
        convert(&exr, &dsm, &["--tile", "8"]);
        convert(&dsm, &plain, &nearest[..2]);
        convert(&dsm, &slice, &nearest);
        let [a, b] = [&plain, &slice].map(|p| channels(p, WINDOW));
        assert_eq!(a.len(), if look.coloured { 3 } else { 1 });
        assert_eq!(a.len(), b.len());
        let both = a.iter().flatten().zip(b.iter().flatten());
        // A lookup takes k / L as it is, a function the f32 that is nearest to it.
        let off = both.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off <= 2f32.powi(-22), "{off}");
        convert(&dsm, &plain_png, &nearest[..2]);
        convert(&dsm, &slice_png, &nearest);
        let [(a_kind, a), (b_kind, b)] = [&plain_png, &slice_png].map(|p| png(p));
        assert_eq!((a_kind, b_kind), (kind, kind));
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= 1));
    }
}

#[test]
fn a_slice_holds_what_a_sampler_answers_at_every_pixel_centre() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, slice, again] =
        ["in.exr", "map.dsm", "slice.exr", "again.exr"].map(|n| folder.path().join(n));
    for look in LOOKS {
        image(&exr, look);
        convert(&exr, &dsm, &["--tile", "8"]);
        let light = TileCache::new(1 << 20).add(DsmFile::open(&dsm).unwrap());
        for (name, filter, width, depth) in [
            ("nearest", Filter::Nearest, "6", "3"),
            ("box", Filter::Box, "2.5", "7.25"),
            ("triangle", Filter::Triangle, "0", "4"),
            ("gaussian", Filter::Gaussian, "16", "5"),
            ("catmull-rom", Filter::CatmullRom, "3", "inf"),
        ] {
            let options = ["--depth", depth, "--width", width, "--filter", name];
            convert(&dsm, &slice, &options);
            let found = channels(&slice, WINDOW);
            let options = SamplerOptions::new(filter).border(Border::Clamp);
            let mut sampler = Sampler::with_options(&light, MapId(0), options).unwrap();
            let (width, depth) = (width.parse().unwrap(), depth.parse().unwrap());
            for i in 0..WINDOW.pixels() as usize {
                let (x, y) = (i as u32 % WINDOW.width, i as u32 / WINDOW.width);
                let query = Query::new(x as f32 + 0.5, y as f32 + 0.5, depth).width(width);
                let expected = sampler.visibility_rgb(&query).unwrap();
                let found: Vec<f32> = found.iter().map(|c| c[i]).collect();
                assert_eq!(found, expected[..found.len()], "{name} at {x},{y}");
            }
        }
        // As many threads as one likes; triangle if no filter is named.
        let wide = ["--depth", "6", "--width", "7"];
        convert(&dsm, &slice, &wide);
        let more = ["-j", "3", "--filter", "triangle", "--map", "key"];
        convert(&dsm, &again, &[&wide[..], &more].concat());
        assert_eq!(
            std::fs::read(&slice).unwrap(),
            std::fs::read(&again).unwrap()
        );
    }
}

#[test]
fn a_wide_slice_of_a_constant_map_is_constant() {
    let folder = tempfile::tempdir().unwrap();
    let [dsm, slice, picture] =
        ["map.dsm", "slice.exr", "slice.png"].map(|n| folder.path().join(n));
    constant(&dsm);
    let window = Rect {
        x: 0,
        y: 0,
        width: 50,
        height: 30,
    };
    for width in ["1", "5", "40", "1000"] {
        for filter in ["box", "triangle", "gaussian", "catmull-rom"] {
            let options = ["--depth", "3", "--width", width, "--filter", filter];
            convert(&dsm, &slice, &options);
            let found = channels(&slice, window);
            assert_eq!(found.len(), 1);
            let off = found[0].iter().map(|v| (v - 0.25).abs());
            let off = off.fold(0.0, f32::max);
            assert!(off < 1e-6, "{width} {filter}: {off}");
            convert(&dsm, &picture, &options);
            let (kind, values) = png(&picture);
            assert_eq!((kind, values.len()), (png::ColorType::Grayscale, 1500));
            assert!(values.iter().all(|&v| v == 16384), "{width} {filter}");
        }
    }
    // In front of the glass.
    convert(&dsm, &picture, &["--depth", "2", "--width", "9"]);
    assert!(png(&picture).1.iter().all(|&v| v == 65535));
}

#[test]
fn slices_that_make_no_sense_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let [dsm, png, exr, npz, out] =
        ["map.dsm", "out.png", "out.exr", "out.npz", "out.dsm"].map(|n| folder.path().join(n));
    constant(&dsm);
    for (options, says) in [
        (&["--width", "2"][..], "missing arguments: --depth <Z>"),
        (
            &["--width", "2", "--opacity"],
            "--opacity does not apply with --width",
        ),
        (&["--depth", "3", "--filter", "box"], "--width"),
        (&["--count", "--filter", "box"], "--width"),
        (&["--depth", "3", "--width", "-1"], "--width -1"),
        (&["--depth", "3", "--width", "nan"], "--width nan"),
        (&["--depth", "3", "--width", "inf"], "--width inf"),
        (&["--depth", "nan", "--width", "2"], "--depth nan"),
        (
            &["--depth", "3", "--width", "2", "--level", "1"],
            "--level does not apply with --width",
        ),
    ] {
        for output in [&png, &exr] {
            let line = refuse(2, &dsm, output, options);
            assert!(line.contains(says), "{options:?}: {line}");
        }
    }
    for output in [&npz, &out] {
        let line = refuse(2, &dsm, output, &["--depth", "3", "--width", "2"]);
        assert!(line.contains("--depth does not apply"), "{line}");
    }
    // What clap finds itself.
    let [dsm, png] = [&dsm, &png].map(|p| p.to_str().unwrap());
    let wrong = run(&[dsm, png, "--depth", "3", "--width", "2", "--filter", "sinc"]);
    assert_eq!(wrong.0, 2);
    assert!(wrong.2.contains("catmull-rom"), "{}", wrong.2);
}

#[test]
fn a_damaged_tile_is_named_and_no_picture_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, png] = ["in.exr", "map.dsm", "out.png"].map(|n| folder.path().join(n));
    image(&exr, LOOKS[0]);
    convert(&exr, &dsm, &[]);
    let mut bytes = std::fs::read(&dsm).unwrap();
    bytes[200] ^= 1;
    std::fs::write(&dsm, bytes).unwrap();
    let line = refuse(1, &dsm, &png, &["--depth", "3", "--width", "1"]);
    for part in ["map.dsm: ", "TILE-CRC", "map 0, level 0, tile "] {
        assert!(line.contains(part), "{part}: {line}");
    }
    // Levels that are sound still make a picture.
    convert(&dsm, &png, &["--depth", "3", "--width", "4"]);
}
