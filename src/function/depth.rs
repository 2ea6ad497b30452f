//! Steps from one f32 depth to another, and the least chord tolerance.

/// A depth as an integer. Keeps the order: adjacent floats become adjacent integers.
pub(crate) fn ordered_bits(z: f32) -> u32 {
    let bits = z.to_bits();
    bits ^ (((bits as i32 >> 31) as u32) | 0x8000_0000)
}

/// The inverse of [`ordered_bits`].
pub(crate) fn from_ordered_bits(ordered: u32) -> f32 {
    f32::from_bits(ordered ^ (((!ordered as i32 >> 31) as u32) | 0x8000_0000))
}

/// The farthest f32 depth up to `z + h`, but at least the float after `z` and at most `end`.
pub(crate) fn step_by(z: f32, h: f64, end: f32) -> f32 {
    let target = f64::from(z) + h;
    if target >= f64::from(end) {
        return end;
    }
    let mut next = target as f32;
    if f64::from(next) > target {
        next = next.next_down();
    }
    next.max(z.next_up()).min(end)
}

/// The smallest chord tolerance. It bounds the number of subdivisions of a curved piece.
pub(crate) const LEAST_CHORD_TOLERANCE: f64 = 1e-9;
