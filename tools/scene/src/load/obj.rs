//! Wavefront OBJ: reads positions, texture coordinates and faces; ignores materials, normals,
//! groups and curves.

use std::collections::HashMap;

use crate::error::Result;
use glam::Vec3;

use super::text::{lines, number, shown, wrong};
use super::{fault, finish};
use crate::geometry::Mesh;

/// Parses an OBJ file.
///
/// A face with more than three corners becomes a fan around its first corner, which is right for
/// convex faces. A vertex is a position, identified by its index in the file, together with a
/// texture coordinate, identified by its value. Therefore the files of a moving object have the
/// same vertices at each key, and there is no seam if an exporter wrote the same texture coordinate
/// twice. Positions that no face uses are dropped. In a file with texture coordinates, a corner
/// without one gets `(0, 0)`.
///
/// # Errors
/// A line without the expected numbers, or with an index out of range; then as [`finish::mesh`].
pub fn parse(bytes: &[u8]) -> Result<Mesh> {
    let mut file = File::default();
    let mut joined = Vec::new();
    for (n, line) in lines(bytes) {
        // A backslash at the end of a line joins the next one to it.
        if let Some(head) = line.strip_suffix(b"\\") {
            joined.extend_from_slice(head);
            joined.push(b' ');
        } else if joined.is_empty() {
            file.line(n, line)?;
        } else {
            joined.extend_from_slice(line);
            file.line(n, &joined)?;
            joined.clear();
        }
    }
    if !joined.is_empty() {
        file.line(lines(bytes).count(), &joined)?;
    }
    file.finish()
}

/// The lines read so far.
#[derive(Default)]
struct File {
    positions: Vec<Vec3>,
    uvs: Vec<[f32; 2]>,
    /// For each corner of each triangle, the index of its position and of its texture coordinate.
    triangles: Vec<[Corner; 3]>,
}

type Corner = (u32, Option<u32>);

impl File {
    fn line(&mut self, n: usize, line: &[u8]) -> Result<()> {
        let line = line.split(|&b| b == b'#').next().unwrap_or_default();
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        match words.next() {
            Some(b"v") => {
                let p = numbers::<3>(n, words, 3)?;
                self.positions.push(Vec3::from_array(p));
            }
            Some(b"vt") => self.uvs.push(numbers::<2>(n, words, 1)?),
            Some(b"f") => self.face(n, words)?,
            _ => {}
        }
        Ok(())
    }

    fn face<'a>(&mut self, n: usize, words: impl Iterator<Item = &'a [u8]>) -> Result<()> {
        let mut fan: Option<(Corner, Option<Corner>)> = None;
        let mut count = 0;
        for word in words {
            let corner = self.corner(n, word)?;
            count += 1;
            fan = Some(match fan {
                None => (corner, None),
                Some((first, None)) => (first, Some(corner)),
                Some((first, Some(last))) => {
                    self.triangles.push([first, last, corner]);
                    (first, Some(corner))
                }
            });
        }
        match count {
            0..3 => wrong(n, format!("a face of {count} corners; three are expected")),
            _ => Ok(()),
        }
    }

    /// `position`, `position/uv`, `position//normal` or `position/uv/normal`.
    fn corner(&self, n: usize, word: &[u8]) -> Result<Corner> {
        let mut parts = word.split(|&b| b == b'/');
        let position = parts.next().unwrap_or_default();
        let position = index(n, position, self.positions.len(), "vertex")?;
        let uv = match parts.next() {
            None | Some(b"") => None,
            Some(uv) => Some(index(n, uv, self.uvs.len(), "texture coordinate")?),
        };
        Ok((position, uv))
    }

    fn finish(self) -> Result<Mesh> {
        let textured = self.triangles.iter().flatten().any(|c| c.1.is_some());
        let mut vertices = HashMap::new();
        let (mut positions, mut uvs) = (Vec::new(), Vec::new());
        let mut vertex = |(p, uv): Corner| {
            let uv = uv.map_or([0.0; 2], |uv| self.uvs[uv as usize]);
            *vertices
                .entry((p, uv.map(f32::to_bits)))
                .or_insert_with(|| {
                    positions.push(self.positions[p as usize]);
                    uvs.push(uv);
                    positions.len() as u32 - 1
                })
        };
        if self.triangles.len() >= (u32::MAX / 3) as usize {
            return fault("more corners than 2^32 - 1");
        }
        let corners = self.triangles.iter();
        let triangles = corners.map(|t| t.map(&mut vertex)).collect();
        if !textured {
            uvs.clear();
        }
        finish::mesh(positions, triangles, uvs)
    }
}

/// Parses the first `N` numbers. At least `least` must be present; missing ones are 0.
fn numbers<'a, const N: usize>(
    n: usize,
    mut words: impl Iterator<Item = &'a [u8]>,
    least: usize,
) -> Result<[f32; N]> {
    let mut out = [0.0; N];
    for (i, out) in out.iter_mut().enumerate() {
        match words.next().map(|w| (w, number::<f32>(w))) {
            Some((_, Some(x))) if x.is_finite() => *out = x,
            Some((w, _)) => return wrong(n, format!("{} is not a finite number", shown(w))),
            None if i < least => return wrong(n, format!("{i} numbers; {least} are expected")),
            None => break,
        }
    }
    Ok(out)
}

/// Converts an index to one from 0 up. In the file, it counts from 1 up, or from -1 down for the
/// last item read so far.
fn index(n: usize, word: &[u8], count: usize, what: &str) -> Result<u32> {
    let at = match number::<i64>(word) {
        Some(i) if i > 0 => usize::try_from(i - 1).ok(),
        Some(i) if i < 0 => usize::try_from(count as i64 + i).ok(),
        _ => None,
    };
    match at.filter(|&at| at < count).map(u32::try_from) {
        Some(Ok(at)) => Ok(at),
        _ => wrong(
            n,
            format!(
                "a face names {what} {}, and {count} were read so far",
                shown(word)
            ),
        ),
    }
}
