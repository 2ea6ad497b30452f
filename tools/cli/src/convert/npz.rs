//! `.dsm` to NumPy: an uncompressed zip archive of `.npy` arrays, for `numpy.load`.
//! `docs/arrays.md` describes the arrays.
//!
//! Each array goes to a temporary file first. No array has to fit in memory, and all sizes are
//! known when the archive is written.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::Path;

use deepshadow::{DsmFile, LevelId, Limits};

use super::args::Args;
use super::level::Level;
use crate::inputs::find_map;
use crate::runstats::Clock;
use crate::source::header::level_header;
use deepshadow_frame::args::Region;
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

    let [left, top, width, height] = level.region(args.region)?;
    let channels: u64 = if level.is_coloured()? { 3 } else { 1 };
    let pixels = u64::from(width) * u64::from(height);
    let vertices = file.level(level.id)?.vertices;
    Limits::check_content(9 * pixels + 4 * (1 + channels) * vertices, "arrays")?;
    let new = || Array::new(folder).in_file(output);
    let (mut offsets, mut z, mut visibility, mut mono) = (new()?, new()?, new()?, new()?);
    offsets.put(&0u64.to_le_bytes()).in_file(output)?;
    let mut n = 0u64;
    let mut bar = console.bar("converting");
    for band in level.bands([left, top, width, height]) {
        let (rows, band) = band?;
        let mut put = || {
            let places = rows
                .clone()
                .flat_map(|y| (left..left + width).map(move |x| (x, y)));
            for f in places.map(|(x, y)| band.function(x, y)) {
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
        bar.set((rows.end - top).into(), height.into());
    }
    drop(bar);
    let mut small = Vec::new();
    for (name, head, bytes) in description(file, level.id, [left, top, width, height])? {
        let mut array = new()?;
        array.put(&bytes).in_file(output)?;
        small.push((name, head, array));
    }

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
        for (name, head, array) in small {
            zip.add(name, &head, array)?;
        }
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

/// Name, header and data of a small array.
type Small = (&'static str, Vec<u8>, Vec<u8>);

/// Returns the arrays that describe a rectangle of a level. A camera that the map lacks is absent.
fn description(file: &DsmFile, id: LevelId, [x, y, w, h]: Region) -> Result<Vec<Small>> {
    let level = file.level(id)?;
    let header = level_header(&file.map(id.map)?.header, id.level);
    let integers = |v: &[i64]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
    let floats = |v: &[f64]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
    let text = |text: String| {
        // UTF-32.
        let bytes: Vec<u8> = text
            .chars()
            .flat_map(|c| u32::from(c).to_le_bytes())
            .collect();
        (npy(&format!("<U{}", bytes.len() / 4), "()"), bytes)
    };
    let [origin_x, origin_y] = header.data_origin.map(i64::from);
    let window = header.display_window.map(i64::from);
    let (name, kind) = (text(header.name), text(header.depth_kind.to_string()));
    let origin = integers(&[origin_x + i64::from(x), origin_y + i64::from(y)]);
    let mut arrays = vec![
        (
            "shape.npy",
            npy("<i8", "(2,)"),
            integers(&[h.into(), w.into()]),
        ),
        ("name.npy", name.0, name.1),
        ("level.npy", npy("<i8", "()"), integers(&[id.level.into()])),
        ("depth_kind.npy", kind.0, kind.1),
        (
            "depth_unit.npy",
            npy("<f8", "()"),
            floats(&[header.depth_unit]),
        ),
        ("data_origin.npy", npy("<i8", "(2,)"), origin),
        ("display_window.npy", npy("<i8", "(4,)"), integers(&window)),
        (
            "max_error.npy",
            npy("<f8", "()"),
            floats(&[level.max_error]),
        ),
    ];
    for (name, matrix) in [
        ("world_to_camera.npy", header.camera.camera_from_world),
        ("world_to_ndc.npy", header.camera.ndc_from_world),
    ] {
        let array = |m: [f64; 16]| (name, npy("<f8", "(4, 4)"), floats(&m));
        arrays.extend(matrix.map(array));
    }
    Ok(arrays)
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
        let (start, count) = (self.position, self.members.len());
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
        let (count, size) = (count as u16, self.position - start);
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
