//! The integration tests of `deepshadow-render`: one module per subject, linked as one program.
//! `cargo test -p deepshadow-render --test all MODULE::` runs one module.

mod command;
mod picture;
mod shadows;
mod support;
