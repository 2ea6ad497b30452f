//! Progress and notes of a program, on standard error.

use std::fmt::Display;
use std::io::Write;

use crate::output::one_line;
use crate::progress::Bar;

/// Standard error of a program. `--quiet` and `--verbose` decide which lines it prints.
#[derive(Clone, Copy, Debug)]
pub struct Console {
    program: &'static str,
    quiet: bool,
    verbose: bool,
}

impl Console {
    /// Creates the console of the program called `program`.
    pub fn new(program: &'static str, quiet: bool, verbose: bool) -> Self {
        Console {
            program,
            quiet,
            verbose,
        }
    }

    /// Prints a line, unless the user asked for `--quiet`.
    pub fn note(&self, line: impl Display) {
        if !self.quiet {
            self.line(line);
        }
    }

    /// Prints a failure after which the program goes on.
    pub fn error(&self, line: impl Display) {
        self.line(line);
    }

    /// Prints a line if the user asked for `--verbose`.
    pub fn detail(&self, line: impl Display) {
        if self.verbose {
            self.line(line);
        }
    }

    /// Returns a progress bar with the label `what`. It stays invisible with `--quiet`.
    pub fn bar(&self, what: &'static str) -> Bar {
        Bar::new(what, !self.quiet)
    }

    /// Ignores errors: a closed or full standard error must not stop the program.
    fn line(&self, line: impl Display) {
        let line = one_line(&line.to_string());
        let _ = writeln!(std::io::stderr(), "{}: {line}", self.program);
    }
}
