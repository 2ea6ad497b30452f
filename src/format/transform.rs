//! Delta planes: the transform that makes tiles small (`spec/format.md`, section 8).

use std::cell::Cell;

use super::directory::Entry;
use super::tile::{Counts, Tile, TileValues, ValuesMut, Words, planes_mut};
use crate::function::{from_ordered_bits, ordered_bits};
use crate::{Error, Result, scratch};

/// Id of no transform.
pub const NONE: u8 = 0;
/// Id of delta planes.
pub const DELTA_PLANES: u8 = 1;

#[inline]
fn zigzag(d: u32) -> u32 {
    (d << 1) ^ ((d as i32 >> 31) as u32)
}

#[inline]
fn from_zigzag(d: u32) -> u32 {
    (d >> 1) ^ (d & 1).wrapping_neg()
}

/// Least and greatest size of the delta planes of a tile with these counts.
pub(super) fn size_range(pixels: u64, vertices: u64, coloured: bool, lattice: u16) -> (u64, u64) {
    let w = if lattice == 0 { 4 } else { 2 };
    let bits = if coloured { pixels.div_ceil(8) } else { 0 };
    let least = 4 * pixels + bits + w * vertices;
    let most =
        least + vertices.div_ceil(8) + 4 * vertices + if coloured { 2 * w * vertices } else { 0 };
    (least, most)
}

/// Predicts the first depth of each pixel from its neighbours in the tile.
struct Predictor {
    /// Ordered first depths: `None`, then those of this row up to pixel `x` and of the row above
    /// from there on. `None` where a pixel has no vertices.
    row: Vec<Option<u32>>,
    /// That of the row above at pixel `x - 1`.
    corner: Option<u32>,
    last: u32,
    x: usize,
}

impl Predictor {
    fn new(width: usize) -> Self {
        Predictor {
            row: vec![None; width + 1],
            corner: None,
            last: 0x8000_0000,
            x: 0,
        }
    }

    /// The prediction for the current pixel.
    #[inline]
    fn predict(&self) -> u32 {
        match (self.row[self.x], self.row[self.x + 1], self.corner) {
            (Some(l), Some(u), Some(ul)) => l.wrapping_add(u).wrapping_sub(ul),
            (Some(l), _, _) => l,
            (None, Some(u), _) => u,
            (None, None, _) => self.last,
        }
    }

    /// Takes the first depth of the pixel, and goes to the next pixel.
    #[inline]
    fn next(&mut self, first: Option<u32>) {
        self.x += 1;
        self.corner = std::mem::replace(&mut self.row[self.x], first);
        self.last = first.unwrap_or(self.last);
        if self.x + 1 == self.row.len() {
            (self.x, self.corner) = (0, None);
        }
    }
}

fn put_planes<T: Lane>(values: &[T], out: &mut Vec<u8>) {
    for plane in 0..size_of::<T>() {
        out.extend(values.iter().map(|v| v.byte(plane)));
    }
}

/// The delta planes of a tile.
pub(super) fn encode(tile: &Tile) -> Vec<u8> {
    let planes = tile.planes();
    let n = planes.depths.len();
    let counts: Vec<u32> = planes
        .vertex_table
        .windows(2)
        .map(|w| w[1] - w[0])
        .collect();
    let (_, most) = size_range(
        counts.len() as u64,
        n as u64,
        tile.is_coloured(),
        tile.lattice(),
    );
    let mut out = Vec::with_capacity(most as usize);
    put_planes(&counts, &mut out);
    let is_coloured = planes.colour_table.windows(2).map(|w| w[1] > w[0]);
    put_bits(&is_coloured.collect::<Vec<_>>(), &mut out);
    let mut predictor = Predictor::new(tile.width() as usize);
    let (mut steps, mut firsts, mut gaps) =
        (Vec::with_capacity(n), Vec::new(), Vec::with_capacity(n));
    for range in planes.vertex_table.windows(2) {
        let z = &planes.depths[range[0] as usize..range[1] as usize];
        let first = z.first().map(|&z| ordered_bits(z));
        if let Some(first) = first {
            firsts.push(zigzag(first.wrapping_sub(predictor.predict())));
        }
        predictor.next(first);
        for pair in z.windows(2) {
            let gap = ordered_bits(pair[1]).wrapping_sub(ordered_bits(pair[0]));
            steps.push(gap == 0);
            if gap != 0 {
                gaps.push(gap);
            }
        }
    }
    put_bits(&steps, &mut out);
    put_planes(&firsts, &mut out);
    put_planes(&gaps, &mut out);
    match planes.values {
        TileValues::Lattice {
            numerators,
            lattice,
        } => put_channels(tile, numerators, lattice, &mut out),
        TileValues::F32(v) => put_channels(tile, bytemuck::cast_slice(v), ONE, &mut out),
    }
    out
}

/// Bits of the visibility 1.
const ONE: u32 = 0x3F80_0000;

/// Writes all channels: how far each value falls from the one before it in its pixel, or from
/// `one`.
fn put_channels<T: Lane>(tile: &Tile, values: &[T], one: T, out: &mut Vec<u8>) {
    let planes = tile.planes();
    let mut put = |values: &[T], table: &[u32]| {
        let mut falls = Vec::with_capacity(values.len());
        for range in table.windows(2) {
            let mut last = one;
            for &v in &values[range[0] as usize..range[1] as usize] {
                falls.push(last.minus(v));
                last = v;
            }
        }
        put_planes(&falls, out);
    };
    let (first, others) = values.split_at(planes.depths.len());
    put(first, planes.vertex_table);
    for plane in others.chunks((others.len() / 2).max(1)) {
        put(plane, planes.colour_table);
    }
}

/// Writes eight bits a byte, the first in the lowest place.
fn put_bits(bits: &[bool], out: &mut Vec<u8>) {
    let byte = |bits: &[bool]| bits.iter().rev().fold(0, |b, &bit| b << 1 | u8::from(bit));
    out.extend(bits.chunks(8).map(byte));
}

/// Checks that the unused bits of `n` flags are zero.
fn check_bits(bytes: &[u8], n: usize) -> Result<()> {
    match bytes.last() {
        Some(last) if !n.is_multiple_of(8) && last >> (n % 8) != 0 => {
            Err(broken("unused bits are not zero"))
        }
        _ => Ok(()),
    }
}

fn bit(bytes: &[u8], i: usize) -> bool {
    bytes[i / 8] >> (i % 8) & 1 == 1
}

fn broken(what: &str) -> Error {
    Error::corrupt("TILE-STREAM", what)
}

/// The parts of a stream, taken one after another.
struct Stream<'a>(&'a [u8]);

impl<'a> Stream<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8]> {
        let (head, tail) = self
            .0
            .split_at_checked(n)
            .ok_or_else(|| broken("the stream is too short for its counts"))?;
        self.0 = tail;
        Ok(head)
    }

    /// `n` words in four planes.
    #[inline(always)]
    fn planes_u32(&mut self, n: usize) -> Result<impl Iterator<Item = u32> + Clone + 'a> {
        let bytes = self.take(4 * n)?;
        let (a, rest) = bytes.split_at(n);
        let (b, rest) = rest.split_at(n);
        let (c, d) = rest.split_at(n);
        Ok((0..n).map(move |i| u32::from_le_bytes([a[i], b[i], c[i], d[i]])))
    }
}

/// Values in a run. A pixel of more values takes several runs. A pixel of fewer values writes past
/// its end, and the next pixel overwrites that. A fixed count costs less than a loop with an
/// unpredictable end.
const RUN: usize = 16;

/// A type of visibilities in byte planes.
trait Lane: Copy + bytemuck::Pod {
    /// `N` values from `at` on, of `n` in planes.
    fn load<const N: usize>(planes: &[u8], n: usize, at: usize) -> [Self; N];
    fn minus(self, fall: Self) -> Self;
    /// The byte of the value in plane `plane`.
    fn byte(self, plane: usize) -> u8;
}

/// `N` bytes of plane `k`.
#[inline(always)]
fn plane<const N: usize>(planes: &[u8], n: usize, k: usize, at: usize) -> &[u8; N] {
    planes[k * n + at..][..N].try_into().expect("N bytes")
}

macro_rules! lane {
    ($number:ty: $($plane:literal)*) => {
        impl Lane for $number {
            #[inline(always)]
            fn load<const N: usize>(planes: &[u8], n: usize, at: usize) -> [$number; N] {
                let bytes = [$(plane::<N>(planes, n, $plane, at)),*];
                std::array::from_fn(|i| <$number>::from_le_bytes([$(bytes[$plane][i]),*]))
            }

            #[inline(always)]
            fn minus(self, fall: $number) -> $number {
                self.wrapping_sub(fall)
            }

            #[inline(always)]
            fn byte(self, plane: usize) -> u8 {
                self.to_le_bytes()[plane]
            }
        }
    };
}

lane!(u16: 0 1);
lane!(u32: 0 1 2 3);

/// Reads the next channel of visibilities: the inverse of [`drops`].
#[inline(always)]
fn visibilities<T: Lane>(
    stream: &mut Stream<'_>,
    out: &mut [T],
    table: &[u32],
    one: T,
) -> Result<()> {
    let n = out.len();
    let planes = stream.take(size_of_val(out))?;
    let mut at = 0;
    for &end in &table[1..] {
        let mut last = one;
        while at < end as usize {
            if let Some(run) = out.get_mut(at..at + RUN) {
                let falls = T::load::<RUN>(planes, n, at);
                let used = (end as usize - at).min(RUN);
                for (v, fall) in run.iter_mut().zip(falls) {
                    last = last.minus(fall);
                    *v = last;
                }
                last = run[used - 1];
                at += used;
            } else {
                last = last.minus(T::load::<1>(planes, n, at)[0]);
                out[at] = last;
                at += 1;
            }
        }
    }
    Ok(())
}

/// The tile whose delta planes these are. Call it in [`wide`](super::wide::wide).
#[inline(always)]
pub(super) fn decode(
    bytes: &[u8],
    width: u32,
    pixels: u32,
    entry: &Entry,
    mut buffer: Words,
) -> Result<Tile> {
    let mut stream = Stream(bytes);
    let (p, n) = (pixels as usize, entry.vertices as usize);
    let counts = stream.planes_u32(p)?;
    if counts.clone().map(u64::from).sum::<u64>() != n as u64 {
        let what = "the counts are not those of the directory";
        return Err(Error::corrupt("TILE-VERTICES", what));
    }
    // Bounds the planes before they are allocated.
    let (least, most) = size_range(p as u64, n as u64, entry.coloured, entry.lattice);
    if !(least..=most).contains(&(bytes.len() as u64)) {
        return Err(broken("the parts have another size than the counts say"));
    }
    let mut coloured = None;
    let mut colour_bits: &[u8] = &[];
    if entry.coloured {
        colour_bits = stream.take(p.div_ceil(8))?;
        check_bits(colour_bits, p)?;
        let pixels = counts.clone().enumerate();
        let own = pixels.filter(|&(i, _)| bit(colour_bits, i));
        if own.clone().any(|(_, count)| count == 0) {
            return Err(broken("a pixel without vertices is coloured"));
        }
        coloured = Some(own.map(|(_, count)| count as usize).sum());
    }
    let shape = Counts {
        pixels: p,
        vertices: n,
        coloured,
        lattice: entry.lattice,
    };
    let planes = planes_mut(&mut buffer, &shape);
    cumulate(counts.clone(), planes.vertex);
    if coloured.is_some() {
        let own = |(i, count)| if bit(colour_bits, i) { count } else { 0 };
        cumulate(counts.clone().enumerate().map(own), planes.colour);
    }
    let filled = counts.map(|c| usize::from(c > 0)).sum::<usize>();
    let followers = n - filled;
    let step_bits = stream.take(followers.div_ceil(8))?;
    check_bits(step_bits, followers)?;
    let steps = step_bits
        .iter()
        .map(|b| b.count_ones() as usize)
        .sum::<usize>();
    let firsts = stream.planes_u32(filled)?;
    scratch::lend(
        &GAPS,
        #[inline(always)]
        |gaps| -> Result<()> {
            let gaps = scratch::first(gaps, followers + RUN);
            let mut zero = 0;
            let stored = stream.planes_u32(followers - steps)?;
            for (place, gap) in gaps.iter_mut().zip(stored) {
                zero |= u32::from(gap == 0);
                *place = gap;
            }
            if zero != 0 {
                return Err(broken("a gap of zero without its step bit"));
            }
            spread(gaps, followers - steps, step_bits, followers);
            let bits = bytemuck::cast_slice_mut(planes.z);
            depths(bits, planes.vertex, firsts, gaps, width as usize);
            Ok(())
        },
    )?;
    match planes.v {
        ValuesMut::Lattice(v) => {
            channels(&mut stream, v, planes.vertex, planes.colour, entry.lattice)?;
        }
        ValuesMut::F32(v) => {
            let bits: &mut [u32] = bytemuck::cast_slice_mut(v);
            channels(&mut stream, bits, planes.vertex, planes.colour, ONE)?;
        }
    }
    if !stream.0.is_empty() {
        return Err(broken("bytes are left over"));
    }
    Ok(Tile::new(width, buffer, shape))
}

/// Writes the running sums of `counts`, from 0 on. The caller has checked that they fit u32.
#[inline(always)]
fn cumulate(counts: impl Iterator<Item = u32>, table: &mut [u32]) {
    let mut total = 0;
    table[0] = 0;
    for (entry, count) in table[1..].iter_mut().zip(counts) {
        total += count;
        *entry = total;
    }
}

/// Reads all channels: the first by the table `vertex`, the others by `colour`.
#[inline(always)]
fn channels<T: Lane>(
    stream: &mut Stream<'_>,
    out: &mut [T],
    vertex: &[u32],
    colour: &[u32],
    one: T,
) -> Result<()> {
    let (first, others) = out.split_at_mut(vertex[vertex.len() - 1] as usize);
    visibilities(stream, first, vertex, one)?;
    if !others.is_empty() {
        for plane in others.chunks_exact_mut(others.len() / 2) {
            visibilities(stream, plane, colour, one)?;
        }
    }
    Ok(())
}

thread_local! {
    /// Buffer for the gaps of a tile.
    static GAPS: Cell<Vec<u32>> = const { Cell::new(Vec::new()) };
}

/// Moves the first `gaps` of `plane` to the followers that they belong to, and writes a gap of zero
/// at every step.
#[inline(always)]
fn spread(plane: &mut [u32], mut gaps: usize, step_bits: &[u8], followers: usize) {
    // Going backwards overwrites nothing that has yet to move. Without steps left, all is in place.
    let mut end = followers;
    for (i, &byte) in step_bits.iter().enumerate().rev() {
        if gaps == end {
            return;
        }
        let start = 8 * i;
        if byte == 0 {
            gaps -= end - start;
            plane.copy_within(gaps..gaps + end - start, start);
        } else {
            for follower in (start..end).rev() {
                plane[follower] = if bit(step_bits, follower) {
                    0
                } else {
                    gaps -= 1;
                    plane[gaps]
                };
            }
        }
        end = start;
    }
}

/// Writes the bits of the depths of all vertices, from the gaps of the followers and [`RUN`] words
/// more. The caller has checked the counts against the sizes of the parts.
#[inline(always)]
fn depths(
    out: &mut [u32],
    table: &[u32],
    mut firsts: impl Iterator<Item = u32>,
    mut gaps: &[u32],
    width: usize,
) {
    let mut predictor = Predictor::new(width);
    let mut at = 0;
    for &end in &table[1..] {
        let end = end as usize;
        if at == end {
            predictor.next(None);
            continue;
        }
        let mut o = predictor
            .predict()
            .wrapping_add(from_zigzag(firsts.next().unwrap_or(0)));
        predictor.next(Some(o));
        out[at] = o;
        at += 1;
        while at < end {
            if let (Some(run), Some(steps)) = (out.get_mut(at..at + RUN), gaps.first_chunk::<RUN>())
            {
                let used = (end - at).min(RUN);
                for (place, gap) in run.iter_mut().zip(steps) {
                    o = o.wrapping_add(*gap);
                    *place = o;
                }
                o = run[used - 1];
                (at, gaps) = (at + used, &gaps[used..]);
            } else {
                o = o.wrapping_add(gaps[0]);
                out[at] = o;
                (at, gaps) = (at + 1, &gaps[1..]);
            }
        }
    }
    out.iter_mut()
        .for_each(|o| *o = from_ordered_bits(*o).to_bits());
}
