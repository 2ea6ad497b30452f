//! The layer rule: each layer of the library uses only itself and the layers above it.

use std::fs;
use std::path::{Path, PathBuf};

/// The layers, the topmost first, as in `lib.rs`. The files beside `lib.rs` serve all layers.
const LAYERS: [&str; 6] = ["function", "map", "format", "io", "cache", "lookup"];

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files
}

/// The names that `lib.rs` re-exports from a layer, and that layer.
fn root_names() -> Vec<(String, &'static str)> {
    let lib = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    let mut names = Vec::new();
    for statement in lib.split("pub use ").skip(1) {
        let statement = statement.split(';').next().unwrap();
        let Some(layer) = LAYERS.into_iter().find(|l| statement.starts_with(l)) else {
            continue;
        };
        let list = statement
            .rsplit("::")
            .next()
            .unwrap()
            .trim_matches(['{', '}', ' ', '\n']);
        let list = statement
            .split_once('{')
            .map_or(list, |(_, list)| list.trim_end_matches('}'));
        names.extend(
            list.split(',')
                .map(|n| (n.trim().to_string(), layer))
                .filter(|(n, _)| !n.is_empty()),
        );
    }
    assert!(
        names.len() > 20,
        "lib.rs has too few re-exports to be parsed correctly: {names:?}"
    );
    names
}

/// The words that follow `crate::` in `text`; a group in braces counts as all its words.
fn uses(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    for part in text.split("crate::").skip(1) {
        let end = part
            .find([';', '(', ')', ' ', ',', '<', '>', '`', ']'])
            .unwrap_or(part.len());
        match part.strip_prefix('{') {
            Some(group) => {
                let group = group.split(';').next().unwrap_or("");
                words.extend(
                    group
                        .split([',', '{', '}'])
                        .map(|w| w.trim().split("::").next().unwrap().to_string()),
                );
            }
            None => words.push(part[..end].split("::").next().unwrap().to_string()),
        }
    }
    words
}

#[test]
fn each_layer_uses_only_the_layers_above_it() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let root = root_names();
    let mut checked = 0;
    for (rank, layer) in LAYERS.into_iter().enumerate() {
        for file in rust_files(&src.join(layer)) {
            let text = fs::read_to_string(&file).unwrap();
            let code: String = text
                .lines()
                .filter(|l| !l.trim_start().starts_with("//"))
                .collect::<Vec<_>>()
                .join("\n");
            for word in uses(&code) {
                let used = LAYERS.into_iter().find(|l| *l == word).or_else(|| {
                    root.iter()
                        .find(|(name, _)| *name == word)
                        .map(|(_, layer)| *layer)
                });
                if let Some(used) = used {
                    let used_rank = LAYERS.iter().position(|l| *l == used).unwrap();
                    assert!(
                        used_rank <= rank,
                        "{} is in layer {layer} but uses crate::{word} of {used}",
                        file.display()
                    );
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 20, "found only {checked} uses");
}

#[test]
fn the_library_depends_on_no_image_format_and_no_tool() {
    let manifest =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap();
    let package = manifest
        .split("[dependencies]")
        .nth(1)
        .unwrap()
        .split("\n[")
        .next()
        .unwrap();
    for foreign in ["exr", "png", "clap", "wgpu", "deepshadow-"] {
        assert!(
            !package.lines().any(|l| l.starts_with(foreign)),
            "the library depends on {foreign}"
        );
    }
}

/// The names of the workspace's own crates that the manifest of the tool `tool` depends on.
fn own_dependencies(tool: &str) -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tools/{tool}/Cargo.toml"));
    let manifest = fs::read_to_string(path).unwrap();
    let tables = manifest.split("\n[").filter(|table| {
        let name = table.split(']').next().unwrap();
        name.ends_with("dependencies")
    });
    tables
        .flat_map(str::lines)
        .filter_map(|line| line.split(['=', '.', ' ']).next())
        .filter(|name| name.starts_with("deepshadow"))
        .map(String::from)
        .collect()
}

#[test]
fn no_program_depends_on_another_program() {
    let tools = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools");
    let mut names: Vec<_> = fs::read_dir(tools)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["cli", "exr", "frame", "render", "scene"]);
    for (tool, allowed) in [
        ("exr", &[][..]),
        ("frame", &["deepshadow"]),
        ("cli", &["deepshadow", "deepshadow-exr", "deepshadow-frame"]),
        ("scene", &["deepshadow", "deepshadow-frame"]),
        // dsm-render reads the scenes of the library deepshadow-scene; it runs no other program.
        (
            "render",
            &["deepshadow", "deepshadow-frame", "deepshadow-scene"],
        ),
    ] {
        for name in own_dependencies(tool) {
            assert!(allowed.contains(&name.as_str()), "{tool} depends on {name}");
        }
    }
    assert!(
        own_dependencies("cli").len() >= 3,
        "the manifest was not understood"
    );
}
