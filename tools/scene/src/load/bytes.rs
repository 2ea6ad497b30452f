//! Reads numbers of either byte order from bytes, with bounds checks.

use crate::error::Result;

use super::fault;

/// Byte order of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endian {
    /// The least significant byte comes first.
    #[default]
    Little,
    /// The most significant byte comes first.
    Big,
}

/// A position in a file's bytes.
#[derive(Clone, Copy, Debug)]
pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    endian: Endian,
}

impl<'a> Cursor<'a> {
    /// Starts at the first byte.
    pub fn new(bytes: &'a [u8], endian: Endian) -> Self {
        Cursor {
            bytes,
            at: 0,
            endian,
        }
    }

    /// Moves to a byte. It may be beyond the end; then there is nothing to read.
    pub fn at(self, at: usize) -> Self {
        Cursor { at, ..self }
    }

    /// The remaining bytes.
    pub fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// The next `n` bytes; `what` names them in errors.
    ///
    /// # Errors
    /// The file has fewer bytes left.
    pub fn take(&mut self, n: u64, what: &str) -> Result<&'a [u8]> {
        let rest = self.rest();
        match usize::try_from(n).ok().and_then(|n| rest.get(..n)) {
            Some(head) => {
                self.at += head.len();
                Ok(head)
            }
            None => fault(format!(
                "the file ends in its {what}: {n} bytes from byte {} on, and there are {}",
                self.at,
                rest.len()
            )),
        }
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N as u64, what)?);
        if self.endian == Endian::Big {
            out.reverse();
        }
        Ok(out)
    }

    /// The next u8.
    ///
    /// # Errors
    /// The file ends early. The same holds for the other types.
    pub fn u8(&mut self, what: &str) -> Result<u8> {
        self.array::<1>(what).map(|b| b[0])
    }

    /// The next u16.
    ///
    /// # Errors
    /// The file ends early.
    pub fn u16(&mut self, what: &str) -> Result<u16> {
        self.array(what).map(u16::from_le_bytes)
    }

    /// The next u32.
    ///
    /// # Errors
    /// The file ends early.
    pub fn u32(&mut self, what: &str) -> Result<u32> {
        self.array(what).map(u32::from_le_bytes)
    }

    /// The next u64.
    ///
    /// # Errors
    /// The file ends early.
    pub fn u64(&mut self, what: &str) -> Result<u64> {
        self.array(what).map(u64::from_le_bytes)
    }

    /// The next f32.
    ///
    /// # Errors
    /// The file ends early.
    pub fn f32(&mut self, what: &str) -> Result<f32> {
        self.u32(what).map(f32::from_bits)
    }
}
