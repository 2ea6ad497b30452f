//! `dsm-info`: what is in a file.
