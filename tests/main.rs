//! The integration tests of `deepshadow`: one program, with one module for each subject.
//!
//! `cargo test -p deepshadow --test all MODULE::` runs one module.

mod attacks;
mod cache;
mod cache_account;
mod cache_arenas;
mod cache_heap;
mod cache_in_place;
mod cache_support;
mod cache_threads;
mod columns;
mod compress;
mod compress_support;
mod damage;
mod finished;
mod function_deep;
mod function_exact;
mod function_sweep;
mod function_transmittance;
mod function_view;
mod function_visibility;
mod fuzz_replay;
mod groups;
mod heap;
mod hexdump;
mod join;
mod layers;
mod lookup;
mod map;
mod names;
mod publish;
mod random;
#[path = "../fuzz/src/resign.rs"]
mod resign;
mod roundtrip;
mod support;
mod tiles;
mod vectors;
mod vectors_support;
mod world;
mod world_support;
