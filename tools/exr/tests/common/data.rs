//! Finds shared test data outside the repository, for the tests of every tool.

use std::path::PathBuf;

/// The files in a folder of shared test data, or none if the folder does not exist.
pub fn data(folder: &str) -> Vec<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let Ok(entries) = std::fs::read_dir(root.join(folder)) else {
        println!("skipped: there is no folder shared/data/{folder}");
        return Vec::new();
    };
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.sort();
    files
}
