//! `.dsm` to NumPy: an uncompressed zip archive of `.npy` arrays, for `numpy.load`.
//!
//! | array | type | shape | contents |
//! |---|---|---|---|
//! | `offsets` | u64 | h w + 1 | first vertex of each pixel, row by row; last, the count |
//! | `z` | f32 | n | depths |
//! | `visibility` | f32 | n, or n x 3 with colour | visibilities; mono pixels repeat them |
//! | `mono` | bool | h w | whether the pixel has one channel |
//! | `max_error` | f64 | none | largest error that the file states for the level |
//!
//! Each array goes to a temporary file first. No array has to fit in memory, and all sizes are
//! known when the archive is written.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::Path;

use deepshadow::{DsmFile, Limits};

use super::args::Args;
use super::level::Level;
use crate::inputs::find_map;
use crate::runstats::Clock;
use deepshadow_frame::console::Console;
use deepshadow_frame::output::{Output, begin};
use deepshadow_frame::{Failure, InFile, Result};

/// Converts one level of one map.
///
/// # Errors
/// `Failed` for an unknown map or level, for damage, and if the output cannot be written.
pub fn convert(args: &Args, file: &DsmFile, console: Console) -> Result<()> {
    let clock = Clock::default();
    let map = find_map(file, args.map.as_deref())?;
    let level = Level::new(file, map.level(args.level.unwrap_or(0)))?;
    let output = args.output.as_path();
    // Created first, so that a folder without write access fails before the work.
    let mut archive = begin(output)?;
    let folder = output.parent().filter(|f| *f != Path::new(""));
    let folder = folder.unwrap_or(Path::new("."));

    let shape = level.shape;
    let channels: u64 = if level.is_coloured()? { 3 } else { 1 };
    let (pixels, vertices) = (level.pixels(), file.level(level.id)?.vertices);
    Limits::check_content(9 * pixels + 4 * (1 + channels) * vertices, "arrays")?;
    let new = || Array::new(folder).in_file(output);
    let (mut offsets, mut z, mut visibility, mut mono) = (new()?, new()?, new()?, new()?);
    offsets.put(&0u64.to_le_bytes()).in_file(output)?;
    let mut n = 0u64;
    let mut bar = console.bar("converting");
    for band in level.bands() {
        let (rows, band) = band?;
        let mut put = || {
            for f in rows.clone().flat_map(|y| band.row(y)) {
                n += f.len() as u64;
                offsets.put(&n.to_le_bytes())?;
                mono.put(&[u8::from(f.channels() == 1)])?;
                for depth in f.depths() {
                    z.put(&depth.to_le_bytes())?;
                }
                for i in 0..f.len() {
                    for c in 0..channels as usize {
                        visibility.put(&(f.value(i, c) as f32).to_le_bytes())?;
                    }
                }
            }
            io::Result::Ok(())
        };
        put().in_file(output)?;
        bar.set(rows.end.into(), shape.height.into());
    }
    drop(bar);
    let mut error = new()?;
    let max_error = file.level(level.id)?.max_error;
    error.put(&max_error.to_le_bytes()).in_file(output)?;

    let per_vertex = match channels {
        1 => format!("({n},)"),
        _ => format!("({n}, {channels})"),
    };
    let mut zip = Zip::new(&mut archive);
    let finish = || {
        zip.add(
            "offsets.npy",
            &npy("<u8", &format!("({},)", pixels + 1)),
            offsets,
        )?;
        zip.add("z.npy", &npy("<f4", &format!("({n},)")), z)?;
        zip.add("visibility.npy", &npy("<f4", &per_vertex), visibility)?;
        zip.add("mono.npy", &npy("|b1", &format!("({pixels},)")), mono)?;
        zip.add("max_error.npy", &npy("<f8", "()"), error)?;
        zip.finish()
    };
    finish()
        .map_err(|e| Failure::Failed(format!("cannot write: {e}")))
        .in_file(output)?;
    archive.commit().in_file(output)?;
    if args.runstats {
        clock.report_file(output, Output::standard())?;
    }
    Ok(())
}

/// Returns the header of a `.npy` file, version 1.0, padded so that the data begins at a multiple
/// of 64 bytes.
fn npy(descr: &str, shape: &str) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    let padding = (64 - (10 + text.len() + 1) % 64) % 64;
    let length = (text.len() + padding + 1) as u16;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(length.to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.resize(bytes.len() + padding, b' ');
    bytes.push(b'\n');
    bytes
}

/// The data of an array, in a temporary file.
struct Array {
    file: BufWriter<File>,
    bytes: u64,
}

impl Array {
    fn new(folder: &Path) -> io::Result<Self> {
        let file = tempfile::tempfile_in(folder)?;
        Ok(Array {
            file: BufWriter::with_capacity(1 << 16, file),
            bytes: 0,
        })
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes)
    }

    /// Calls `take` with each piece of the file.
    fn each(file: &mut File, mut take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        file.rewind()?;
        let mut buffer = vec![0; 1 << 18];
        loop {
            match file.read(&mut buffer)? {
                0 => return Ok(()),
                n => take(&buffer[..n])?,
            }
        }
    }
}

/// A member of the archive. Both its local header and the central directory need these fields.
struct Member {
    name: &'static str,
    crc: u32,
    bytes: u64,
    offset: u64,
}

/// A zip archive of stored members, with 64-bit sizes where they are needed.
struct Zip<W> {
    out: W,
    position: u64,
    members: Vec<Member>,
}

/// Sizes and offsets from this value on need the 64-bit fields.
const FULL: u64 = u32::MAX as u64;

impl<W: Write> Zip<W> {
    fn new(out: W) -> Self {
        Zip {
            out,
            position: 0,
            members: Vec::new(),
        }
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.position += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    fn add(&mut self, name: &'static str, head: &[u8], array: Array) -> io::Result<()> {
        let mut file = array.file.into_inner().map_err(|e| e.into_error())?;
        let mut crc = crc32fast::Hasher::new();
        crc.update(head);
        Array::each(&mut file, |piece| {
            crc.update(piece);
            Ok(())
        })?;
        let member = Member {
            name,
            crc: crc.finalize(),
            bytes: head.len() as u64 + array.bytes,
            offset: self.position,
        };
        let mut extra = Vec::new();
        if member.bytes >= FULL {
            extra.extend([1, 0, 16, 0]);
            extra.extend(member.bytes.to_le_bytes());
            extra.extend(member.bytes.to_le_bytes());
        }
        let mut local = b"PK\x03\x04".to_vec();
        local.extend(member.fields(extra.len()));
        local.extend(name.as_bytes());
        local.extend(extra);
        self.put(&local)?;
        self.put(head)?;
        Array::each(&mut file, |piece| self.put(piece))?;
        self.members.push(member);
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        let start = self.position;
        for member in std::mem::take(&mut self.members) {
            let mut extra = Vec::new();
            if member.bytes >= FULL {
                extra.extend(member.bytes.to_le_bytes());
                extra.extend(member.bytes.to_le_bytes());
            }
            if member.offset >= FULL {
                extra.extend(member.offset.to_le_bytes());
            }
            if !extra.is_empty() {
                let length = extra.len() as u8;
                extra.splice(0..0, [1, 0, length, 0]);
            }
            let mut central = b"PK\x01\x02\x2d\0".to_vec();
            central.extend(member.fields(extra.len()));
            // No comment, first disk, no attributes.
            central.extend([0; 10]);
            central.extend(short(member.offset));
            central.extend(member.name.as_bytes());
            central.extend(extra);
            self.put(&central)?;
        }
        let (count, size) = (5u16, self.position - start);
        if self.position >= FULL {
            let record = self.position;
            let mut end = b"PK\x06\x06".to_vec();
            end.extend(44u64.to_le_bytes());
            end.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
            for value in [u64::from(count), u64::from(count), size, start] {
                end.extend(value.to_le_bytes());
            }
            end.extend(b"PK\x06\x07\0\0\0\0");
            end.extend(record.to_le_bytes());
            end.extend(1u32.to_le_bytes());
            self.put(&end)?;
        }
        let mut end = b"PK\x05\x06\0\0\0\0".to_vec();
        end.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
        end.extend(short(size));
        end.extend(short(start));
        end.extend([0, 0]);
        self.put(&end)?;
        self.out.flush()
    }
}

impl Member {
    /// Returns the fields that the local header and the central directory share, starting with the
    /// version.
    fn fields(&self, extra: usize) -> Vec<u8> {
        // Version 4.5, no flags, stored. The fixed time, midnight of 1980-01-01, makes the output
        // depend on the input only.
        let mut fields = vec![45, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
        fields.extend(self.crc.to_le_bytes());
        fields.extend(short(self.bytes));
        fields.extend(short(self.bytes));
        fields.extend((self.name.len() as u16).to_le_bytes());
        fields.extend((extra as u16).to_le_bytes());
        fields
    }
}

/// Returns a 32-bit field. All bits are set if the value is in a 64-bit field.
fn short(value: u64) -> [u8; 4] {
    (value.min(FULL) as u32).to_le_bytes()
}
