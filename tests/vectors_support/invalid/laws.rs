//! Vertices that break a law.

use super::*;

pub fn add(add: &mut Add<'_>) {
    let inf = f32::INFINITY;
    let step = 1.0;
    let cases: &[(&str, &[(f32, f32)])] = &[
        ("DEPTH-FINITE", &[(1.0, 0.75), (inf, 0.5)]),
        ("DEPTH-FINITE-minus", &[(-inf, 0.75), (1.0, 0.5)]),
        ("DEPTH-FINITE-nan", &[(f32::NAN, 0.75)]),
        ("DEPTH-ZERO", &[(-0.0, 0.5)]),
        ("DEPTH-ZERO-visibility", &[(1.0, -0.0)]),
        ("DEPTH-ORDER", &[(2.0, 0.75), (1.0, 0.5)]),
        ("DEPTH-FIRST", &[(1.0, 0.75), (1.0, 0.5)]),
        (
            "DEPTH-PAIR",
            &[(0.5, 1.0), (step, 0.75), (step, 0.625), (step, 0.5)],
        ),
        ("VISIBILITY-RANGE", &[(1.0, -0.5)]),
        ("VISIBILITY-RANGE-above", &[(1.0, 1.0 + f32::EPSILON)]),
        ("VISIBILITY-RANGE-infinite", &[(1.0, inf)]),
        ("VISIBILITY-RANGE-nan", &[(1.0, f32::NAN)]),
        ("VISIBILITY-RISE", &[(1.0, 0.5), (2.0, 0.75)]),
        (
            "VERTEX-STEP",
            &[(1.0, 1.0), (2.0, 0.75), (2.0, 0.75), (3.0, 0.5)],
        ),
        (
            "VERTEX-REDUNDANT",
            &[(1.0, 0.5), (2.0, 0.5), (3.0, 0.5), (4.0, 0.25)],
        ),
        (
            "VERTEX-REDUNDANT-first",
            &[(1.0, 1.0), (2.0, 1.0), (3.0, 0.5)],
        ),
        ("VERTEX-REDUNDANT-last", &[(1.0, 0.5), (2.0, 0.5)]),
        ("VERTEX-REDUNDANT-alone", &[(1.0, 1.0)]),
    ];
    for (name, vertices) in cases {
        add(name, pixel(vertices));
    }
}

/// A file of one pixel with these vertices: (depth, visibility), with exact ranges.
fn pixel(vertices: &[(f32, f32)]) -> Vec<u8> {
    let mut depths = [vertices[0].0; 2];
    for &(z, _) in vertices {
        depths = [
            if z < depths[0] { z } else { depths[0] },
            if z > depths[1] { z } else { depths[1] },
        ];
    }
    let end = vertices[vertices.len() - 1].1;
    let entry = data(vertices.len() as u32, 0, depths, [end; 2]);
    let mut bytes = Vec::new();
    put_u32(&mut bytes, &[0, vertices.len() as u32]);
    vertices
        .iter()
        .for_each(|v| put_u32(&mut bytes, &[v.0.to_bits()]));
    vertices
        .iter()
        .for_each(|v| put_u32(&mut bytes, &[v.1.to_bits()]));
    plain((1, 1), entry, bytes).signed()
}
