//! JSON documents whose long lists are written item by item.

use std::io::{self, Write};

use serde::ser::{Serialize, SerializeSeq, Serializer};
use serde_json::Value;

use deepshadow_frame::output::{Output, escape_json};

/// Calls a function with each item of a list.
pub type Items = Box<dyn Fn(&mut dyn FnMut(Value))>;

/// A part of a document.
pub enum Part {
    /// A value.
    Value(Value),
    /// A list that need not fit in memory.
    List(Items),
    /// Named parts.
    Object(Vec<(String, Part)>),
}

impl From<Value> for Part {
    fn from(value: Value) -> Self {
        Part::Value(value)
    }
}

impl Serialize for Part {
    fn serialize<S: Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        match self {
            Part::Value(value) => value.serialize(out),
            Part::List(items) => {
                let mut list = out.serialize_seq(None)?;
                let mut written = Ok(());
                items(&mut |item| {
                    if written.is_ok() {
                        written = list.serialize_element(&item);
                    }
                });
                written?;
                list.end()
            }
            Part::Object(parts) => out.collect_map(parts.iter().map(|(name, part)| (name, part))),
        }
    }
}

impl Part {
    /// Writes the part, indented by two columns if it is an item of a list.
    pub fn write(&self, out: &mut Output, is_item: bool) {
        out.put(|out| {
            let out = Escaped(out);
            let written = match is_item {
                true => serde_json::to_writer_pretty(Indented(out), self),
                false => serde_json::to_writer_pretty(out, self),
            };
            Ok(written?)
        });
    }
}

/// Escapes control characters. serde_json writes no character in two pieces.
struct Escaped<W>(W);

impl<W: Write> Write for Escaped<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = std::str::from_utf8(bytes).map_err(io::Error::other)?;
        self.0.write_all(escape_json(text).as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Indents all lines but the first.
struct Indented<W>(W);

impl<W: Write> Write for Indented<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for line in bytes.split_inclusive(|&b| b == b'\n') {
            self.0.write_all(line)?;
            if line.ends_with(b"\n") {
                self.0.write_all(b"  ")?;
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}
