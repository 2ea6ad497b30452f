//! Checks the laws of `spec/semantics.md`, section 3, for a whole tile at memory speed.
//!
//! The fast check reads the planes of a monochrome tile once, in chunks that fit the L1 cache. It
//! compares each vertex with its neighbours in loops that the compiler vectorises; the first
//! vertices of pixels are marked, so that no comparison crosses two pixels. The slow check, which
//! finds the place, runs only if a law may be broken.

use super::ensure;
use super::tile::{Tile, TileValues};
use super::wide::wide;
use crate::error::Place;
use crate::function::Broken;
use crate::function::view::lattice_value;
use crate::{Error, Result};

/// The ranges of a tile that its directory entry states: least and greatest depth of a vertex
/// (zeros if there is none), and least and greatest visibility behind everything.
type Ranges = ([f32; 2], [f32; 2]);

/// Checks the laws of all functions of a tile. The tables of the tile must be sound.
pub(super) fn check(tile: &Tile) -> Result<Ranges> {
    let ranges = wide(
        #[inline(always)]
        || fast_check(tile),
    );
    if let Some(ranges) = ranges {
        return Ok(ranges);
    }
    if let TileValues::Lattice {
        numerators,
        lattice,
    } = tile.planes().values
    {
        let most = numerators.iter().fold(0, |most, &k| most.max(k));
        ensure(most <= lattice, "TILE-LATTICE", || {
            format!("a visibility above {lattice} / {lattice}")
        })?;
    }
    match tile.first_broken() {
        Some((i, Broken { rule, why, vertex })) => {
            let what = format!("{why} (pixel {i} of the tile)");
            Err(Error::corrupt(rule, what).at(Place::sample(vertex)))
        }
        None => {
            debug_assert!(tile.is_coloured(), "the fast check refused a lawful tile");
            Ok((tile.depth_range(), tile.end_range()))
        }
    }
}

/// The fast check. `None` if a law may be broken, and for coloured tiles.
#[inline(always)]
fn fast_check(tile: &Tile) -> Option<Ranges> {
    match tile.planes().values {
        TileValues::Lattice {
            numerators,
            lattice,
        } => {
            let (depths, ends) = monochrome(tile, numerators, lattice)?;
            Some((depths, ends.map(|k| lattice_value(k, lattice))))
        }
        // As bit patterns, 0 to 1 are one range in the order of the numbers. -0, NaN and negative
        // numbers lie above it.
        TileValues::F32(v) => {
            let (depths, ends) = monochrome(tile, bytemuck::cast_slice(v), 1f32.to_bits())?;
            Some((depths, ends.map(f32::from_bits)))
        }
    }
}

/// Vertices that are checked together: few enough that planes and marks stay in the L1 cache.
const CHUNK: usize = 2048;

/// A type of visibilities in planes.
trait Lane: Copy + Default + PartialEq {
    /// Checks the visibilities `here` of a chunk, or of a part of it, and includes them in `seen`.
    ///
    /// `before` and `behind` are the same plane, one vertex earlier and later. `starts` and `gaps`
    /// belong to the same vertices and to one more. A start is 1 as a visibility is stored at the
    /// first vertex of a pixel, else 0. A gap has the sign of the distance from the vertex before.
    fn check(planes: [&[Self]; 3], starts: &[Self], gaps: &[i16], seen: &mut Seen<Self>);
}

/// The result for the vertices that were checked.
struct Seen<T> {
    /// Not 0 if a visibility breaks a law.
    broken: T,
    /// Negative if a depth is less than the one before it.
    falls: i16,
    /// Least visibility of all vertices.
    least: T,
    /// Greatest visibility of the last vertices of all pixels.
    most: T,
}

macro_rules! lane {
    ($t:ty) => {
        impl Lane for $t {
            #[inline(always)]
            fn check(
                [before, here, behind]: [&[Self]; 3],
                starts: &[Self],
                gaps: &[i16],
                seen: &mut Seen<Self>,
            ) {
                let equal = |a: $t, b: $t| <$t>::from(a == b).wrapping_neg();
                let step = |gap: i16| <$t>::from(gap == 0).wrapping_neg();
                let n = here.len();
                let (before, behind) = (&before[..n], &behind[..n]);
                let (starts, ends) = (&starts[..n], &starts[1..=n]);
                let (gaps, next_gaps) = (&gaps[..n], &gaps[1..=n]);
                let Seen {
                    mut broken,
                    mut falls,
                    mut least,
                    mut most,
                } = *seen;
                for i in 0..n {
                    // In front of a function the visibility is 1. This also bounds what follows.
                    let previous = before[i].max(starts[i]);
                    let rise = here[i].saturating_sub(previous);
                    let flat = equal(previous, here[i]);
                    let redundant = flat & (ends[i] | equal(here[i], behind[i]));
                    let empty_step = flat & step(gaps[i]);
                    let crowded = (starts[i] | step(gaps[i])) & step(next_gaps[i]);
                    broken |= rise | redundant | empty_step | crowded;
                    falls |= gaps[i];
                    least = least.min(here[i]);
                    most = most.max(here[i].min(ends[i]));
                }
                *seen = Seen {
                    broken,
                    falls,
                    least,
                    most,
                };
            }
        }
    };
}

lane!(u16);
lane!(u32);

/// Ranges of the depths and of the end values of a monochrome tile, visibilities as they are
/// stored. `None` if a law may be broken, and for coloured tiles.
#[inline(always)]
fn monochrome<T: Lane>(tile: &Tile, v: &[T], one: T) -> Option<([f32; 2], [T; 2])> {
    if tile.is_coloured() {
        return None;
    }
    let table = tile.planes().vertex_table;
    let z: &[i32] = bytemuck::cast_slice(tile.planes().depths);
    // Most tiles hold no negative depth. Without one, the order of depths is that of their bits.
    planes::<T, false>(table, z, v, one).or_else(|| planes::<T, true>(table, z, v, one))
}

/// Checks the planes of a monochrome tile chunk by chunk. Depths are given as bits; they may be
/// negative only if `SIGNED`.
#[inline(always)]
fn planes<T: Lane, const SIGNED: bool>(
    table: &[u32],
    z: &[i32],
    v: &[T],
    one: T,
) -> Option<([f32; 2], [T; 2])> {
    // From bits to integers in the order of the numbers, -0 as -1; and back.
    let ordered = |z: i32| {
        if SIGNED { z ^ (z >> 31 & i32::MAX) } else { z }
    };
    let n = z.len();
    if n == 0 {
        return Some(([0.0; 2], [one; 2]));
    }
    let mut seen = Seen {
        broken: T::default(),
        falls: 0,
        least: one,
        most: T::default(),
    };
    let (mut least, mut most) = (ordered(z[0]), ordered(z[0]));
    let mut negative_zero = SIGNED && least == -1;
    // Of the vertices of a chunk, and of the vertex after it: see `Lane::check`.
    let mut starts = [T::default(); CHUNK + 1];
    let mut gaps = [1i16; CHUNK + 1];
    let mut pixel = 0;
    for from in (0..n).step_by(CHUNK) {
        let to = (from + CHUNK).min(n);

        // The first vertex of the plane has none before it.
        let (low, high) = (from.max(1), (to + 1).min(n));
        let (before, here) = (&z[low - 1..high - 1], &z[low..high]);
        let signs = &mut gaps[low - from..high - from];
        for i in 0..here.len() {
            let (a, b) = (ordered(before[i]), ordered(here[i]));
            let gap = if SIGNED {
                i32::from(a < b) - i32::from(a > b)
            } else {
                b.wrapping_sub(a)
            };
            signs[i] = gap.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
            least = least.min(b);
            most = most.max(b);
            negative_zero |= SIGNED && b == -1;
        }

        // Any depth may begin a pixel. The end of the plane is marked as a start, too.
        let first = starts[CHUNK];
        starts.fill(T::default());
        starts[0] = first;
        if first == one {
            gaps[0] = 1;
        }
        while let Some(&start) = table.get(pixel).filter(|&&start| start as usize <= to) {
            starts[start as usize - from] = one;
            gaps[start as usize - from] = 1;
            pixel += 1;
        }

        // Nor is the first vertex compared with one before it, or the last with one after it.
        for (low, high) in [(from.max(1), to.min(n - 1)), (from, 1), (n - 1, to)] {
            if low < high {
                let before = if low == 0 {
                    &[T::default()]
                } else {
                    &v[low - 1..]
                };
                let behind = &v[(low + 1).min(n - 1)..];
                let (starts, gaps) = (&starts[low - from..], &gaps[low - from..]);
                T::check([before, &v[low..high], behind], starts, gaps, &mut seen);
            }
        }
    }
    const INFINITE: i32 = 0x7F80_0000;
    let finite = least > !INFINITE && most < INFINITE && (SIGNED || least >= 0);
    if !finite || negative_zero || seen.broken != T::default() || seen.falls < 0 {
        return None;
    }
    let empty = table.windows(2).fold(false, |any, w| any | (w[0] == w[1]));
    let depths = [least, most].map(|z| f32::from_bits(ordered(z) as u32));
    Some((depths, [seen.least, if empty { one } else { seen.most }]))
}
