//! What the fuzz targets check. Plain functions of bytes, so that `cargo test` replays the seeds and the regressions without a fuzzer
//! (`tests/fuzz_replay.rs`, and those of the same name in `tools/exr` and `tools/scene`, include these files).

pub mod bytes;
pub mod compress;
pub mod curves;
pub mod decode_tile;
pub mod deep_exr;
pub mod deep_exr_legal;
pub mod encode_decode;
pub mod load_object;
pub mod naive;
pub mod open_verify;
pub mod resign;
