//! Makes legal functions with awkward numbers from a fuzzer's bytes.
//!
//! Drops are at the tolerance and at twice the tolerance, values at the edge of the tube. Depths
//! are adjacent floats, denormals or huge. Some vertices are steps.

use deepshadow::raw::Precision;
use deepshadow::{Curve, Visibility};

use super::bytes::Bytes;

/// A value whose tube begins almost exactly at a multiple of `eps`, which is often storable.
///
/// The tube is narrowed as the compressors narrow it. It begins just below the multiple for `k` up
/// to 2, and just above it for `k` from 4.
fn tube_edge(value: f64, eps: f64, k: f64) -> f64 {
    let multiple = ((value / eps).floor() - 1.0).max(0.0) * eps;
    multiple + eps * (1.0 - 1e-12) - 1e-12 + (k - 3.0) * 2e-14
}

/// Makes up to `most` depths, and a plane of values per channel, under the laws of a [`Curve`].
fn parts(b: &mut Bytes, channels: usize, eps: f64, most: usize) -> (Vec<f32>, Vec<Vec<f64>>) {
    let (mut z, mut v) = (Vec::<f32>::new(), vec![Vec::new(); channels]);
    let mut at = match b.u8() % 8 {
        0 => 0.0,
        1 => f32::from_bits(1),
        2 => -f32::from_bits(3),
        3 => -1.0e30,
        4 => f32::MIN,
        5 => f32::from_bits(b.u32()),
        _ => 1.0 + f32::from(b.u8()) / 16.0,
    };
    if !at.is_finite() {
        at = 7.0;
    }
    let mut value = [1.0f64; 3];
    let mut last_single = true;
    while z.len() < most && !b.is_empty() {
        let op = b.u8();
        // The depth: that of the last vertex, for a step, or a greater one.
        let step = op & 7 == 0 && z.len() >= 2 && last_single;
        if !step && !z.is_empty() {
            let next = match op & 7 {
                0 | 1 => at.next_up(),
                2 => at + at.abs() * f32::EPSILON * f32::from(b.u8()),
                3 => at + f32::from(b.u8()) / 256.0,
                4 => at + f32::from(b.u8()),
                5 => at + at.abs() + f32::from_bits(1 + u32::from(b.u8())),
                6 => f32::from_bits(b.u32()),
                _ => at + 0.125,
            };
            at = if next > at && next.is_finite() {
                next
            } else {
                at.next_up()
            };
            if !at.is_finite() {
                break;
            }
        }
        last_single = !step;
        let together = op & 8 != 0;
        let mut drop = 0.0;
        for (c, value) in value[..channels].iter_mut().enumerate() {
            if c == 0 || !together {
                let how = b.u8();
                let k = f64::from(how >> 4);
                drop = match how & 15 {
                    0 => 0.0,
                    1 => *value - tube_edge(*value, eps, k),
                    2 => k * eps,
                    3 => 2.0 * eps,
                    4 => (2.0 * eps).next_up(),
                    5 => (2.0 * eps).next_down(),
                    6 => eps.next_up(),
                    7 => k / 255.0,
                    8 => *value,
                    9 => *value * b.unit(),
                    10 => k * eps / 8.0,
                    11 => f64::from_bits(u64::from(how) << 40),
                    12 => k * 2f64.powi(-24),
                    13 => *value - *value / 2.0,
                    14 => b.unit() * eps,
                    _ => k / 64.0,
                };
            }
            *value = (*value - drop).clamp(0.0, *value);
        }
        z.push(at);
        v.iter_mut().zip(value).for_each(|(v, value)| v.push(value));
    }
    (z, v)
}

/// Makes a curve of one or three channels with at most `most` vertices.
pub fn curve(b: &mut Bytes, eps: f64, most: usize) -> Curve {
    let channels = if b.u8().is_multiple_of(3) { 3 } else { 1 };
    let (z, v) = parts(b, channels, eps, most);
    Curve::from_planes(z, v).expect("the function obeys the laws")
}

/// Makes a stored function with at most `most` vertices, on the lattice if `precision` has one.
pub fn function(b: &mut Bytes, precision: Precision, most: usize) -> Visibility {
    let head = b.u8();
    let channels = if head.is_multiple_of(3) { 3 } else { 1 };
    let most = if head & 0x40 == 0 { most } else { 0 };
    let (z, v) = parts(b, channels, 1.0 / 64.0, most);
    let store = |v: f64| match precision {
        Precision::F32 => v as f32,
        Precision::Lattice(l) => (v * f64::from(l)).floor() as f32 / f32::from(l),
    };
    let stored = |plane: Vec<f64>| plane.into_iter().map(store).collect();
    Visibility::from_planes(z, v.into_iter().map(stored).collect())
        .expect("the function obeys the laws")
}
