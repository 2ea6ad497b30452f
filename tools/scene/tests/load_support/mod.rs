//! Small files of every format, made here, and real files if they are available.

use std::io::Write;

use deepshadow_scene::Result;
use deepshadow_scene::load::{self, Loaded};

#[path = "../../../exr/tests/common/data.rs"]
mod data;
pub use data::data;

#[path = "../../../../fuzz/src/load_object.rs"]
pub mod laws;

/// Loads bytes under a file name with this ending.
pub fn load_as(ending: &str, bytes: &[u8]) -> Result<Loaded> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("object.{ending}"));
    std::fs::write(&path, bytes).unwrap();
    let raw = (ending == "raw").then(|| "2x3x2:u16".parse().unwrap());
    load::object(&path, raw)
}

/// The error of one line for a broken file, without the file's name.
pub fn refused(ending: &str, bytes: &[u8]) -> String {
    let line = load_as(ending, bytes).unwrap_err().to_string();
    assert!(line.contains(&format!("object.{ending}: ")), "{line}");
    assert!(!line.contains('\n'), "{line:?}");
    line.split_once(": ").unwrap().1.to_owned()
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

pub fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// A textured square with a raised corner, as one face of four corners.
pub const OBJ: &str = "\
# a square
mtllib none.mtl
v 0 0 0
v 1 0 0
v 1 1 0.5
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
f 1/1/1 2/2/1 3/3/1 4/4/1
";

/// The same square as text, with an unknown element between vertices and faces.
pub const PLY: &str = "\
ply
format ascii 1.0
comment a square
element vertex 4
property uchar red
property double z
property float y
property float x
property float s
property float t
element edge 1
property list uchar short ends
property int kind
element face 1
property uchar flags
property list uchar uint vertex_indices
end_header
9 0 0 0 0 0
9 0 0 1 1 0
9 0.5 1 1 1 1
9 0 1 0 0 1
2 0 1 7
3 4 0 1 2 3
";

/// The same square in binary.
pub fn ply_binary(big: bool) -> Vec<u8> {
    let name = if big { "big" } else { "little" };
    let header = PLY.split("9 0 0 0").next().unwrap();
    let mut out = header
        .replace("ascii", &format!("binary_{name}_endian"))
        .into_bytes();
    let mut put = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        if big {
            bytes.reverse();
        }
        out.extend(bytes);
    };
    for [x, y, z] in [
        [0.0f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.5],
        [0.0, 1.0, 0.0],
    ] {
        put(&[9]);
        put(&f64::from(z).to_le_bytes());
        [y, x, x, y].iter().for_each(|v| put(&v.to_le_bytes()));
    }
    put(&[2]);
    put(&0i16.to_le_bytes());
    put(&1i16.to_le_bytes());
    put(&7i32.to_le_bytes());
    put(&[3]);
    put(&[4]);
    (0..4u32).for_each(|i| put(&i.to_le_bytes()));
    out
}

/// A `.hair` file of strands with these numbers of points, and a thickness array if `widths`.
pub fn hair(strands: &[u16], widths: bool) -> Vec<u8> {
    let points: u32 = strands.iter().map(|&n| u32::from(n)).sum();
    let flags = 1 | 2 | if widths { 4 } else { 0 };
    let mut out = b"HAIR".to_vec();
    for n in [strands.len() as u32, points, flags, 5] {
        out.extend(n.to_le_bytes());
    }
    for x in [0.25f32, 0.0, 1.0, 1.0, 1.0] {
        out.extend(x.to_le_bytes());
    }
    out.resize(128, b' ');
    strands
        .iter()
        .for_each(|n| out.extend((n - 1).to_le_bytes()));
    for i in 0..points * 3 {
        out.extend((i as f32 * 0.5).to_le_bytes());
    }
    if widths {
        (0..points).for_each(|i| out.extend((i as f32).to_le_bytes()));
    }
    out
}

/// A `.tfx` file.
pub fn tfx(strands: u32, length: u32) -> Vec<u8> {
    let mut out = 4.0f32.to_le_bytes().to_vec();
    for n in [strands, length, 160] {
        out.extend(n.to_le_bytes());
    }
    out.resize(160, 0);
    for i in 0..strands * length * 4 {
        out.extend((i as f32).to_le_bytes());
    }
    out
}

/// The twelve samples of every small volume, 2 x 3 x 2.
pub const SAMPLES: [u16; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 256, 1000];

pub fn samples(big: bool) -> Vec<u8> {
    let bytes = |v: u16| match big {
        true => [(v >> 8) as u8, v as u8],
        false => v.to_le_bytes(),
    };
    SAMPLES.into_iter().flat_map(bytes).collect()
}

/// A `.nii` file of u16 with slope 2 and intercept 1.
pub fn nifti(big: bool) -> Vec<u8> {
    let mut out = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| {
        out[at..at + bytes.len()].copy_from_slice(bytes);
        if big {
            out[at..at + bytes.len()].reverse();
        }
    };
    put(0, &348u32.to_le_bytes());
    for (i, n) in [3u16, 2, 3, 2, 1].into_iter().enumerate() {
        put(40 + 2 * i, &n.to_le_bytes());
    }
    put(70, &512u16.to_le_bytes());
    put(72, &16u16.to_le_bytes());
    for (i, x) in [-1.0f32, 0.5, 1.5, -2.0].into_iter().enumerate() {
        put(76 + 4 * i, &x.to_le_bytes());
    }
    for (at, x) in [(108, 352.0f32), (112, 2.0), (116, 1.0)] {
        put(at, &x.to_le_bytes());
    }
    out[344..348].copy_from_slice(b"n+1\0");
    out.extend(samples(big));
    out
}

/// A `.nrrd` file; `fields` come before the empty line.
pub fn nrrd(fields: &str, samples: &[u8]) -> Vec<u8> {
    let head = "NRRD0004\n# small\ntype: unsigned short\ndimension: 3\nsizes: 2 3 2\n";
    [head.as_bytes(), fields.as_bytes(), b"\n", samples].concat()
}

/// A `.mha` file; `fields` come before the samples.
pub fn mha(fields: &str, samples: &[u8]) -> Vec<u8> {
    let head = "ObjectType = Image\nNDims = 3\nDimSize = 2 3 2\n\
                ElementSpacing = 0.5 1.5 2\nElementType = MET_USHORT\n";
    let last = "ElementDataFile = LOCAL\n";
    [head.as_bytes(), fields.as_bytes(), last.as_bytes(), samples].concat()
}

/// A small file of every format and variant, with its ending.
pub fn files() -> Vec<(&'static str, Vec<u8>)> {
    let text: String = SAMPLES.iter().map(|v| format!("{v} ")).collect();
    let text = text.trim_end().as_bytes().to_vec();
    vec![
        ("obj", OBJ.into()),
        ("ply", PLY.into()),
        ("ply", ply_binary(false)),
        ("ply", ply_binary(true)),
        ("ply.gz", gzip(PLY.as_bytes())),
        ("hair", hair(&[2, 3, 4], true)),
        ("hair", hair(&[3, 1, 2], false)),
        ("tfx", tfx(2, 3)),
        ("raw", samples(false)),
        (
            "nrrd",
            nrrd(
                "encoding: raw\nendian: little\nspacings: 0.5 1.5 2\n",
                &samples(false),
            ),
        ),
        (
            "nrrd",
            nrrd(
                "encoding: raw\nendian: big\nspace directions: (0,0.5,0) (1.5,0,0) (0,0,-2)\n",
                &samples(true),
            ),
        ),
        (
            "nrrd",
            nrrd(
                "encoding: gzip\nendian: little\nspacings: 0.5 1.5 2\n",
                &gzip(&samples(false)),
            ),
        ),
        (
            "nrrd",
            nrrd("encoding: ascii\nspacings: 0.5 1.5 2\n", &text),
        ),
        ("nii", nifti(false)),
        ("nii", nifti(true)),
        ("nii.gz", gzip(&nifti(false))),
        ("mha", mha("", &samples(false))),
        (
            "mha",
            mha("BinaryDataByteOrderMSB = True\n", &samples(true)),
        ),
        (
            "mha",
            mha("CompressedData = True\n", &zlib(&samples(false))),
        ),
    ]
}

/// Named inputs for fuzzing: every small file and a transfer function, each after the index of its
/// reader.
pub fn seeds() -> Vec<(String, Vec<u8>)> {
    let mut out = Vec::new();
    let mut add = |reader: &str, kind: &str, bytes: &[u8]| {
        let first = laws::READERS.iter().position(|r| *r == reader).unwrap();
        let name = format!("{}{kind}", reader.replace('.', "-"));
        out.push((name, [&[first as u8], bytes].concat()));
    };
    for (i, (ending, bytes)) in files().into_iter().enumerate() {
        let head: &[u8] = if ending == "raw" { &[2, 3, 2, 3] } else { &[] };
        let kind = match (ending, &bytes) {
            (_, b) if b.windows(6).any(|w| w == b"gzip\ne") => "-gzip",
            (_, b) if b.windows(5).any(|w| w == b"ascii") => "-text",
            (_, b) if b.windows(10).any(|w| w == b"Compressed") => "-zlib",
            _ => "",
        };
        add(ending, &format!("-{i}{kind}"), &[head, &bytes].concat());
    }
    add("transfer", "", b"# bone\n100 0\n200 1 0.5 0.25\n200 4\n");
    let nhdr = nrrd("encoding: raw\nendian: big\ndata file: a.raw\n", b"");
    add("detached", "", &nhdr);
    out
}
