//! Runs the seeds and regressions of the fuzz target `load_object` without a fuzzer. `BLESS=1`
//! rewrites the seeds.

use std::path::{Path, PathBuf};

use crate::load_support::*;

fn folder(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fuzz")
        .join(kind)
        .join("load_object")
}

#[test]
fn seeds_and_regressions_pass() {
    if std::env::var_os("BLESS").is_some() {
        std::fs::create_dir_all(folder("seeds")).unwrap();
        for (name, bytes) in seeds() {
            std::fs::write(folder("seeds").join(name), bytes).unwrap();
        }
    }
    let mut count = 0;
    for kind in ["seeds", "regressions"] {
        for entry in std::fs::read_dir(folder(kind)).into_iter().flatten() {
            let path = entry.unwrap().path();
            println!("{}", path.display());
            laws::run(&std::fs::read(&path).unwrap());
            count += 1;
        }
    }
    assert!(count > 0, "no seeds");
    seeds().iter().for_each(|(_, bytes)| laws::run(bytes));
}
