//! Tests transfer functions against a slow, obvious implementation.

use deepshadow_scene::transfer::TransferFunction;

fn grey(points: &[(f32, f32)]) -> TransferFunction {
    TransferFunction::new(points.iter().map(|&(v, e)| (v, [e; 3])).collect()).unwrap()
}

#[test]
fn a_transfer_function_is_linear_between_points_and_constant_outside() {
    let f = grey(&[(1.0, 2.0), (3.0, 6.0)]);
    for (value, extinction) in [(-9.0, 2.0), (1.0, 2.0), (1.5, 3.0), (3.0, 6.0), (99.0, 6.0)] {
        assert_eq!(f.at(value), [extinction; 3], "at {value}");
    }
    assert_eq!(grey(&[(5.0, 2.0)]).at(-1.0), [2.0; 3]);
}

#[test]
fn at_a_jump_the_second_point_applies() {
    let f = grey(&[(0.0, 1.0), (1.0, 1.0), (1.0, 3.0), (2.0, 3.0), (2.0, 0.0)]);
    assert_eq!(f.at(1.0f32.next_down()), [1.0; 3]);
    assert_eq!(f.at(1.0), [3.0; 3]);
    assert_eq!(f.at(2.0f32.next_down()), [3.0; 3]);
    assert_eq!(f.at(2.0), [0.0; 3]);
    assert!(f.is_zero_between(2.0, 9.0));
    assert!(!f.is_zero_between(2.0f32.next_down(), 9.0));
}

#[test]
fn max_between_is_the_greatest_of_all_values_between() {
    let f = grey(&[
        (0.0, 0.0),
        (1.0, 0.0),
        (1.0, 4.0),
        (2.0, 1.0),
        (3.0, 0.0),
        (5.0, 0.0),
        (6.0, 2.0),
    ]);
    let values: Vec<f32> = (-8..=56).map(|i| i as f32 / 8.0).collect();
    for (i, &lo) in values.iter().enumerate() {
        for (k, &hi) in values.iter().enumerate().skip(i) {
            // Points lie on these values, so the greatest is at one of them.
            let slow = values[i..=k]
                .iter()
                .map(|v| f.at(*v)[0])
                .fold(0.0, f32::max);
            assert_eq!(f.max_between(lo, hi), [slow; 3], "from {lo} to {hi}");
            assert_eq!(f.is_zero_between(lo, hi), slow == 0.0);
        }
    }
    // At a jump down at the end of a range, the value in front of the jump counts.
    let down = grey(&[(0.0, 1.0), (1.0, 5.0), (1.0, 0.0)]);
    assert_eq!(down.max_between(0.5, 1.0), [5.0; 3]);
    assert_eq!(down.max_between(1.0, 2.0), [0.0; 3]);
}

#[test]
fn channels_may_differ() {
    let f = TransferFunction::new(vec![(0.0, [0.0; 3]), (1.0, [1.0, 2.0, 4.0])]).unwrap();
    assert!(f.is_coloured());
    assert!(!TransferFunction::linear(0.0, 1.0).is_coloured());
    assert_eq!(f.at(0.5), [0.5, 1.0, 2.0]);
    assert_eq!(f.max_between(0.0, 0.25), [0.25, 0.5, 1.0]);
    assert_eq!(f.scaled(0.5).at(9.0), [0.5, 1.0, 2.0]);
}

#[test]
fn a_ramp_rises_falls_or_jumps() {
    assert_eq!(TransferFunction::linear(10.0, 20.0).at(12.5), [0.25; 3]);
    assert_eq!(TransferFunction::linear(20.0, 10.0).at(12.5), [0.75; 3]);
    let jump = TransferFunction::linear(10.0, 10.0);
    assert_eq!(
        (jump.at(10.0f32.next_down()), jump.at(10.0)),
        ([0.0; 3], [1.0; 3])
    );
    // From the least to the greatest f32.
    assert_eq!(
        TransferFunction::linear(f32::MIN, f32::MAX).at(0.0),
        [0.5; 3]
    );
}

#[test]
fn invalid_points_are_refused_by_number() {
    let nan = f32::NAN;
    for (points, words) in [
        (vec![], "at least one point"),
        (vec![(nan, 0.0)], "point 1: the value NaN"),
        (vec![(0.0, 0.0), (1.0, -1.0)], "point 2: extinction -1"),
        (vec![(0.0, 0.0), (1.0, nan)], "point 2: extinction NaN"),
        (
            vec![(1.0, 0.0), (0.0, 1.0)],
            "point 2: the value 0 follows 1",
        ),
        (
            vec![(0.0, 0.0), (0.0, 1.0), (0.0, 2.0)],
            "point 3: a third point",
        ),
    ] {
        let points = points.into_iter().map(|(v, e)| (v, [e; 3])).collect();
        let line = TransferFunction::new(points).unwrap_err().to_string();
        assert!(line.contains(words), "{line}");
    }
}
