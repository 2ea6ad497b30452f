//! The header of PLY: lines of text with the format, and elements with their properties.

use crate::error::Result;

use super::super::text::{number, shown, wrong};
use super::super::{bytes::Endian, fault};

/// Encoding of the data after the header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Format {
    Text,
    Binary(Endian),
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// A property of an element.
#[derive(Clone, Debug, PartialEq)]
pub enum Property {
    /// A number: its name and type.
    One(String, Type),
    /// A list of numbers: its name, the type of its length, and the type of its entries.
    List(String, Type, Type),
}

/// A kind of element, and its number in the file.
#[derive(Clone, Debug)]
pub struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

/// The header, and the bytes after it.
#[derive(Debug)]
pub struct Header<'a> {
    pub format: Format,
    pub elements: Vec<Element>,
    /// Number of lines of the header.
    pub lines: u64,
    pub body: &'a [u8],
}

impl Type {
    fn named(name: &[u8]) -> Option<Type> {
        Some(match name {
            b"char" | b"int8" => Type::I8,
            b"uchar" | b"uint8" => Type::U8,
            b"short" | b"int16" => Type::I16,
            b"ushort" | b"uint16" => Type::U16,
            b"int" | b"int32" => Type::I32,
            b"uint" | b"uint32" => Type::U32,
            b"float" | b"float32" => Type::F32,
            b"double" | b"float64" => Type::F64,
            _ => return None,
        })
    }

    /// Size of a number in a binary file.
    pub fn bytes(self) -> u64 {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::F64 => 8,
        }
    }
}

impl Element {
    /// Index of the number property with this name.
    pub fn single(&self, name: &str) -> Option<usize> {
        let is = |p: &Property| matches!(p, Property::One(n, _) if n == name);
        self.properties.iter().position(is)
    }
}

impl<'a> Header<'a> {
    /// The header at the beginning of a file.
    pub fn parse(bytes: &'a [u8]) -> Result<Self> {
        let mut rest = bytes;
        let mut format = None;
        let mut elements: Vec<Element> = Vec::new();
        for n in 1.. {
            let Some(end) = rest.iter().position(|&b| b == b'\n') else {
                return match n {
                    1 => fault("does not begin with a line ply"),
                    _ => wrong(n, "the file ends in its header"),
                };
            };
            let (line, tail) = (&rest[..end], &rest[end + 1..]);
            rest = tail;
            let words: Vec<&[u8]> = line
                .split(u8::is_ascii_whitespace)
                .filter(|w| !w.is_empty())
                .collect();
            match words[..] {
                [b"ply"] if n == 1 => {}
                _ if n == 1 => return fault("does not begin with a line ply"),
                [] | [b"comment" | b"obj_info", ..] => {}
                [b"format", name, b"1.0"] => format = Some(format_named(n, name)?),
                [b"element", name, _] if elements.iter().any(|e| e.name == text(name)) => {
                    return wrong(n, format!("a second element {}", shown(name)));
                }
                [b"element", name, count] => elements.push(Element {
                    name: text(name),
                    count: match number(count) {
                        Some(count) => count,
                        None => return wrong(n, format!("{} is not a count", shown(count))),
                    },
                    properties: Vec::new(),
                }),
                [b"property", b"list", count, entry, name] => {
                    let property = Property::List(text(name), kind(n, count)?, kind(n, entry)?);
                    add(n, &mut elements, property)?;
                }
                [b"property", entry, name] => {
                    let property = Property::One(text(name), kind(n, entry)?);
                    add(n, &mut elements, property)?;
                }
                [b"end_header"] => {
                    return match format {
                        None => wrong(n, "the header names no format"),
                        Some(format) => Ok(Header {
                            format,
                            elements,
                            lines: n as u64,
                            body: rest,
                        }),
                    };
                }
                [word, ..] => return wrong(n, format!("{} is not understood", shown(word))),
            }
        }
        unreachable!("a file does not have so many lines")
    }
}

fn text(word: &[u8]) -> String {
    String::from_utf8_lossy(word).into_owned()
}

fn format_named(n: usize, name: &[u8]) -> Result<Format> {
    match name {
        b"ascii" => Ok(Format::Text),
        b"binary_little_endian" => Ok(Format::Binary(Endian::Little)),
        b"binary_big_endian" => Ok(Format::Binary(Endian::Big)),
        _ => wrong(n, format!("the format {} is not known", shown(name))),
    }
}

fn kind(n: usize, name: &[u8]) -> Result<Type> {
    match Type::named(name) {
        Some(kind) => Ok(kind),
        None => wrong(n, format!("the type {} is not known", shown(name))),
    }
}

fn add(n: usize, elements: &mut [Element], property: Property) -> Result<()> {
    match elements.last_mut() {
        Some(element) => {
            element.properties.push(property);
            Ok(())
        }
        None => wrong(n, "a property before the first element"),
    }
}
