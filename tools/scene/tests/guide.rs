//! Tests that the guide to scene files matches the program: its scenes load, and its tables name
//! every key, demo and file ending.

use std::collections::BTreeSet;
use std::path::Path;

use deepshadow_scene::demo;
use deepshadow_scene::load::ENDINGS;
use deepshadow_scene::scene::{Scene, file};

const GUIDE: &str = include_str!("../../../docs/scenes.md");

/// The text of each code block in this language.
fn blocks(language: &str) -> Vec<&'static str> {
    let fence = format!("```{language}\n");
    let block = |rest: &'static str| rest.split("```").next().unwrap_or_default();
    GUIDE.split(&*fence).skip(1).map(block).collect()
}

/// The text from a heading to the next.
fn section(heading: &str) -> &'static str {
    let start = GUIDE.find(&format!("\n## {heading}\n")).expect(heading);
    let text = &GUIDE[start + 4..];
    text.split("\n## ").next().unwrap()
}

/// The words in backticks in the first column of a section's table.
fn rows(heading: &str) -> BTreeSet<String> {
    let rows = section(heading).lines().filter_map(|l| {
        let cell = l.strip_prefix("| `")?;
        cell.split(" |").next()
    });
    let names = rows.flat_map(|cell| cell.split('`').step_by(2));
    let names = names.filter(|n| !n.trim().is_empty()).map(str::to_owned);
    names.collect()
}

/// Writes the files that the guide's scenes name: its own texts, a moving flag and a volume.
fn write_files(folder: &Path) {
    for text in blocks("text") {
        let first = text.lines().next().unwrap();
        if let Some(name) = first.strip_prefix("# ") {
            std::fs::write(folder.join(name), text).unwrap();
        }
    }
    for key in 0..3 {
        let flag = format!("v 0 0 0\nv 1 0 {key}\nv 0 1 0\nf 1 2 3\n");
        std::fs::write(folder.join(format!("flag.{key}.obj")), flag).unwrap();
    }
    let samples: Vec<u8> = (0..8 * 8 * 12u16).flat_map(u16::to_be_bytes).collect();
    std::fs::write(folder.join("head.raw"), samples).unwrap();
}

fn read(text: &str) -> Result<Scene, String> {
    let folder = tempfile::tempdir().unwrap();
    write_files(folder.path());
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).unwrap();
    file::read(&path).map_err(|e| e.to_string())
}

/// The valid names that the error for a wrong key or word lists.
fn known(text: &str) -> BTreeSet<String> {
    let refusal = read(text).unwrap_err();
    let names: BTreeSet<String> = match refusal.split_once("; there are ") {
        Some((_, list)) => list.split(", ").map(str::to_owned).collect(),
        None => {
            let names = refusal.split('`').skip(1).step_by(2).skip(1);
            names.map(str::to_owned).collect()
        }
    };
    assert!(names.len() > 1, "{refusal}");
    names
}

#[test]
fn every_scene_of_the_guide_is_read_and_its_lights_see_it() {
    let scenes = blocks("toml");
    assert!(scenes.len() > 4);
    for text in scenes {
        let scene = read(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        for light in &scene.lights {
            light
                .views(&scene)
                .unwrap_or_else(|e| panic!("{e}\n{text}"));
        }
    }
}

#[test]
fn every_key_has_a_row_and_every_row_is_a_key() {
    let tables = [
        ("The top of the file", "qqqqqqqqqqqq = 1"),
        ("Objects", "[[object]]\nqqqqqqqqqqqq = 1"),
        ("Lights", "[[light]]\nqqqqqqqqqqqq = 1"),
        ("Camera", "[camera]\nqqqqqqqqqqqq = 1"),
    ];
    for (heading, text) in tables {
        assert_eq!(rows(heading), known(text), "{heading}");
    }
    let moves = known("[[object]]\nmotion = [{ qqqqqqqqqqqq = 1 }]");
    assert!(moves.is_subset(&rows("Objects")), "{moves:?}");
}

#[test]
fn every_word_of_a_light_is_in_its_table() {
    let table = section("Lights");
    for key in ["type", "filter", "depth"] {
        for word in known(&format!("[[light]]\n{key} = \"qqqqqqqqqqqq\"")) {
            // The library knows these words, but a light refuses them.
            if ![("filter", "nearest"), ("depth", "unspecified")].contains(&(key, &*word)) {
                assert!(table.contains(&format!("`{word}`")), "{key}: {word}");
            }
        }
    }
}

#[test]
fn every_demo_has_a_row_with_its_parts() {
    let names: BTreeSet<_> = demo::names().map(|(name, _)| name.to_owned()).collect();
    assert_eq!(rows("Demos"), names);
    for name in names {
        let row = section("Demos").lines();
        let mut row = row.filter(|l| l.starts_with(&format!("| `{name}` |")));
        let parts = row.next().unwrap().split(" | ").nth(1).unwrap();
        let own = demo::by_name(&name, 0).unwrap().parts;
        let own: Vec<_> = own.iter().map(|p| format!("`{}`", p.name)).collect();
        assert_eq!(parts, own.join(", "), "{name}");
    }
}

#[test]
fn demos_that_are_the_same_for_every_seed_are_named() {
    let said = section("Chance");
    for (name, _) in demo::names() {
        let same = demo::by_name(name, 0) == demo::by_name(name, 1);
        assert_eq!(said.contains(&format!("`{name}`")), same, "{name}");
    }
}

#[test]
fn every_scene_in_the_folder_scenes_is_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/scenes");
    let files = std::fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().path());
    let scenes: Vec<_> = files
        .filter(|f| f.extension().is_some_and(|e| e == "toml"))
        .collect();
    assert!(!scenes.is_empty());
    for path in scenes {
        let scene = file::read(&path).unwrap_or_else(|e| panic!("{e}"));
        for light in &scene.lights {
            light.views(&scene).unwrap();
        }
    }
}

#[test]
fn every_ending_has_a_row() {
    let endings: BTreeSet<_> = ENDINGS.iter().map(|e| format!(".{e}")).collect();
    assert_eq!(rows("Files"), endings);
}

#[test]
fn the_defaults_of_lights_and_cameras_are_those_of_the_tables() {
    let text = "[[object]]\ndemo = \"box\"\n[[light]]\ndirection = [0, 0, -1]\n\
        [camera]\nposition = [0, 0, 9]\ntarget = [0, 0, 0]";
    let scene = read(text).unwrap();
    let (light, camera) = (&scene.lights[0], scene.camera.unwrap());
    let filter = format!("`{:?}`", light.filter).to_lowercase();
    let said = |heading: &str, key: &str, value: String| {
        let mut rows = section(heading).lines();
        let row = rows.find(|l| l.starts_with(&format!("| `{key}` |")));
        let cells: Vec<_> = row.unwrap().split(" | ").collect();
        assert_eq!(cells[cells.len() - 2], value, "{heading}: {key}");
    };
    said("Lights", "name", format!("`{}`", light.name));
    said("Lights", "resolution", light.resolution[0].to_string());
    said("Lights", "samples", light.samples.to_string());
    said("Lights", "filter", filter);
    said("Lights", "filter_width", light.filter_width.to_string());
    said("Camera", "angle", camera.angle.to_string());
    said("Camera", "resolution", camera.resolution[0].to_string());
    said("The top of the file", "seed", scene.seed.to_string());
}

#[test]
fn both_forms_of_a_transform_are_equal() {
    let scenes = blocks("toml");
    let text = scenes.iter().find(|s| s.contains("matrix")).unwrap();
    let scene = read(text).unwrap();
    let [a, b] = [0, 1].map(|i| scene.objects[i].motion[0]);
    assert!(a.abs_diff_eq(b, 1e-12), "{a} is not {b}");
}
