//! Checks every rule of the specification over a whole file, and hashes its content.

use sha2::{Digest, Sha256};

use super::Progress;
use super::file::DsmFile;
use crate::format::directory::TileKind;
use crate::format::header::Trailer;
use crate::format::layout::HEADER_SIZE;
use crate::map::{LevelId, LevelInfo, MapId, TileId};
use crate::{Error, Place, Result};

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

    /// Checks every byte and every rule of `spec/` that does not need the source: CRCs, the layout
    /// without gap or overlap, and the laws of every function. Calls `progress` after every tile;
    /// `false` stops.
    ///
    /// # Errors
    /// The first broken rule; `Cancelled`.
    pub fn verify(&self, mut progress: impl FnMut(Progress) -> bool) -> Result<Report> {
        // The layout first: with blocks or tiles that share bytes, a small file could ask for any
        // amount of work.
        let Trailer {
            directory_offset,
            footer_offset,
            ..
        } = *self.trailer();
        let blocks = self.blocks();
        let blocks = blocks.map(|b| (b.offset, u64::from(b.stored_size), Place::default()));
        check_cover(
            "BLOCK-COVER",
            blocks.collect(),
            directory_offset,
            footer_offset,
        )?;
        let mut ranges = Vec::new();
        for (id, level) in self.levels() {
            let (mut vertices, mut bytes) = (0, 0);
            for tile in level.shape.tile_ids() {
                let entry = self.entry(id, tile)?;
                let size = u64::from(entry.stored_size);
                vertices += u64::from(entry.vertices);
                bytes += size;
                if entry.kind == TileKind::Data {
                    let place = Place {
                        tile: Some(level.shape.tile_index(tile)),
                        ..id.into()
                    };
                    ranges.push((entry.offset, size, place));
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
        check_cover("TILE-COVER", ranges, HEADER_SIZE as u64, directory_offset)?;
        let mut report = Report::default();
        let total = self.all_tiles();
        for (id, level) in self.levels() {
            for tile in level.shape.tile_ids() {
                let entry = self.entry(id, tile)?;
                match entry.kind {
                    TileKind::Empty => report.empty_tiles += 1,
                    TileKind::Constant => report.constant_tiles += 1,
                    // Only these have bytes besides their entry.
                    TileKind::Data => drop(self.tile(id, tile)?),
                }
                report.tiles += 1;
                report.vertices += u64::from(entry.vertices);
                report.payload_bytes += u64::from(entry.stored_size);
                let done = report.tiles;
                if !progress(Progress { done, total }) {
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
    /// As [`DsmFile::tile`]; `Cancelled`.
    pub fn content_hash(&self, mut progress: impl FnMut(Progress) -> bool) -> Result<[u8; 32]> {
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
                    progress(Progress { done, total })
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
        for ty in 0..shape.tiles_y() {
            let tiles = (0..shape.tiles_x())
                .map(|tx| self.tile(id, TileId::new(tx, ty)))
                .collect::<Result<Vec<_>>>()?;
            for y in 0..shape.tile_extent(TileId::new(0, ty)).1 {
                for tile in &tiles {
                    for x in 0..tile.width() {
                        let f = tile.function((y * tile.width() + x) as usize);
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
                }
            }
            if !progress(tiles.len() as u64) {
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

/// Checks that the ranges (offset, size) cover the bytes from `start` to `end` once each.
fn check_cover(
    rule: &'static str,
    mut ranges: Vec<(u64, u64, Place)>,
    start: u64,
    end: u64,
) -> Result<()> {
    ranges.sort_unstable_by_key(|r| r.0);
    let mut at = start;
    for (offset, size, place) in ranges {
        if offset != at {
            let what = match offset < at {
                true => "overlaps what lies before it",
                false => "leaves a gap before it",
            };
            return Err(Error::corrupt(rule, what).at(Place::byte(offset)).at(place));
        }
        at = offset + size;
    }
    if at != end {
        let what = format!("a gap of {} bytes at the end", end.saturating_sub(at));
        return Err(Error::corrupt(rule, what).at(Place::byte(at)));
    }
    Ok(())
}
