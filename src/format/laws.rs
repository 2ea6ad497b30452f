//! The laws of `spec/semantics.md`, section 3, over a whole tile at memory speed.
//!
//! A monochrome tile is checked plane by plane: pairs of neighbours that break a law are counted over the whole plane, where
//! the compiler vectorises, and those that straddle two pixels are subtracted. Only when something is left over does the
//! slow way look for its place.

use super::tile::{Tile, Values};
use crate::function::{Broken, check_laws};
use crate::{Error, Place, Result};

/// The laws of one function, canonical form included.
pub(super) fn canonical(channels: usize, z: &[f32], v: &[f32]) -> std::result::Result<(), Broken> {
    check_laws(channels, z, v)?;
    let broken = |rule, why, vertex| Err(Broken { rule, why, vertex });
    let n = z.len();
    let own = |i: usize| &v[i * channels..(i + 1) * channels];
    for i in 0..n {
        let negative_zero = |v: &f32| *v == 0.0 && v.is_sign_negative();
        if negative_zero(&z[i]) || own(i).iter().any(negative_zero) {
            return broken("DEPTH-ZERO", "zero is stored as -0", i);
        }
        if i > 0 && z[i - 1] == z[i] && own(i - 1) == own(i) {
            return broken(
                "VERTEX-STEP",
                "nothing falls between two vertices of one depth",
                i,
            );
        }
        let flat_before = if i == 0 {
            own(0).iter().all(|&v| v == 1.0)
        } else {
            own(i - 1) == own(i)
        };
        if flat_before && (i + 1 == n || own(i) == own(i + 1)) {
            return broken("VERTEX-REDUNDANT", "a vertex is redundant", i);
        }
    }
    if channels == 3 && v.chunks_exact(3).all(|v| v[0] == v[1] && v[0] == v[2]) {
        return broken("COLOUR-EQUAL", "a coloured pixel is monochrome", 0);
    }
    Ok(())
}

/// The laws of all functions of a tile.
pub(super) fn check(tile: &Tile) -> Result<()> {
    let sound = match &tile.v {
        Values::Lattice(k) => {
            if k.iter().fold(0, |most, &k| most.max(k)) > tile.lattice {
                return Err(Error::corrupt(
                    "TILE-LATTICE",
                    format!("a visibility above {0} / {0}", tile.lattice),
                ));
            }
            plane_is_sound(tile, k, tile.lattice)
        }
        Values::F32(v) => {
            // As bit patterns, 0 to 1 are one range; -0, NaN and the negative lie above it.
            let one = 1f32.to_bits();
            v.iter().fold(0, |most, v| most.max(v.to_bits())) <= one && plane_is_sound(tile, v, 1.0)
        }
    };
    if sound {
        return Ok(());
    }
    match tile.first_broken() {
        Some((i, broken)) => {
            let place = Place {
                sample: Some(broken.vertex),
                ..Place::default()
            };
            Err(Error::corrupt(
                broken.rule,
                format!("{} (pixel {i} of the tile)", broken.why),
            )
            .at(place))
        }
        None => Ok(()),
    }
}

/// Whether no law is broken, for monochrome tiles; coloured ones always take the slow way.
///
/// Each pass goes over one plane of one type, so that it becomes vector code.
fn plane_is_sound<T: PartialOrd + Copy>(tile: &Tile, v: &[T], one: T) -> bool {
    if tile.is_coloured() {
        return false;
    }
    let z = &tile.z[..];
    let n = z.len();
    let v = &v[..n];
    let odd = |z: &f32| {
        let bits = z.to_bits();
        u32::from(bits & 0x7F80_0000 == 0x7F80_0000) | u32::from(bits == 0x8000_0000)
    };
    if z.iter().fold(0, |bad, z| bad | odd(z)) != 0 {
        return false;
    }
    let (before, behind) = (&z[..n.saturating_sub(1)], &z[n.min(1)..]);
    let falls = count(before, behind, |a, b| a > b);
    let equals = count(before, behind, |a, b| a == b);
    let rises = count(&v[..n.saturating_sub(1)], &v[n.min(1)..], |a, b| a < b);
    let flats = {
        let (a, b, c) = (&v[..n.saturating_sub(2)], &v[n.min(1)..], &v[n.min(2)..]);
        let flat = |((&a, &b), &c): ((&T, &T), &T)| u32::from((a == b) & (b == c));
        a.iter().zip(b).zip(c).map(flat).sum::<u32>()
    };
    // What straddles two pixels is no fault; each pixel's own ends are looked at here.
    let (mut falls, mut rises, mut flats, mut next_flat) = (falls, rises, flats, 0);
    for range in tile.vertex.windows(2) {
        let (start, end) = (range[0] as usize, range[1] as usize);
        if start == end {
            continue;
        }
        if start > 0 {
            falls -= u32::from(z[start - 1] > z[start]);
            rises -= u32::from(v[start - 1] < v[start]);
            // Triples that straddle the start of this pixel, each counted once.
            for i in start.saturating_sub(2).max(next_flat)..start.min(n.saturating_sub(2)) {
                flats -= u32::from(v[i] == v[i + 1] && v[i + 1] == v[i + 2]);
                next_flat = i + 1;
            }
        }
        let single = end - start == 1;
        let first = v[start] == one && (single || v[start + 1] == one);
        let rest = !single && (z[start] == z[start + 1] || v[end - 1] == v[end - 2]);
        if first || rest {
            return false;
        }
    }
    falls == 0 && rises == 0 && flats == 0 && (equals == 0 || steps_are_sound(tile, v))
}

/// How many neighbours have a relation; a tile has fewer than 2^32.
fn count<T: Copy>(a: &[T], b: &[T], relation: impl Fn(T, T) -> bool) -> u32 {
    a.iter()
        .zip(b)
        .map(|(&a, &b)| u32::from(relation(a, b)))
        .sum()
}

/// Whether no depth holds three vertices, and something falls at every one that holds two.
fn steps_are_sound<T: PartialOrd + Copy>(tile: &Tile, v: &[T]) -> bool {
    tile.vertex.windows(2).all(|range| {
        let (start, end) = (range[0] as usize, range[1] as usize);
        let (z, v) = (&tile.z[start..end], &v[start..end]);
        let pairs = z
            .windows(2)
            .zip(v.windows(2))
            .all(|(z, v)| z[0] != z[1] || v[0] != v[1]);
        pairs && z.windows(3).all(|z| z[0] != z[2])
    })
}
