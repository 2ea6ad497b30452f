//! Standard output that survives `| head`, and files that are written atomically.

use std::fmt::Display;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use deepshadow::raw::AtomicFile;

use crate::{InFile, Result};

/// A buffered writer of lines. After the reader closes the pipe, it drops all output silently. It
/// keeps the first error and returns it at the end.
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

    /// Output to any writer.
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

    /// Writes text without a line end.
    pub fn text(&mut self, text: &str) {
        self.put(|out| out.write_all(text.as_bytes()));
    }

    /// Writes an empty line, unless nothing was written before.
    pub fn section(&mut self) {
        if self.written {
            self.line("");
        }
    }

    /// Whether an error has stopped the output.
    pub fn is_closed(&self) -> bool {
        self.failed.is_some()
    }

    /// Flushes the buffer, so that lines on standard error come after it. Keeps errors for later.
    pub fn settle(&mut self) {
        self.put(Write::flush);
    }

    /// Flushes the buffer.
    ///
    /// # Errors
    /// The first error of all writes, unless the reader closed the pipe.
    pub fn flush(&mut self) -> io::Result<()> {
        self.settle();
        match self.failed.take() {
            Some(e) if e.kind() != ErrorKind::BrokenPipe => Err(e),
            _ => Ok(()),
        }
    }

    /// Calls `write` with the buffer.
    pub fn put(&mut self, write: impl FnOnce(&mut BufWriter<Box<dyn Write>>) -> io::Result<()>) {
        if self.failed.is_none() {
            self.written = true;
            self.failed = write(&mut self.out).err();
        }
    }
}

/// Returns `text` on one line with control characters escaped, so that it cannot move the cursor of
/// a terminal.
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

/// Whether `c` is a control character or changes the direction of text.
pub fn is_control(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Writes the file at `path` atomically: it appears whole or not at all.
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
    fn a_closed_pipe_is_no_error_but_a_full_disk_is_one() {
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
