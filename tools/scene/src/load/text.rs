//! Words and lines of text files, and errors with line numbers.

use crate::error::{Error, ErrorKind, Result};

/// Words between white space or commas, across lines.
#[derive(Clone, Debug)]
pub struct Words<'a> {
    rest: &'a [u8],
    line: u64,
}

impl<'a> Words<'a> {
    /// Starts at the first byte, on line 1.
    pub fn new(bytes: &'a [u8]) -> Self {
        Words::from_line(bytes, 1)
    }

    /// Starts at the first byte, on line `line`.
    pub fn from_line(bytes: &'a [u8], line: u64) -> Self {
        Words { rest: bytes, line }
    }

    /// Number of bytes left.
    pub fn left(&self) -> usize {
        self.rest.len()
    }

    /// The next word; `what` names it in errors.
    ///
    /// # Errors
    /// The file has no further word.
    pub fn word(&mut self, what: &str) -> Result<&'a [u8]> {
        let gap = |b: &u8| b.is_ascii_whitespace() || *b == b',';
        let start = self.rest.iter().position(|b| !gap(b));
        let Some(start) = start else {
            return self.wrong(format!("the file ends before {what}"));
        };
        let (skipped, rest) = self.rest.split_at(start);
        self.line += skipped.iter().filter(|&&b| b == b'\n').count() as u64;
        let end = rest.iter().position(gap).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        Ok(word)
    }

    /// The next word as a number.
    ///
    /// # Errors
    /// There is no further word, or it is not a number of this type.
    pub fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.word(what)?;
        match number(word) {
            Some(n) => Ok(n),
            None => self.wrong(format!("{} is not a number for {what}", shown(word))),
        }
    }

    /// An error on the current line.
    ///
    /// # Errors
    /// Always.
    pub fn wrong<T>(&self, what: String) -> Result<T> {
        Err(Error::new(
            ErrorKind::File,
            format!("line {}: {what}", self.line),
        ))
    }
}

/// Parses a number.
pub fn number<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Up to 24 characters of a word, quoted.
pub fn shown(word: &[u8]) -> String {
    let head: String = String::from_utf8_lossy(word).chars().take(24).collect();
    format!("{head:?}")
}

/// The lines of a file without line ends, with their numbers from 1.
pub fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let lines = bytes.split(|&b| b == b'\n').enumerate();
    lines.map(|(i, line)| (i + 1, line.strip_suffix(b"\r").unwrap_or(line)))
}

/// An error on this line.
///
/// # Errors
/// Always.
pub fn wrong<T>(line: usize, what: impl std::fmt::Display) -> Result<T> {
    Err(Error::new(ErrorKind::File, format!("line {line}: {what}")))
}
