//! Files into [`crate::geometry`]: nothing that a file says is believed before it is checked.
