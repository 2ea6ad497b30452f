//! The integration tests of `deepshadow-render`, one module a subject, in one program: it links once.
//! `cargo test -p deepshadow-render --test all MODULE::` runs one module.

mod command;
mod picture;
mod shadows;
mod support;
