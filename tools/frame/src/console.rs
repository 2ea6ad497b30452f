//! What a program says beside its results: progress and notes, on standard error.

use std::fmt::Display;
use std::io::Write;

use crate::output::one_line;
use crate::progress::Bar;

/// Standard error of a program, as loud as its user asked for.
#[derive(Clone, Copy, Debug)]
pub struct Console {
    program: &'static str,
    quiet: bool,
    verbose: bool,
}

impl Console {
    /// For the program of this name.
    pub fn new(program: &'static str, quiet: bool, verbose: bool) -> Self {
        Console {
            program,
            quiet,
            verbose,
        }
    }

    /// Prints a line that users should know of, unless they asked for quiet.
    pub fn note(&self, line: impl Display) {
        if !self.quiet {
            self.line(line);
        }
    }

    /// Prints a line if users asked for more.
    pub fn detail(&self, line: impl Display) {
        if self.verbose {
            self.line(line);
        }
    }

    /// A progress bar for work that is called `what`; it shows nothing if users asked for quiet.
    pub fn bar(&self, what: &'static str) -> Bar {
        Bar::new(what, !self.quiet)
    }

    /// A closed or full standard error is no failure.
    fn line(&self, line: impl Display) {
        let line = one_line(&line.to_string());
        let _ = writeln!(std::io::stderr(), "{}: {line}", self.program);
    }
}
