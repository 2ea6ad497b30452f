//! Runs the program and checks its exit code and output.

use std::path::Path;

use assert_cmd::Command;

const SCENE: &str = r#"
[[object]]
demo = "cloud"
[[light]]
name = "key"
direction = [1, -2, -1]
resolution = 32
samples = 4
"#;

/// Runs the program. Returns its exit code, standard output and standard error.
fn run(arguments: &[&str]) -> (i32, String, String) {
    let mut command = Command::cargo_bin("dsm-render").unwrap();
    let output = command.args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let code = output.status.code().unwrap();
    (code, text(output.stdout), text(output.stderr))
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    folder
}

fn path(folder: &tempfile::TempDir, name: &str) -> String {
    folder.path().join(name).to_str().unwrap().to_owned()
}

#[test]
fn help_names_every_kind_of_shadow() {
    let (code, out, _) = run(&["--help"]);
    assert_eq!(code, 0);
    for option in [
        "--shadows",
        "--reference",
        "--pcf",
        "--no-shadows",
        "--compare",
    ] {
        assert!(out.contains(option), "{option}");
    }
}

#[test]
fn invalid_arguments_exit_with_2_and_one_line() {
    let folder = folder();
    let (scene, png, jpg) = (
        path(&folder, "scene.toml"),
        path(&folder, "a.png"),
        path(&folder, "a.jpg"),
    );
    for wrong in [
        vec![&*scene, &*png],
        vec![&scene, &jpg, "--no-shadows"],
        vec![&scene, &png, "--no-shadows", "--spp", "0"],
        vec![&scene, &png, "--no-shadows", "--crop", "0,0,1000,1"],
        vec![&scene, &png, "--no-shadows", "--only-light", "moon"],
        vec![&png, &png, "--compare", "--no-shadows"],
        vec![&png, &jpg, "--compare"],
    ] {
        let (code, out, err) = run(&wrong);
        assert_eq!((code, &*out), (2, ""), "{wrong:?}: {err}");
        assert!(
            err.starts_with("dsm-render: ") && err.lines().count() == 1,
            "{err}"
        );
        assert!(!Path::new(&png).exists());
    }
    for wrong in [vec![&*scene], vec![&scene, &png, "--no-shadows", "--pcf"]] {
        assert_eq!(run(&wrong).0, 2, "{wrong:?}");
    }
}

#[test]
fn missing_files_exit_with_1_and_are_named() {
    let folder = folder();
    let (scene, png) = (path(&folder, "scene.toml"), path(&folder, "a.png"));
    let map = path(&folder, "none.dsm");
    for (arguments, named) in [
        (vec![&*scene, &*png, "--shadows", &*map], "none.dsm"),
        (vec![&*map, &png, "--no-shadows"], "none.dsm"),
        (vec![&png, &png, "--compare"], "a.png"),
    ] {
        let (code, _, err) = run(&arguments);
        assert_eq!(code, 1, "{arguments:?}: {err}");
        assert!(err.contains(named) && err.lines().count() == 1, "{err}");
        assert!(!Path::new(&png).exists());
    }
}

#[test]
fn a_map_without_the_light_exits_with_1_and_lists_its_maps() {
    let folder = folder();
    let (scene, png, map) = (
        path(&folder, "scene.toml"),
        path(&folder, "a.png"),
        path(&folder, "map.dsm"),
    );
    let mut writer = deepshadow::Writer::create(&map).unwrap();
    let header = deepshadow::MapHeader::new("rim", 8, 8);
    writer
        .add_map(header, deepshadow::Encoding::default())
        .unwrap();
    writer.finish().unwrap();
    let (code, _, err) = run(&[&scene, &png, "--shadows", &map]);
    assert_eq!(code, 1, "{err}");
    assert!(err.contains("\"key\"") && err.contains("\"rim\""), "{err}");
}

#[test]
fn a_picture_equals_itself_and_differs_from_one_without_shadows() {
    let folder = folder();
    let scene = path(&folder, "scene.toml");
    let (a, b) = (path(&folder, "a.exr"), path(&folder, "b.exr"));
    let small = ["--resolution", "16x12", "--spp", "2", "--runstats"];
    let render = |out: &str, shadows: &str| {
        let (code, said, err) = run(&[&[&*scene, out, shadows], &small[..]].concat());
        assert_eq!(code, 0, "{err}");
        said
    };
    let said = render(&a, "--reference");
    assert!(
        said.contains("shadow lookups") && said.contains("memory of shadows"),
        "{said}"
    );
    render(&b, "--no-shadows");
    let (code, same, _) = run(&[&a, &a, "--compare"]);
    assert_eq!(code, 0);
    assert!(
        same.starts_with("RMSE                0.000000\n") && same.contains("inf dB"),
        "{same}"
    );
    let drawn = path(&folder, "d.png");
    let (code, other, _) = run(&[&a, &b, "--compare", "--difference", &drawn]);
    assert_eq!(code, 0);
    assert!(!other.contains("RMSE                0.000000"), "{other}");
    assert!(Path::new(&drawn).exists());
    // Pictures of different sizes cannot be compared.
    let c = path(&folder, "c.png");
    assert_eq!(
        run(&[
            &scene,
            &c,
            "--no-shadows",
            "--resolution",
            "8x8",
            "--spp",
            "1"
        ])
        .0,
        0
    );
    assert_eq!(run(&[&a, &c, "--compare"]).0, 1);
}

#[test]
fn a_map_with_another_camera_is_noted() {
    let folder = folder();
    let [scene, map, png] = ["scene.toml", "map.dsm", "a.png"].map(|n| path(&folder, n));
    let read = deepshadow_scene::scene::file::read(Path::new(&scene)).unwrap();
    let settings = deepshadow_scene::build::Settings::default();
    deepshadow_scene::build::build(&read, Path::new(&map), &settings, |_, _| {}).unwrap();
    let small = ["--resolution", "8x6", "--spp", "1"];
    let render = || run(&[&[&*scene, &*png, "--shadows", &*map], &small[..]].concat());
    assert_eq!(render(), (0, String::new(), String::new()));
    std::fs::write(&scene, SCENE.replace("-2, -1", "-2, -1.1")).unwrap();
    let (code, _, err) = render();
    let says = "light \"key\": its map has another camera than the scene";
    assert!(
        code == 0 && err.contains(says) && err.lines().count() == 1,
        "{err}"
    );
}

#[test]
fn a_picture_goes_to_standard_output_and_strangers_are_named() {
    let folder = folder();
    let [scene, png] = ["scene.toml", "a.png"].map(|n| path(&folder, n));
    let small = ["--no-shadows", "--resolution", "8x6", "--spp", "1"];
    let render = |scene: &str, out: &str| {
        let mut command = Command::cargo_bin("dsm-render").unwrap();
        let arguments = [&[scene, out], &small[..]].concat();
        let output = command.args(arguments).write_stdin(SCENE).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        output.stdout
    };
    assert_eq!(render(&scene, &png), b"");
    assert!(render("-", "-") == std::fs::read(&png).unwrap());
    std::fs::write(&png, b"\xff\xd8\xff\xe0").unwrap();
    let (code, _, err) = run(&[&png, &png, "--compare"]);
    assert_eq!(code, 1);
    assert!(
        err.contains("a.png: not a PNG image, but a JPEG image"),
        "{err}"
    );
    let (code, out, _) = run(&["--man"]);
    assert!(code == 0 && out.contains("dsm\\-render"), "{out}");
}
