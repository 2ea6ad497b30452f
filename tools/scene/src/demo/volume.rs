//! Fills grids from a function of position, slice by slice on all cores.

use glam::Vec3;
use rayon::prelude::*;

use crate::geometry::Grid;

/// Half the extent of a grid of this size, whose longest side is 2 units.
pub fn half(size: [u32; 3]) -> Vec3 {
    let cells = Vec3::from_array(size.map(|n| n as f32 - 1.0));
    cells / cells.max_element()
}

/// A grid centred at the origin, with its longest side 2 units: `density` at every sample, faded to
/// 0 within a twentieth of each side.
///
/// # Panics
/// If a side has fewer than two samples.
pub fn filled(size: [u32; 3], density: impl Fn(Vec3) -> f32 + Sync) -> Grid {
    fill(size, density, |at| fade(at, size))
}

/// A grid centred at the origin, with its longest side 2 units: `density` at every sample.
/// `density` must fall to 0 at the border by itself.
///
/// # Panics
/// If a side has fewer than two samples.
pub fn filled_to_the_border(size: [u32; 3], density: impl Fn(Vec3) -> f32 + Sync) -> Grid {
    // Set the border to exactly 0, because rounding may leave a small rest.
    fill(size, density, |at| fade(at, size).ceil())
}

fn fill(
    size: [u32; 3],
    density: impl Fn(Vec3) -> f32 + Sync,
    share: impl Fn([usize; 3]) -> f32 + Sync,
) -> Grid {
    assert!(size.iter().all(|&n| n >= 2), "a grid of {size:?}");
    let half = half(size);
    let spacing = half * 2.0 / Vec3::from_array(size.map(|n| n as f32 - 1.0));
    let [nx, ny, _] = size.map(|n| n as usize);
    let mut values = vec![0.0; size.iter().map(|&n| n as usize).product()];
    values
        .par_chunks_mut(nx * ny)
        .enumerate()
        .for_each(|(z, slice)| {
            for (i, value) in slice.iter_mut().enumerate() {
                let at = [i % nx, i / nx, z];
                let share = share(at);
                if share > 0.0 {
                    let p = Vec3::from_array(at.map(|n| n as f32)) * spacing - half;
                    *value = density(p).max(0.0) * share;
                }
            }
        });
    Grid {
        size,
        origin: -half,
        spacing,
        values,
    }
}

/// 0 at the borders, rising to 1 at a twentieth of each side.
fn fade(at: [usize; 3], size: [u32; 3]) -> f32 {
    let axis = |k: usize| {
        let (n, last) = (at[k] as f32, size[k] as f32 - 1.0);
        (n.min(last - n) * 20.0 / last).min(1.0)
    };
    axis(0) * axis(1) * axis(2)
}
