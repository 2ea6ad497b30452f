//! The canonical form and the laws of stored functions.

use deepshadow::{Result, Vertex, Visibility};

fn mono(points: &[(f32, f32)]) -> Result<Visibility> {
    Visibility::mono(points.iter().map(|&(z, v)| Vertex::new(z, v)).collect())
}

#[test]
fn redundant_vertices_are_removed_and_the_function_stays_the_same() {
    let f = mono(&[
        (0.0, 1.0),
        (1.0, 1.0),
        (2.0, 0.5),
        (3.0, 0.5),
        (4.0, 0.5),
        (5.0, 0.2),
        (6.0, 0.2),
    ])
    .unwrap();
    assert_eq!(f.depths(), [1.0, 2.0, 4.0, 5.0]);
    assert_eq!(f.visibility(3.5), 0.5);
    assert!(mono(&[(0.0, 1.0), (7.0, 1.0)]).unwrap().is_empty());
    assert_eq!(
        mono(&[(1.0, 0.5), (2.0, 0.4), (2.0, 0.4), (3.0, 0.0)])
            .unwrap()
            .len(),
        3
    );
}

#[test]
fn a_step_from_one_becomes_the_first_depth_when_nothing_is_left_before_it() {
    let f = mono(&[(1.0, 1.0), (2.0, 1.0), (2.0, 0.5), (3.0, 0.25)]).unwrap();
    assert_eq!(f, mono(&[(2.0, 0.5), (3.0, 0.25)]).unwrap());
    let step = [(1.0, [1.0; 3]), (2.0, [1.0; 3]), (2.0, [1.0, 0.5, 1.0])];
    let f = Visibility::rgb(step.map(|(z, v)| Vertex::new(z, v)).to_vec()).unwrap();
    let values = [0, 1, 2].map(|c| f.values(c));
    assert_eq!(
        (f.depths(), values),
        (&[2.0][..], [&[1.0][..], &[0.5], &[1.0]])
    );
}

#[test]
fn equal_channels_become_mono() {
    let f = Visibility::rgb(vec![
        Vertex::new(1.0, [0.5; 3]),
        Vertex::new(2.0, [0.25; 3]),
    ])
    .unwrap();
    assert_eq!((f.channels(), f.values(0)), (1, &[0.5f32, 0.25][..]));
}

#[test]
fn broken_laws_are_named() {
    for (points, rule) in [
        (vec![(f32::NAN, 0.5)], "DEPTH-FINITE"),
        (vec![(2.0, 0.5), (1.0, 0.4)], "DEPTH-ORDER"),
        (vec![(1.0, 0.5), (1.0, 0.4)], "DEPTH-FIRST"),
        (
            vec![(0.0, 0.9), (1.0, 0.5), (1.0, 0.4), (1.0, 0.3)],
            "DEPTH-PAIR",
        ),
        (vec![(1.0, 1.5)], "VISIBILITY-RANGE"),
        (vec![(1.0, f32::NAN)], "VISIBILITY-RANGE"),
        (vec![(1.0, 0.5), (2.0, 0.6)], "VISIBILITY-RISE"),
    ] {
        let e = mono(&points).unwrap_err().to_string();
        assert!(e.contains(rule), "{e}");
    }
}

#[test]
fn both_sides_of_a_step() {
    let f = mono(&[(1.0, 0.8), (2.0, 0.6), (2.0, 0.2)]).unwrap();
    assert_eq!((f.visibility(1.0), f.visibility_behind(1.0)), (1.0, 0.8));
    assert_eq!((f.visibility(2.0), f.visibility_behind(2.0)), (0.6, 0.2));
    assert_eq!(f.visibility(2.0f32.next_up()), 0.2);
    assert_eq!(f.visibility(f32::NEG_INFINITY), 1.0);
    assert_eq!(f.visibility(f32::INFINITY), 0.2);
}
