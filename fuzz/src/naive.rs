//! A naive tile reader, the oracle for the fast one.
//!
//! Written from `spec/format.md`, sections 7 to 9, alone.

use deepshadow::Visibility;
use deepshadow::raw::directory::Entry;

/// Decodes the functions of a data tile. `None` if it breaks a rule of sections 7 to 9 or a law.
///
/// Of the entry it uses the sizes, padding, codec, transform, number of vertices, lattice and
/// colour. It does not check the CRC or the ranges.
pub fn decode(
    entry: &Entry,
    stored: &[u8],
    (width, height): (u32, u32),
) -> Option<Vec<Visibility>> {
    let frame = stored.len().checked_sub(usize::from(entry.padding))?;
    let (frame, zeros) = stored.split_at(frame);
    if zeros.iter().any(|&b| b != 0) {
        return None;
    }
    let size = entry.decoded_size as usize;
    let bytes = match entry.codec {
        0 => frame.to_vec(),
        1 => lz4(frame)?,
        2 => {
            if frame.get(..4)? != [0x28, 0xB5, 0x2F, 0xFD] {
                return None;
            }
            let whole = zstd::zstd_safe::find_frame_compressed_size(frame).ok()? == frame.len();
            let stated = zstd::zstd_safe::get_frame_content_size(frame).ok()? == Some(size as u64);
            let free = zstd::zstd_safe::get_dict_id_from_frame(frame).is_none();
            let window = frame[4] & 0x20 != 0 || frame[5] <= 0x88;
            if !(whole && stated && free && window) {
                return None;
            }
            thread_local! {
                static CONTEXT: std::cell::RefCell<zstd::bulk::Decompressor<'static>> =
                    std::cell::RefCell::new(zstd::bulk::Decompressor::new().expect("memory"));
            }
            CONTEXT
                .with_borrow_mut(|d| d.decompress(frame, size))
                .ok()?
        }
        _ => return None,
    };
    if bytes.len() != size {
        return None;
    }
    let (width, pixels) = (width as usize, (width * height) as usize);
    match entry.transform {
        0 => plain(entry, &bytes, pixels),
        1 => planes(entry, &bytes, width, pixels),
        _ => None,
    }
}

/// Decodes an LZ4 block. `None` if it breaks a rule of its format, end conditions included.
pub fn lz4(block: &[u8]) -> Option<Vec<u8>> {
    let (mut part, mut out, mut last_match) = (Part(block), Vec::new(), None);
    let length = |part: &mut Part<'_>, nibble: u8| {
        let mut bytes = vec![nibble];
        while bytes == [15] || bytes.len() > 1 && bytes.last() == Some(&255) {
            bytes.push(part.take(1)?[0]);
        }
        Some(bytes.iter().map(|&b| usize::from(b)).sum::<usize>())
    };
    loop {
        let token = part.take(1)?[0];
        let count = length(&mut part, token >> 4)?;
        out.extend_from_slice(part.take(count)?);
        if part.0.is_empty() {
            let enough = |at| count >= 5 && out.len() - at >= 12;
            return last_match.is_none_or(enough).then_some(out);
        }
        let offset = part.take(2)?;
        let offset = usize::from(offset[0]) + 256 * usize::from(offset[1]);
        let count = 4 + length(&mut part, token & 15)?;
        last_match = Some(out.len());
        if offset == 0 || offset > out.len() || count > 1 << 24 {
            return None;
        }
        (0..count).for_each(|_| out.push(out[out.len() - offset]));
    }
}

/// The bytes that remain to be read.
struct Part<'a>(&'a [u8]);

impl<'a> Part<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(n)?;
        self.0 = tail;
        Some(head)
    }

    fn words(&mut self, n: usize) -> Option<Vec<u32>> {
        let word = |c: &[u8]| u32::from_le_bytes([c[0], c[1], c[2], c[3]]);
        Some(self.take(4 * n)?.chunks(4).map(word).collect())
    }

    /// Reads `n` little-endian values of `w` bytes each.
    fn values(&mut self, n: usize, w: usize) -> Option<Vec<u32>> {
        let value = |c: &[u8]| c.iter().rev().fold(0, |v, &b| v << 8 | u32::from(b));
        Some(self.take(w * n)?.chunks(w).map(value).collect())
    }

    /// Reads `n` values stored as `w` byte planes.
    fn byte_planes(&mut self, n: usize, w: usize) -> Option<Vec<u32>> {
        let bytes = self.take(w * n)?;
        Some(
            (0..n)
                .map(|i| (0..w).map(|p| u32::from(bytes[p * n + i]) << (8 * p)).sum())
                .collect(),
        )
    }

    /// Reads `n` bits. `None` if a padding bit is set.
    fn bits(&mut self, n: usize) -> Option<Vec<bool>> {
        let bytes = self.take(n.div_ceil(8))?;
        let bit = |i: usize| bytes[i / 8] >> (i % 8) & 1 == 1;
        if (n..8 * bytes.len()).any(bit) {
            return None;
        }
        Some((0..n).map(bit).collect())
    }
}

/// Decodes transform 0: plain arrays.
fn plain(entry: &Entry, bytes: &[u8], pixels: usize) -> Option<Vec<Visibility>> {
    let mut part = Part(bytes);
    let n = entry.vertices;
    let table = part.words(pixels + 1)?;
    if table[0] != 0 || table[pixels] != n || table.windows(2).any(|w| w[0] > w[1]) {
        return None;
    }
    let colour = if entry.coloured {
        part.words(pixels + 1)?
    } else {
        vec![0; pixels + 1]
    };
    let counts: Vec<usize> = table.windows(2).map(|w| (w[1] - w[0]) as usize).collect();
    if colour[0] != 0 || colour.windows(2).any(|w| w[0] > w[1]) {
        return None;
    }
    let mut coloured = Vec::new();
    for i in 0..pixels {
        let grown = (colour[i + 1] - colour[i]) as usize;
        if grown != 0 && grown != counts[i] {
            return None;
        }
        coloured.push(grown != 0);
    }
    let m = colour[pixels] as usize;
    let w = if entry.lattice == 0 { 4 } else { 2 };
    let depths = part.words(n as usize)?;
    let first = part.values(n as usize, w)?;
    let (second, third) = (part.values(m, w)?, part.values(m, w)?);
    if !bytes.len().is_multiple_of(8) || part.0.len() > 7 || part.0.iter().any(|&b| b != 0) {
        return None;
    }
    functions(entry, &counts, &coloured, depths, [first, second, third])
}

/// Decodes transform 1: byte planes of differences.
fn planes(entry: &Entry, bytes: &[u8], width: usize, pixels: usize) -> Option<Vec<Visibility>> {
    let mut part = Part(bytes);
    let n = entry.vertices as usize;
    let counts: Vec<usize> = part
        .byte_planes(pixels, 4)?
        .into_iter()
        .map(|c| c as usize)
        .collect();
    if counts.iter().sum::<usize>() != n {
        return None;
    }
    let coloured = if entry.coloured {
        part.bits(pixels)?
    } else {
        vec![false; pixels]
    };
    if (0..pixels).any(|i| coloured[i] && counts[i] == 0) {
        return None;
    }
    let q = counts.iter().filter(|&&c| c > 0).count();
    let mut steps = part.bits(n - q)?.into_iter();
    let s = steps.clone().filter(|&b| b).count();
    let mut firsts = part.byte_planes(q, 4)?.into_iter();
    let gaps = part.byte_planes(n - q - s, 4)?;
    if gaps.contains(&0) {
        return None;
    }
    let mut gaps = gaps.into_iter();
    let mut first_of: Vec<Option<u32>> = vec![None; pixels];
    let mut depths = Vec::new();
    for i in 0..pixels {
        if counts[i] == 0 {
            continue;
        }
        let (x, y) = (i % width, i / width);
        let left = if x > 0 { first_of[i - 1] } else { None };
        let up = if y > 0 { first_of[i - width] } else { None };
        let corner = if x > 0 && y > 0 {
            first_of[i - width - 1]
        } else {
            None
        };
        let prediction = match (left, up, corner) {
            (Some(l), Some(u), Some(c)) => l.wrapping_add(u).wrapping_sub(c),
            (Some(l), _, _) => l,
            (None, Some(u), _) => u,
            _ => first_of[..i]
                .iter()
                .rev()
                .find_map(|&o| o)
                .unwrap_or(1 << 31),
        };
        let coded = firsts.next()?;
        let d = if coded % 2 == 0 {
            coded / 2
        } else {
            !(coded / 2)
        };
        let mut o = prediction.wrapping_add(d);
        first_of[i] = Some(o);
        for j in 0..counts[i] {
            if j > 0 && !steps.next()? {
                o = o.wrapping_add(gaps.next()?);
            }
            depths.push(if o >= 1 << 31 { o - (1 << 31) } else { !o });
        }
    }
    let (w, one, mask) = match entry.lattice {
        0 => (4, 0x3F80_0000, u32::MAX),
        l => (2, u32::from(l), 0xFFFF),
    };
    let of_colour: Vec<usize> = (0..pixels)
        .map(|i| if coloured[i] { counts[i] } else { 0 })
        .collect();
    let mut channel = |counts: &[usize]| {
        let mut values = part.byte_planes(counts.iter().sum(), w)?;
        let mut at = 0;
        for &count in counts {
            let mut last = one;
            for v in &mut values[at..at + count] {
                last = last.wrapping_sub(*v) & mask;
                *v = last;
            }
            at += count;
        }
        Some(values)
    };
    let values = [
        channel(&counts)?,
        channel(&of_colour)?,
        channel(&of_colour)?,
    ];
    if !part.0.is_empty() {
        return None;
    }
    functions(entry, &counts, &coloured, depths, values)
}

/// Makes the functions. `None` if one breaks a law or is not canonical.
fn functions(
    entry: &Entry,
    counts: &[usize],
    coloured: &[bool],
    depths: Vec<u32>,
    values: [Vec<u32>; 3],
) -> Option<Vec<Visibility>> {
    if entry.coloured && !coloured.contains(&true) {
        return None;
    }
    let value = |v: u32| match entry.lattice {
        0 => (v != 1 << 31).then_some(f32::from_bits(v)),
        l => (v <= u32::from(l)).then_some(v as f32 / f32::from(l)),
    };
    let (mut at, mut at_colour) = (0, 0);
    let mut out = Vec::new();
    for (i, &count) in counts.iter().enumerate() {
        let channels = if coloured[i] { 3 } else { 1 };
        let (mut z, mut v) = (Vec::new(), vec![Vec::new(); channels]);
        for _ in 0..count {
            if depths[at] == 1 << 31 {
                return None;
            }
            z.push(f32::from_bits(depths[at]));
            v[0].push(value(values[0][at])?);
            at += 1;
            if coloured[i] {
                v[1].push(value(values[1][at_colour])?);
                v[2].push(value(values[2][at_colour])?);
                at_colour += 1;
            }
        }
        // A function that obeys the laws and is canonical is unchanged by building it.
        let f = Visibility::from_planes(z.clone(), v.clone()).ok()?;
        if f.channels() != channels || f.depths() != z || (0..channels).any(|c| f.values(c) != v[c])
        {
            return None;
        }
        out.push(f);
    }
    Some(out)
}

/// The ranges of the entry: least and greatest depth, least and greatest end value.
pub fn ranges(functions: &[Visibility]) -> ([f32; 2], [f32; 2]) {
    let (mut depths, mut ends) = ([f32::INFINITY, f32::NEG_INFINITY], [1f32, 0f32]);
    for f in functions {
        for &z in f.depths() {
            depths = [depths[0].min(z), depths[1].max(z)];
        }
        for v in f.end_rgb() {
            ends = [ends[0].min(v), ends[1].max(v)];
        }
    }
    (depths, ends)
}
