//! The integration tests of `deepshadow-scene`: one module per subject, in one program that links
//! once.
//! `cargo test -p deepshadow-scene --test all MODULE::` runs one module.

mod demo;
mod fuzz_replay;
mod guide;
mod load_broken;
mod load_damage;
mod load_formats;
mod load_support;
mod maps;
mod program;
mod reference;
mod support;
mod transfer;
