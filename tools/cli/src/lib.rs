//! The programs `dsm-info` ([`info`]) and `dsm-convert` ([`convert`]).
//!
//! [`source`] reads deep images for both.

pub mod convert;
pub mod info;
pub mod source;
