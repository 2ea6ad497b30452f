//! `dsm-build SCENE OUT.dsm`.
fn main() {}
