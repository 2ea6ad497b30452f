//! `dsm-info` on small files: what it prints, what it says in JSON, and how it fails.

mod against;
mod asked;
mod compared;
mod damaged;
mod drawn;
mod files;
mod looked_up;
mod strangers;
