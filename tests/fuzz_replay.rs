//! Runs the checks of the fuzz targets on their seeds and regressions, without a fuzzer.
#![allow(dead_code, reason = "the fuzzer uses the rest")]

#[path = "../fuzz/src/bytes.rs"]
mod bytes;
#[path = "../fuzz/src/compress.rs"]
mod compress;
#[path = "../fuzz/src/curves.rs"]
mod curves;
#[path = "../fuzz/src/decode_tile.rs"]
mod decode_tile;
#[path = "../fuzz/src/encode_decode.rs"]
mod encode_decode;
#[path = "../fuzz/src/naive.rs"]
pub mod naive;
#[path = "../fuzz/src/open_verify.rs"]
mod open_verify;

use std::path::Path;

use deepshadow::Compressor;

/// Runs a target on its seeds and regressions; fails if there are none.
fn replay(target: &str, run: impl Fn(&[u8])) {
    let mut count = 0;
    for kind in ["seeds", "regressions"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("fuzz")
            .join(kind)
            .join(target);
        for entry in std::fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            println!("{}", path.display());
            run(&std::fs::read(&path).unwrap());
            count += 1;
        }
    }
    assert!(count > 0, "no seeds for {target}");
}

#[test]
fn open_verify_holds_on_its_seeds() {
    replay("open_verify", open_verify::run);
}

#[test]
fn decode_tile_holds_on_its_seeds() {
    replay("decode_tile", decode_tile::run);
}

#[test]
fn encode_decode_holds_on_its_seeds() {
    replay("encode_decode", encode_decode::run);
}

#[test]
fn compress_holds_on_its_seeds() {
    for &compressor in Compressor::ALL {
        let name = format!("compress_{compressor:?}").to_lowercase();
        replay(&name, |data| compress::run(compressor, data));
    }
}

#[test]
fn open_verify_holds_on_every_conformance_vector() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("spec/vectors");
    for kind in ["valid", "invalid"] {
        for entry in std::fs::read_dir(folder.join(kind)).unwrap() {
            open_verify::run(&std::fs::read(entry.unwrap().path()).unwrap());
        }
    }
}
