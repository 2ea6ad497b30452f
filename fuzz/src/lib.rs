//! The checks of the fuzz targets, as plain functions of bytes.
//!
//! `cargo test` runs them over the seeds and regressions, without a fuzzer: `tests/fuzz_replay.rs`,
//! and the files of the same name in `tools/exr` and `tools/scene`, include these modules.

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
