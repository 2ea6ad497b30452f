//! Reads any bytes as a mesh, strands, a volume or a transfer function.
//!
//! The first byte selects the reader. An object that is read must obey the laws of its kind.

use deepshadow_scene::Result;
use deepshadow_scene::load::{
    Loaded, frames, hair, metaimage, nifti, nrrd, obj, packed, ply, raw, samples, tfx, transfer,
};
use deepshadow_scene::transfer::TransferFunction;

/// The readers. The first byte, modulo their number, is the index.
pub const READERS: [&str; 12] = [
    "obj", "ply", "ply.gz", "hair", "tfx", "raw", "nrrd", "nii", "nii.gz", "mha", "transfer",
    "detached",
];

/// Checks one input.
pub fn run(data: &[u8]) {
    let Some((&first, bytes)) = data.split_first() else {
        return;
    };
    let reader = READERS[usize::from(first) % READERS.len()];
    let result = match reader {
        "transfer" => {
            return transfer::parse(bytes).map_or_else(|e| one_line(&e), |f| function(&f));
        }
        _ => read(reader, bytes),
    };
    match result.and_then(frames::tidy) {
        Ok(loaded) => laws(&loaded),
        Err(e) => one_line(&e),
    }
}

/// Asserts that the message of an error is one line.
fn one_line(e: &deepshadow_scene::Error) {
    let line = e.to_string();
    assert!(!line.is_empty() && !line.contains('\n'), "{line:?}");
}

fn read(reader: &str, bytes: &[u8]) -> Result<Loaded> {
    Ok(match reader {
        "obj" => Loaded::Mesh(obj::parse(bytes)?),
        "ply" => Loaded::Mesh(ply::parse(bytes)?),
        "ply.gz" => Loaded::Mesh(ply::parse(&packed::gzip(bytes)?)?),
        "hair" => Loaded::Curves(hair::parse(bytes)?),
        "tfx" => Loaded::Curves(tfx::parse(bytes)?),
        "raw" => {
            // The first four bytes give the size and the sample type.
            let (head, bytes) = bytes.split_at(bytes.len().min(4));
            let n = |i: usize| head.get(i).map_or(0, |b| u32::from(*b));
            let kinds = ["u8", "i8", "u16be", "i16", "u32be", "i32le", "f32", "f64be"];
            let size = format!("{}x{}x{}", n(0), n(1), n(2));
            Loaded::Volume(raw::parse(
                bytes,
                raw::RawShape::new(&size, kinds[n(3) as usize % kinds.len()])?,
            )?)
        }
        "nrrd" => Loaded::Volume(with_samples(nrrd::parse(bytes)?, bytes)?),
        "nii" => Loaded::Volume(nifti::parse(bytes)?),
        "nii.gz" => Loaded::Volume(nifti::parse_packed(bytes)?),
        "mha" => Loaded::Volume(with_samples(metaimage::parse(bytes)?, bytes)?),
        // A detached NRRD header: the same bytes serve as the samples.
        _ => Loaded::Volume(nrrd::parse(bytes)?.grid(bytes)?),
    })
}

fn with_samples(
    header: samples::Header<'_>,
    bytes: &[u8],
) -> Result<deepshadow_scene::geometry::Grid> {
    match header.data {
        samples::Data::Here(samples) => header.grid(samples),
        samples::Data::In(_) => header.grid(bytes),
    }
}

/// Asserts the laws of loaded geometry: finite values, indices in range, no degenerate parts.
pub fn laws(loaded: &Loaded) {
    match loaded {
        Loaded::Mesh(mesh) => {
            let [positions] = &mesh.positions[..] else {
                panic!("{} keys", mesh.positions.len());
            };
            assert!(!mesh.triangles.is_empty());
            assert!(positions.iter().all(|p| p.is_finite()));
            assert!(mesh.uvs.is_empty() || mesh.uvs.len() == positions.len());
            assert!(mesh.uvs.iter().flatten().all(|x| x.is_finite()));
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|i| positions[i as usize]);
                assert!(a != b && b != c && c != a, "a triangle without area");
            }
        }
        Loaded::Curves(curves) => {
            let [points] = &curves.points[..] else {
                panic!("{} keys", curves.points.len());
            };
            assert!(curves.strands.len() >= 2);
            assert_eq!(curves.strands[0], 0);
            assert_eq!(*curves.strands.last().unwrap() as usize, points.len());
            assert!(points.iter().all(|p| p.is_finite()));
            assert!(curves.widths.is_empty() || curves.widths.len() == points.len());
            assert!(curves.widths.iter().all(|w| w.is_finite() && *w >= 0.0));
            for strand in curves.strands.windows(2) {
                assert!(
                    strand[0] + 2 <= strand[1],
                    "a strand of less than two points"
                );
                let points = &points[strand[0] as usize..strand[1] as usize];
                assert!(
                    points.windows(2).all(|w| w[0] != w[1]),
                    "a segment of no length"
                );
            }
        }
        Loaded::Volume(grid) => {
            let count: u64 = grid.size.iter().map(|&n| u64::from(n)).product();
            assert!(grid.size.iter().all(|&n| n >= 2));
            assert_eq!(count, grid.values.len() as u64);
            assert!(grid.values.iter().all(|v| v.is_finite()));
            assert!(
                grid.spacing
                    .to_array()
                    .iter()
                    .all(|s| *s > 0.0 && s.is_finite())
            );
            assert!(grid.origin.is_finite() && grid.last().is_finite());
        }
    }
}

/// Asserts that a transfer function is consistent with its maxima and zeros over ranges.
pub fn function(function: &TransferFunction) {
    let points = function.points();
    let values: Vec<f32> = points.iter().map(|p| p.0).collect();
    assert!(!values.is_empty() && values.is_sorted());
    let some = &values[..values.len().min(8)];
    for (i, &lo) in some.iter().enumerate() {
        assert!(function.at(lo).iter().all(|e| e.is_finite() && *e >= 0.0));
        for &hi in &some[i..] {
            let max = function.max_between(lo, hi);
            let zero = function.is_zero_between(lo, hi);
            for k in 0..=4 {
                let t = f64::from(k) / 4.0;
                let between = (f64::from(lo) * (1.0 - t) + f64::from(hi) * t) as f32;
                let at = function.at(between.clamp(lo, hi));
                assert!((0..3).all(|c| at[c] <= max[c] * 1.000_001 + f32::MIN_POSITIVE));
                assert!(!zero || at == [0.0; 3]);
            }
        }
    }
}
