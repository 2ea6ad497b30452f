//! The meshes that demos are made of: balls, boxes, tubes and flat ground, all of shared vertices.

use std::collections::HashMap;

use glam::Vec3;

use crate::geometry::Mesh;

/// A ball: an icosahedron whose triangles were split into four so many times; `10 * 4^times + 2` vertices, triangles facing outward.
///
/// # Panics
/// When `times` is more than 10, which is twenty million triangles.
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

/// The twelve corners of an icosahedron, at distance 1, and its twenty triangles.
pub fn icosahedron() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let mut corners = Vec::new();
    for k in 0..3 {
        for (a, b) in [(-1.0, -g), (-1.0, g), (1.0, -g), (1.0, g)] {
            // (0, ±1, ±g) and its turns.
            let mut p = [0.0; 3];
            p[(k + 1) % 3] = a;
            p[(k + 2) % 3] = b;
            corners.push(Vec3::from_array(p));
        }
    }
    // Corners at distance 2 are neighbours, and three neighbours are a triangle.
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

/// Adds the triangles of `other` to those of `mesh`; both stand still, and texture coordinates stay behind.
pub fn join(mesh: &mut Mesh, other: &Mesh) {
    if mesh.positions.is_empty() {
        mesh.positions.push(Vec::new());
    }
    let first = mesh.positions[0].len() as u32;
    mesh.positions[0].extend_from_slice(&other.positions[0]);
    let shifted = other.triangles.iter().map(|t| t.map(|i| i + first));
    mesh.triangles.extend(shifted);
}
