//! Building blocks of demos: balls, boxes, tubes, flat ground and hairs. Triangles share vertices.

use std::collections::HashMap;

use glam::Vec3;

use super::trig::{across, sin_cos};
use crate::geometry::{Curves, Mesh};

/// A ball: an icosahedron whose triangles are split into four `times` times. It has `10 * 4^times +
/// 2` vertices; triangles face outward.
///
/// # Panics
/// If `times` is more than 10, which makes twenty million triangles.
pub fn ball(centre: Vec3, radius: f32, times: u32) -> Mesh {
    assert!(times <= 10, "{times} splits");
    let (mut corners, mut triangles) = icosahedron();
    for _ in 0..times {
        let mut middles = HashMap::new();
        let mut next = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    corners.push((corners[a as usize] + corners[b as usize]).normalize());
                    corners.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            next.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = next;
    }
    let place = |p: Vec3| centre + p * radius;
    Mesh::still(corners.into_iter().map(place).collect(), triangles)
}

/// The twelve corners of an icosahedron at distance 1, and its twenty triangles.
pub fn icosahedron() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let mut corners = Vec::new();
    for k in 0..3 {
        for (a, b) in [(-1.0, -g), (-1.0, g), (1.0, -g), (1.0, g)] {
            // (0, ±1, ±g) and its cyclic permutations.
            let mut p = [0.0; 3];
            p[(k + 1) % 3] = a;
            p[(k + 2) % 3] = b;
            corners.push(Vec3::from_array(p));
        }
    }
    // Corners at distance 2 are neighbours, and three neighbours form a triangle.
    let near = |a: Vec3, b: Vec3| (a.distance_squared(b) - 4.0).abs() < 0.1;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let (p, q, r) = (corners[a], corners[b], corners[c]);
                if near(p, q) && near(q, r) && near(r, p) {
                    let outward = (q - p).cross(r - p).dot(p) > 0.0;
                    let (b, c) = if outward { (b, c) } else { (c, b) };
                    triangles.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    let unit = corners.into_iter().map(Vec3::normalize).collect();
    (unit, triangles)
}

/// Appends the triangles of `other` to `mesh`. Both must be static; texture coordinates are not
/// copied.
pub fn join(mesh: &mut Mesh, other: &Mesh) {
    if mesh.positions.is_empty() {
        mesh.positions.push(Vec::new());
    }
    let first = mesh.positions[0].len() as u32;
    mesh.positions[0].extend_from_slice(&other.positions[0]);
    let shifted = other.triangles.iter().map(|t| t.map(|i| i + first));
    mesh.triangles.extend(shifted);
}

/// A box with a given centre and half its sides; eight vertices, triangles facing outward.
pub fn cuboid(centre: Vec3, half: Vec3) -> Mesh {
    let sign = |i: u32, bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
    let corner = |i: u32| centre + half * Vec3::new(sign(i, 0), sign(i, 1), sign(i, 2));
    let faces: [[u32; 4]; 6] = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let triangles = faces
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    Mesh::still((0..8).map(corner).collect(), triangles.collect())
}

/// A square of side `2 * half` around the origin at y = 0. It consists of `across` x `across`
/// smaller squares, faces up, and has texture coordinates from (0, 0) to (1, 1).
pub fn ground(half: f32, across: u32) -> Mesh {
    let at = |n: u32| n as f32 / across as f32;
    let row = across + 1;
    let places = || (0..row * row).map(|i| (at(i % row), at(i / row)));
    let positions =
        places().map(|(u, v)| Vec3::new((2.0 * u - 1.0) * half, 0.0, (1.0 - 2.0 * v) * half));
    let cells = (0..across * across).map(|i| i / across * row + i % across);
    let triangles = cells.flat_map(|i| [[i, i + 1, i + row + 1], [i, i + row + 1, i + row]]);
    Mesh {
        uvs: places().map(|(u, v)| [u, v]).collect(),
        ..Mesh::still(positions.collect(), triangles.collect())
    }
}

/// A pipe around a path of at least two points, closed at both ends. Its rings have `corners`
/// corners, at least three; triangles face outward.
pub fn tube(path: &[Vec3], radius: f32, corners: u32) -> Mesh {
    let (corners, rings) = (corners.max(3), path.len() as u32);
    let mut positions = Vec::new();
    let mut side = across(direction(path, 0)).0;
    for (i, &centre) in path.iter().enumerate() {
        let along = direction(path, i);
        // Carry the side along the path with the least rotation, so that the pipe does not twist.
        side = (side - along * side.dot(along)).normalize();
        let other = along.cross(side);
        positions.extend((0..corners).map(|k| {
            let (sin, cos) = sin_cos(k as f32 / corners as f32);
            centre + (side * cos + other * sin) * radius
        }));
    }
    let mut triangles = Vec::new();
    for ring in 0..rings - 1 {
        for k in 0..corners {
            let (a, b) = (ring * corners + k, ring * corners + (k + 1) % corners);
            triangles.extend([[a, b, b + corners], [a, b + corners, a + corners]]);
        }
    }
    for (ring, front) in [(0, true), (rings - 1, false)] {
        let centre = positions.len() as u32;
        positions.push(path[ring as usize]);
        for k in 0..corners {
            let (a, b) = (ring * corners + k, ring * corners + (k + 1) % corners);
            triangles.push(if front {
                [centre, b, a]
            } else {
                [centre, a, b]
            });
        }
    }
    Mesh::still(positions, triangles)
}

/// Direction of a path at a point.
fn direction(path: &[Vec3], i: usize) -> Vec3 {
    (path[(i + 1).min(path.len() - 1)] - path[i.saturating_sub(1)]).normalize()
}

/// Strands of `segments` segments each, from the points of all strands. `width` maps a position on
/// the strand, from 0 at the root to 1 at the tip, to its width.
///
/// # Panics
/// If strands have no segments, or there are more than 2^32 - 1 points.
pub fn hairs(points: Vec<Vec3>, hairs: u32, segments: u32, width: impl Fn(f32) -> f32) -> Curves {
    assert!(segments > 0, "hairs without segments");
    let count = hairs.checked_mul(segments.saturating_add(1));
    assert!(count.is_some(), "{hairs} hairs of {segments} segments");
    let widths = (0..=segments).map(|i| width(i as f32 / segments as f32));
    Curves {
        points: vec![points],
        strands: (0..=hairs).map(|i| i * (segments + 1)).collect(),
        widths: widths.collect::<Vec<f32>>().repeat(hairs as usize),
    }
}
