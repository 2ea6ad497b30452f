//! Standard output that survives `| head`, and files that appear whole or not at all.

use std::fmt::Display;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use deepshadow::raw::AtomicFile;

use crate::{InFile, Result};

/// Lines on their way out. When the reader goes away, the rest is dropped without a word; any other
/// failure is kept for the end.
pub struct Output {
    out: BufWriter<Box<dyn Write>>,
    failed: Option<io::Error>,
    written: bool,
}

impl std::fmt::Debug for Output {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Output")
            .field("failed", &self.failed)
            .finish_non_exhaustive()
    }
}

impl Output {
    /// Standard output.
    pub fn standard() -> Self {
        Output::to(io::stdout())
    }

    /// Output to anything.
    pub fn to(out: impl Write + 'static) -> Self {
        Output {
            out: BufWriter::new(Box::new(out)),
            failed: None,
            written: false,
        }
    }

    /// Writes a line.
    pub fn line(&mut self, line: impl Display) {
        self.put(|out| writeln!(out, "{line}"));
    }

    /// Writes text as it is.
    pub fn text(&mut self, text: &str) {
        self.put(|out| out.write_all(text.as_bytes()));
    }

    /// Sets what follows apart from what was written before.
    pub fn section(&mut self) {
        if self.written {
            self.line("");
        }
    }

    /// Whether nothing more will arrive.
    pub fn is_closed(&self) -> bool {
        self.failed.is_some()
    }

    /// Sends on what is buffered, so that a complaint comes after it.
    pub fn settle(&mut self) {
        self.put(Write::flush);
    }

    /// Sends on what is buffered.
    ///
    /// # Errors
    /// The first failure of all, unless it was a reader who went away.
    pub fn flush(&mut self) -> io::Result<()> {
        self.settle();
        match self.failed.take() {
            Some(e) if e.kind() != ErrorKind::BrokenPipe => Err(e),
            _ => Ok(()),
        }
    }

    fn put(&mut self, write: impl FnOnce(&mut BufWriter<Box<dyn Write>>) -> io::Result<()>) {
        if self.failed.is_none() {
            self.written = true;
            self.failed = write(&mut self.out).err();
        }
    }
}

/// Text on one line in which nothing can move the cursor of a terminal: control characters are escaped.
pub fn one_line(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '\n' => out.push(' '),
            c if is_control(c) => out.extend(c.escape_default()),
            c => out.push(c),
        }
    }
    out
}

/// Whether a character controls a terminal, or turns the direction of text.
pub fn is_control(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Writes the file at `path`, which appears whole or not at all.
///
/// # Errors
/// `Failed`, naming the file.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(path).in_file(path)?;
    file.write_all(bytes).in_file(path)?;
    file.commit().in_file(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Fails(ErrorKind);

    impl Write for Fails {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Err(self.0.into())
        }
    }

    #[test]
    fn a_reader_who_goes_away_is_no_failure_but_a_full_disk_is() {
        for (kind, good) in [
            (ErrorKind::BrokenPipe, true),
            (ErrorKind::StorageFull, false),
        ] {
            let mut out = Output::to(Fails(kind));
            out.line("x".repeat(100_000));
            assert!(out.is_closed());
            assert_eq!(out.flush().is_ok(), good, "{kind:?}");
        }
    }
}
