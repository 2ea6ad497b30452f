//! Runs the fuzz target `deep_exr` over its seeds and regressions, without a fuzzer.
//!
//! `BLESS=1` rewrites the seeds.

#[path = "../../../fuzz/src/bytes.rs"]
#[allow(dead_code, reason = "only other targets use the rest")]
mod bytes;
#[path = "../../../fuzz/src/deep_exr.rs"]
mod deep_exr;
#[path = "../../../fuzz/src/deep_exr_legal.rs"]
mod deep_exr_legal;

use crate::common::*;
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
    for compression in COMPRESSIONS {
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
    // Descriptions of legal images with each compression; the bytes after the head give counts and
    // values.
    for (code, name) in ["none", "rle", "zips", "zstd"].into_iter().enumerate() {
        for (order, kind) in [(0, "lines"), (4, "upward"), (7, "tiles")] {
            let head = [4, 29, 60, 61, 7, 0b11_0110, 0x24, 62, code as u8, order];
            let values = (0..200u32).map(|i| (i * i / 7 % 251) as u8);
            let bytes = head.into_iter().chain(values).collect();
            out.push((format!("legal-{name}-{kind}"), bytes));
        }
    }
    let two = [
        3, 20, 60, 60, 4, 0, 60, 1, 0, 2, 0, 0, 9, 0, 0, 0, 30, 60, 60, 18,
    ];
    out.push(("legal-parts".into(), two.to_vec()));
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
