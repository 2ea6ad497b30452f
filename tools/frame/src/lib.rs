//! Shared parts of the programs: arguments, failures, exit codes, progress, notes and output.
//!
//! | module | contents |
//! |---|---|
//! | this one | [`Failure`], its exit code, and [`InFile`], which adds a file name to it |
//! | [`args`] | options that every program takes, and parsers for their values |
//! | [`storage`] | options for the encoding of maps, in every program that writes maps |
//! | [`choice`](choice()) | options whose values are the names of a library enum |
//! | [`console`], [`progress`] | notes and progress on standard error |
//! | [`foreign`] | the kinds of files, by their first bytes |
//! | [`stream`] | inputs and outputs that may be pipes |
//! | `documents` | shell completions and man pages |
//! | [`output`] | standard output that survives a closed pipe, escaped text, and atomic files |
//! | `signals` | the end of a program by a signal |

pub mod args;
mod choice;
pub mod console;
mod documents;
pub mod foreign;
pub mod output;
pub mod progress;
#[cfg(unix)]
mod signals;
pub mod storage;
pub mod stream;

pub use choice::{Choice, Named, choice};

use std::fmt;
use std::io::Write;
use std::process::ExitCode;

/// Result of a tool.
pub type Result<T> = std::result::Result<T, Failure>;

/// Why a tool stops: one line for the user, and the exit code.
#[derive(Debug)]
pub enum Failure {
    /// The file or the operation failed: exit code 1.
    Failed(String),
    /// The arguments are wrong or contradict each other: exit code 2.
    Usage(String),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (line, advice) = match self {
            Failure::Failed(line) => (line, ""),
            Failure::Usage(line) => (line, " (try --help)"),
        };
        write!(f, "{}{advice}", output::one_line(line))
    }
}

/// Any error fails the operation. `Failure` itself does not implement `Error`, so that this
/// conversion does not conflict with the one from `Failure` to itself.
impl<E: std::error::Error> From<E> for Failure {
    fn from(e: E) -> Self {
        Failure::Failed(e.to_string())
    }
}

/// Adds the name of a file to a failure.
pub trait InFile<T> {
    /// Changes the line of the failure to `FILE: LINE`, unless it names the file already.
    ///
    /// # Errors
    /// The failure that it is called on.
    fn in_file(self, path: &std::path::Path) -> Result<T>;
}

impl<T, E: Into<Failure>> InFile<T> for std::result::Result<T, E> {
    fn in_file(self, path: &std::path::Path) -> Result<T> {
        self.map_err(|e| match e.into() {
            Failure::Failed(line) if !names_file(&line, path) => {
                Failure::Failed(format!("{}: {line}", path.display()))
            }
            failure => failure,
        })
    }
}

/// Whether `line` names the file at `path`, as a word of its own.
pub fn names_file(line: &str, path: &std::path::Path) -> bool {
    let path = path.to_string_lossy();
    let is_end = |c: Option<char>| c.is_none_or(|c| c.is_whitespace() || "\"':,;".contains(c));
    line.match_indices(&*path).any(|(at, _)| {
        let (before, after) = (&line[..at], &line[at + path.len()..]);
        is_end(before.chars().next_back()) && is_end(after.chars().next())
    })
}

/// Returns the exit code of a tool's result, and prints a failure in one line on standard error.
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_failure_names_its_file_once() {
        let named = |line: &str, path: &str| {
            let failed: Result<()> = Err(Failure::Failed(line.into()));
            failed.in_file(Path::new(path)).unwrap_err().to_string()
        };
        assert_eq!(named("Is a directory", "dir"), "dir: Is a directory");
        assert_eq!(
            named("cannot open dir: it is gone", "dir"),
            "cannot open dir: it is gone"
        );
        assert_eq!(
            named("a/b.dsm: damaged", "b.dsm"),
            "b.dsm: a/b.dsm: damaged"
        );
    }
}
