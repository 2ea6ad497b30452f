//! Delta planes: the transform that makes tiles small (`spec/format.md`, section 8).

use super::directory::Entry;
use super::tile::{Tile, Values};
use crate::{Error, Result};

/// Id of no transform.
pub const NONE: u8 = 0;
/// Id of delta planes.
pub const DELTA_PLANES: u8 = 1;

/// The ordered integer of a depth: sorts as the depths do.
#[inline]
fn ordered(z: f32) -> u32 {
    let bits = z.to_bits();
    if bits >> 31 == 0 {
        bits ^ 0x8000_0000
    } else {
        !bits
    }
}

#[inline]
fn from_ordered(o: u32) -> f32 {
    f32::from_bits(if o >> 31 == 1 { o ^ 0x8000_0000 } else { !o })
}

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
    width: usize,
    /// Ordered first depths of the row above and of this row; `None` where a pixel has no vertices.
    above: Vec<Option<u32>>,
    row: Vec<Option<u32>>,
    last: u32,
    x: usize,
}

impl Predictor {
    fn new(width: usize) -> Self {
        Predictor {
            width,
            above: vec![None; width],
            row: vec![None; width],
            last: 0x8000_0000,
            x: 0,
        }
    }

    /// The prediction for the pixel whose turn it is.
    #[inline]
    fn predict(&self) -> u32 {
        let left = if self.x > 0 {
            self.row[self.x - 1]
        } else {
            None
        };
        let corner = if self.x > 0 {
            self.above[self.x - 1]
        } else {
            None
        };
        match (left, self.above[self.x], corner) {
            (Some(l), Some(u), Some(ul)) => l.wrapping_add(u).wrapping_sub(ul),
            (Some(l), _, _) => l,
            (None, Some(u), _) => u,
            (None, None, _) => self.last,
        }
    }

    /// Tells what the pixel's first depth was, and goes on to the next.
    #[inline]
    fn next(&mut self, first: Option<u32>) {
        self.row[self.x] = first;
        self.last = first.unwrap_or(self.last);
        self.x += 1;
        if self.x == self.width {
            std::mem::swap(&mut self.above, &mut self.row);
            self.x = 0;
        }
    }
}

fn put_planes_u32(values: &[u32], out: &mut Vec<u8>) {
    for plane in 0..4 {
        out.extend(values.iter().map(|v| (v >> (8 * plane)) as u8));
    }
}

fn put_planes_u16(values: &[u16], out: &mut Vec<u8>) {
    for plane in 0..2 {
        out.extend(values.iter().map(|v| (v >> (8 * plane)) as u8));
    }
}

/// The delta planes of a tile.
pub(super) fn encode(tile: &Tile) -> Vec<u8> {
    let n = tile.z.len();
    let counts: Vec<u32> = tile.vertex.windows(2).map(|w| w[1] - w[0]).collect();
    let (_, most) = size_range(
        counts.len() as u64,
        n as u64,
        tile.is_coloured(),
        tile.lattice,
    );
    let mut out = Vec::with_capacity(most as usize);
    put_planes_u32(&counts, &mut out);
    if tile.is_coloured() {
        put_bits(tile.colour.windows(2).map(|w| w[1] > w[0]), &mut out);
    }
    let mut predictor = Predictor::new(tile.width as usize);
    let (mut steps, mut firsts, mut gaps) =
        (Vec::with_capacity(n), Vec::new(), Vec::with_capacity(n));
    for range in tile.vertex.windows(2) {
        let z = &tile.z[range[0] as usize..range[1] as usize];
        let first = z.first().map(|&z| ordered(z));
        if let Some(first) = first {
            firsts.push(zigzag(first.wrapping_sub(predictor.predict())));
        }
        predictor.next(first);
        for pair in z.windows(2) {
            let gap = ordered(pair[1]).wrapping_sub(ordered(pair[0]));
            steps.push(gap == 0);
            if gap != 0 {
                gaps.push(gap);
            }
        }
    }
    put_bits(steps.into_iter(), &mut out);
    put_planes_u32(&firsts, &mut out);
    put_planes_u32(&gaps, &mut out);
    match &tile.v {
        Values::Lattice(k) => {
            each_plane(tile, k, |k, table| {
                put_planes_u16(&drops(k, table, tile.lattice, u16::wrapping_sub), &mut out)
            });
        }
        Values::F32(v) => {
            let bits: Vec<u32> = v.iter().map(|v| v.to_bits()).collect();
            each_plane(tile, &bits, |v, table| {
                put_planes_u32(&drops(v, table, ONE, u32::wrapping_sub), &mut out)
            });
        }
    }
    out
}

/// Bits of the visibility 1.
const ONE: u32 = 0x3F80_0000;

/// Calls `f` with each channel's values and the table that says which pixel they belong to.
fn each_plane<T>(tile: &Tile, values: &[T], mut f: impl FnMut(&[T], &[u32])) {
    let (first, rest) = values.split_at(tile.z.len());
    f(first, &tile.vertex);
    let coloured = tile.colour.last().map_or(0, |&m| m as usize);
    if coloured > 0 {
        rest.chunks_exact(coloured)
            .for_each(|plane| f(plane, &tile.colour));
    }
}

/// How far each value falls from the one before it in its pixel, or from `one`.
fn drops<T: Copy>(values: &[T], table: &[u32], one: T, minus: impl Fn(T, T) -> T) -> Vec<T> {
    let mut out = Vec::with_capacity(values.len());
    for range in table.windows(2) {
        let mut last = one;
        for &v in &values[range[0] as usize..range[1] as usize] {
            out.push(minus(last, v));
            last = v;
        }
    }
    out
}

/// The inverse of [`drops`], in place.
fn undrop<T: Copy>(values: &mut [T], table: &[u32], one: T, minus: impl Fn(T, T) -> T) {
    for range in table.windows(2) {
        let mut last = one;
        for v in &mut values[range[0] as usize..range[1] as usize] {
            last = minus(last, *v);
            *v = last;
        }
    }
}

fn put_bits(bits: impl Iterator<Item = bool>, out: &mut Vec<u8>) {
    let (mut byte, mut used) = (0u8, 0);
    for bit in bits {
        byte |= u8::from(bit) << used;
        used += 1;
        if used == 8 {
            out.push(byte);
            (byte, used) = (0, 0);
        }
    }
    if used > 0 {
        out.push(byte);
    }
}

/// The bits of `n` flags, whose unused ones must be zero.
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

    fn planes_u32(&mut self, n: usize) -> Result<Vec<u32>> {
        let bytes = self.take(4 * n)?;
        let (a, rest) = bytes.split_at(n);
        let (b, rest) = rest.split_at(n);
        let (c, d) = rest.split_at(n);
        let word =
            |(((&a, &b), &c), &d): (((&u8, &u8), &u8), &u8)| u32::from_le_bytes([a, b, c, d]);
        Ok(a.iter().zip(b).zip(c).zip(d).map(word).collect())
    }

    fn planes_u16(&mut self, n: usize) -> Result<Vec<u16>> {
        let (a, b) = self.take(2 * n)?.split_at(n);
        Ok(a.iter()
            .zip(b)
            .map(|(&a, &b)| u16::from_le_bytes([a, b]))
            .collect())
    }
}

/// The tile whose delta planes these are.
pub(super) fn decode(bytes: &[u8], width: u32, pixels: u32, entry: &Entry) -> Result<Tile> {
    let mut stream = Stream(bytes);
    let (p, n) = (pixels as usize, entry.vertices as usize);
    let counts = stream.planes_u32(p)?;
    let vertex = cumulate(counts.iter().copied());
    if vertex.last() != Some(&entry.vertices)
        || counts.iter().map(|&c| u64::from(c)).sum::<u64>() != n as u64
    {
        let what = "the counts are not those of the directory";
        return Err(Error::corrupt("TILE-VERTICES", what));
    }
    let mut colour = Vec::new();
    if entry.coloured {
        let bits = stream.take(p.div_ceil(8))?;
        check_bits(bits, p)?;
        if (0..p).any(|i| bit(bits, i) && counts[i] == 0) {
            return Err(broken("a pixel without vertices is coloured"));
        }
        colour = cumulate((0..p).map(|i| if bit(bits, i) { counts[i] } else { 0 }));
    }
    let filled = counts.iter().filter(|&&c| c > 0).count();
    let followers = n - filled;
    let step_bits = stream.take(followers.div_ceil(8))?;
    check_bits(step_bits, followers)?;
    let steps = step_bits
        .iter()
        .map(|b| b.count_ones() as usize)
        .sum::<usize>();
    let firsts = stream.planes_u32(filled)?;
    let gaps = stream.planes_u32(followers - steps)?;
    if gaps.contains(&0) {
        return Err(broken("a gap of zero without its step bit"));
    }
    let z = depths(&counts, &firsts, step_bits, &gaps, width as usize);
    let m = colour.last().map_or(0, |&m: &u32| m as usize);
    let v = if entry.lattice != 0 {
        let mut k = stream.planes_u16(n)?;
        undrop(&mut k, &vertex, entry.lattice, u16::wrapping_sub);
        for _ in 0..if m > 0 { 2 } else { 0 } {
            let mut plane = stream.planes_u16(m)?;
            undrop(&mut plane, &colour, entry.lattice, u16::wrapping_sub);
            k.append(&mut plane);
        }
        Values::Lattice(k)
    } else {
        let mut bits = stream.planes_u32(n)?;
        undrop(&mut bits, &vertex, ONE, u32::wrapping_sub);
        for _ in 0..if m > 0 { 2 } else { 0 } {
            let mut plane = stream.planes_u32(m)?;
            undrop(&mut plane, &colour, ONE, u32::wrapping_sub);
            bits.append(&mut plane);
        }
        Values::F32(bits.into_iter().map(f32::from_bits).collect())
    };
    if !stream.0.is_empty() {
        return Err(broken("bytes are left over"));
    }
    Ok(Tile {
        width,
        lattice: entry.lattice,
        vertex,
        colour,
        z,
        v,
    })
}

fn cumulate(counts: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut total = 0u32;
    let mut table = vec![0];
    table.extend(counts.map(|c| {
        total = total.wrapping_add(c);
        total
    }));
    table
}

/// The depths of all vertices. The counts have been checked against the sizes of the parts.
fn depths(
    counts: &[u32],
    firsts: &[u32],
    step_bits: &[u8],
    gaps: &[u32],
    width: usize,
) -> Vec<f32> {
    let total = counts.iter().map(|&c| c as usize).sum();
    let mut z = vec![0.0; total];
    let (mut firsts, mut gaps, mut rest) = (firsts.iter(), gaps, &mut z[..]);
    let mut predictor = Predictor::new(width);
    let mut follower = 0;
    for &count in counts {
        if count == 0 {
            predictor.next(None);
            continue;
        }
        let (own, others) = std::mem::take(&mut rest).split_at_mut(count as usize);
        rest = others;
        let mut o = predictor
            .predict()
            .wrapping_add(from_zigzag(*firsts.next().unwrap_or(&0)));
        predictor.next(Some(o));
        own[0] = from_ordered(o);
        let followers = &mut own[1..];
        let after = follower + followers.len();
        if no_bit(step_bits, follower, after) && followers.len() <= gaps.len() {
            // The usual pixel has no step: its gaps are one run.
            let (run, later) = gaps.split_at(followers.len());
            gaps = later;
            for (z, gap) in followers.iter_mut().zip(run) {
                o = o.wrapping_add(*gap);
                *z = from_ordered(o);
            }
        } else {
            for (i, z) in followers.iter_mut().enumerate() {
                if !bit(step_bits, follower + i)
                    && let Some((gap, later)) = gaps.split_first()
                {
                    gaps = later;
                    o = o.wrapping_add(*gap);
                }
                *z = from_ordered(o);
            }
        }
        follower = after;
    }
    z
}

/// Whether none of the bits from `start` to `end` is set.
fn no_bit(bytes: &[u8], start: usize, end: usize) -> bool {
    if start == end {
        return true;
    }
    let (first, last) = (start / 8, (end - 1) / 8);
    let (head, tail) = (0xFFu8 << (start % 8), 0xFFu8 >> (7 - (end - 1) % 8));
    if first == last {
        return bytes[first] & head & tail == 0;
    }
    bytes[first] & head == 0
        && bytes[last] & tail == 0
        && bytes[first + 1..last].iter().all(|&b| b == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordered_integers_sort_as_depths_do() {
        let depths = [
            f32::MIN,
            -1.0,
            -f32::from_bits(1),
            0.0,
            f32::from_bits(1),
            1.0,
            1.0f32.next_up(),
            f32::MAX,
        ];
        for pair in depths.windows(2) {
            assert!(ordered(pair[0]) < ordered(pair[1]));
        }
        for z in depths {
            assert_eq!(from_ordered(ordered(z)).to_bits(), z.to_bits());
        }
        assert_eq!(ordered(0.0), 0x8000_0000);
    }

    #[test]
    fn zigzag_is_small_near_zero() {
        assert_eq!(
            [0, -1i32, 1, -2, 2].map(|d| zigzag(d as u32)),
            [0, 1, 2, 3, 4]
        );
        for d in [0, 1, u32::MAX, 1 << 31, (1 << 31) - 1] {
            assert_eq!(from_zigzag(zigzag(d)), d);
        }
    }
}
