//! The 64 bytes at either end of a file.

use super::ensure;
use super::layout::*;
use super::record::{Number, Record};
use crate::error::Place;
use crate::{Error, Result};

/// CRC-32 of a record without its own CRC, the last four bytes.
fn crc_of(record: &[u8]) -> u32 {
    crc32fast::hash(&record[..record.len() - 4])
}

/// [`ensure`] about the byte at `at` of the record that starts at byte `start` of the file.
fn ensure_at(holds: bool, rule: &'static str, start: u64, at: usize, what: &str) -> Result<()> {
    ensure(holds, rule, || what).map_err(|e| e.at(Place::byte(start + at as u64)))
}

/// The header, the same in every file of this version.
pub fn encode_header() -> [u8; HEADER_SIZE] {
    let mut h = [0; HEADER_SIZE];
    MAGIC.write(&mut h[HEADER_MAGIC..]);
    VERSION.write(&mut h[HEADER_VERSION..]);
    (HEADER_SIZE as u16).write(&mut h[HEADER_LENGTH..]);
    crc_of(&h).write(&mut h[HEADER_CRC..]);
    h
}

/// Checks that `h` is the header of a file of this version.
///
/// # Errors
/// `Corrupt` by the rules of section 3, `Unsupported` for another version.
pub fn check_header(h: &[u8; HEADER_SIZE]) -> Result<()> {
    let check = |holds, rule, at, what| ensure_at(holds, rule, 0, at, what);
    let what = "this is not a .dsm file, or it was damaged in a transfer";
    check(h[..8] == MAGIC, "HEADER-MAGIC", HEADER_MAGIC, what)?;
    let version = u16::read(&h[HEADER_VERSION..]);
    if version != VERSION {
        return Err(Error::unsupported(format!(
            "version {version} of the format (this is a reader of version {VERSION})"
        )));
    }
    let crc = u32::read(&h[HEADER_CRC..]);
    let what = "the header is damaged";
    check(crc_of(h) == crc, "HEADER-CRC", HEADER_CRC, what)?;
    let size = usize::from(u16::read(&h[HEADER_LENGTH..]));
    let what = "the header does not have 64 bytes";
    check(size == HEADER_SIZE, "HEADER-SIZE", HEADER_LENGTH, what)?;
    let is_zero = h[HEADER_RESERVED..HEADER_CRC].iter().all(|&b| b == 0);
    let what = "reserved bytes are not zero";
    check(is_zero, "HEADER-RESERVED", HEADER_RESERVED, what)
}

/// The positions of the parts of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trailer {
    /// Length of the whole file in bytes.
    pub file_length: u64,
    /// Offset at which the tiles end and the directory begins.
    pub directory_offset: u64,
    /// Offset at which the directory ends and the footer begins.
    pub footer_offset: u64,
    /// Size of the footer, with its padding.
    pub footer_size: u64,
    /// CRC-32 of the footer.
    pub footer_crc: u32,
}

impl Trailer {
    fn fields(&mut self, mut r: Record<'_>) {
        r.field(TRAILER_LENGTH, &mut self.file_length);
        r.field(TRAILER_DIRECTORY, &mut self.directory_offset);
        r.field(TRAILER_FOOTER, &mut self.footer_offset);
        r.field(TRAILER_FOOTER_SIZE, &mut self.footer_size);
        r.field(TRAILER_FOOTER_CRC, &mut self.footer_crc);
    }

    /// The bytes of the trailer.
    pub fn encode(mut self) -> [u8; TRAILER_SIZE] {
        let mut t = [0; TRAILER_SIZE];
        self.fields(Record::Write(&mut t));
        VERSION.write(&mut t[TRAILER_VERSION..]);
        COMMIT.write(&mut t[TRAILER_COMMIT..]);
        crc_of(&t).write(&mut t[TRAILER_CRC..]);
        t
    }

    /// The trailer of a file of `length` bytes whose last 64 bytes are `t`.
    ///
    /// # Errors
    /// `Corrupt` by the rules of section 4.
    pub fn parse(t: &[u8; TRAILER_SIZE], length: u64) -> Result<Trailer> {
        let start = length.saturating_sub(TRAILER_SIZE as u64);
        let check = |holds, rule, at, what: &str| ensure_at(holds, rule, start, at, what);
        let is_committed = t[TRAILER_COMMIT..TRAILER_CRC] == COMMIT;
        let what = "no commit mark: the file was cut off or never finished";
        check(is_committed, "TRAILER-COMMIT", TRAILER_COMMIT, what)?;
        let crc = u32::read(&t[TRAILER_CRC..]);
        let what = "the trailer is damaged";
        check(crc_of(t) == crc, "TRAILER-CRC", TRAILER_CRC, what)?;
        let version = u16::read(&t[TRAILER_VERSION..]);
        let what = "the trailer is of another version than the header";
        check(version == VERSION, "TRAILER-VERSION", TRAILER_VERSION, what)?;
        let is_zero = t[TRAILER_RESERVED..TRAILER_COMMIT].iter().all(|&b| b == 0);
        let what = "reserved bytes are not zero";
        check(is_zero, "TRAILER-RESERVED", TRAILER_RESERVED, what)?;

        let mut trailer = Trailer::default();
        trailer.fields(Record::Read(t));
        let (stated, directory) = (trailer.file_length, trailer.directory_offset);
        let (footer, size) = (trailer.footer_offset, trailer.footer_size);
        let what = &format!("the file has {length} bytes instead of {stated}");
        check(stated == length, "FILE-LENGTH", TRAILER_LENGTH, what)?;
        let aligned = |n: u64| n.is_multiple_of(ALIGN as u64);
        let inside = (HEADER_SIZE as u64..=footer).contains(&directory) && aligned(directory);
        let what = &format!("a directory at byte {directory}");
        check(inside, "DIRECTORY-RANGE", TRAILER_DIRECTORY, what)?;
        let end = [size, TRAILER_SIZE as u64]
            .into_iter()
            .try_fold(footer, u64::checked_add);
        let fits = aligned(footer) && aligned(size) && end == Some(length) && size <= 1 << 31;
        let what = &format!("a footer of {size} bytes at byte {footer}");
        check(fits, "FOOTER-RANGE", TRAILER_FOOTER, what)?;
        Ok(trailer)
    }
}
