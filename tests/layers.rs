//! The layer rule: each layer of the library uses only itself and the layers above it, and no two
//! files import each other.

use std::collections::{BTreeMap, BTreeSet};
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

/// The text of a file without its comments.
fn code_of(file: &Path) -> String {
    let text = fs::read_to_string(file).unwrap();
    let lines = text.lines().filter(|l| !l.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
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
            for word in uses(&code_of(&file)) {
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

/// The name of a module from the root on: `["io", "writer"]` is the file `src/io/writer.rs`.
type Module = Vec<String>;

/// The paths that each file of `src/` imports or re-exports.
fn imports() -> BTreeMap<Module, Vec<Vec<String>>> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let imports = |file: PathBuf| {
        let path = file.strip_prefix(&src).unwrap().with_extension("");
        let module = path.iter().map(|name| name.to_str().unwrap().to_owned());
        let module = module.filter(|name| !["lib", "mod"].contains(&name.as_str()));
        (module.collect(), declared(&code_of(&file)))
    };
    rust_files(&src).into_iter().map(imports).collect()
}

/// The paths in the `use` declarations of a file. Those of modules inside it are indented, and do
/// not count.
fn declared(code: &str) -> Vec<Vec<String>> {
    let (mut found, mut lines) = (Vec::new(), code.lines());
    while let Some(line) = lines.next() {
        let starts = ["use ", "pub use ", "pub(crate) use ", "pub(super) use "];
        let Some(first) = starts.iter().find_map(|start| line.strip_prefix(start)) else {
            continue;
        };
        let mut tree = first.to_owned();
        while !tree.contains(';') {
            tree.push_str(lines.next().unwrap());
        }
        found.extend(paths(tree.split(';').next().unwrap()));
    }
    found
}

/// The paths of a `use` tree.
fn paths(tree: &str) -> Vec<Vec<String>> {
    let Some((stem, group)) = tree.split_once('{') else {
        let path = tree.split(" as ").next().unwrap().split("::");
        return vec![path.map(|name| name.trim().to_owned()).collect()];
    };
    let (group, _) = group.rsplit_once('}').unwrap();
    let mut depth = 0;
    let parts = group.split(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    });
    let parts = parts.filter(|part| !part.trim().is_empty());
    parts
        .flat_map(|part| paths(&format!("{stem}{part}")))
        .collect()
}

/// The module that defines the item of a path in module `from`, found through re-exports; `None`
/// for an item of another crate.
fn home(
    imports: &BTreeMap<Module, Vec<Vec<String>>>,
    from: &Module,
    path: &[String],
) -> Option<Module> {
    let mut module = from.clone();
    for (i, name) in path.iter().enumerate() {
        let inner = [&module[..], std::slice::from_ref(name)].concat();
        match name.as_str() {
            "crate" => module.clear(),
            "self" => {}
            "super" => drop(module.pop()),
            _ if imports.contains_key(&inner) => module = inner,
            _ if i == 0 => return None,
            _ => {
                let same = |path: &&Vec<String>| module != *from && path.last() == Some(name);
                let again = imports[&module].iter().find(same);
                let further = again.and_then(|path| home(imports, &module, path));
                return further.or(Some(module));
            }
        }
    }
    Some(module)
}

#[test]
fn no_two_files_import_each_other() {
    let imports = imports();
    let mut edges = BTreeSet::new();
    for (module, paths) in &imports {
        let used = paths.iter().filter_map(|path| home(&imports, module, path));
        edges.extend(used.map(|used| (module.clone(), used)));
    }
    assert!(edges.len() > 200, "found only {} imports", edges.len());
    let both = |(a, b): &&(Module, Module)| a < b && edges.contains(&(b.clone(), a.clone()));
    let both = edges.iter().filter(both);
    let both: Vec<_> = both
        .map(|(a, b)| format!("{} and {}", a.join("::"), b.join("::")))
        .collect();
    assert!(both.is_empty(), "import each other:\n{}", both.join("\n"));
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

/// The macros that print panic if standard output or standard error is closed or full.
#[test]
fn no_program_prints_with_a_macro() {
    let tools = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools");
    let mut checked = 0;
    for tool in fs::read_dir(tools).unwrap() {
        for file in rust_files(&tool.unwrap().path().join("src")) {
            let text = fs::read_to_string(&file).unwrap();
            for name in ["print!", "println!", "eprint!", "eprintln!", "dbg!"] {
                let found = text.match_indices(name).find(|(at, _)| {
                    let before = text[..*at].chars().next_back();
                    before.is_none_or(|c| !c.is_alphanumeric() && c != '_')
                });
                assert!(found.is_none(), "{} uses {name}", file.display());
            }
            checked += 1;
        }
    }
    assert!(checked > 50, "found only {checked} files");
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
