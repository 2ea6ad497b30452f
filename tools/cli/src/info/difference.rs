//! The largest difference of two levels, pixel by pixel.

use deepshadow::raw::Deviation;
use deepshadow::{Curve, DsmFile, FunctionRef, MapId, Pixel};
use rayon::prelude::*;

use super::compare::LevelPair;
use deepshadow_frame::Result;

/// Returns the largest difference of two functions, at all vertices of both and on both sides of
/// steps. The result is symmetric.
fn difference(a: FunctionRef<'_>, b: FunctionRef<'_>, curve: &mut Curve) -> Deviation {
    curve.assign(a, 0.0);
    let one = curve.deviation(b);
    curve.assign(b, 0.0);
    let other = curve.deviation(a);
    if other.error > one.error { other } else { one }
}

/// Compares a level of a map in one file with the level of the same size in another file. Calls
/// `progress` with the number of rows of each finished part.
///
/// # Errors
/// `Failed` for damage in either file.
pub fn compare_level(
    files: [&DsmFile; 2],
    maps: [MapId; 2],
    level: u32,
    mut progress: impl FnMut(u64),
) -> Result<LevelPair> {
    let infos = [
        files[0].level(maps[0].level(level))?,
        files[1].level(maps[1].level(level))?,
    ];
    let shape = infos[0].shape;
    let mut pair = LevelPair {
        maps,
        name: files[0].map(maps[0])?.header.name.clone(),
        level,
        shape,
        differing: 0,
        largest: None,
        vertices: infos.map(|i| i.vertices),
        bytes: infos.map(|i| i.payload_bytes),
    };
    let step = shape.tile_size.max(infos[1].shape.tile_size);
    for first in (0..shape.height).step_by(step as usize) {
        let end = (first + step).min(shape.height);
        let read = |i: usize| {
            let area = [0, first, shape.width, end - first];
            files[i].band(maps[i].level(level), area)
        };
        let (here, there) = (read(0)?, read(1)?);
        let row = |y: u32| {
            let (mut curve, mut differing) = (Curve::default(), 0);
            let mut largest = None;
            for x in 0..shape.width {
                let (a, b) = (here.function(x, y), there.function(x, y));
                if a != b {
                    differing += 1;
                    keep(
                        &mut largest,
                        (Pixel::new(x, y), difference(a, b, &mut curve)),
                    );
                }
            }
            (differing, largest)
        };
        let rows: Vec<_> = (first..end).into_par_iter().map(row).collect();
        for (differing, largest) in rows {
            pair.differing += differing;
            if let Some(largest) = largest {
                keep(&mut pair.largest, largest);
            }
        }
        progress(u64::from(end - first));
    }
    Ok(pair)
}

/// Keeps the larger of two differences; of equal ones, the first.
fn keep(largest: &mut Option<(Pixel, Deviation)>, seen: (Pixel, Deviation)) {
    if largest.is_none_or(|(_, l)| seen.1.error > l.error) {
        *largest = Some(seen);
    }
}
