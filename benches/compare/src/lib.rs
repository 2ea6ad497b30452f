//! What the benches share.

pub mod plot;
