//! The 64 bytes at either end of a file.

use byteorder::{ByteOrder, LittleEndian as LE};

use super::layout::*;
use crate::{Error, Place, Result};

fn crc_of(record: &[u8]) -> u32 {
    crc32fast::hash(&record[..record.len() - 4])
}

/// The header, the same in every file of this version.
pub fn encode_header() -> [u8; HEADER_SIZE] {
    let mut h = [0; HEADER_SIZE];
    h[..8].copy_from_slice(&MAGIC);
    LE::write_u16(&mut h[HEADER_VERSION..], VERSION);
    LE::write_u16(&mut h[HEADER_LENGTH..], HEADER_SIZE as u16);
    let crc = crc_of(&h);
    LE::write_u32(&mut h[HEADER_CRC..], crc);
    h
}

/// # Errors
/// `Corrupt` by the rules of section 3, `Unsupported` for another version.
pub fn check_header(h: &[u8; HEADER_SIZE]) -> Result<()> {
    let corrupt = |rule, what: &str, byte: usize| {
        Err(Error::corrupt(rule, what).at(Place::byte(byte as u64)))
    };
    if h[..8] != MAGIC {
        return corrupt(
            "HEADER-MAGIC",
            "this is not a .dsm file, or it was damaged in a transfer",
            0,
        );
    }
    let version = LE::read_u16(&h[HEADER_VERSION..]);
    if version != VERSION {
        return Err(Error::unsupported(format!(
            "version {version} of the format (this is a reader of version {VERSION})"
        )));
    }
    if crc_of(h) != LE::read_u32(&h[HEADER_CRC..]) {
        return corrupt("HEADER-CRC", "the header is damaged", HEADER_CRC);
    }
    if usize::from(LE::read_u16(&h[HEADER_LENGTH..])) != HEADER_SIZE {
        return corrupt(
            "HEADER-SIZE",
            "the header does not have 64 bytes",
            HEADER_LENGTH,
        );
    }
    if h[HEADER_RESERVED..HEADER_CRC].iter().any(|&b| b != 0) {
        return corrupt(
            "HEADER-RESERVED",
            "reserved bytes are not zero",
            HEADER_RESERVED,
        );
    }
    Ok(())
}

/// Where the parts of a file are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trailer {
    /// Length of the whole file in bytes.
    pub file_length: u64,
    /// Where the tiles end and the directory begins.
    pub directory_offset: u64,
    /// Where the directory ends and the footer begins.
    pub footer_offset: u64,
    /// Size of the footer with its padding.
    pub footer_size: u64,
    /// CRC-32 of the footer.
    pub footer_crc: u32,
}

impl Trailer {
    /// The bytes of the trailer.
    pub fn encode(&self) -> [u8; TRAILER_SIZE] {
        let mut t = [0; TRAILER_SIZE];
        LE::write_u64(&mut t[TRAILER_LENGTH..], self.file_length);
        LE::write_u64(&mut t[TRAILER_DIRECTORY..], self.directory_offset);
        LE::write_u64(&mut t[TRAILER_FOOTER..], self.footer_offset);
        LE::write_u64(&mut t[TRAILER_FOOTER_SIZE..], self.footer_size);
        LE::write_u32(&mut t[TRAILER_FOOTER_CRC..], self.footer_crc);
        LE::write_u16(&mut t[TRAILER_VERSION..], VERSION);
        t[TRAILER_COMMIT..TRAILER_COMMIT + 8].copy_from_slice(&COMMIT);
        let crc = crc_of(&t);
        LE::write_u32(&mut t[TRAILER_CRC..], crc);
        t
    }

    /// The trailer of a file of `length` bytes, of which `t` are the last 64.
    ///
    /// # Errors
    /// `Corrupt` by the rules of section 4.
    pub fn parse(t: &[u8; TRAILER_SIZE], length: u64) -> Result<Trailer> {
        let start = length.saturating_sub(TRAILER_SIZE as u64);
        let corrupt = |rule, what: String, field: usize| {
            Err(Error::corrupt(rule, what).at(Place::byte(start + field as u64)))
        };
        if t[TRAILER_COMMIT..TRAILER_COMMIT + 8] != COMMIT {
            return corrupt(
                "TRAILER-COMMIT",
                "no commit mark: the file was cut off or never finished".into(),
                TRAILER_COMMIT,
            );
        }
        if crc_of(t) != LE::read_u32(&t[TRAILER_CRC..]) {
            return corrupt("TRAILER-CRC", "the trailer is damaged".into(), TRAILER_CRC);
        }
        if LE::read_u16(&t[TRAILER_VERSION..]) != VERSION {
            return corrupt(
                "TRAILER-VERSION",
                "the trailer is of another version than the header".into(),
                TRAILER_VERSION,
            );
        }
        if t[TRAILER_RESERVED..TRAILER_COMMIT].iter().any(|&b| b != 0) {
            return corrupt(
                "TRAILER-RESERVED",
                "reserved bytes are not zero".into(),
                TRAILER_RESERVED,
            );
        }
        let trailer = Trailer {
            file_length: LE::read_u64(&t[TRAILER_LENGTH..]),
            directory_offset: LE::read_u64(&t[TRAILER_DIRECTORY..]),
            footer_offset: LE::read_u64(&t[TRAILER_FOOTER..]),
            footer_size: LE::read_u64(&t[TRAILER_FOOTER_SIZE..]),
            footer_crc: LE::read_u32(&t[TRAILER_FOOTER_CRC..]),
        };
        if trailer.file_length != length {
            let what = format!(
                "the file has {length} bytes instead of {}",
                trailer.file_length
            );
            return corrupt("FILE-LENGTH", what, TRAILER_LENGTH);
        }
        let (directory, footer) = (trailer.directory_offset, trailer.footer_offset);
        if directory < HEADER_SIZE as u64 || directory > footer || directory % ALIGN as u64 != 0 {
            return corrupt(
                "DIRECTORY-RANGE",
                format!("a directory at byte {directory}"),
                TRAILER_DIRECTORY,
            );
        }
        let end = footer
            .checked_add(trailer.footer_size)
            .and_then(|n| n.checked_add(TRAILER_SIZE as u64));
        let aligned =
            footer % ALIGN as u64 == 0 && trailer.footer_size.is_multiple_of(ALIGN as u64);
        if !aligned || end != Some(length) || trailer.footer_size > 1 << 31 {
            let what = format!("a footer of {} bytes at byte {footer}", trailer.footer_size);
            return corrupt("FOOTER-RANGE", what, TRAILER_FOOTER);
        }
        Ok(trailer)
    }
}
