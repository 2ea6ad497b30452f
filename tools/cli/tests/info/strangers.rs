//! Files that are no `.dsm`.

use super::files::{info, run};

fn said_of(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.dsm");
    std::fs::write(&path, bytes).unwrap();
    let (code, stdout, stderr) = run(info().arg(&path));
    assert_eq!((code, stdout.as_str()), (1, ""));
    let prefix = format!("dsm-info: {}: not a .dsm file", path.display());
    assert!(stderr.starts_with(&prefix), "{stderr}");
    stderr[prefix.len()..].trim_end().to_string()
}

#[test]
fn strangers_are_named() {
    for (bytes, what) in [
        (&b""[..], "empty"),
        (b"\x76\x2f\x31\x01\x02\x08\0\0", "deep OpenEXR"),
        (b"\x76\x2f\x31\x01\x02\x00\0\0", "flat OpenEXR"),
        (b"\x76\x2f\x31\x01\x02\x18\0\0", "deep OpenEXR"),
        (b"\x89PNG\r\n\x1a\n\0\0", "PNG"),
        (b"\xff\xd8\xff\xe0", "JPEG"),
        (b"II*\0\x08\0\0\0", "surface model"),
        (b"\xde\x32\x04\0\x80\x01", "PRMan"),
        (b"MSD3\x80\x01", "3Delight"),
        (b"fbtH\x07\0\0\0", "Houdini"),
        (b"\x1f\x8b\x08", "gzip"),
        (b"ncols 12\nnrows 3\n", "surface model"),
        ("Hello, Größe\n".as_bytes(), "text"),
        (&[0; 200], "zeros"),
        (b"\x89DSM\n\x1a\n\x01\0", "transfer"),
        (&[7; 300], "of an unknown kind"),
    ] {
        let said = said_of(bytes);
        assert!(said.contains(what), "{what}: {said}");
    }
    let mut npz = b"PK\x03\x04".to_vec();
    npz.resize(30, 0);
    npz.extend_from_slice(b"a.npy");
    assert!(said_of(&npz).contains(".npz"));
}

#[test]
fn a_geotiff_is_told_from_a_tiff_in_both_byte_orders() {
    let tag = 34735u16;
    let mut little = b"II*\0\x08\0\0\0\x01\0".to_vec();
    little.extend(tag.to_le_bytes());
    little.extend([3, 0, 1, 0, 0, 0, 1, 0, 0, 0]);
    let mut big = b"MM\0*\0\0\0\x08\0\x01".to_vec();
    big.extend([(tag >> 8) as u8, tag as u8]);
    big.extend([0, 3, 0, 0, 0, 1, 0, 1, 0, 0]);
    assert!(said_of(&little).contains("GeoTIFF"));
    assert!(said_of(&big).contains("GeoTIFF"));
    // Offsets that lead nowhere are no reason to fail.
    assert!(said_of(b"II*\0\xff\xff\xff\xff").contains("a TIFF"));
    assert!(said_of(b"II+\0\x08\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff").contains("a TIFF"));
}

#[test]
fn a_folder_and_a_missing_file_are_called_so() {
    let folder = tempfile::tempdir().unwrap();
    let (code, _, stderr) = run(info().arg(folder.path()));
    assert_eq!(code, 1);
    assert!(stderr.contains("a folder"), "{stderr}");
    let (code, _, stderr) = run(info().arg(folder.path().join("none.dsm")));
    assert_eq!(code, 1);
    assert!(stderr.contains("none.dsm: No such file"), "{stderr}");
}
