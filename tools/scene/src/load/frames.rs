//! Joins files that show one object at the keys of a motion, and drops geometry without extent.
//!
//! A triangle may collapse at one key and be wide at the next. Therefore geometry is only dropped
//! after all keys are read, if it has no extent at any key.

use crate::error::Result;
use glam::{DVec3, Vec3};

use super::{Loaded, fault};
use crate::geometry::{Curves, Mesh};

/// Appends the points of `next` to `first` as its next key.
///
/// # Errors
/// They are not two meshes with the same triangles, or two sets of curves with the same strands.
pub(super) fn follow(first: Loaded, next: Loaded) -> Result<Loaded> {
    match (first, next) {
        (Loaded::Mesh(mut a), Loaded::Mesh(b)) => {
            let vertices = |m: &Mesh| m.positions.first().map_or(0, Vec::len);
            if vertices(&a) != vertices(&b) || a.triangles != b.triangles {
                return fault(format!(
                    "{} vertices and {} triangles that are not those of the first frame, {} and {}",
                    vertices(&b),
                    b.triangles.len(),
                    vertices(&a),
                    a.triangles.len()
                ));
            }
            a.positions.extend(b.positions);
            Ok(Loaded::Mesh(a))
        }
        (Loaded::Curves(mut a), Loaded::Curves(b)) => {
            if a.strands != b.strands {
                return fault(format!(
                    "{} strands that are not as long as the {} of the first frame",
                    b.strands.len() - 1,
                    a.strands.len() - 1
                ));
            }
            a.points.extend(b.points);
            Ok(Loaded::Curves(a))
        }
        (Loaded::Volume(_), _) | (_, Loaded::Volume(_)) => {
            fault("a volume cannot have frames; meshes and curves can")
        }
        _ => fault("not the same kind of object as the first frame"),
    }
}

/// Drops triangles that have no area at any key, points that repeat the previous one at every key,
/// and strands with only one point left.
///
/// # Errors
/// Nothing is left.
pub fn tidy(loaded: Loaded) -> Result<Loaded> {
    match loaded {
        Loaded::Mesh(mesh) => drop_flat_triangles(mesh).map(Loaded::Mesh),
        Loaded::Curves(curves) => drop_short_strands(curves).map(Loaded::Curves),
        volume => Ok(volume),
    }
}

fn drop_flat_triangles(mut mesh: Mesh) -> Result<Mesh> {
    let (before, keys) = (mesh.triangles.len(), &mesh.positions);
    mesh.triangles.retain(|t| {
        keys.iter()
            .any(|positions| has_area(t.map(|i| positions[i as usize])))
    });
    match mesh.triangles.len() {
        0 => fault(format!("none of its {before} triangles has an area")),
        _ => Ok(mesh),
    }
}

/// Whether three corners span an area. Computed in f64, because products of the smallest
/// differences underflow in f32.
fn has_area(corners: [Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

fn drop_short_strands(mut curves: Curves) -> Result<Curves> {
    let keys = &curves.points;
    let repeats = |i: usize| keys.iter().all(|points| points[i] == points[i - 1]);
    let mut keep = Vec::with_capacity(keys.first().map_or(0, Vec::len));
    let mut strands = vec![0];
    for strand in curves.strands.windows(2) {
        let (start, end) = (strand[0] as usize, strand[1] as usize);
        let kept = keep.len();
        keep.extend((start..end).map(|i| i == start || !repeats(i)));
        let points = keep[kept..].iter().filter(|k| **k).count();
        match points {
            0 | 1 => keep[kept..].fill(false),
            n => strands.push(strands.last().map_or(0, |s| s + n as u32)),
        }
    }
    if strands.len() == 1 {
        let before = curves.strands.len() - 1;
        return fault(format!("none of its {before} strands has a length"));
    }
    let next_kept = |i: &mut usize| {
        *i += 1;
        keep[*i - 1]
    };
    for points in &mut curves.points {
        let mut i = 0;
        points.retain(|_| next_kept(&mut i));
    }
    let mut i = 0;
    curves.widths.retain(|_| next_kept(&mut i));
    curves.strands = strands;
    Ok(curves)
}
