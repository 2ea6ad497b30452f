//! Names the kind of a file by its first bytes. All programs use this one table.

use std::fmt;
use std::io::{Read, Seek, SeekFrom};

use deepshadow::raw::layout::MAGIC;

/// First bytes of a file that tell its kind.
pub const HEAD: u64 = 4096;

/// The kind of a file, by its first bytes. `Display` gives a noun with its article.
///
/// ```
/// use deepshadow_frame::foreign::FileKind;
/// let kind = FileKind::of(b"\x76\x2f\x31\x01\x02\x00\x00\x00");
/// assert_eq!((kind, kind.to_string().as_str()), (FileKind::OpenExr, "an OpenEXR file"));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FileKind {
    /// A deep shadow map of this project.
    Dsm,
    /// An OpenEXR file.
    OpenExr,
    /// Another known kind.
    Other(&'static str),
    /// An unknown kind.
    Unknown,
}

impl FileKind {
    /// Returns the kind of a file that begins with these bytes; [`HEAD`] of them are enough.
    pub fn of(head: &[u8]) -> Self {
        // Three of the eight bytes, so that opening a file damaged by a transfer as text says so.
        if head.len() >= 4 && head[1..4] == MAGIC[1..4] {
            return FileKind::Dsm;
        }
        if head.starts_with(OPEN_EXR) {
            return FileKind::OpenExr;
        }
        identify(head).map_or(FileKind::Unknown, FileKind::Other)
    }
}

impl fmt::Display for FileKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FileKind::Dsm => "a deep shadow map (.dsm)",
            FileKind::OpenExr => "an OpenEXR file",
            FileKind::Other(name) => name,
            FileKind::Unknown => "of an unknown kind",
        })
    }
}

/// The first bytes of an OpenEXR file.
const OPEN_EXR: &[u8] = b"\x76\x2f\x31\x01";

/// Returns the kind of a whole file: a noun with its article, and advice for some kinds.
pub fn identify_file(file: &mut (impl Read + Seek)) -> Option<&'static str> {
    let mut head = Vec::new();
    file.seek(SeekFrom::Start(0)).ok()?;
    file.take(HEAD).read_to_end(&mut head).ok()?;
    let mut read = |at: u64, size: usize| {
        let mut bytes = vec![0; size];
        file.seek(SeekFrom::Start(at)).ok()?;
        file.read_exact(&mut bytes).ok()?;
        Some(bytes)
    };
    if is_geotiff(&head, &mut read) {
        return Some("a GeoTIFF, perhaps a digital surface model, which is also called DSM");
    }
    identify(&head)
}

/// Returns the kind of a file that begins with these bytes.
pub fn identify(head: &[u8]) -> Option<&'static str> {
    if head.is_empty() {
        return Some("an empty file");
    }
    if head.starts_with(&MAGIC) {
        return Some("a deep shadow map (.dsm)");
    }
    if let [0x76, 0x2f, 0x31, 0x01, _, flags, ..] = head {
        return Some(match flags & 0x08 {
            0 => "a flat OpenEXR image",
            _ => "a deep OpenEXR image; dsm-convert converts it to .dsm",
        });
    }
    if transferred(head) {
        return Some("one damaged by a transfer as text; transfer it again as binary");
    }
    let known: &[(&[u8], &str)] = &[
        (b"II*\0", TIFF),
        (b"MM\0*", TIFF),
        (b"II+\0", TIFF),
        (b"MM\0+", TIFF),
        (&[0xde, 0x32, 0x04, 0x00], "a PRMan deep texture (.dtex)"),
        (&[0x00, 0x04, 0x32, 0xde], "a PRMan deep texture (.dtex)"),
        (b"MSD3", "a 3Delight deep shadow map"),
        (b"3DSM", "a 3Delight deep shadow map"),
        (b"fbtH", "a Houdini texture or deep shadow map (.rat)"),
        (b"Htbf", "a Houdini texture or deep shadow map (.rat)"),
        (b"\x89PNG\r\n\x1a\n", "a PNG image"),
        (&[0xff, 0xd8, 0xff], "a JPEG image"),
        (b"GIF8", "a GIF image"),
        (b"SDPX", "a DPX image"),
        (b"XPDS", "a DPX image"),
        (b"Ptex", "a Ptex texture"),
        (b"#?RADIANCE", "a Radiance image"),
        (b"PF\n", "a PFM image"),
        (b"Pf\n", "a PFM image"),
        (b"\x93NUMPY", "a NumPy array"),
        (b"\x89HDF\r\n\x1a\n", "an HDF5 file (Field3D, perhaps)"),
        (&[0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0], "an OpenVDB volume"),
        (b"NanoVDB", "a NanoVDB volume"),
        (b"PXR-USDC", "a USD scene"),
        (b"#usda", "a USD scene"),
        (b"glTF", "a glTF scene"),
        (b"Kaydara FBX", "an FBX scene"),
        (b"BLENDER", "a Blender scene"),
        (b"Ogawa", "an Alembic scene"),
        (b"ply\n", "a PLY mesh"),
        (b"ply\r\n", "a PLY mesh"),
        (b"solid ", "an STL mesh"),
        (b"HAIR", "a .hair file of curves"),
        (b"NRRD000", "an NRRD volume"),
        (b"ObjectType =", "a MetaImage volume"),
        (b"# vtk DataFile", "a VTK file"),
        (b"LASF", "a LAS point cloud"),
        (
            b"EHFA_HEADER_TAG",
            "an ERDAS Imagine raster, a format of digital surface models (DSM)",
        ),
        (
            b"ncols",
            "an Esri ASCII grid, a format of digital surface models (DSM)",
        ),
        (b"%PDF", "a PDF document"),
        (b"\x7fELF", "a program"),
        (&[0x1f, 0x8b], "a gzip archive"),
        (&[0x28, 0xb5, 0x2f, 0xfd], "a Zstandard archive"),
        (b"BZh", "a bzip2 archive"),
        (b"\xfd7zXZ", "an xz archive"),
    ];
    if let Some((_, what)) = known.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Some(what);
    }
    if head.starts_with(b"PK\x03\x04") {
        return Some(
            match head
                .get(30..)
                .and_then(|r| r.windows(4).position(|w| w == b".npy"))
            {
                Some(at) if at < 256 => "a zip archive of NumPy arrays (.npz)",
                _ => "a zip archive",
            },
        );
    }
    if head.starts_with(b"RIFF") && head.get(8..12) == Some(b"WEBP") {
        return Some("a WebP image");
    }
    if let Some(b"n+1\0" | b"ni1\0") = head.get(344..348) {
        return Some("a NIfTI volume");
    }
    let first = head.iter().find(|b| !b.is_ascii_whitespace());
    if first == Some(&b'{') && head.windows(7).any(|w| w == b"\"asset\"") {
        return Some("a glTF scene");
    }
    if head.iter().all(|&b| b == 0) {
        return Some("a file that begins with zeros, perhaps from a failed download");
    }
    is_text(head).then_some("text")
}

const TIFF: &str = "a TIFF image, perhaps a digital surface model, which is also called DSM";

/// Whether these bytes were the magic of `.dsm` before a transfer stripped bits or changed line
/// ends.
fn transferred(head: &[u8]) -> bool {
    let stripped: Vec<u8> = MAGIC.iter().map(|b| b & 0x7f).collect();
    let unix = [&MAGIC[..4], &MAGIC[5..]].concat();
    let dos = [&MAGIC[..7], b"\r\n"].concat();
    let replaced = [&[0xef, 0xbf, 0xbd], &MAGIC[1..4]].concat(); // read as UTF-8
    [stripped, unix, dos, replaced]
        .iter()
        .any(|magic| head.starts_with(magic))
}

/// Whether the bytes are UTF-8 without unusual control characters. The last character may be cut
/// off.
fn is_text(head: &[u8]) -> bool {
    let valid = match std::str::from_utf8(head) {
        Ok(text) => text,
        Err(e) if e.error_len().is_none() => {
            std::str::from_utf8(&head[..e.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => return false,
    };
    let usual = |c: char| !c.is_control() || matches!(c, '\n' | '\r' | '\t' | '\u{c}');
    !valid.is_empty() && valid.chars().all(usual)
}

/// Whether the first directory of a TIFF file has a GeoTIFF tag.
fn is_geotiff(head: &[u8], read: &mut dyn FnMut(u64, usize) -> Option<Vec<u8>>) -> bool {
    let little = head.starts_with(b"II");
    let number = |bytes: &[u8]| {
        let add = |n: u64, &b: &u8| n << 8 | u64::from(b);
        if little {
            bytes.iter().rev().fold(0, add)
        } else {
            bytes.iter().fold(0, add)
        }
    };
    let big = match head {
        [b'I', b'I', b'*', 0, ..] | [b'M', b'M', 0, b'*', ..] => false,
        [b'I', b'I', b'+', 0, ..] | [b'M', b'M', 0, b'+', ..] => true,
        _ => return false,
    };
    // Position of the directory's offset, sizes of offsets and counts, size of an entry.
    let (at, offset, count, entry) = if big { (8, 8, 8, 20) } else { (4, 4, 2, 12) };
    let mut tags = || {
        let start = number(head.get(at..at + offset)?);
        let entries = number(&read(start, count)?).min(1000) as usize;
        let bytes = read(start.checked_add(count as u64)?, entries * entry)?;
        Some(
            bytes
                .chunks_exact(entry)
                .map(|e| number(&e[..2]))
                .collect::<Vec<_>>(),
        )
    };
    let geo = [33550, 33922, 34264, 34735];
    tags().is_some_and(|tags| tags.iter().any(|tag| geo.contains(tag)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transfer_as_text_is_recognised() {
        for bytes in [
            &b"\x09DSM\r\n\x1a\n"[..],
            b"\x89DSM\n\x1a\n\x01\0",
            b"\x89DSM\r\n\x1a\r\n",
            b"\xef\xbf\xbdDSM\r\n",
        ] {
            assert!(identify(bytes).unwrap().contains("transfer"), "{bytes:?}");
        }
        assert_eq!(identify(b"DSM of the town\n"), Some("text"));
        assert_eq!(identify(&[1, 2, 3]), None);
    }

    #[test]
    fn text_may_end_within_a_character() {
        assert!(is_text(&"é".repeat(3).as_bytes()[..5]));
        assert!(!is_text(&[0x80]));
        assert!(!is_text(b"a\0b"));
    }
}
