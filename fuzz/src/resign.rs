//! Recomputes every CRC of a file that it can find, after the bytes were changed.
//!
//! Mutated files then pass the CRC checks and reach the code after them.

fn u16_at(b: &[u8], at: usize) -> Option<usize> {
    Some(u16::from_le_bytes(b.get(at..at + 2)?.try_into().ok()?).into())
}

fn u32_at(b: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(
        b.get(at..at.checked_add(4)?)?.try_into().ok()?,
    ))
}

fn u64_at(b: &[u8], at: usize) -> Option<usize> {
    let value = u64::from_le_bytes(b.get(at..at.checked_add(8)?)?.try_into().ok()?);
    usize::try_from(value).ok()
}

fn put(b: &mut [u8], at: usize, value: u32) {
    b[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

/// Offsets of the block references in the footer `f`, relative to its start.
///
/// Stops at the first record that cannot be read.
pub fn block_references(f: &[u8]) -> Vec<usize> {
    let mut out = Vec::new();
    walk(f, &mut out);
    out
}

/// Appends the offsets to `out`. `None` if a record cannot be read.
fn walk(f: &[u8], out: &mut Vec<usize>) -> Option<()> {
    let maps = u32_at(f, 16)?;
    let mut at = 32;
    for _ in 0..maps {
        at += 2 + u16_at(f, at)?;
        let (width, height) = (u64::from(u32_at(f, at)?), u64::from(u32_at(f, at + 4)?));
        let (tile, levels, camera) = (*f.get(at + 9)?, *f.get(at + 10)?, *f.get(at + 13)?);
        let attributes = u32_at(f, at + 48)?;
        at += 52 + 128 * usize::from((camera & 1) + (camera >> 1 & 1));
        for level in 0..u32::from(levels).min(32) {
            let tiles = |side: u64| side.div_ceil(1 << level).div_ceil(1 << tile.min(16));
            let blocks = (tiles(width) * tiles(height)).div_ceil(1024);
            at += 24;
            for _ in 0..blocks {
                f.get(at..at + 24)?;
                out.push(at);
                at += 24;
            }
        }
        for _ in 0..attributes {
            at += 2 + u16_at(f, at)?;
            at += 5 + u32_at(f, at + 1)? as usize;
        }
    }
    Some(())
}

/// Recomputes the CRCs of the header, tiles, directory blocks, footer and trailer.
///
/// Tiles are found through directory blocks with codec none only.
pub fn resign(file: &mut [u8]) {
    let length = file.len();
    if length < 128 {
        return;
    }
    let crc = crc32fast::hash(&file[..60]);
    put(file, 60, crc);
    let trailer = length - 64;
    let footer = u64_at(file, trailer + 16).zip(u64_at(file, trailer + 24));
    let footer = footer
        .and_then(|(at, size)| Some((at, at.checked_add(size).filter(|&end| end <= length)?)));
    if let Some((start, end)) = footer {
        for reference in block_references(&file[start..end]) {
            sign_block(file, start + reference);
        }
        let crc = crc32fast::hash(&file[start..end]);
        put(file, trailer + 32, crc);
    }
    let crc = crc32fast::hash(&file[trailer..trailer + 60]);
    put(file, trailer + 60, crc);
}

/// Recomputes the CRCs of a directory block and of its data tiles.
fn sign_block(file: &mut [u8], reference: usize) -> Option<()> {
    let (offset, size) = (
        u64_at(file, reference)?,
        u32_at(file, reference + 8)? as usize,
    );
    let end = offset.checked_add(size).filter(|&end| end <= file.len())?;
    if file[reference + 16] == 0 {
        for entry in (offset..end).step_by(48).filter(|e| e + 48 <= end) {
            let (at, size) = (u64_at(file, entry)?, u32_at(file, entry + 8)? as usize);
            if file[entry + 40] != 2 {
                continue;
            }
            if let Some(payload) = at.checked_add(size).and_then(|end| file.get(at..end)) {
                let crc = crc32fast::hash(payload);
                put(file, entry + 20, crc);
            }
        }
    }
    let crc = crc32fast::hash(&file[offset..end]);
    put(file, reference + 12, crc);
    Some(())
}
