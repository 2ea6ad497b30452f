//! Integration tests of `deepshadow-exr`: one module per subject, in one program that links once.
//!
//! `cargo test -p deepshadow-exr --test all MODULE::` runs one module.

mod broken;
mod common;
mod files;
mod flat;
mod fuzz_replay;
#[path = "../../../tests/heap.rs"]
mod heap;
mod memory;
mod round_trip;
