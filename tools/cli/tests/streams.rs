//! Standard input and output, folders, completions and man pages.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::convert_support::{Look, convert, image, refuse, run, run_program};
use deepshadow::{DsmFile, MapId, Pixel};

/// Runs a program with `input` on standard input; gives exit code, standard output and error.
fn piped(program: &str, arguments: &[&str], input: &Path) -> (i32, Vec<u8>, String) {
    let mut child = Command::new(assert_cmd::cargo::cargo_bin(program))
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut pipe, bytes) = (child.stdin.take().unwrap(), std::fs::read(input).unwrap());
    let feed = std::thread::spawn(move || {
        // A program that refuses its arguments closes the pipe.
        let _ = pipe.write_all(&bytes);
    });
    let output = child.wait_with_output().unwrap();
    feed.join().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    (output.status.code().unwrap(), output.stdout, text)
}

#[test]
fn pipes_give_the_same_bytes_as_files() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm, back] = ["in.exr", "map.dsm", "back.exr"].map(|n| folder.path().join(n));
    image(&exr, Look::default());
    convert(&exr, &dsm, &[]);
    convert(&dsm, &back, &[]);
    for input in ["-", "/dev/stdin"] {
        for output in ["-", "/dev/stdout"] {
            let (code, out, err) = piped("dsm-convert", &[input, output, "--to", "dsm"], &exr);
            assert_eq!((code, err.as_str()), (0, ""));
            assert!(out == std::fs::read(&dsm).unwrap(), "{input} {output}");
        }
        let (code, out, err) = piped("dsm-convert", &[input, "-", "--to", "exr"], &dsm);
        assert_eq!((code, err.as_str()), (0, ""));
        assert!(out == std::fs::read(&back).unwrap());
        let (code, out, err) = piped("dsm-info", &[input, "--hash"], &dsm);
        assert_eq!((code, err.as_str()), (0, ""));
        let (_, hash, _) = run_program("dsm-info", &[dsm.to_str().unwrap(), "--hash"]);
        assert_eq!(String::from_utf8(out).unwrap(), hash);
        let (code, out, err) = piped("dsm-join", &["collect", input, "-"], &dsm);
        assert_eq!((code, err.as_str()), (0, ""));
        assert!(DsmFile::from_bytes(out).unwrap().find("key").is_some());
    }
}

#[test]
fn standard_output_needs_a_kind_and_takes_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let exr = folder.path().join("in.exr");
    image(&exr, Look::default());
    let (code, out, err) = piped("dsm-convert", &["-", "-"], &exr);
    assert_eq!((code, out.len()), (2, 0));
    assert!(err.contains("use --to dsm, exr, png or npz"), "{err}");
    let stats = ["-", "-", "--to", "dsm", "--runstats"];
    let (code, out, err) = piped("dsm-convert", &stats, &exr);
    assert_eq!((code, out.len()), (2, 0));
    assert!(err.contains("--runstats"), "{err}");
    // A kind that standard input does not have.
    let (code, _, err) = piped("dsm-info", &["-"], &exr);
    assert_eq!(code, 1);
    assert!(
        err.contains("-: not a .dsm file, but a deep OpenEXR"),
        "{err}"
    );
}

#[test]
fn several_images_go_to_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n).to_str().unwrap().to_owned();
    let [a, b, maps, file] = ["a.exr", "b.exr", "maps/", "one.dsm"].map(path);
    image(a.as_ref(), Look::default());
    image(
        b.as_ref(),
        Look {
            coloured: true,
            ..Look::default()
        },
    );
    let (code, _, err) = run(&[&a, &b, &file]);
    assert_eq!(code, 2);
    assert!(err.contains("need a folder"), "{err}");
    let (code, _, err) = run(&[&a, &b, &maps]);
    assert_eq!((code, err.as_str()), (0, ""));
    let made = ["maps/a.dsm", "maps/b.dsm"].map(path);
    convert(a.as_ref(), file.as_ref(), &[]);
    assert!(std::fs::read(&made[0]).unwrap() == std::fs::read(&file).unwrap());
    assert_eq!(
        DsmFile::open(&made[1]).unwrap().maps()[0].header.channels,
        3
    );
    // What exists is skipped, and a broken input stops only itself.
    std::fs::write(&made[0], "kept").unwrap();
    std::fs::remove_file(&made[1]).unwrap();
    let [bad, c] = ["bad.exr", "c.exr"].map(path);
    std::fs::write(&bad, "no image").unwrap();
    image(c.as_ref(), Look::default());
    let (code, _, err) = run(&[&a, &bad, &b, &c, &maps, "--skip-existing"]);
    assert_eq!((code, err.lines().count()), (1, 2), "{err}");
    assert!(
        err.contains("bad.exr: not an OpenEXR file, but text"),
        "{err}"
    );
    assert!(err.contains("1 of 4 files failed"), "{err}");
    assert_eq!(std::fs::read(&made[0]).unwrap(), b"kept");
    assert!(Path::new(&made[1]).is_file() && Path::new(&path("maps/c.dsm")).is_file());
    // Two inputs of one name.
    std::fs::create_dir(path("more")).unwrap();
    std::fs::copy(&a, path("more/a.exr")).unwrap();
    let (code, _, err) = run(&[&a, &path("more/a.exr"), &maps]);
    assert_eq!(code, 2);
    assert!(err.contains("would both become"), "{err}");
}

#[test]
fn an_image_becomes_a_picture_in_one_step() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, dsm, one, two] = ["in.exr", "map.dsm", "one.png", "two.png"].map(path);
    image(
        &exr,
        Look {
            coloured: true,
            thick: true,
            tiled: false,
        },
    );
    convert(
        &exr,
        &dsm,
        &["--tolerance", "0.001", "--compressor", "lookahead"],
    );
    for options in [
        &["--depth", "6"][..],
        &["--depth", "6", "--region", "3,4,20,10"],
        &["--depth", "6", "--width", "5", "--region", "3,4,20,10"],
        &["--opacity", "--level", "1"],
    ] {
        convert(&exr, &one, options);
        convert(&dsm, &two, options);
        let (a, b) = (decoded(&one), decoded(&two));
        assert_eq!(a.len(), b.len());
        let far = a.iter().zip(&b).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(far <= 140, "{options:?}: {far} of 65535"); // twice the tolerance
    }
    let line = refuse(2, &exr, &path("deep.exr"), &[]);
    assert!(line.contains("--depth"), "{line}");
    convert(&exr, &path("a.npz"), &["--tolerance", "0.02"]);
    assert!(std::fs::read(path("a.npz")).unwrap().starts_with(b"PK"));
}

/// The 16-bit values of a PNG.
fn decoded(path: &Path) -> Vec<u16> {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    let pair = |b: &[u8]| u16::from(b[0]) << 8 | u16::from(b[1]);
    bytes.chunks_exact(2).map(pair).collect()
}

#[test]
fn a_region_of_a_picture_is_that_part_of_the_whole_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, dsm, all, part] = ["in.exr", "map.dsm", "all.png", "part.png"].map(path);
    image(&exr, Look::default());
    convert(&exr, &dsm, &["--tile", "8"]);
    for options in [&["--depth", "6"][..], &["--depth", "6", "--width", "3"]] {
        convert(&dsm, &all, options);
        let cut = [options, &["--region", "5,7,30,20"]].concat();
        convert(&dsm, &part, &cut);
        let (all, part) = (decoded(&all), decoded(&part));
        for (y, row) in part.chunks(30).enumerate() {
            assert_eq!(row, &all[(7 + y) * 45 + 5..][..30]);
        }
    }
    let line = refuse(1, &dsm, &part, &["--depth", "6", "--region", "40,0,6,1"]);
    assert!(
        line.contains("--region 40,0,6,1: not inside the 45 x 37 pixels"),
        "{line}"
    );
}

#[test]
fn a_level_becomes_the_base_of_a_smaller_map() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n);
    let [exr, dsm, half] = ["in.exr", "map.dsm", "half.dsm"].map(path);
    image(&exr, Look::default());
    let numbers = [
        "1", "0", "0", "0", "0", "1", "0", "0", "0", "0", "1", "0.5", "0", "0", "3", "1",
    ];
    let camera = [&["--MNDC"][..], &numbers].concat();
    convert(&exr, &dsm, &camera);
    convert(&dsm, &half, &["--level", "1"]);
    let (whole, small) = (DsmFile::open(&dsm).unwrap(), DsmFile::open(&half).unwrap());
    let (old, new) = (&whole.maps()[0], &small.maps()[0]);
    assert_eq!((new.header.width, new.header.height), (23, 19));
    assert_eq!(new.levels.len(), old.levels.len() - 1);
    for (level, info) in new.levels.iter().enumerate() {
        let (old, new) = (
            MapId(0).level(level as u32 + 1),
            MapId(0).level(level as u32),
        );
        assert_eq!(info.max_error, whole.level(old).unwrap().max_error);
        let pixels =
            (0..info.shape.height).flat_map(|y| (0..info.shape.width).map(move |x| (x, y)));
        for pixel in pixels.map(|(x, y)| Pixel::new(x, y)) {
            let there = small.function(new, pixel).unwrap();
            assert_eq!(there, whole.function(old, pixel).unwrap());
        }
    }
    // A point falls on the same place: pixel p of the map is p / 2 of the level.
    let place = |map: &deepshadow::MapInfo, point: [f64; 4]| {
        let m = map.header.camera.ndc_from_world.unwrap();
        let row =
            |c: usize| (0..4).map(|i| point[i] * m[4 * i + c]).sum::<f64>() / row_w(&m, point);
        let [x0, y0, x1, y1] = map.header.display_window.map(f64::from);
        let [x, y] = map.header.data_origin.map(f64::from);
        [
            row(0) * (x1 - x0 + 1.0) + x0 - x,
            row(1) * (y1 - y0 + 1.0) + y0 - y,
        ]
    };
    for point in [[0.25, 0.5, 1.0, 1.0], [-3.0, 2.0, 7.0, 1.0]] {
        let (a, b) = (place(old, point), place(new, point));
        assert!(
            (0..2).all(|i| (a[i] / 2.0 - b[i]).abs() < 1e-9),
            "{a:?} {b:?}"
        );
    }
    let line = refuse(1, &dsm, &half, &["--level", "9"]);
    assert!(line.contains("no level 9"), "{line}");
}

fn row_w(m: &[f64; 16], point: [f64; 4]) -> f64 {
    (0..4).map(|i| point[i] * m[4 * i + 3]).sum()
}

#[test]
fn every_program_prints_completions_and_a_man_page() {
    for program in ["dsm-info", "dsm-convert", "dsm-join"] {
        for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
            let (code, out, err) = run_program(program, &["--completions", shell]);
            assert_eq!((code, err.as_str()), (0, ""));
            assert!(
                out.contains(program) && out.contains("threads"),
                "{program} {shell}"
            );
        }
        let (code, out, _) = run_program(program, &["--man"]);
        assert_eq!(code, 0);
        assert!(out.contains(".TH ") && out.contains(program), "{out}");
        let (code, _, err) = run_program(program, &["--completions", "tcsh"]);
        assert_eq!(code, 2);
        assert!(err.contains("--completions tcsh: not one of bash"), "{err}");
    }
    let (code, out, _) = run_program("dsm-join", &["stitch", "--man"]);
    assert_eq!(code, 0);
    assert!(
        out.contains("dsm\\-join\\-stitch") && out.contains("nomipmap"),
        "{out}"
    );
}

#[test]
fn too_many_threads_are_fewer_and_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "map.dsm"].map(|n| folder.path().join(n));
    image(&exr, Look::default());
    let (_, err) = convert(&exr, &dsm, &["-j", "100000"]);
    assert_eq!(err.lines().count(), 1);
    assert!(
        err.contains("--threads 100000: uses 256 threads, the most"),
        "{err}"
    );
}

#[test]
fn wrong_values_have_one_shape() {
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "map.dsm"].map(|n| folder.path().join(n));
    image(&exr, Look::default());
    for (options, line) in [
        (
            &["--name", ""][..],
            "--name : not 1 to 255 bytes long without control characters",
        ),
        (
            &["--tolerance", "2"],
            "--tolerance 2: not a number from 0 to 1",
        ),
        (
            &["--tile", "48"],
            "--tile 48: not one of 8, 16, 32, 64, 128 and 256",
        ),
        (
            &["--zscale", "0"],
            "--zscale 0: not a finite number other than 0",
        ),
        (
            &["--opacitylimit", "0"],
            "--opacitylimit 0: not a number above 0 and at most 1",
        ),
        (&["--depth-unit", "0"], "--depth-unit 0: not above 0 metres"),
        (
            &["--compressor", "best"],
            "--compressor best: not one of croquet, lookahead, minimal",
        ),
        (
            &["-j", "many"],
            "--threads many: not a whole number above 0",
        ),
        (
            &["--region", "1,2,3"],
            "--region 1,2,3: not a rectangle X,Y,W,H in pixels",
        ),
        (
            &["--compression", "zip"],
            "--compression zip: there is no codec \"zip\"; there are none, \
            lz4, zstd, zstd:1 to zstd:22",
        ),
    ] {
        let said = refuse(2, &exr, &dsm, options);
        assert_eq!(said, format!("dsm-convert: {line} (try --help)\n"));
    }
    // The help of a matrix shows two of its sixteen numbers.
    let (_, help, _) = run(&["--help"]);
    assert!(
        help.contains("--Mcamera <M11> <M12>...") && !help.contains("<M> <M>"),
        "{help}"
    );
}

#[test]
fn a_map_without_shadows_is_noted() {
    use deepshadow_exr::{Channel, DeepBlock, DeepWriter, Part, Rect, SampleType};
    let folder = tempfile::tempdir().unwrap();
    let [exr, dsm] = ["in.exr", "map.dsm"].map(|n| folder.path().join(n));
    let window = Rect {
        x: 0,
        y: 0,
        width: 2,
        height: 1,
    };
    let channels = ["A", "Z"]
        .map(|n| Channel::new(n, SampleType::Float))
        .to_vec();
    let part = Part::deep_scanline(window, channels);
    let file = std::fs::File::create(&exr).unwrap();
    let mut writer = DeepWriter::new(file, vec![part.clone()]).unwrap();
    let mut block = DeepBlock::with_channels(window, &part.channels);
    (0..2).for_each(|_| block.push_pixel());
    writer.write(0, &block).unwrap();
    writer.finish().unwrap();
    let (_, err) = convert(&exr, &dsm, &[]);
    assert!(err.contains("no pixel has a sample with opacity"), "{err}");
}
