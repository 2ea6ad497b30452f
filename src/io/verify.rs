//! Every rule over a whole file, and the hash of its content.

use sha2::{Digest, Sha256};

use super::Progress;
use super::file::DsmFile;
use crate::format::directory::{Entry, TileKind};
use crate::format::layout::HEADER_SIZE;
use crate::map::{LevelId, LevelInfo, MapId, TileId};
use crate::{Error, Place, Result};

/// Counts of a full check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Report {
    /// Tiles of all maps and levels.
    pub tiles: u64,
    /// Tiles without a vertex.
    pub empty_tiles: u64,
    /// Tiles whose pixels all have the same one vertex.
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

    /// Checks every byte and every rule of `spec/` that does not need the source: the CRCs, the layout without gap or overlap,
    /// the laws of every function. `progress` is called for every tile; returning `false` stops.
    ///
    /// # Errors
    /// The first rule that is broken; `Cancelled`.
    pub fn verify(&self, mut progress: impl FnMut(Progress) -> bool) -> Result<Report> {
        // The layout first: blocks or tiles that share bytes could ask for any amount of work in a small file.
        let (directory, footer) = (
            self.trailer().directory_offset,
            self.trailer().footer_offset,
        );
        let blocks = self
            .blocks()
            .map(|b| (b.offset, u64::from(b.stored_size), Place::default()))
            .collect();
        check_cover("BLOCK-COVER", blocks, directory, footer)?;
        let mut ranges = Vec::new();
        for (id, level) in self.levels() {
            let (mut vertices, mut bytes) = (0, 0);
            for tile in level.shape.tile_ids() {
                let entry = self.entry(id, tile)?;
                vertices += u64::from(entry.vertices);
                bytes += u64::from(entry.stored_size);
                if entry.kind == TileKind::Data {
                    let place = Place {
                        tile: Some(level.shape.tile_index(tile)),
                        ..id.into()
                    };
                    ranges.push((entry.offset, u64::from(entry.stored_size), place));
                }
            }
            check_sums(level, vertices, bytes).map_err(|e| e.at(id))?;
        }
        check_cover("TILE-COVER", ranges, HEADER_SIZE as u64, directory)?;
        let mut report = Report::default();
        let total = self.all_tiles();
        for (id, level) in self.levels() {
            for tile in level.shape.tile_ids() {
                let entry = self.entry(id, tile)?;
                if entry.kind == TileKind::Data {
                    self.tile(id, tile)?; // the others are nothing but their entry
                }
                report.count(&entry);
                let done = report.tiles;
                if !progress(Progress { done, total }) {
                    return Err(Error::cancelled());
                }
            }
        }
        Ok(report)
    }

    /// SHA-256 of the decoded content (`spec/format.md`, section 10): the same for files that differ only in codec, transform,
    /// tile size, order of tiles or attributes.
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
            h.data_origin
                .iter()
                .chain(&h.display_window)
                .for_each(|v| hash.update(v.to_le_bytes()));
            let matrices = [h.camera.camera_from_world, h.camera.ndc_from_world];
            hash.update([u8::from(matrices[0].is_some()) | u8::from(matrices[1].is_some()) << 1]);
            matrices
                .iter()
                .flatten()
                .flatten()
                .for_each(|v| hash.update(v.to_le_bytes()));
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
            group
                .maps
                .iter()
                .for_each(|m| hash.update(m.0.to_le_bytes()));
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

impl Report {
    fn count(&mut self, entry: &Entry) {
        self.tiles += 1;
        self.vertices += u64::from(entry.vertices);
        self.payload_bytes += u64::from(entry.stored_size);
        match entry.kind {
            TileKind::Empty => self.empty_tiles += 1,
            TileKind::Constant => self.constant_tiles += 1,
            TileKind::Data => {}
        }
    }
}

fn hash_name(hash: &mut Sha256, name: &str) {
    hash.update((name.len() as u16).to_le_bytes());
    hash.update(name);
}

fn check_sums(level: &LevelInfo, vertices: u64, bytes: u64) -> Result<()> {
    if vertices != level.vertices {
        let what = format!(
            "{vertices} vertices where the footer says {}",
            level.vertices
        );
        return Err(Error::corrupt("LEVEL-VERTICES", what));
    }
    if bytes != level.payload_bytes {
        let what = format!(
            "{bytes} bytes of tiles where the footer says {}",
            level.payload_bytes
        );
        return Err(Error::corrupt("LEVEL-BYTES", what));
    }
    Ok(())
}

/// The ranges (offset, size) cover the bytes from `start` to `end`, each once.
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
            let what = if offset < at {
                "overlaps what lies before it"
            } else {
                "leaves a gap before it"
            };
            return Err(Error::corrupt(rule, what).at(Place {
                byte: Some(offset),
                ..place
            }));
        }
        at = offset + size;
    }
    if at != end {
        let what = format!("a gap of {} bytes at the end", end.saturating_sub(at));
        return Err(Error::corrupt(rule, what).at(Place {
            byte: Some(at),
            ..Place::default()
        }));
    }
    Ok(())
}
