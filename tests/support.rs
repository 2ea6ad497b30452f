//! Helpers that several test modules share.

use deepshadow::*;
use proptest::prelude::ProptestConfig;

/// The settings of a property test that runs `n` random cases and writes no file when it fails.
pub fn cases(n: u32) -> ProptestConfig {
    ProptestConfig {
        cases: n,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// The monochrome curve through these points (depth, visibility).
pub fn polyline(points: &[(f32, f64)]) -> Curve {
    let (depths, values) = points.iter().copied().unzip();
    Curve::mono(depths, values).unwrap()
}

/// Asserts that the vertices of a curve obey the laws of `spec/semantics.md`.
pub fn assert_lawful(curve: &Curve) {
    let planes = (0..curve.channels()).map(|c| curve.values(c).to_vec());
    let checked = Curve::from_planes(curve.depths().to_vec(), planes.collect());
    assert!(checked.is_ok(), "{checked:?} of {curve:?}");
}

/// The bytes of a file that `fill` writes.
pub fn written(fill: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut writer = Writer::in_memory();
    fill(&mut writer);
    writer.into_bytes().unwrap()
}

/// A file that `fill` writes into memory, verified.
pub fn file(fill: impl FnOnce(&mut Writer)) -> DsmFile {
    let file = DsmFile::from_bytes(written(fill)).unwrap();
    file.verify(|_, _| true).unwrap();
    file
}

/// All tiles of all levels of a file, row by row.
pub fn tile_ids(file: &DsmFile) -> Vec<(LevelId, TileId)> {
    let mut out = Vec::new();
    for (m, map) in file.maps().iter().enumerate() {
        for (l, level) in map.levels.iter().enumerate() {
            let id = MapId(m as u32).level(l as u32);
            for y in 0..level.shape.tiles_y() {
                out.extend((0..level.shape.tiles_x()).map(|x| (id, TileId::new(x, y))));
            }
        }
    }
    out
}
