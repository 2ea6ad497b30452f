//! `dsm-convert`: deep images to deep shadow maps, and back.
