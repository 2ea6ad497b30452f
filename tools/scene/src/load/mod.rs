//! Reads geometry from files: one small module per format. All readers take bytes, so they can be
//! fuzzed.
//!
//! | content | files | reader |
//! |---|---|---|
//! | meshes | `.obj`, `.ply`, `.ply.gz` | [`obj`], [`ply`] |
//! | strands | `.hair`, `.tfx` | [`hair`], [`tfx`] |
//! | volumes | `.raw`, `.nrrd`, `.nhdr` | [`raw`], [`nrrd`] |
//! | volumes | `.nii`, `.nii.gz`, `.mhd`, `.mha` | [`nifti`], [`metaimage`] |
//! | transfer functions | any text | [`transfer`] |
//!
//! Each reader is small, reports the line or place of an error, and takes no more memory than a
//! small multiple of the file. (The crate `tobj` reports neither line nor place, and splits meshes
//! by material; `nifti` allocates the size that a header announces.)
//!
//! Volumes keep only the spacing of their samples: they start at the origin, and the scene places
//! them.

pub mod bytes;
pub mod finish;
pub mod frames;
pub mod hair;
pub mod metaimage;
pub mod nifti;
pub mod nrrd;
pub mod obj;
pub mod packed;
pub mod ply;
pub mod raw;
pub mod samples;
pub mod text;
pub mod tfx;
pub mod transfer;

use std::path::Path;

use deepshadow_frame::foreign::{identify, identify_file};

use crate::error::{Error, ErrorKind, InFile, Result};

use crate::geometry::{Curves, Grid, Mesh};
pub use raw::RawShape;

/// The geometry of an object.
#[derive(Clone, Debug, PartialEq)]
pub enum Loaded {
    /// Triangles.
    Mesh(Mesh),
    /// Strands.
    Curves(Curves),
    /// Samples on a grid.
    Volume(Grid),
}

/// The file endings that [`object`] reads.
pub const ENDINGS: [&str; 12] = [
    "obj", "ply", "ply.gz", "hair", "tfx", "raw", "nrrd", "nhdr", "nii", "nii.gz", "mhd", "mha",
];

/// Reads an object from a file. The file's ending determines its format; `raw` describes the
/// samples of a `.raw` file.
///
/// Triangles without area, points that repeat the previous one, and strands of one point are
/// dropped.
///
/// # Errors
/// One line with the file's name: for a file that cannot be read, an ending that is not in
/// [`ENDINGS`], an invalid or empty file, a `.raw` file without a shape, or another file with a
/// shape.
pub fn object(path: &Path, raw: Option<RawShape>) -> Result<Loaded> {
    read(path, raw).and_then(frames::tidy).in_file(path)
}

/// Reads one moving object from a file for each key: meshes with the same triangles, or curves with
/// the same strands, with points at other positions.
///
/// Texture coordinates and widths are those of the first file. Triangles, points and strands are
/// dropped only if they have no extent at any key.
///
/// # Errors
/// As [`object`]; no files; a file that does not match the first.
pub fn frames(paths: &[impl AsRef<Path>], raw: Option<RawShape>) -> Result<Loaded> {
    let mut paths = paths.iter().map(AsRef::as_ref);
    let Some(path) = paths.next() else {
        return fault("no frames");
    };
    let mut object = read(path, raw).in_file(path)?;
    for next in paths {
        let follow = |loaded| frames::follow(object, loaded);
        object = read(next, raw).and_then(follow).in_file(next)?;
    }
    frames::tidy(object).in_file(path)
}

fn read(path: &Path, raw: Option<RawShape>) -> Result<Loaded> {
    let name = path.to_string_lossy().to_lowercase();
    let is = |ending: &&str| name.strip_suffix(*ending).is_some_and(|n| n.ends_with('.'));
    let Some(ending) = ENDINGS.into_iter().find(is) else {
        let known = ENDINGS.map(|e| format!(".{e}")).join(" ");
        let mut file = std::fs::File::open(path)?;
        let kind = identify_file(&mut file).unwrap_or("not a known kind of file");
        return fault(format!("{kind}; known are {known}"));
    };
    match (ending, raw) {
        ("raw", None) => {
            let line = "a .raw file needs the number of its samples, such as 64x64x93, and their \
                        `type` unless it is u8";
            return Err(Error::of_key("shape", line));
        }
        ("raw", Some(_)) | (_, None) => {}
        (_, Some(_)) => return fault("only a .raw file takes a shape"),
    }
    let bytes = std::fs::read(path)?;
    parse(path, ending, raw, &bytes).map_err(|e| match identify(&bytes) {
        Some(kind) if e.kind() == ErrorKind::File && is_stranger(ending, kind) => {
            Error::new(ErrorKind::File, format!("not a .{ending} file, but {kind}"))
        }
        _ => e,
    })
}

/// Whether a file of this kind cannot be a damaged file with this ending.
fn is_stranger(ending: &str, kind: &str) -> bool {
    let own = match ending {
        "ply" => "PLY",
        "ply.gz" | "nii.gz" => "gzip",
        "hair" => ".hair",
        "nrrd" | "nhdr" => "NRRD",
        "nii" => "NIfTI",
        "mhd" | "mha" => "MetaImage",
        _ => "",
    };
    let of_any_format = ["text", "empty", "zeros"];
    let is_own = !own.is_empty() && kind.contains(own);
    !is_own && ending != "raw" && !of_any_format.iter().any(|word| kind.contains(word))
}

fn parse(path: &Path, ending: &str, raw: Option<RawShape>, bytes: &[u8]) -> Result<Loaded> {
    Ok(match (ending, raw) {
        ("obj", _) => Loaded::Mesh(obj::parse(bytes)?),
        ("ply", _) => Loaded::Mesh(ply::parse(bytes)?),
        ("ply.gz", _) => Loaded::Mesh(ply::parse(&packed::gzip(bytes)?)?),
        ("hair", _) => Loaded::Curves(hair::parse(bytes)?),
        ("tfx", _) => Loaded::Curves(tfx::parse(bytes)?),
        ("nrrd" | "nhdr", _) => Loaded::Volume(detached(path, nrrd::parse(bytes)?)?),
        ("nii", _) => Loaded::Volume(nifti::parse(bytes)?),
        ("nii.gz", _) => Loaded::Volume(nifti::parse_packed(bytes)?),
        ("mhd" | "mha", _) => Loaded::Volume(detached(path, metaimage::parse(bytes)?)?),
        (_, Some(shape)) => Loaded::Volume(raw::parse(bytes, shape)?),
        (_, None) => unreachable!("a raw file without a shape was refused"),
    })
}

/// The grid of a header. Its samples may be in another file, relative to the header's folder.
fn detached(path: &Path, header: samples::Header<'_>) -> Result<Grid> {
    let file = match &header.data {
        samples::Data::Here(bytes) => return header.grid(bytes),
        samples::Data::In(name) => path.parent().unwrap_or(Path::new("")).join(name),
    };
    let bytes = std::fs::read(&file).in_file(&file)?;
    header.grid(&bytes).in_file(&file)
}

/// An error in the file, as one line.
fn fault<T>(line: impl Into<String>) -> Result<T> {
    Err(Error::new(ErrorKind::File, line))
}
