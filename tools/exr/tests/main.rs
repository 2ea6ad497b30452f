//! The integration tests of `deepshadow-exr`, one module a subject, in one program: it links once.
//! `cargo test -p deepshadow-exr --test all MODULE::` runs one module.

mod broken;
mod common;
mod files;
mod flat;
mod fuzz_replay;
mod round_trip;
