//! Opens any bytes as a file and compares all ways to read it.
//!
//! A file that passes the full check must obey the laws and survive a rewrite.

use std::io;
use std::sync::Arc;

use deepshadow::raw::directory::TileKind;
use deepshadow::{
    Codec, DsmFile, Encoding, Error, ErrorKind, FunctionRef, Limits, MapId, Mips, Pixels, ReadAt,
    TileId, Visibility, Writer,
};

/// Bytes read by position, like a file. Panics on a read past the end.
struct Positioned(Vec<u8>);

impl ReadAt for Positioned {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        let end = offset
            .checked_add(buffer.len() as u64)
            .filter(|&end| end <= self.length());
        assert!(end.is_some(), "a read past the end passed the checks");
        buffer.copy_from_slice(&self.0[offset as usize..][..buffer.len()]);
        Ok(())
    }
}

/// Bytes available as a slice, like a memory map.
struct InMemory(Vec<u8>);

impl ReadAt for InMemory {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }

    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        buffer.copy_from_slice(&self.0[offset as usize..][..buffer.len()]);
        Ok(())
    }

    fn as_slice(&self) -> Option<&[u8]> {
        Some(&self.0)
    }
}

fn limits() -> Limits {
    Limits::default().memory(1 << 20)
}

/// Asserts that an error blames the file, and names a rule if and only if it is corrupt.
fn fault_of_the_file(e: &Error) {
    assert!(
        matches!(
            e.kind(),
            ErrorKind::Corrupt | ErrorKind::Unsupported | ErrorKind::Limit
        ),
        "{e:?}"
    );
    assert_eq!(e.kind() == ErrorKind::Corrupt, e.rule().is_some(), "{e:?}");
}

/// Checks one input: the bytes of a file.
pub fn run(data: &[u8]) {
    let whole = DsmFile::from_source(Arc::new(InMemory(data.to_vec())), limits());
    let file = match DsmFile::from_source(Arc::new(Positioned(data.to_vec())), limits()) {
        Ok(file) => file,
        Err(e) => {
            fault_of_the_file(&e);
            assert_eq!(whole.map_err(|e| e.to_string()).err(), Some(e.to_string()));
            return;
        }
    };
    let whole = whole.expect("the same bytes");
    let pixels = |file: &DsmFile| -> u64 {
        let levels = file.maps().iter().flat_map(|m| &m.levels);
        levels
            .map(|l| u64::from(l.shape.width) * u64::from(l.shape.height))
            .sum()
    };
    let tiles: u64 = file
        .maps()
        .iter()
        .flat_map(|m| &m.levels)
        .map(|l| l.shape.tiles())
        .sum();
    if pixels(&file) > 1 << 14 || tiles > 1 << 10 {
        let stopped = file.verify(|done, _| done < 64);
        if let Err(e) = stopped
            && e.kind() != ErrorKind::Cancelled
        {
            fault_of_the_file(&e);
        }
        return;
    }
    // Read every tile separately.
    let mut first = None;
    for (m, map) in file.maps().iter().enumerate() {
        for (l, level) in map.levels.iter().enumerate() {
            for ty in 0..level.shape.tiles_y() {
                for tx in 0..level.shape.tiles_x() {
                    let tile = file.tile(MapId(m as u32).level(l as u32), TileId::new(tx, ty));
                    let same = whole.tile(MapId(m as u32).level(l as u32), TileId::new(tx, ty));
                    match tile {
                        Ok(tile) => {
                            assert_eq!(same.expect("the same bytes"), tile);
                            let entry = file
                                .entry(MapId(m as u32).level(l as u32), TileId::new(tx, ty))
                                .expect("its tile was read");
                            assert_eq!(entry.vertices as usize, tile.vertices());
                            assert_eq!(
                                level.shape.tile_extent(TileId::new(tx, ty)).0,
                                tile.width()
                            );
                            for i in 0..tile.pixels() {
                                lawful(tile.function(i), map.header.channels);
                            }
                        }
                        Err(e) => {
                            fault_of_the_file(&e);
                            assert_eq!(same.map_err(|e| e.to_string()).err(), Some(e.to_string()));
                            first.get_or_insert(e);
                        }
                    }
                }
            }
        }
    }
    match (file.verify(|_, _| true), first) {
        (Ok(report), None) => {
            assert_eq!(report.tiles, tiles);
            file.content_hash(|_, _| true).expect("every tile is sound");
            rewrite(&file);
        }
        (Ok(_), Some(e)) => panic!("the full check misses {e}"),
        (Err(e), first) => {
            fault_of_the_file(&e);
            let whole_file_rules = ["TILE-COVER", "BLOCK-COVER", "LEVEL-VERTICES", "LEVEL-BYTES"];
            let spans_tiles = e.rule().is_some_and(|r| whole_file_rules.contains(&r));
            assert!(
                spans_tiles || first.is_some(),
                "only the full check finds {e}"
            );
        }
    }
}

/// Asserts that a function obeys the laws, is canonical and has no -0.
fn lawful(f: FunctionRef<'_>, channels: usize) {
    assert!(f.channels() <= channels);
    let plane = |c| (0..f.len()).map(|i| f.value(i, c) as f32).collect();
    let planes: Vec<Vec<f32>> = (0..f.channels()).map(plane).collect();
    let again = Visibility::from_planes(f.depths().to_vec(), planes.clone());
    assert_eq!(
        again.as_ref().ok().map(Visibility::function),
        Some(f),
        "a function that is not canonical: {again:?}"
    );
    let positive = |v: &f32| v.is_sign_positive() || *v != 0.0;
    assert!(
        f.depths()
            .iter()
            .chain(planes.iter().flatten())
            .all(positive),
        "-0"
    );
}

/// Writes the base levels again and asserts that the new file holds the same functions.
fn rewrite(file: &DsmFile) {
    let mut writer = Writer::in_memory();
    for (m, map) in file.maps().iter().enumerate() {
        let level = &map.levels[0];
        let encoding = Encoding::default()
            .codec(Codec::None)
            .mips(Mips::None)
            .source_error(level.max_error);
        writer
            .add_map(map.header.clone(), encoding)
            .expect("the header of a sound file");
        for ty in 0..level.shape.tiles_y() {
            for tx in 0..level.shape.tiles_x() {
                let tile = file
                    .tile(MapId(m as u32).level(0), TileId::new(tx, ty))
                    .expect("read before");
                let pixels =
                    Pixels::Functions(tile.functions().map(|f| f.to_visibility()).collect());
                writer
                    .tile(MapId(m as u32), TileId::new(tx, ty), pixels)
                    .expect("functions of a sound file");
            }
        }
    }
    file.groups()
        .iter()
        .for_each(|g| writer.add_group(g.clone()));
    file.attributes()
        .iter()
        .for_each(|(name, value)| writer.add_attribute(name, value.clone()));
    let second = DsmFile::from_bytes(writer.into_bytes().expect("the content of a sound file"))
        .expect("what was written");
    second.verify(|_, _| true).expect("what was written");
    assert_eq!(second.groups(), file.groups());
    assert_eq!(
        format!("{:?}", second.attributes()),
        format!("{:?}", file.attributes())
    );
    for (m, map) in file.maps().iter().enumerate() {
        assert_eq!(
            format!("{:?}", second.maps()[m].header),
            format!("{:?}", map.header)
        );
        let shape = map.levels[0].shape;
        for ty in 0..shape.tiles_y() {
            for tx in 0..shape.tiles_x() {
                let (old, new) = (
                    file.tile(MapId(m as u32).level(0), TileId::new(tx, ty))
                        .expect("read"),
                    second
                        .tile(MapId(m as u32).level(0), TileId::new(tx, ty))
                        .expect("read"),
                );
                for i in 0..old.pixels() {
                    assert_eq!(
                        old.function(i),
                        new.function(i),
                        "map {m}, tile {tx},{ty}, pixel {i}"
                    );
                }
                let kind = |f: &DsmFile| {
                    f.entry(MapId(m as u32).level(0), TileId::new(tx, ty))
                        .expect("read")
                        .kind
                };
                assert_eq!(
                    kind(file) == TileKind::Empty,
                    kind(&second) == TileKind::Empty
                );
            }
        }
    }
    if file.maps().iter().all(|m| m.levels.len() == 1) {
        let hash = |f: &DsmFile| f.content_hash(|_, _| true).expect("sound");
        assert_eq!(hash(&second), hash(file));
    }
}

/// Mutates the file in the first `size` bytes of `data`. Returns its new length.
///
/// The seed selects the change: any bytes, up to 16 bytes of one part in place, or the whole
/// footer. The footer may change its length; the trailer then moves. `by` is the mutator: it gets a
/// buffer, the used length and the maximal length, and returns the new length.
pub fn mutate(
    data: &mut [u8],
    size: usize,
    max_size: usize,
    seed: u32,
    by: impl Fn(&mut [u8], usize, usize) -> usize,
) -> usize {
    let number = |at: usize| {
        data.get(at..at + 8)
            .map(|b| u64::from_le_bytes(b.try_into().expect("8 bytes")) as usize)
    };
    let parts = size
        .checked_sub(64)
        .and_then(|t| Some((number(t + 8)?, number(t + 16)?)));
    let Some((directory, footer)) =
        parts.filter(|&(d, f)| size >= 128 && 64 <= d && d <= f && f <= size - 64)
    else {
        return by(data, size, max_size);
    };
    let trailer = size - 64;
    let (start, end) = match seed % 8 {
        0 => return by(data, size, max_size),
        1 | 2 => (64, directory),
        3 | 4 => (directory, footer),
        5 | 6 => (footer, trailer),
        _ => (trailer, trailer + 60),
    };
    if start == end {
        return by(data, size, max_size);
    }
    if seed % 8 == 6 {
        // Mutate the whole footer, then move the trailer.
        let mut part = data[start..end].to_vec();
        let room = max_size.saturating_sub(size) + part.len();
        part.resize(room.max(1), 0);
        let new = by(&mut part, end - start, room.max(1)) / 8 * 8;
        let mut tail = data[trailer..size].to_vec();
        if start + new + 64 <= max_size {
            data[start..start + new].copy_from_slice(&part[..new]);
            tail[..8].copy_from_slice(&((start + new + 64) as u64).to_le_bytes());
            tail[24..32].copy_from_slice(&(new as u64).to_le_bytes());
            data[start + new..start + new + 64].copy_from_slice(&tail);
            return start + new + 64;
        }
    }
    // Mutate a few bytes of the part in place.
    let stretch = 1 + (seed >> 8) as usize % 16;
    let at = start + (seed >> 12) as usize % (end - start);
    let stop = (at + stretch).min(end);
    let mut part = data[at..stop].to_vec();
    let length = part.len();
    let new = by(&mut part, length, length);
    data[at..at + new].copy_from_slice(&part[..new]);
    size
}
