//! Lookups of deepshadow beside what else a renderer could use, in one process and one run.
mod flat;
mod maps;
#[path = "standin.rs"]
mod ours;
mod pcf;
mod queries;
mod reference;
mod scene;
mod timing;
mod walk;
fn main() {}
