//! The laws of `spec/semantics.md`, section 3, over a whole tile at memory speed.
//!
//! A monochrome tile is checked plane by plane: pairs of neighbours that break a law are counted over the whole plane, where
//! the compiler vectorises, and those that straddle two pixels are subtracted. Only when something is left over does the
//! slow way look for its place.

use super::tile::{Tile, Values, lattice_value};
use super::wide::wide;
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

/// What a tile spans.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ranges {
    /// Least and greatest depth of a vertex; zeros if there is none.
    pub depths: [f32; 2],
    /// Least and greatest visibility behind everything.
    pub ends: [f32; 2],
}

/// The laws of all functions of a tile whose tables are sound, and what it spans.
pub(super) fn check(tile: &Tile) -> Result<Ranges> {
    let lattice = tile.lattice();
    let ranges = match tile.view().v {
        Values::Lattice(k) => {
            if k.iter().fold(0, |most, &k| most.max(k)) > lattice {
                return Err(Error::corrupt(
                    "TILE-LATTICE",
                    format!("a visibility above {lattice} / {lattice}"),
                ));
            }
            wide(
                #[inline(always)]
                || monochrome(tile, k, lattice),
            )
            .map(|(depths, ends)| (depths, ends.map(|k| lattice_value(k, lattice))))
        }
        Values::F32(v) => {
            // As bit patterns, 0 to 1 are one range, ordered as the numbers; -0, NaN and the negative lie above it.
            let one = 1f32.to_bits();
            let bits: &[u32] = bytemuck::cast_slice(v);
            if bits.iter().fold(0, |most, &v| most.max(v)) <= one {
                monochrome(tile, bits, one).map(|(depths, ends)| (depths, ends.map(f32::from_bits)))
            } else {
                None
            }
        }
    };
    if let Some((depths, ends)) = ranges {
        return Ok(Ranges { depths, ends });
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
        None => Ok(Ranges {
            depths: tile.depth_range(),
            ends: tile.end_range(),
        }),
    }
}

/// A type of visibilities in planes: counts neighbours with counters of its own width, which become vector code.
trait Lane: Copy + Ord + Default {
    /// How many neighbours rise (a < b), and how many triples are flat (a == b == c). At most 2^15 of them.
    fn count(a: &[Self], b: &[Self], c: &[Self]) -> [i64; 2];
}

macro_rules! lane {
    ($t:ty) => {
        impl Lane for $t {
            #[inline(always)]
            fn count(a: &[Self], b: &[Self], c: &[Self]) -> [i64; 2] {
                let n = a.len();
                let (b, c) = (&b[..n], &c[..n]);
                let (mut rises, mut flats): ($t, $t) = (0, 0);
                for i in 0..n {
                    rises += <$t>::from(a[i] < b[i]);
                    flats += <$t>::from((a[i] == b[i]) & (b[i] == c[i]));
                }
                [rises.into(), flats.into()]
            }
        }
    };
}

lane!(u16);
lane!(u32);

/// What a monochrome tile spans, visibilities in the type of the plane; `None` if a law may be broken, and for coloured tiles.
///
/// Neighbours are compared over whole planes, where the compiler makes vector code; those that straddle two pixels are taken
/// off again pixel by pixel.
#[inline(always)]
fn monochrome<T: Lane>(tile: &Tile, v: &[T], one: T) -> Option<([f32; 2], [T; 2])> {
    const CHUNK: usize = 1 << 15;
    if tile.is_coloured() {
        return None;
    }
    let (table, z) = (tile.view().vertex, tile.view().z);
    let n = z.len();
    let v = &v[..n];
    let odd = |z: &f32| {
        let z = z.to_bits();
        u32::from(z & 0x7F80_0000 == 0x7F80_0000) | u32::from(z == 0x8000_0000)
    };
    if z.iter().fold(0, |any, z| any | odd(z)) != 0 {
        return None;
    }
    let (mut falls, mut equals) = (0u32, 0u32);
    for (a, b) in z.iter().zip(z.get(1..).unwrap_or(&[])) {
        falls += u32::from(a > b);
        equals |= u32::from(a == b);
    }
    let mut falls = i64::from(falls);
    let [mut rises, mut flats] = [0i64; 2];
    for at in (0..n.saturating_sub(2)).step_by(CHUNK) {
        let end = (at + CHUNK).min(n - 2);
        let counted = T::count(&v[at..end], &v[at + 1..], &v[at + 2..]);
        rises += counted[0];
        flats += counted[1];
    }
    if n > 1 {
        rises += i64::from(v[n - 2] < v[n - 1]);
    }
    // Each loop keeps few numbers, so that they stay in registers.
    let [mut least, mut most] = [f32::INFINITY, f32::NEG_INFINITY];
    let (mut bad, mut start) = (false, 0);
    for &end in &table[1..] {
        let (first, end) = (start, end as usize);
        if first == end {
            continue;
        }
        start = end;
        let [head, tail] = [z[first], z[end - 1]];
        falls -= i64::from(first > 0 && z[first - 1] > head);
        bad |= end - first > 1 && head == z[first + 1];
        least = if head < least { head } else { least };
        most = if tail > most { tail } else { most };
    }
    let depths = if n == 0 { [0.0; 2] } else { [least, most] };
    let (mut ends, mut start) = ([one, T::default()], 0);
    for &end in &table[1..] {
        let (first, end) = (start, end as usize);
        if first == end {
            ends[1] = one;
            continue;
        }
        start = end;
        let [head, tail] = [v[first], v[end - 1]];
        if first > 0 {
            rises -= i64::from(v[first - 1] < head);
            // A triple straddles if its middle is the first of a pixel, or the last: but no function may end flat.
            flats -= i64::from(first + 1 < n && v[first - 1] == head && head == v[first + 1]);
        }
        bad |= if end - first > 1 {
            (head == one && v[first + 1] == one) | (tail == v[end - 2])
        } else {
            head == one
        };
        ends = [ends[0].min(tail), ends[1].max(tail)];
    }
    let sound = !bad && falls == 0 && rises == 0 && flats == 0;
    (sound && (equals == 0 || steps_are_sound(table, z, v))).then_some((depths, ends))
}

/// Whether no depth of a pixel holds three vertices, and something falls at every one that holds two.
#[inline(always)]
fn steps_are_sound<T: PartialEq + Copy>(table: &[u32], z: &[f32], v: &[T]) -> bool {
    let n = z.len();
    let twin = |i: usize| (z[i - 1] == z[i]) & (v[i - 1] == v[i]);
    let triple = |i: usize| (z[i - 1] == z[i]) & (z[i] == z[i + 1]);
    let (mut twins, mut triples) = (0u32, 0u32);
    for i in 1..n {
        twins += u32::from(twin(i));
    }
    for i in 1..n.saturating_sub(1) {
        triples += u32::from(triple(i));
    }
    // As in `monochrome`, what straddles two pixels is taken off: a triple where its middle is the first or the last of one.
    let mut start = 0;
    for &end in &table[1..] {
        let (first, end) = (start, end as usize);
        if first == end {
            continue;
        }
        start = end;
        if first > 0 {
            twins -= u32::from(twin(first));
            triples -= u32::from(first + 1 < n && triple(first));
        }
        if end - 1 > first && end < n {
            triples -= u32::from(triple(end - 1));
        }
    }
    twins == 0 && triples == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::tile::{Counts, ValuesMut, planes_mut};

    /// A tile of vertices that need not be lawful, from few depths and few visibilities, so that everything meets everything.
    fn any_tile(dice: &mut impl FnMut(u32) -> u32, lattice: u16) -> Tile {
        let pixels = 1 + dice(6) as usize;
        let mut table = vec![0];
        for i in 0..pixels {
            table.push(table[i] + dice(5));
        }
        let n = table[pixels] as usize;
        let counts = Counts {
            pixels,
            vertices: n,
            coloured: None,
            lattice,
        };
        let mut words = Vec::new();
        let planes = planes_mut(&mut words, &counts);
        planes.vertex.copy_from_slice(&table);
        let mut values = vec![0; n];
        for range in table.windows(2) {
            let range = range[0] as usize..range[1] as usize;
            let (mut z, mut k) = (dice(3), 4 - dice(2));
            for i in range {
                planes.z[i] = match (dice(60), z) {
                    (0, _) => -0.0,
                    (1, _) => f32::INFINITY,
                    (_, z) => z as f32,
                };
                values[i] = k;
                z = (z + dice(3)).saturating_sub(u32::from(dice(40) == 0) * 2);
                k = k.saturating_sub(dice(3)) + u32::from(dice(40) == 0);
            }
        }
        match planes.v {
            ValuesMut::Lattice(v) => v.iter_mut().zip(&values).for_each(|(v, k)| *v = *k as u16),
            ValuesMut::F32(v) => v
                .iter_mut()
                .zip(&values)
                .for_each(|(v, k)| *v = *k as f32 / 4.0),
        }
        Tile::new(pixels as u32, words, counts)
    }

    #[test]
    fn whole_planes_are_judged_as_single_functions_are() {
        let mut state = 1u64;
        let mut dice = |n: u32| {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 33) as u32 % n
        };
        let mut sound = [0; 2];
        for i in 0..200_000 {
            let tile = any_tile(&mut dice, if i % 2 == 0 { 4 } else { 0 });
            let slow = tile.first_broken().is_none();
            match check(&tile) {
                Ok(ranges) => {
                    assert!(slow, "{tile:?}");
                    assert_eq!(ranges.depths, tile.depth_range(), "{tile:?}");
                    assert_eq!(ranges.ends, tile.end_range(), "{tile:?}");
                }
                Err(e) => assert!(!slow || e.rule() == Some("TILE-LATTICE"), "{tile:?}"),
            }
            // The fast way must not leave what is sound to the slow one.
            let fast = match tile.view().v {
                Values::Lattice(k) => {
                    k.iter().all(|&k| k <= 4) && monochrome(&tile, k, 4).is_some()
                }
                Values::F32(v) => {
                    monochrome(&tile, bytemuck::cast_slice(v), 1f32.to_bits()).is_some()
                }
            };
            assert_eq!(fast, slow, "{tile:?}");
            sound[usize::from(slow)] += 1;
        }
        assert!(sound.iter().all(|&n| n > 10_000), "{sound:?}");
    }
}
