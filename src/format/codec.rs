//! Codecs: stored bytes to decoded bytes of a known size, and back.

use std::cell::Cell;
use std::fmt;
use std::str::FromStr;

use crate::names::unknown;
use crate::{Error, Result, scratch};

/// How the bytes of tiles and of directory blocks are stored (`spec/format.md`, section 9).
///
/// With [`Codec::None`] tiles can be looked up in place in a mapped file. The others store
/// the delta planes of section 8.
///
/// Their names are `none`, `lz4` and `zstd:LEVEL`; `zstd` alone is level 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Codec {
    /// The decoded bytes.
    None,
    /// One LZ4 block: the fastest to decode of the small ones.
    Lz4,
    /// One Zstandard frame at this level, 1 to 22: the smallest.
    Zstd(i32),
}

impl Default for Codec {
    /// Zstandard at level 3 if this build has it, else LZ4.
    fn default() -> Self {
        if cfg!(feature = "zstd") {
            Codec::Zstd(ZSTD_LEVEL)
        } else {
            Codec::Lz4
        }
    }
}

/// Id of codec none.
pub const NONE: u8 = 0;
const LZ4: u8 = 1;
const ZSTD: u8 = 2;

/// The usual level of Zstandard.
const ZSTD_LEVEL: i32 = 3;
/// The descriptor of the largest window, of 2^27 bytes.
#[cfg(feature = "zstd")]
const ZSTD_WINDOW: u8 = (27 - 10) << 3;
const ZSTD_LEVELS: std::ops::RangeInclusive<i32> = 1..=22;

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Codec::Zstd(level) => f.pad(&format!("{}:{level}", name(ZSTD))),
            codec => f.pad(name(codec.id())),
        }
    }
}

impl FromStr for Codec {
    type Err = Error;

    /// # Errors
    /// `Input` for another word or level; the error lists the names.
    fn from_str(text: &str) -> Result<Self> {
        let found = match text.split_once(':') {
            None => Self::ALL.iter().copied().find(|c| name(c.id()) == text),
            Some((word, level)) if word == name(ZSTD) => {
                let level = level.parse().ok().filter(|l| ZSTD_LEVELS.contains(l));
                level.map(Codec::Zstd)
            }
            Some(_) => None,
        };
        found.ok_or_else(|| {
            let (zstd, least, most) = (name(ZSTD), ZSTD_LEVELS.start(), ZSTD_LEVELS.end());
            let mut names: Vec<_> = Self::ALL.iter().map(|c| name(c.id()).to_owned()).collect();
            names.push(format!("{zstd}:{least} to {zstd}:{most}"));
            unknown("codec", text, &names)
        })
    }
}

impl Codec {
    /// All codecs, each at its usual level.
    pub const ALL: &[Self] = &[Codec::None, Codec::Lz4, Codec::Zstd(ZSTD_LEVEL)];

    pub(crate) fn id(self) -> u8 {
        match self {
            Codec::None => NONE,
            Codec::Lz4 => LZ4,
            Codec::Zstd(_) => ZSTD,
        }
    }

    /// # Errors
    /// `Unsupported` for a codec that this build lacks, `Input` for a level that does not exist.
    pub(crate) fn check(self) -> Result<()> {
        match self {
            Codec::Zstd(_) if !cfg!(feature = "zstd") => {
                Err(Error::unsupported("this build has no zstd codec"))
            }
            Codec::Zstd(level) if !ZSTD_LEVELS.contains(&level) => Err(Error::input(format!(
                "zstd levels go from 1 to 22, not {level}"
            ))),
            _ => Ok(()),
        }
    }

    /// Appends the stored bytes of `decoded` to `out`, without padding.
    pub(crate) fn encode(self, decoded: &[u8], out: &mut Vec<u8>) -> Result<()> {
        match self {
            Codec::None => out.extend_from_slice(decoded),
            Codec::Lz4 => {
                let start = out.len();
                out.resize(
                    start + lz4_flex::block::get_maximum_output_size(decoded.len()),
                    0,
                );
                let size = lz4_flex::block::compress_into(decoded, &mut out[start..])
                    .map_err(|e| Error::input(format!("lz4: {e}")))?;
                out.truncate(start + size);
            }
            #[cfg(feature = "zstd")]
            Codec::Zstd(level) => zstd_encode(level, decoded, out)?,
            #[cfg(not(feature = "zstd"))]
            Codec::Zstd(_) => self.check()?,
        }
        Ok(())
    }
}

/// Name of a codec id, for display.
pub fn name(id: u8) -> &'static str {
    match id {
        NONE => "none",
        LZ4 => "lz4",
        ZSTD => "zstd",
        128.. => "private",
        _ => "unknown",
    }
}

/// Decodes `stored` to exactly `size` bytes and calls `f` with them.
///
/// The caller has checked `size` against the limits. The bytes lie in a buffer of the thread.
///
/// # Errors
/// `Corrupt` by `rule` if the bytes do not decode, `Unsupported` for an unknown codec. `f` is not
/// called then.
pub(crate) fn with_decoded<R>(
    id: u8,
    stored: &[u8],
    size: usize,
    rule: &'static str,
    f: impl FnOnce(&[u8]) -> R,
) -> Result<R> {
    thread_local! {
        static SCRATCH: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
    }
    if id == NONE {
        let n = stored.len();
        return match n == size {
            true => Ok(f(stored)),
            false => Err(Error::corrupt(
                rule,
                format!("{n} bytes stored as they are instead of {size}"),
            )),
        };
    }
    scratch::lend(&SCRATCH, |scratch| {
        match id {
            LZ4 => lz4_decode(stored, size, scratch),
            #[cfg(feature = "zstd")]
            ZSTD => zstd_decode(stored, size, scratch),
            _ => return Err(Error::unsupported(format!("codec {id} ({})", name(id)))),
        }
        .map_err(|what| Error::corrupt(rule, what))?;
        Ok(f(&scratch[..size]))
    })
}

/// Decodes an LZ4 block to the start of `out`.
fn lz4_decode(stored: &[u8], size: usize, out: &mut Vec<u8>) -> Decoded {
    // Decoding makes an LZ4 block less than 255 times larger. Rejects forged sizes before
    // allocating.
    if size / 255 > stored.len() {
        return Err(format!("{} bytes of lz4 cannot hold {size}", stored.len()));
    }
    if lz4_ends_well(stored) != Some(true) {
        return Err("lz4: the block does not end in enough literals".into());
    }
    match lz4_flex::block::decompress_into(stored, scratch::first(out, size)) {
        Ok(n) if n == size => Ok(()),
        Ok(n) => Err(format!("lz4 yields {n} bytes instead of {size}")),
        Err(e) => Err(format!("lz4: {e}")),
    }
}

/// Whether an LZ4 block ends as its format demands: after the last match come 5 literals or more,
/// and the match begins 12 bytes or more before the end. lz4_flex does not check this. `None` if a
/// sequence is cut off.
fn lz4_ends_well(mut block: &[u8]) -> Option<bool> {
    fn length(block: &mut &[u8], bits: u8) -> Option<usize> {
        let mut length = usize::from(bits);
        let mut more = if bits == 15 { 255 } else { 0 };
        while more == 255 {
            more = *block.split_off_first()?;
            length += usize::from(more);
        }
        Some(length)
    }
    let (mut decoded, mut last_match) = (0, None);
    loop {
        let token = *block.split_off_first()?;
        let literals = length(&mut block, token >> 4)?;
        block = block.get(literals..)?;
        decoded += literals;
        if block.is_empty() {
            return Some(last_match.is_none_or(|at| literals >= 5 && at + 12 <= decoded));
        }
        block = block.get(2..)?;
        last_match = Some(decoded);
        decoded += 4 + length(&mut block, token & 15)?;
    }
}

/// Nothing, or why the bytes are not what the codec wrote.
type Decoded = std::result::Result<(), String>;

#[cfg(feature = "zstd")]
fn zstd_encode(level: i32, decoded: &[u8], out: &mut Vec<u8>) -> Result<()> {
    use std::cell::RefCell;
    thread_local! {
        // A context is large: each thread keeps the one of its last level.
        static CONTEXT: RefCell<Option<(i32, zstd::bulk::Compressor<'static>)>> =
            const { RefCell::new(None) };
    }
    let failed = |e| Error::io("zstd could not compress", e);
    CONTEXT.with_borrow_mut(|slot| {
        if slot.as_ref().is_none_or(|(l, _)| *l != level) {
            *slot = Some((level, zstd::bulk::Compressor::new(level).map_err(failed)?));
        }
        let (_, compressor) = slot.as_mut().expect("made above");
        let start = out.len();
        out.resize(start + zstd::zstd_safe::compress_bound(decoded.len()), 0);
        let size = compressor
            .compress_to_buffer(decoded, &mut out[start..])
            .map_err(failed)?;
        out.truncate(start + size);
        Ok(())
    })
}

#[cfg(feature = "zstd")]
fn zstd_decode(stored: &[u8], size: usize, out: &mut Vec<u8>) -> Decoded {
    use std::cell::RefCell;
    use zstd::zstd_safe;
    thread_local! {
        static CONTEXT: RefCell<zstd_safe::DCtx<'static>> = RefCell::new(zstd_safe::DCtx::create());
    }
    if !stored.starts_with(&[0x28, 0xB5, 0x2F, 0xFD]) {
        return Err("no zstd frame".into());
    }
    // Without a single segment, the window follows the descriptor.
    let header = stored.get(4..6);
    if header.is_some_and(|h| h[0] & 0x20 == 0 && h[1] > ZSTD_WINDOW) {
        return Err("the zstd frame has a window of more than 128 MiB".into());
    }
    if zstd_safe::get_dict_id_from_frame(stored).is_some() {
        return Err("the zstd frame needs a dictionary".into());
    }
    if !matches!(zstd_safe::get_frame_content_size(stored), Ok(Some(n)) if n == size as u64) {
        return Err(format!("the zstd frame does not state {size} bytes"));
    }
    if zstd_safe::find_frame_compressed_size(stored) != Ok(stored.len()) {
        return Err("the zstd frame ends early or late".into());
    }
    // A block of a frame takes at least three bytes and yields at most 128 KiB. Rejects forged
    // sizes before allocating.
    if size >> 17 > stored.len() / 3 {
        return Err(format!("{} bytes of zstd cannot hold {size}", stored.len()));
    }
    let out = scratch::first(out, size);
    match CONTEXT.with_borrow_mut(|context| context.decompress(out, stored)) {
        Ok(n) if n == size => Ok(()),
        Ok(n) => Err(format!("zstd yields {n} bytes instead of {size}")),
        Err(code) => Err(format!("zstd: {}", zstd_safe::get_error_name(code))),
    }
}
