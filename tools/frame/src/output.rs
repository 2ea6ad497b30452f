//! Standard output that survives `| head`, escaped text, and files that are written atomically.

use std::fmt::Display;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use deepshadow::raw::AtomicFile;

use crate::{Failure, InFile, Result};

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

    /// Writes a line, or several. Escapes control characters.
    pub fn line(&mut self, line: impl Display) {
        let line = escape(&line.to_string(), |c| match c {
            '\n' => c.into(),
            c => c.escape_default().to_string(),
        });
        self.put(|out| writeln!(out, "{line}"));
    }

    /// Writes text as it is, without a line end.
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
    /// `Failed` for the first error of all writes, unless the reader closed the pipe.
    pub fn flush(&mut self) -> Result<()> {
        self.settle();
        printed(self.failed.take().map_or(Ok(()), Err))
    }

    /// Calls `write` with the buffer.
    pub fn put(&mut self, write: impl FnOnce(&mut BufWriter<Box<dyn Write>>) -> io::Result<()>) {
        if self.failed.is_none() {
            self.written = true;
            self.failed = write(&mut self.out).err();
        }
    }
}

/// The result of a program that printed on standard output.
///
/// # Errors
/// `Failed` for an error, unless the reader closed the pipe.
pub fn printed(result: io::Result<()>) -> Result<()> {
    match result {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(Failure::Failed(format!(
            "cannot write to standard output: {e}"
        ))),
        _ => Ok(()),
    }
}

/// Returns `text` on one line with control characters escaped, so that it cannot move the cursor of
/// a terminal.
pub fn one_line(text: &str) -> String {
    escape(text, |c| match c {
        '\n' => " ".into(),
        c => c.escape_default().to_string(),
    })
}

/// Returns a JSON text with control characters escaped. It has the same meaning.
pub fn escape_json(text: &str) -> String {
    escape(text, |c| match c {
        // JSON has line ends only between its tokens.
        '\n' => c.into(),
        c => format!("\\u{:04x}", u32::from(c)),
    })
}

/// Replaces each control character of `text`.
fn escape(text: &str, replaced: impl Fn(char) -> String) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match is_control(c) {
            true => out += &replaced(c),
            false => out.push(c),
        }
    }
    out
}

/// Whether `c` is a control character or changes the order of text or its lines.
pub fn is_control(c: char) -> bool {
    const OTHERS: [char; 4] = ['\u{61c}', '\u{180e}', '\u{200e}', '\u{200f}'];
    let ranges = matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    c.is_control() || ranges || OTHERS.contains(&c)
}

/// Begins the file at `path`, which appears whole or not at all. Called before the work, so that a
/// path that cannot be written fails early.
///
/// # Errors
/// `Failed`, naming the file.
pub fn begin(path: &Path) -> Result<AtomicFile> {
    AtomicFile::create(path).in_file(path)
}

/// Writes the file at `path` atomically: it appears whole or not at all.
///
/// # Errors
/// `Failed`, naming the file.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    finish(begin(path)?, path, bytes)
}

/// Writes and publishes a file that [`begin`] began at `path`.
///
/// # Errors
/// `Failed`, naming the file.
pub fn finish(mut file: AtomicFile, path: &Path, bytes: &[u8]) -> Result<()> {
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

    /// Characters that a terminal would obey: C0, DEL, C1, and those that turn text around.
    const HOSTILE: &str = "\0\t\r\u{1b}\u{7f}\u{85}\u{9b}\u{61c}\u{200f}\u{2028}\u{202e}\u{2066}";

    #[test]
    fn every_control_character_is_escaped_and_other_text_is_not() {
        let clean = |text: &str| !text.chars().any(|c| is_control(c) && c != '\n');
        for escaped in [one_line(HOSTILE), escape_json(HOSTILE)] {
            assert!(clean(&escaped), "{escaped:?}");
            assert!(escaped.is_ascii(), "{escaped:?}");
        }
        assert_eq!(one_line("a\u{9b}2J\u{202e}b\nc"), r"a\u{9b}2J\u{202e}b c");
        assert_eq!(
            escape_json("{\n \"\u{9b}\u{202e}\""),
            "{\n \"\\u009b\\u202e\""
        );
        let words = "Gr\u{f6}\u{df}e, e\u{301}, \u{928}\u{94d}\u{200d}, \u{1f311}";
        assert_eq!(
            (one_line(words), escape_json(words)),
            (words.into(), words.into())
        );
    }

    #[test]
    fn lines_are_escaped_and_text_is_not() {
        let written = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
        struct Shared(std::sync::Arc<std::sync::Mutex<Vec<u8>>>);
        impl Write for Shared {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                self.0.lock().unwrap().write(bytes)
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let mut out = Output::to(Shared(written.clone()));
        out.line(format!("a{HOSTILE}b\nc"));
        out.text("\u{1b}");
        out.flush().unwrap();
        let text = String::from_utf8(written.lock().unwrap().clone()).unwrap();
        let (lines, raw) = text.split_at(text.len() - 1);
        assert_eq!((lines.lines().count(), raw), (2, "\u{1b}"));
        assert!(
            !lines.chars().any(|c| is_control(c) && c != '\n'),
            "{lines:?}"
        );
    }
}
