//! What every program shares: arguments, failures and exit codes, progress and notes, output.
//!
//! | module | contents |
//! |---|---|
//! | this one | [`Failure`], its exit code, and [`InFile`], which adds the name of a file |
//! | [`args`] | options that every program takes, and how values are written |
//! | [`storage`] | options for how maps are stored, of every program that writes them |
//! | [`choice`] | options whose values are names of the library |
//! | [`console`], [`progress`] | notes and progress on standard error |
//! | [`output`] | standard output that survives `| head`, and files that appear whole or not at all |

pub mod args;
mod choice;
pub mod console;
pub mod output;
pub mod progress;
pub mod storage;

pub use choice::{Choice, choice};

use std::fmt;
use std::io::Write;
use std::process::ExitCode;

/// Result of what a tool does.
pub type Result<T> = std::result::Result<T, Failure>;

/// Why a tool stops: one line for the user, and the exit code.
#[derive(Debug)]
pub enum Failure {
    /// The file or the operation failed: exit code 1.
    Failed(String),
    /// The arguments make no sense together: exit code 2.
    Usage(String),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Failure::Failed(line) | Failure::Usage(line)) = self;
        f.write_str(&output::one_line(line))
    }
}

/// Any error fails the operation. (`Failure` itself is no `Error`, so that this covers them all.)
impl<E: std::error::Error> From<E> for Failure {
    fn from(e: E) -> Self {
        Failure::Failed(e.to_string())
    }
}

/// Adds the name of a file to what went wrong with it.
pub trait InFile<T> {
    /// `FILE: what went wrong`.
    ///
    /// # Errors
    /// The one it is called on.
    fn in_file(self, path: &std::path::Path) -> Result<T>;
}

impl<T, E: Into<Failure>> InFile<T> for std::result::Result<T, E> {
    fn in_file(self, path: &std::path::Path) -> Result<T> {
        self.map_err(|e| match e.into() {
            Failure::Failed(line) if !line.contains(&*path.to_string_lossy()) => {
                Failure::Failed(format!("{}: {line}", path.display()))
            }
            failure => failure,
        })
    }
}

/// Turns the result of a tool into its exit code, its failure into one line on standard error.
pub fn exit(tool: &str, result: Result<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // A closed or full standard error changes nothing.
            let _ = writeln!(std::io::stderr(), "{tool}: {failure}");
            ExitCode::from(match failure {
                Failure::Failed(_) => 1,
                Failure::Usage(_) => 2,
            })
        }
    }
}
