//! Tests of `dsm-build` as a program.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::load_support::data;
use assert_cmd::Command;
use deepshadow::{DsmFile, MapId, Pixel};

fn dsm_build() -> Command {
    Command::cargo_bin("dsm-build").unwrap()
}

/// Exit code and standard error of a run.
fn outcome(command: &mut Command) -> (i32, String) {
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code().unwrap(), said)
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("triangle.obj"), TRIANGLE).unwrap();
    std::fs::write(
        folder.path().join("moved.obj"),
        TRIANGLE.replace("v 1 0 0", "v 2 0 0"),
    )
    .unwrap();
    std::fs::write(
        folder.path().join("other.obj"),
        format!("{TRIANGLE}v 1 1 0\nf 2 4 3\n"),
    )
    .unwrap();
    folder
}

#[test]
fn help_lists_the_options_and_demos() {
    let output = dsm_build().arg("--help").output().unwrap();
    let help = String::from_utf8(output.stdout).unwrap();
    for word in [
        "demo:hairball",
        "--light-dir",
        "--samples",
        "--region",
        "--transfer",
        "--runstats",
        "SCENE",
    ] {
        assert!(help.contains(word), "{word} is missing");
    }
    assert!(output.status.success());
}

#[test]
fn one_object_becomes_a_map_that_frames_it() {
    let folder = folder();
    let out = folder.path().join("out.dsm");
    let mut run = dsm_build();
    run.arg(folder.path().join("triangle.obj")).arg(&out);
    run.args([
        "--light-dir",
        "0,0,-1",
        "--resolution",
        "64",
        "--samples",
        "4",
        "--opacity",
        "0.5",
    ]);
    assert_eq!(outcome(&mut run), (0, String::new()));
    let file = DsmFile::open(&out).unwrap();
    let header = &file.maps()[0].header;
    assert_eq!((header.width, header.height, header.channels), (64, 64, 1));
    // The triangle fills half of the square that frames it.
    let seen = (0..64 * 64).filter(|i| {
        !file
            .function(MapId(0).level(0), Pixel::new(i % 64, i / 64))
            .unwrap()
            .is_empty()
    });
    let seen = seen.count();
    assert!((1800..2200).contains(&seen), "{seen} pixels");
}

#[test]
fn invalid_arguments_give_one_line_and_exit_code_2() {
    let folder = folder();
    let triangle = folder.path().join("triangle.obj");
    let out = folder.path().join("out.dsm");
    let scene = folder.path().join("scene.toml");
    std::fs::write(
        &scene,
        "[[object]]\nfile = 'triangle.obj'\n[[light]]\ndirection = [0, 0, -1]\n",
    )
    .unwrap();
    let cases: &[(&Path, &[&str], &str)] = &[
        (
            &triangle,
            &["--samples", "5000"],
            "--samples: 5000 is not from 1 to 4096",
        ),
        (
            &triangle,
            &["--opacity", "1.5"],
            "--opacity: 1.5 is not from 0 to 1",
        ),
        (
            &triangle,
            &["--tolerance", "2"],
            "--tolerance 2: not a number from 0 to 1",
        ),
        (&triangle, &["--transfer", "x"], "--transfer: only volumes"),
        (&triangle, &["--width", "1"], "--width: only curves"),
        (
            &triangle,
            &["--light-dir", "0,0,0"],
            "--light-dir: 0, 0, 0 is not a direction",
        ),
        (&triangle, &["--light-dir", "1,2"], "not three numbers"),
        (
            &triangle,
            &["--region", "8,0,8,8"],
            "cuts tiles of 32 pixels",
        ),
        (
            &triangle,
            &["--region", "0,0,4096,8"],
            "is not inside the 512 x 512 pixels",
        ),
        (&triangle, &["--tile", "48"], "--tile 48: not one of"),
        (
            &triangle,
            &["--compression", "zip"],
            "--compression zip: there is no codec",
        ),
        (
            &triangle,
            &["--threads", "0"],
            "--threads 0: not a whole number above 0",
        ),
        (
            &triangle,
            &["--filter-width", "0"],
            "--filter-width: 0 is not from 1 to 16",
        ),
        (&triangle, &["--type", "u8"], "--shape"),
        (
            &triangle,
            &["--resolution", "64,64"],
            "--resolution 64,64: not a size",
        ),
        (Path::new("demo:nothing"), &[], "is not one of hairball"),
        (
            &scene,
            &["--opacity", "0.5"],
            "--opacity: applies only to a single object",
        ),
    ];
    for (input, options, says) in cases {
        let (code, said) = outcome(dsm_build().arg(input).arg(&out).args(*options));
        assert!(
            code == 2 && said.contains(says),
            "{options:?}: {code} {said}"
        );
        assert!(!out.exists());
    }
    let (code, said) = outcome(
        dsm_build()
            .arg(&triangle)
            .arg(folder.path().join("out.exr")),
    );
    assert!(code == 2 && said.contains("a .dsm file"), "{said}");
}

#[test]
fn errors_in_scenes_name_the_file_line_and_key() {
    let folder = folder();
    let scene = folder.path().join("scene.toml");
    let out = folder.path().join("out.dsm");
    let cases = [
        (
            "[[object]]\nfile = 'triangle.obj'\nopactiy = 0.5\n",
            "scene.toml:3: unknown key `opactiy`: did you mean `opacity`?",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nopacity = 1.5\n",
            "scene.toml:3: object: opacity: 1.5 is not from 0 to 1",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nopacity = 'full'\n",
            "scene.toml:3: opacity: invalid type",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nopacity = [1, 0]\n",
            "scene.toml:3: opacity: invalid length 2",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n\nscale = 0\n",
            "scene.toml:4: object: scale: 0 flattens the object",
        ),
        (
            "[[object]]\nopacity = 1\n",
            "scene.toml:1: object: file: an object needs a file, frames or a demo",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\ndemo = 'cloud'\n",
            "scene.toml:2: object: file: an object is one of",
        ),
        (
            "[[object]]\ndemo = 'clod'\n",
            "scene.toml:2: object: demo: \"clod\" is not one of hairball",
        ),
        (
            "[[object]]\nfile = 'missing.obj'\n",
            "missing.obj: No such file",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nextinction = 2\n",
            "scene.toml:3: object: extinction: only volumes",
        ),
        (
            "[[object]]\nframes = ['triangle.obj', 'other.obj']\n",
            "other.obj: 4 vertices and 2 triangles that are not those of the first frame",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nmotion = [{translate = [0, 0, 0]}]\n",
            "scene.toml:3: object: motion: 1 transforms are not 2 to 64",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nmotion = [{}, {scale = 0}]\n",
            "scene.toml:3: object: motion: scale: 0 flattens the object",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\nmotion = [{}, {turn = 1}]\n",
            "scene.toml:3: ",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\nname = 'a'\n",
            "scene.toml:3: light: type: a light needs a direction or a position",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\ntype = 'spto'\n",
            "scene.toml:4: unknown key `spto`: did you mean `spot`?",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\ndirection = [0, 0, 1]\nangle = 3\n",
            "scene.toml:5: light: angle: a directional light does not have this key",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\nposition = [0, 0, 1]\nsamples = 0\n",
            "scene.toml:5: light: samples: 0 is not from 1 to 4096",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\nposition = [0, 0, nan]\n",
            "scene.toml:4: light: position: NaN",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\nposition = [0, 0, 5]\n[[light]]\n\
            position = [0, 0, 9]\n",
            "scene.toml:5: light: name: two lights are called \"light\"",
        ),
        (
            "[[object]]\nfile = 'triangle.obj'\n[camera]\nposition = [0, 0, 1]\n\
            target = [0, 0, 1]\n",
            "scene.toml:5: camera: target: it is the position of the camera",
        ),
        ("seed = 1\n", "scene.toml:1: a scene needs an [[object]]"),
        (
            "[[object]]\nfile = 'triangle.obj'\n",
            "scene.toml: a scene needs a [[light]]",
        ),
        ("[[object]\n", "scene.toml:1: "),
        (
            "[[object]]\nfile = 'triangle.obj'\n[[light]]\nposition = [0.3, 0.3, 0]\n",
            "light \"light\": not all objects are in front of it",
        ),
    ];
    for (text, says) in cases {
        std::fs::write(&scene, text).unwrap();
        let (code, said) = outcome(dsm_build().arg(&scene).arg(&out));
        assert!(
            code == 1 && said.contains(says),
            "{text}\n{code} {said}\nshould say {says}"
        );
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(!out.exists());
    }
}

#[test]
fn a_scene_with_every_feature_is_built() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let mut texture = png::Encoder::new(std::fs::File::create(at("leaf.png")).unwrap(), 2, 1);
    texture.set_color(png::ColorType::Grayscale);
    texture
        .write_header()
        .unwrap()
        .write_image_data(&[0, 255])
        .unwrap();
    std::fs::write(
        at("leaf.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n",
    )
    .unwrap();
    std::fs::write(at("fog.raw"), [0u8, 10, 20, 30, 40, 50, 60, 255]).unwrap();
    std::fs::write(at("fog.txt"), "# value, extinction\n0 0\n255 2 1 0.5\n").unwrap();
    std::fs::write(
        at("scene.toml"),
        "seed = 7\n\
         [[object]]\nname = 'leaf'\nfile = 'leaf.obj'\ntexture = 'leaf.png'\n\
         opacity = [1, 0.5, 0]\nrotate = [0, 90, 0]\nscale = 2\n\
         [[object]]\nframes = ['triangle.obj', 'moved.obj']\ntranslate = [0, 0, 1]\n\
         color = [0.5, 0.5, 1]\n\
         [[object]]\nfile = 'fog.raw'\nshape = '2x2x2'\ntransfer = 'fog.txt'\nextinction = 0.5\n\
         step = 0.5\nmotion = [{}, {rotate = [0, 0, 30]}]\n\
         [[object]]\nfile = 'triangle.obj'\nshadow = false\n\
         matrix = [1,0,0,0, 0,1,0,0, 0,0,1,0, 5,0,0,1]\n\
         [[light]]\nname = 'sun'\ndirection = [0, -1, -1]\nresolution = [40, 24]\nsamples = 4\n\
         filter = 'catmull-rom'\ntolerance = 0.13\n\
         [[light]]\nname = 'lamp'\ntype = 'point'\nposition = [0.2, 0.2, 4]\nresolution = 16\n\
         samples = 2\ndepth = 'distance'\n\
         [[light]]\nname = 'spot'\nposition = [0, 0, 9]\nangle = 30\nresolution = 16\n\
         samples = 2\nfilter = 'gaussian'\nfilter_width = 1.5\n\
         [camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]\n",
    )
    .unwrap();
    let out = at("out.dsm");
    assert_eq!(
        outcome(
            dsm_build()
                .arg(at("scene.toml"))
                .arg(&out)
                .arg("--runstats")
        ),
        (0, String::new())
    );
    let file = DsmFile::open(&out).unwrap();
    let names: Vec<_> = file.maps().iter().map(|m| m.header.name.clone()).collect();
    assert_eq!(
        names,
        [
            "sun", "lamp.+x", "lamp.-x", "lamp.+y", "lamp.-y", "lamp.+z", "lamp.-z", "spot"
        ]
    );
    assert_eq!(file.maps()[0].levels[0].max_error, 0.13);
    assert_eq!(
        file.maps()[1].header.depth_kind,
        deepshadow::DepthKind::RayDistance
    );
    assert!(file.maps().iter().all(|m| m.header.channels == 3));
    assert!(file.maps()[0].levels[0].vertices > 0 && file.maps()[7].levels[0].vertices > 0);
}

/// Starts a long build over an old file, and waits until it has begun to write.
#[cfg(target_os = "linux")]
fn begun(folder: &Path, program: &mut std::process::Command) -> std::process::Child {
    let out = folder.join("out.dsm");
    std::fs::write(&out, "old").unwrap();
    let mut child = program
        .arg("demo:hairball")
        .arg(&out)
        .args(["--samples", "1024", "--resolution", "2048", "-q"])
        .spawn()
        .unwrap();
    let begun = |pid: u32| {
        let files = std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?;
        let opened = files.filter_map(|f| std::fs::read_link(f.ok()?.path()).ok());
        opened.into_iter().find(|f| f.starts_with(folder))
    };
    let started = Instant::now();
    while begun(child.id()).is_none() {
        assert!(
            started.elapsed() < Duration::from_secs(120),
            "it does not begin"
        );
        assert!(child.try_wait().unwrap().is_none(), "it has ended already");
        std::thread::sleep(Duration::from_millis(20));
    }
    child
}

#[cfg(target_os = "linux")]
fn send(signal: &str, child: &std::process::Child) {
    let pid = child.id().to_string();
    let sent = std::process::Command::new("kill")
        .args([signal, &pid])
        .status();
    assert!(sent.unwrap().success());
}

#[cfg(target_os = "linux")]
#[test]
fn a_signal_ends_a_build_at_once_and_leaves_only_the_old_file() {
    use std::os::unix::process::ExitStatusExt;
    let folder = tempfile::tempdir().unwrap();
    for (signal, number) in [("-INT", 2), ("-TERM", 15), ("-HUP", 1), ("-KILL", 9)] {
        // A script may run the tests in the background, which ignores SIGINT.
        let mut program = std::process::Command::new("env");
        program.arg("--default-signal=INT,TERM,HUP");
        program.arg(assert_cmd::cargo::cargo_bin("dsm-build"));
        let mut child = begun(folder.path(), &mut program);
        let sent = Instant::now();
        send(signal, &child);
        let status = child.wait().unwrap();
        // A shell shows 128 more. A busy machine needs some time.
        assert_eq!(status.signal(), Some(number), "{status}");
        assert!(sent.elapsed() < Duration::from_secs(5), "{signal}");
        let left = std::fs::read_dir(folder.path()).unwrap();
        let left: Vec<_> = left.map(|f| f.unwrap().file_name()).collect();
        assert_eq!(left, ["out.dsm"], "{signal}");
        let old = std::fs::read(folder.path().join("out.dsm")).unwrap();
        assert_eq!(old, b"old", "{signal}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_signal_that_the_caller_ignores_stays_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let mut nohup = std::process::Command::new("sh");
    nohup.args(["-c", "trap '' HUP; exec \"$0\" \"$@\""]);
    nohup.arg(assert_cmd::cargo::cargo_bin("dsm-build"));
    let mut child = begun(folder.path(), &mut nohup);
    send("-HUP", &child);
    std::thread::sleep(Duration::from_millis(300));
    assert!(child.try_wait().unwrap().is_none(), "it has ended");
    send("-TERM", &child);
    child.wait().unwrap();
}

#[test]
fn real_files_become_maps() {
    let out = tempfile::tempdir().unwrap();
    let out = out.path().join("out.dsm");
    let mut seen = 0;
    let files: &[(&str, &[&str], &[&str])] = &[
        (
            "mesh",
            &[
                "bunny_lowres.ply",
                "bunny_nori.obj",
                "dragon_vrip_res4.ply.gz",
                "eztree_gen_oak_small.obj",
                "ico4.obj",
                "spot.obj",
                "teapot.obj",
            ],
            &[],
        ),
        ("curves", &["Ratboy_mohawk.tfx", "sintel_hair.tfx"], &[]),
        (
            "volume",
            &[
                "FLAIR.nii.gz",
                "bonsai.nii.gz",
                "fuel.nii.gz",
                "nibabel_anatomical.nii",
                "HeadMRVolume.mhd",
            ],
            &[],
        ),
        (
            "volume",
            &["Bucky_32x32x32_u8.raw"],
            &["--shape", "32x32x32"],
        ),
        (
            "volume",
            &["headsq_quarter_64x64x93_u16le.raw"],
            &["--shape", "64x64x93", "--type", "u16"],
        ),
    ];
    for (kind, names, options) in files {
        for path in data(kind) {
            let name = path.file_name().unwrap().to_str().unwrap();
            if !names.contains(&name) {
                continue;
            }
            seen += 1;
            let mut run = dsm_build();
            run.arg(&path).arg(&out).args(*options);
            run.args(["--resolution", "64", "--samples", "4", "--nomipmap"]);
            assert_eq!(outcome(&mut run), (0, String::new()), "{name}");
            let file = DsmFile::open(&out).unwrap();
            assert!(
                file.maps()[0].levels[0].vertices > 100,
                "{name} casts no shadow"
            );
        }
    }
    assert!([0, 16].contains(&seen), "{seen} of 16 files");
}

#[test]
fn a_raw_volume_says_which_options_it_needs() {
    let folder = folder();
    let [raw, out] = ["fog.raw", "out.dsm"].map(|n| folder.path().join(n));
    std::fs::write(&raw, [200u8; 64]).unwrap();
    let (code, said) = outcome(dsm_build().arg(&raw).arg(&out));
    assert_eq!(code, 2);
    assert!(
        said.contains("--shape: a .raw file needs the number of its samples"),
        "{said}"
    );
    // The spelling that it proposes is one that it takes.
    let shape = said
        .split("such as ")
        .nth(1)
        .unwrap()
        .split(',')
        .next()
        .unwrap();
    assert_eq!(shape, "64x64x93");
    std::fs::write(&raw, vec![200u8; 64 * 64 * 93]).unwrap();
    let mut run = dsm_build();
    run.arg(&raw)
        .arg(&out)
        .args(["--shape", shape, "--resolution", "16"]);
    assert_eq!(outcome(&mut run), (0, String::new()));
    let (code, said) = outcome(dsm_build().arg(&raw).arg(&out).args(["--shape", "4x4"]));
    assert!(code == 2 && said.contains("WxHxD"), "{said}");
}

#[test]
fn maps_that_are_lit_everywhere_are_noted_with_the_reason() {
    let folder = folder();
    let [scene, out] = ["scene.toml", "out.dsm"].map(|n| folder.path().join(n));
    let light = "resolution = 16\nsamples = 1\n";
    for (object, lamp, says) in [
        (
            "opacity = 0",
            "direction = [0, 0, -1]",
            "lit everywhere: every object has opacity 0",
        ),
        (
            "",
            "position = [0.3, 0.3, 5]\ntarget = [0.3, 0.3, 9]\nangle = 20",
            "lit everywhere: no object is in its view",
        ),
        (
            "",
            "position = [0.3, 0.3, 1e9]\nangle = 1e-3",
            "too coarse for objects of size 1",
        ),
    ] {
        let text =
            format!("[[object]]\nfile = 'triangle.obj'\n{object}\n[[light]]\n{lamp}\n{light}");
        std::fs::write(&scene, text).unwrap();
        let (code, said) = outcome(dsm_build().arg(&scene).arg(&out));
        assert!(code == 0 && said.contains(says), "{lamp}: {said}");
        assert_eq!(
            outcome(dsm_build().arg(&scene).arg(&out).arg("-q")),
            (0, String::new())
        );
    }
    // One dark face of a point light is enough.
    let text = format!(
        "[[object]]\nfile = 'triangle.obj'\n[[light]]\ntype = 'point'\nposition = [0.3, 0.3, 0.5]\n\
         {light}"
    );
    std::fs::write(&scene, text).unwrap();
    assert_eq!(
        outcome(dsm_build().arg(&scene).arg(&out)),
        (0, String::new())
    );
}

#[test]
fn files_of_other_kinds_are_named() {
    let folder = folder();
    let out = folder.path().join("out.dsm");
    for (name, bytes, says) in [
        (
            "a.gltf",
            &b"{ \"asset\": {} }"[..],
            "a glTF scene; known are .obj",
        ),
        ("a.glb", b"glTF\x02\0\0\0", "a glTF scene; known are .obj"),
        (
            "a.fbx",
            b"Kaydara FBX Binary",
            "an FBX scene; known are .obj",
        ),
        (
            "a.xyz",
            b"\x01\x02",
            "not a known kind of file; known are .obj",
        ),
        (
            "a.dsm",
            b"\x89DSM\r\n\x1a\n\x01\0",
            "a deep shadow map (.dsm); known are .obj",
        ),
        (
            "a.obj",
            b"glTF\x02\0\0\0",
            "not a .obj file, but a glTF scene",
        ),
        (
            "a.nrrd",
            b"\x89PNG\r\n\x1a\n",
            "not a .nrrd file, but a PNG image",
        ),
        (
            "a.toml",
            b"\x89PNG\r\n\x1a\n",
            "not a scene, which is a text file in TOML, but a PNG image",
        ),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let (code, said) = outcome(dsm_build().arg(&path).arg(&out));
        assert!(code == 1 && said.contains(says), "{name}: {said}");
        assert!(said.contains(name) && said.lines().count() == 1, "{said}");
    }
}

#[test]
fn a_scene_comes_from_standard_input_and_its_map_goes_to_standard_output() {
    let scene = "[[object]]\ndemo = 'cloud'\n[[light]]\ndirection = [0, -1, 0]\nresolution = 16\n";
    let run = |arguments: &[&str]| {
        let mut run = dsm_build();
        let output = run.args(arguments).write_stdin(scene).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        (output.status.code().unwrap(), output.stdout, said)
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.dsm");
    assert_eq!(
        run(&["-", out.to_str().unwrap()]),
        (0, vec![], String::new())
    );
    let (code, bytes, said) = run(&["-", "-"]);
    assert_eq!((code, said.as_str()), (0, ""));
    assert!(bytes == std::fs::read(&out).unwrap());
    let (code, bytes, said) = run(&["-", "-", "--runstats"]);
    assert_eq!((code, bytes.len()), (2, 0));
    assert!(
        said.contains("--runstats: standard output takes the file"),
        "{said}"
    );
    let (code, text, _) = run(&["--completions", "bash"]);
    assert!(code == 0 && String::from_utf8(text).unwrap().contains("dsm-build"));
    let (code, text, _) = run(&["--man"]);
    assert!(code == 0 && String::from_utf8(text).unwrap().contains("demo:hairball"));
}
