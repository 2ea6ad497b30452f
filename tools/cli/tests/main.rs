//! The integration tests of `deepshadow-cli`, one module a subject, in one program: it links once.
//! `cargo test -p deepshadow-cli --test all MODULE::` runs one module.

mod convert;
mod convert_refusals;
mod convert_slice;
mod convert_support;
mod info;
mod join;
#[cfg(unix)]
mod memory;
#[cfg(target_os = "linux")]
mod outputs;
mod running;
mod streams;
