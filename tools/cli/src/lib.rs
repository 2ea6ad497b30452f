//! The programs `dsm-info` ([`info`]), `dsm-convert` ([`convert`]) and `dsm-join` ([`join`]).
//!
//! | module | shared by |
//! |---|---|
//! | [`source`] | `dsm-info` and `dsm-convert`: deep images |
//! | [`inputs`] | all: maps by name |
//! | [`label`] | `dsm-convert` and `dsm-join`: names and attributes of maps |
//! | [`runstats`] | `dsm-convert` and `dsm-join`: times and counts |

pub mod convert;
pub mod info;
pub mod inputs;
pub mod join;
pub mod label;
pub mod runstats;
pub mod source;
