//! No line of our Rust code is longer than 100 columns, comments included.

use std::path::Path;

/// Collects the lines of the Rust files under `path` that are too long.
fn collect(path: &Path, long: &mut Vec<String>) {
    if path.is_dir() {
        if path.ends_with("target") {
            return;
        }
        for entry in std::fs::read_dir(path).unwrap() {
            collect(&entry.unwrap().path(), long);
        }
    } else if path.extension().is_some_and(|e| e == "rs") {
        for (i, line) in std::fs::read_to_string(path).unwrap().lines().enumerate() {
            if line.chars().count() > 100 {
                long.push(format!("{}:{}", path.display(), i + 1));
            }
        }
    }
}

#[test]
fn no_line_is_longer_than_100_columns() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut long = Vec::new();
    for folder in ["src", "tools", "tests", "benches", "examples", "fuzz"] {
        let path = root.join(folder);
        assert!(path.is_dir(), "{}", path.display());
        collect(&path, &mut long);
    }
    let list = long.join("\n");
    assert!(long.is_empty(), "{} lines:\n{list}", long.len());
}
