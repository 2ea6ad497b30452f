//! What the command line tools share: how they fail, how they show progress.
//!
//! Each tool is a room of its own, [`info`] and [`convert`]; [`source`] reads deep images for both,
//! [`filter`] names filters for both.

pub mod convert;
pub mod filter;
pub mod info;
pub mod progress;
pub mod source;

use std::fmt;
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
        write!(f, "{}", line.replace('\n', " "))
    }
}

impl std::error::Error for Failure {}

impl From<deepshadow::Error> for Failure {
    fn from(e: deepshadow::Error) -> Self {
        Failure::Failed(e.to_string())
    }
}

impl From<deepshadow_exr::Error> for Failure {
    fn from(e: deepshadow_exr::Error) -> Self {
        Failure::Failed(e.to_string())
    }
}

impl From<std::io::Error> for Failure {
    fn from(e: std::io::Error) -> Self {
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
            eprintln!("{tool}: {failure}");
            ExitCode::from(match failure {
                Failure::Failed(_) => 1,
                Failure::Usage(_) => 2,
            })
        }
    }
}
