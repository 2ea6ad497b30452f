//! The seeds and the regressions of the fuzz target `deep_exr`, without a fuzzer. `BLESS=1` writes the seeds anew.

mod common;
#[path = "../../../fuzz/src/deep_exr.rs"]
mod deep_exr;

use common::*;
use deepshadow_exr::*;
use std::path::{Path, PathBuf};

fn folder(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fuzz")
        .join(kind)
        .join("deep_exr")
}

fn seeds() -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    for compression in [
        Compression::None,
        Compression::Rle,
        Compression::Zips,
        Compression::Zstd,
    ] {
        for tiles in [None, Some(Tiles::new(2, 2))] {
            let window = rect(-1, 2, 5, 3);
            let mut part = Part::deep_scanline(window, channels());
            part.compression = compression;
            part.tiles = tiles;
            let name = format!(
                "{compression:?}-{}",
                if tiles.is_some() { "tiles" } else { "lines" }
            );
            out.push((
                name.to_lowercase(),
                file_of(&[part], &[image(window, &channels(), 3)]),
            ));
        }
    }
    let z = vec![
        Channel::new("A", SampleType::Half),
        Channel::new("Z", SampleType::Float),
    ];
    let (a, b) = (rect(0, 0, 2, 2), rect(0, 0, 3, 1));
    let mut parts = [
        Part::deep_scanline(a, z.clone()),
        Part::deep_scanline(b, z.clone()),
    ];
    (parts[0].name, parts[1].name) = (Some("a".into()), Some("b".into()));
    out.push((
        "parts".into(),
        file_of(&parts, &[image(a, &z, 1), image(b, &z, 2)]),
    ));
    out
}

#[test]
fn seeds_and_regressions_pass() {
    let mut count = 0;
    if std::env::var_os("BLESS").is_some() {
        for (name, bytes) in seeds() {
            std::fs::write(folder("seeds").join(name), bytes).unwrap();
        }
    }
    for kind in ["seeds", "regressions"] {
        for entry in std::fs::read_dir(folder(kind)).into_iter().flatten() {
            let path = entry.unwrap().path();
            println!("{}", path.display());
            deep_exr::run(&std::fs::read(&path).unwrap());
            count += 1;
        }
    }
    assert!(count > 0, "no seeds");
    seeds().iter().for_each(|(_, bytes)| deep_exr::run(bytes));
}
