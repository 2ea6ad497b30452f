//! Checks every rule of the specification over a whole file, and hashes its content.

use std::sync::atomic::Ordering::Relaxed;

use sha2::{Digest, Sha256};

use super::Run;
use super::file::DsmFile;
use crate::error::Place;
use crate::format::directory::TileKind;
use crate::format::header::Trailer;
use crate::format::layout::HEADER_SIZE;
use crate::map::{LevelId, LevelInfo, LevelShape, MapId};
use crate::{Error, Limits, Result};

/// Totals of a file, counted by [`DsmFile::verify`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Report {
    /// Tiles of all maps and levels.
    pub tiles: u64,
    /// Tiles without a vertex.
    pub empty_tiles: u64,
    /// Tiles with the same single vertex in every pixel.
    pub constant_tiles: u64,
    /// Vertices of all pixels.
    pub vertices: u64,
    /// Bytes of all payloads.
    pub payload_bytes: u64,
}

impl DsmFile {
    fn all_tiles(&self) -> u64 {
        self.levels().map(|(_, level)| level.shape.tiles()).sum()
    }

    /// Checks that directory blocks and payloads cover the file without gap or overlap, and that
    /// the sums of each level are right. Reads the directory only. Otherwise a small file with
    /// payloads that share bytes could ask for any amount of work.
    ///
    /// # Errors
    /// `Corrupt` by BLOCK-COVER, TILE-COVER, LEVEL-VERTICES and LEVEL-BYTES; as [`DsmFile::entry`];
    /// `Limit` for a list of tiles beyond [`Limits::memory`](crate::Limits::memory).
    pub fn check_layout(&self) -> Result<()> {
        if self.is_covered.load(Relaxed) {
            return Ok(());
        }
        let Trailer {
            directory_offset,
            footer_offset,
            ..
        } = *self.trailer();
        let blocks = self.blocks().map(|b| Stretch {
            offset: b.offset,
            size: b.stored_size,
            level: 0,
            tile: 0,
        });
        check_cover(blocks.collect(), directory_offset, footer_offset)
            .map_err(|(what, at, _)| Error::corrupt("BLOCK-COVER", what).at(Place::byte(at)))?;
        let mut stretches = Vec::new();
        for (n, (id, level)) in self.levels().enumerate() {
            let (mut vertices, mut bytes) = (0, 0);
            for run in self.runs(id)? {
                let Run {
                    entry,
                    first,
                    tiles,
                    ..
                } = run?;
                vertices += tiles * u64::from(entry.vertices);
                bytes += u64::from(entry.stored_size);
                if entry.kind == TileKind::Data {
                    if stretches.len() == stretches.capacity() {
                        // Twice as long soon, and once more while it grows.
                        let bytes = 3 * size_of::<Stretch>() * stretches.len();
                        self.limits().check(bytes as u64, "a list of tiles")?;
                    }
                    stretches.push(Stretch {
                        offset: entry.offset,
                        size: entry.stored_size,
                        level: n as u32,
                        tile: first,
                    });
                }
            }
            let sums = [
                ("LEVEL-VERTICES", "vertices", vertices, level.vertices),
                ("LEVEL-BYTES", "bytes of tiles", bytes, level.payload_bytes),
            ];
            if let Some((rule, what, is, says)) = sums.into_iter().find(|s| s.2 != s.3) {
                let what = format!("{is} {what} where the footer says {says}");
                return Err(Error::corrupt(rule, what).at(id));
            }
        }
        let covered = check_cover(stretches, HEADER_SIZE as u64, directory_offset);
        covered.map_err(|(what, at, stretch)| {
            let e = Error::corrupt("TILE-COVER", what).at(Place::byte(at));
            let found = stretch.and_then(|s| Some((s.tile, self.levels().nth(s.level as usize)?)));
            match found {
                Some((tile, (id, _))) => e.at(Place::tile(tile)).at(id),
                None => e,
            }
        })?;
        self.is_covered.store(true, Relaxed);
        Ok(())
    }

    /// Checks every byte and every rule of `spec/` that does not need the source: CRCs, the layout
    /// without gap or overlap, and the laws of every function. Calls `progress` with the numbers of
    /// tiles done and of all tiles; `false` stops.
    ///
    /// # Errors
    /// The first broken rule; `Cancelled`; `Limit`.
    pub fn verify(&self, mut progress: impl FnMut(u64, u64) -> bool) -> Result<Report> {
        self.check_layout()?;
        let mut report = Report::default();
        let total = self.all_tiles();
        for (id, level) in self.levels() {
            for run in self.runs(id)? {
                let Run {
                    entry,
                    first,
                    tiles,
                    ..
                } = run?;
                match entry.kind {
                    TileKind::Empty => report.empty_tiles += tiles,
                    TileKind::Constant => report.constant_tiles += tiles,
                    // Only these have bytes besides their entry.
                    TileKind::Data => drop(self.tile(id, level.shape.tile_at(first))?),
                }
                report.tiles += tiles;
                report.vertices += tiles * u64::from(entry.vertices);
                report.payload_bytes += u64::from(entry.stored_size);
                if !progress(report.tiles, total) {
                    return Err(Error::cancelled());
                }
            }
        }
        Ok(report)
    }

    /// SHA-256 of the decoded content (`spec/format.md`, section 10). Files that differ only in
    /// codec, transform, tile size, order of tiles or attributes have the same hash.
    ///
    /// # Errors
    /// As [`DsmFile::band`], for a row of tiles; `Cancelled`; `Limit` for more content than
    /// [`Limits::CONTENT`].
    pub fn content_hash(&self, mut progress: impl FnMut(u64, u64) -> bool) -> Result<[u8; 32]> {
        let content = self.levels().map(|(_, level)| {
            let LevelShape { width, height, .. } = level.shape;
            5 * u64::from(width) * u64::from(height) + 8 * level.vertices
        });
        Limits::check_content(content.sum(), "a hash")?;
        let mut hash = Sha256::new();
        hash.update(b"DSM-CONTENT-1\0\0\0");
        hash.update((self.maps().len() as u32).to_le_bytes());
        let (mut done, total) = (0, self.all_tiles());
        for (m, map) in self.maps().iter().enumerate() {
            let h = &map.header;
            hash_name(&mut hash, &h.name);
            hash.update(h.width.to_le_bytes());
            hash.update(h.height.to_le_bytes());
            hash.update([h.depth_kind.byte()]);
            hash.update(h.depth_unit.to_le_bytes());
            let window = h.data_origin.iter().chain(&h.display_window);
            window.for_each(|v| hash.update(v.to_le_bytes()));
            let matrices = [h.camera.camera_from_world, h.camera.ndc_from_world];
            hash.update([u8::from(matrices[0].is_some()) | u8::from(matrices[1].is_some()) << 1]);
            let numbers = matrices.iter().flatten().flatten();
            numbers.for_each(|v| hash.update(v.to_le_bytes()));
            hash.update([map.levels.len() as u8]);
            for (l, level) in map.levels.iter().enumerate() {
                hash.update(level.max_error.to_le_bytes());
                let id = MapId::from_index(m).level(l as u32);
                self.hash_level(id, level, &mut hash, &mut |tiles| {
                    done += tiles;
                    progress(done, total)
                })?;
            }
        }
        hash.update((self.groups().len() as u32).to_le_bytes());
        for group in self.groups() {
            hash_name(&mut hash, &group.name);
            hash.update([group.role.byte()]);
            hash.update((group.maps.len() as u32).to_le_bytes());
            let maps = group.maps.iter();
            maps.for_each(|m| hash.update(m.0.to_le_bytes()));
        }
        Ok(hash.finalize().into())
    }

    fn hash_level(
        &self,
        id: LevelId,
        level: &LevelInfo,
        hash: &mut Sha256,
        progress: &mut dyn FnMut(u64) -> bool,
    ) -> Result<()> {
        let shape = level.shape;
        let mut bytes = Vec::new();
        for y in (0..shape.height).step_by(shape.tile_size as usize) {
            let rows = shape.tile_size.min(shape.height - y);
            let band = self.band(id, [0, y, shape.width, rows])?;
            for y in y..y + rows {
                for f in band.row(y) {
                    bytes.clear();
                    bytes.extend_from_slice(&(f.len() as u32).to_le_bytes());
                    bytes.push(f.channels() as u8);
                    let mut put = |v: f32| bytes.extend_from_slice(&v.to_le_bytes());
                    f.depths().iter().for_each(|z| put(*z));
                    for i in 0..f.len() {
                        (0..f.channels()).for_each(|c| put(f.value(i, c) as f32));
                    }
                    hash.update(&bytes);
                }
                if !progress(0) {
                    return Err(Error::cancelled());
                }
            }
            if !progress(shape.tiles_x().into()) {
                return Err(Error::cancelled());
            }
        }
        Ok(())
    }
}

fn hash_name(hash: &mut Sha256, name: &str) {
    hash.update((name.len() as u16).to_le_bytes());
    hash.update(name);
}

/// The bytes of a block or, with its level and index, of a tile.
#[derive(Clone, Copy)]
struct Stretch {
    offset: u64,
    tile: u64,
    size: u32,
    level: u32,
}

/// Checks that the stretches cover the bytes from `start` to `end` once each.
///
/// # Errors
/// What is wrong, from which byte on, and the stretch that begins there.
fn check_cover(
    mut stretches: Vec<Stretch>,
    start: u64,
    end: u64,
) -> std::result::Result<(), (String, u64, Option<Stretch>)> {
    stretches.sort_unstable_by_key(|s| s.offset);
    let mut at = start;
    for s in stretches {
        if s.offset != at {
            let what = match s.offset < at {
                true => "overlaps what lies before it",
                false => "leaves a gap before it",
            };
            return Err((what.into(), s.offset, Some(s)));
        }
        at = s.offset + u64::from(s.size);
    }
    if at != end {
        let what = format!("a gap of {} bytes at the end", end.saturating_sub(at));
        return Err((what, at, None));
    }
    Ok(())
}
