//! PLY, as text or as binary of either byte order. Properties may have any order and type; elements
//! other than vertices and faces are skipped.

mod header;

use crate::error::Result;
use glam::Vec3;

use self::header::{Element, Format, Header, Property, Type};
use super::bytes::Cursor;
use super::text::Words;
use super::{fault, finish};
use crate::geometry::Mesh;

/// Parses a PLY file.
///
/// A face with more than three corners becomes a fan around its first corner, which is right for
/// convex faces. Texture coordinates are the vertex properties `u v`, `s t`, `texture_u texture_v`
/// or `texture_s texture_t`; texture coordinates of corners are ignored.
///
/// # Errors
/// A header that is not PLY, has no vertices or faces, or announces more than the file can hold; a
/// number that cannot be parsed; then as [`finish::mesh`].
pub fn parse(bytes: &[u8]) -> Result<Mesh> {
    let header = Header::parse(bytes)?;
    let mut source = match header.format {
        Format::Text => Source::Text(Words::from_line(header.body, header.lines + 1)),
        Format::Binary(endian) => Source::Binary(Cursor::new(header.body, endian)),
    };
    let (mut positions, mut uvs, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for element in &header.elements {
        source.check_size(element)?;
        match element.name.as_str() {
            "vertex" => vertices(element, &mut source, &mut positions, &mut uvs)?,
            "face" => faces(element, &mut source, &mut triangles)?,
            _ => skip_element(element, &mut source)?,
        }
    }
    if positions.is_empty() {
        return fault("holds no vertices");
    }
    finish::mesh(positions, triangles, uvs)
}

/// The data after the header.
enum Source<'a> {
    Text(Words<'a>),
    Binary(Cursor<'a>),
}

impl Source<'_> {
    fn left(&self) -> u64 {
        match self {
            Source::Text(words) => words.left() as u64,
            Source::Binary(cursor) => cursor.rest().len() as u64,
        }
    }

    /// Rejects an element count that the rest of the file cannot hold, before allocating anything.
    fn check_size(&self, element: &Element) -> Result<()> {
        let least = element.properties.iter().map(|p| match (self, p) {
            // A digit and a space; the last number may lack its space.
            (Source::Text(_), _) => 2,
            (Source::Binary(_), Property::One(_, t)) => t.bytes(),
            (Source::Binary(_), Property::List(_, count, _)) => count.bytes(),
        });
        let least = element.count.saturating_mul(least.sum());
        if least > self.left() + 1 {
            return fault(format!(
                "{} of element {} take {least} bytes at least, and there are {}",
                element.count,
                element.name,
                self.left()
            ));
        }
        Ok(())
    }

    /// The next number. f64 represents every value of these types exactly.
    fn number(&mut self, kind: Type, what: &str) -> Result<f64> {
        match self {
            Source::Text(words) => words.number(what),
            Source::Binary(cursor) => kind.read(cursor, what),
        }
    }

    /// The next number, which must be a whole number of at most 32 bits.
    fn index(&mut self, kind: Type, what: &str) -> Result<u32> {
        let n = self.number(kind, what)?;
        if n.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&n) {
            return Ok(n as u32);
        }
        let line = format!("{what} is {n}: a whole number from 0 up is expected");
        match self {
            Source::Text(words) => words.wrong(line),
            Source::Binary(_) => fault(line),
        }
    }

    /// Number of entries of a list, at most as many as the rest of the file can hold.
    fn length(&mut self, (count, entry): (Type, Type), what: &str) -> Result<u32> {
        let n = self.index(count, what)?;
        let each = match self {
            Source::Text(_) => 1,
            Source::Binary(_) => entry.bytes(),
        };
        match u64::from(n) * each > self.left() {
            true => fault(format!("{what} is {n}, more than the file holds")),
            false => Ok(n),
        }
    }

    fn pass(&mut self, property: &Property) -> Result<()> {
        match property {
            Property::One(name, kind) => self.number(*kind, name).map(drop),
            Property::List(name, count, entry) => {
                for _ in 0..self.length((*count, *entry), name)? {
                    self.number(*entry, name)?;
                }
                Ok(())
            }
        }
    }
}

fn vertices(
    element: &Element,
    source: &mut Source,
    positions: &mut Vec<Vec3>,
    uvs: &mut Vec<[f32; 2]>,
) -> Result<()> {
    let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(|name| element.single(name)) else {
        return fault("its vertices have no x, y and z");
    };
    let pairs = [
        ["u", "v"],
        ["s", "t"],
        ["texture_u", "texture_v"],
        ["texture_s", "texture_t"],
    ];
    let uv = pairs
        .into_iter()
        .find_map(|[u, v]| Some([element.single(u)?, element.single(v)?]));
    if u32::try_from(element.count).is_err() {
        return fault(format!("{} vertices are more than 2^32 - 1", element.count));
    }
    positions.reserve_exact(element.count as usize);
    if uv.is_some() {
        uvs.reserve_exact(element.count as usize);
    }
    let mut row = vec![0.0; element.properties.len()];
    for _ in 0..element.count {
        for (value, property) in row.iter_mut().zip(&element.properties) {
            match property {
                Property::One(name, kind) => *value = source.number(*kind, name)? as f32,
                list => source.pass(list)?,
            }
        }
        positions.push(Vec3::new(row[x], row[y], row[z]));
        uvs.extend(uv.map(|[u, v]| [row[u], row[v]]));
    }
    Ok(())
}

fn faces(element: &Element, source: &mut Source, triangles: &mut Vec<[u32; 3]>) -> Result<()> {
    let corners = |p: &Property| match p {
        Property::List(name, ..) => name == "vertex_indices" || name == "vertex_index",
        Property::One(..) => false,
    };
    let Some(corners) = element.properties.iter().position(corners) else {
        return fault("its faces have no list vertex_indices");
    };
    for _ in 0..element.count {
        for (i, property) in element.properties.iter().enumerate() {
            match property {
                Property::List(name, count, entry) if i == corners => {
                    let n = source.length((*count, *entry), name)?;
                    let mut fan = [0; 2];
                    for k in 0..n {
                        let index = source.index(*entry, name)?;
                        if k >= 2 {
                            triangles.push([fan[0], fan[1], index]);
                        }
                        fan[usize::from(k > 0)] = index;
                    }
                }
                other => source.pass(other)?,
            }
        }
    }
    Ok(())
}

fn skip_element(element: &Element, source: &mut Source) -> Result<()> {
    // An element without properties takes no space, whatever its count.
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        for property in &element.properties {
            source.pass(property)?;
        }
    }
    Ok(())
}

impl Type {
    fn read(self, cursor: &mut Cursor, what: &str) -> Result<f64> {
        Ok(match self {
            Type::I8 => f64::from(cursor.u8(what)? as i8),
            Type::U8 => f64::from(cursor.u8(what)?),
            Type::I16 => f64::from(cursor.u16(what)? as i16),
            Type::U16 => f64::from(cursor.u16(what)?),
            Type::I32 => f64::from(cursor.u32(what)? as i32),
            Type::U32 => f64::from(cursor.u32(what)?),
            Type::F32 => f64::from(cursor.f32(what)?),
            Type::F64 => f64::from_bits(cursor.u64(what)?),
        })
    }
}
