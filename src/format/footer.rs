//! The footer: features, maps, levels, groups, attributes, and where the directory blocks are.

use std::collections::HashSet;

use byteorder::{ByteOrder, LittleEndian as LE};

use super::layout::*;
use crate::map::*;
use crate::{Error, Place, Result};

/// Most maps, groups, and attributes of one owner.
pub const MAX_COUNT: u32 = 65536;

/// The footer, decoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Footer {
    /// Optional features that the file says it has.
    pub optional_features: u64,
    /// Maps, in order.
    pub maps: Vec<MapRecord>,
    /// Groups, in order.
    pub groups: Vec<Group>,
    /// Attributes of the file.
    pub attributes: Vec<(String, Attribute)>,
}

/// One map of the footer.
#[derive(Clone, Debug, PartialEq)]
pub struct MapRecord {
    /// Name, size, camera and so on.
    pub header: MapHeader,
    /// Its levels.
    pub levels: Vec<LevelRecord>,
}

/// One level of the footer.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelRecord {
    /// No stored function is further than this from the exact one.
    pub max_error: f64,
    /// Vertices of all tiles.
    pub vertices: u64,
    /// Stored bytes of all tiles.
    pub payload_bytes: u64,
    /// The blocks of its directory.
    pub blocks: Vec<BlockRef>,
}

/// Where a block of the directory is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockRef {
    /// Byte offset in the file.
    pub offset: u64,
    /// Bytes in the file.
    pub stored_size: u32,
    /// CRC-32 of them.
    pub crc: u32,
    /// Codec id.
    pub codec: u8,
    /// Zero bytes at their end.
    pub padding: u8,
}

impl Footer {
    /// The bytes of the footer, padded.
    ///
    /// # Errors
    /// `Input` for names, attributes, groups and maps that the format does not allow.
    pub fn encode(&self) -> Result<Vec<u8>> {
        let mut out = vec![0; FOOTER_SIZE];
        LE::write_u64(&mut out[FOOTER_OPTIONAL..], self.optional_features);
        LE::write_u32(&mut out[FOOTER_MAPS..], self.maps.len() as u32);
        LE::write_u32(&mut out[FOOTER_GROUPS..], self.groups.len() as u32);
        LE::write_u32(&mut out[FOOTER_ATTRIBUTES..], self.attributes.len() as u32);
        for map in &self.maps {
            encode_map(map, &mut out)?;
        }
        for group in &self.groups {
            put_name(&group.name, &mut out)?;
            out.push(group.role.byte());
            put_u32(group.maps.len() as u32, &mut out);
            group.maps.iter().for_each(|m| put_u32(m.0, &mut out));
        }
        for attribute in &self.attributes {
            encode_attribute(attribute, &mut out)?;
        }
        out.resize(out.len().next_multiple_of(ALIGN), 0);
        // What was written is read back: whatever the format does not allow is the caller's error.
        let what = |e: Error| Error::input(e.to_string());
        Footer::parse(&out, 0, u64::MAX).map_err(what)?;
        Ok(out)
    }

    /// The footer whose bytes are at `offset` in the file, its CRC already checked. `directory` bytes precede it,
    /// which bounds the blocks that it can name.
    ///
    /// # Errors
    /// `Corrupt` by the rules of section 5, `Unsupported` for a required feature.
    pub fn parse(bytes: &[u8], offset: u64, directory: u64) -> Result<Footer> {
        let mut c = Cursor { bytes, at: 0 };
        let mut footer = Footer::default();
        footer
            .parse_records(&mut c, directory)
            .map_err(|e| e.at(Place::byte(offset + c.at as u64)))?;
        Ok(footer)
    }

    fn parse_records(&mut self, c: &mut Cursor, directory: u64) -> Result<()> {
        let fixed = c.take(FOOTER_SIZE)?;
        let required = LE::read_u64(&fixed[FOOTER_REQUIRED..]);
        if required != 0 {
            return Err(Error::unsupported(format!(
                "required features {required:#x}"
            )));
        }
        self.optional_features = LE::read_u64(&fixed[FOOTER_OPTIONAL..]);
        let maps = count(LE::read_u32(&fixed[FOOTER_MAPS..]), "MAP-COUNT", "maps")?;
        if maps == 0 {
            return Err(Error::corrupt("MAP-COUNT", "no map"));
        }
        let groups = count(
            LE::read_u32(&fixed[FOOTER_GROUPS..]),
            "GROUP-COUNT",
            "groups",
        )?;
        let attributes = LE::read_u32(&fixed[FOOTER_ATTRIBUTES..]);
        reserved(&fixed[FOOTER_RESERVED..], "FOOTER-RESERVED")?;
        let mut names = HashSet::new();
        for m in 0..maps {
            let map = parse_map(c, directory).map_err(|e| e.at(MapId(m)))?;
            if !names.insert(map.header.name.clone()) {
                return Err(Error::corrupt(
                    "MAP-NAME",
                    format!("two maps are called {:?}", map.header.name),
                ));
            }
            self.maps.push(map);
        }
        names.clear();
        for _ in 0..groups {
            let group = parse_group(c, maps)?;
            if !names.insert(group.name.clone()) {
                return Err(Error::corrupt(
                    "GROUP-NAME",
                    format!("two groups are called {:?}", group.name),
                ));
            }
            self.groups.push(group);
        }
        self.attributes = parse_attributes(c, attributes)?;
        let rest = &c.bytes[c.at..];
        if rest.len() >= ALIGN || rest.iter().any(|&b| b != 0) {
            return Err(Error::corrupt(
                "FOOTER-PADDING",
                "bytes behind the last record",
            ));
        }
        Ok(())
    }
}

fn encode_map(map: &MapRecord, out: &mut Vec<u8>) -> Result<()> {
    let h = &map.header;
    h.check()
        .map_err(|(rule, what)| Error::input(format!("{what} ({rule})")))?;
    put_name(&h.name, out)?;
    let mut r = [0; MAP_SIZE];
    LE::write_u32(&mut r[MAP_WIDTH..], h.width);
    LE::write_u32(&mut r[MAP_HEIGHT..], h.height);
    r[MAP_CHANNELS] = h.channels as u8;
    r[MAP_TILE] = h.tile_size.trailing_zeros() as u8;
    r[MAP_LEVELS] = map.levels.len() as u8;
    r[MAP_DEPTH] = h.depth_kind.byte();
    r[MAP_INTERPRETATION] = h.interpretation.byte();
    let matrices = [h.camera.camera_from_world, h.camera.ndc_from_world];
    r[MAP_CAMERA] = u8::from(matrices[0].is_some()) | u8::from(matrices[1].is_some()) << 1;
    LE::write_f64(&mut r[MAP_UNIT..], h.depth_unit);
    LE::write_i32_into(&h.data_origin, &mut r[MAP_ORIGIN..MAP_ORIGIN + 8]);
    LE::write_i32_into(&h.display_window, &mut r[MAP_DISPLAY..MAP_DISPLAY + 16]);
    LE::write_u32(&mut r[MAP_ATTRIBUTES..], h.attributes.len() as u32);
    out.extend_from_slice(&r);
    for value in matrices.iter().flatten().flatten() {
        out.extend_from_slice(&value.to_le_bytes());
    }
    for level in &map.levels {
        let mut r = [0; LEVEL_SIZE];
        LE::write_f64(&mut r[LEVEL_ERROR..], level.max_error);
        LE::write_u64(&mut r[LEVEL_VERTICES..], level.vertices);
        LE::write_u64(&mut r[LEVEL_BYTES..], level.payload_bytes);
        out.extend_from_slice(&r);
        for block in &level.blocks {
            let mut r = [0; BLOCK_SIZE];
            LE::write_u64(&mut r[BLOCK_OFFSET..], block.offset);
            LE::write_u32(&mut r[BLOCK_STORED..], block.stored_size);
            LE::write_u32(&mut r[BLOCK_CRC..], block.crc);
            r[BLOCK_CODEC] = block.codec;
            r[BLOCK_PADDING] = block.padding;
            out.extend_from_slice(&r);
        }
    }
    h.attributes
        .iter()
        .try_for_each(|a| encode_attribute(a, out))
}

fn parse_map(c: &mut Cursor, directory: u64) -> Result<MapRecord> {
    let name = c.name("MAP-NAME")?;
    let r = c.take(MAP_SIZE)?;
    let tile_log2 = r[MAP_TILE];
    if !(3..=8).contains(&tile_log2) {
        return Err(Error::corrupt(
            "MAP-TILE",
            format!("tiles of 2^{tile_log2} pixels"),
        ));
    }
    let mut header = MapHeader {
        channels: usize::from(r[MAP_CHANNELS]),
        tile_size: 1 << tile_log2,
        depth_kind: DepthKind::from_byte(r[MAP_DEPTH])
            .ok_or_else(|| Error::corrupt("MAP-DEPTH", format!("depth kind {}", r[MAP_DEPTH])))?,
        interpretation: Interpretation::from_byte(r[MAP_INTERPRETATION]).ok_or_else(|| {
            let what = format!("interpretation {}", r[MAP_INTERPRETATION]);
            Error::corrupt("MAP-INTERPRETATION", what)
        })?,
        depth_unit: LE::read_f64(&r[MAP_UNIT..]),
        ..MapHeader::new(
            name,
            LE::read_u32(&r[MAP_WIDTH..]),
            LE::read_u32(&r[MAP_HEIGHT..]),
        )
    };
    LE::read_i32_into(&r[MAP_ORIGIN..MAP_ORIGIN + 8], &mut header.data_origin);
    LE::read_i32_into(
        &r[MAP_DISPLAY..MAP_DISPLAY + 16],
        &mut header.display_window,
    );
    reserved(&r[MAP_RESERVED..MAP_UNIT], "MAP-RESERVED")?;
    if header.depth_unit.is_sign_negative() {
        let what = format!("a depth unit of {} metres", header.depth_unit);
        return Err(Error::corrupt("MAP-UNIT", what));
    }
    let (camera, level_count) = (r[MAP_CAMERA], u32::from(r[MAP_LEVELS]));
    let attributes = LE::read_u32(&r[MAP_ATTRIBUTES..]);
    if camera > 3 {
        return Err(Error::corrupt(
            "MAP-CAMERA",
            format!("camera flags {camera:#x}"),
        ));
    }
    if camera & 1 != 0 {
        header.camera.camera_from_world = Some(c.matrix()?);
    }
    if camera & 2 != 0 {
        header.camera.ndc_from_world = Some(c.matrix()?);
    }
    header
        .check()
        .map_err(|(rule, what)| Error::corrupt(rule, what))?;
    if level_count == 0 || level_count > header.full_level_count() {
        return Err(Error::corrupt(
            "MAP-LEVELS",
            format!(
                "{level_count} levels over {} x {}",
                header.width, header.height
            ),
        ));
    }
    let mut levels = Vec::new();
    for l in 0..level_count {
        let shape = LevelShape::of(&header, l);
        let place = Place {
            level: Some(l),
            ..Place::default()
        };
        levels.push(parse_level(c, shape, directory).map_err(|e| e.at(place))?);
    }
    header.attributes = parse_attributes(c, attributes)?;
    Ok(MapRecord { header, levels })
}

fn parse_level(c: &mut Cursor, shape: LevelShape, directory: u64) -> Result<LevelRecord> {
    let r = c.take(LEVEL_SIZE)?;
    let max_error = LE::read_f64(&r[LEVEL_ERROR..]);
    if !(0.0..=1.0).contains(&max_error) || max_error.is_sign_negative() {
        return Err(Error::corrupt(
            "LEVEL-ERROR",
            format!("a promise of {max_error}"),
        ));
    }
    let (vertices, payload_bytes) = (
        LE::read_u64(&r[LEVEL_VERTICES..]),
        LE::read_u64(&r[LEVEL_BYTES..]),
    );
    let count = shape.tiles().div_ceil(BLOCK_ENTRIES);
    let size = count
        .checked_mul(BLOCK_SIZE as u64)
        .and_then(|n| usize::try_from(n).ok());
    let records = c.take(size.ok_or_else(short)?)?;
    let blocks = records
        .chunks_exact(BLOCK_SIZE)
        .map(|r| {
            reserved(&r[BLOCK_RESERVED..], "BLOCK-RESERVED")?;
            let block = BlockRef {
                offset: LE::read_u64(&r[BLOCK_OFFSET..]),
                stored_size: LE::read_u32(&r[BLOCK_STORED..]),
                crc: LE::read_u32(&r[BLOCK_CRC..]),
                codec: r[BLOCK_CODEC],
                padding: r[BLOCK_PADDING],
            };
            if block.padding > 7 || u32::from(block.padding) > block.stored_size {
                return Err(Error::corrupt(
                    "BLOCK-PADDING",
                    format!("{} bytes of padding", block.padding),
                ));
            }
            let aligned = block.offset.is_multiple_of(ALIGN as u64)
                && block.stored_size.is_multiple_of(ALIGN as u32);
            if !aligned || u64::from(block.stored_size) > directory {
                let what = format!(
                    "a block of {} bytes at byte {}",
                    block.stored_size, block.offset
                );
                return Err(Error::corrupt("BLOCK-RANGE", what));
            }
            Ok(block)
        })
        .collect::<Result<_>>()?;
    Ok(LevelRecord {
        max_error,
        vertices,
        payload_bytes,
        blocks,
    })
}

fn parse_group(c: &mut Cursor, maps: u32) -> Result<Group> {
    let name = c.name("GROUP-NAME")?;
    let role = c.take(1)?[0];
    let role = GroupRole::from_byte(role)
        .ok_or_else(|| Error::corrupt("GROUP-ROLE", format!("role {role}")))?;
    let broken = |what: String| Err(Error::corrupt("GROUP-MAPS", what));
    let count = c.u32()?;
    if count == 0 || count > maps {
        return broken(format!("a group of {count} maps in a file of {maps}"));
    }
    let ids = c.take(4 * count as usize)?.chunks_exact(4);
    let ids: Vec<MapId> = ids.map(|id| MapId(LE::read_u32(id))).collect();
    let mut seen = vec![false; maps as usize];
    for m in &ids {
        match seen.get_mut(m.index()) {
            Some(seen) if !*seen => *seen = true,
            _ => return broken(format!("map {m} is not there, or there twice")),
        }
    }
    Ok(Group::new(name, role, ids))
}

fn encode_attribute((name, value): &(String, Attribute), out: &mut Vec<u8>) -> Result<()> {
    let mut bytes = Vec::new();
    let kind = match value {
        Attribute::Text(text) => {
            bytes.extend_from_slice(text.as_bytes());
            0
        }
        Attribute::Integers(values) => {
            values
                .iter()
                .for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
            1
        }
        Attribute::Numbers(values) => {
            values
                .iter()
                .for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
            2
        }
        Attribute::Opaque {
            type_name,
            bytes: value,
        } => {
            put_name(type_name, &mut bytes)?;
            bytes.extend_from_slice(value);
            3
        }
        Attribute::Unknown { kind, bytes: value } => {
            bytes.extend_from_slice(value);
            *kind
        }
    };
    put_name(name, out)?;
    out.push(kind);
    let length =
        u32::try_from(bytes.len()).map_err(|_| Error::input("an attribute of more than 4 GiB"))?;
    put_u32(length, out);
    out.extend_from_slice(&bytes);
    Ok(())
}

fn parse_attributes(c: &mut Cursor, n: u32) -> Result<Vec<(String, Attribute)>> {
    let n = count(n, "ATTRIBUTE-COUNT", "attributes")?;
    let mut names = HashSet::new();
    let mut attributes = Vec::new();
    for _ in 0..n {
        let name = c.name("ATTRIBUTE-NAME")?;
        if !names.insert(name.clone()) {
            return Err(Error::corrupt(
                "ATTRIBUTE-NAME",
                format!("two attributes are called {name:?}"),
            ));
        }
        let kind = c.take(1)?[0];
        let length = c.u32()?;
        let bytes = c.take(length as usize)?;
        let broken =
            |what: &str| Error::corrupt("ATTRIBUTE-VALUE", format!("attribute {name:?}: {what}"));
        if matches!(kind, 1 | 2) && (bytes.is_empty() || bytes.len() % 8 != 0) {
            return Err(broken("not one or more numbers of 8 bytes"));
        }
        let value = match kind {
            0 => Attribute::Text(text(bytes).ok_or_else(|| broken("not UTF-8"))?.into()),
            1 => Attribute::Integers(bytes.chunks_exact(8).map(LE::read_i64).collect()),
            2 => Attribute::Numbers(bytes.chunks_exact(8).map(LE::read_f64).collect()),
            3 => {
                let mut inner = Cursor { bytes, at: 0 };
                let type_name = inner
                    .name("ATTRIBUTE-VALUE")
                    .map_err(|_| broken("no name of a type"))?;
                Attribute::Opaque {
                    type_name,
                    bytes: bytes[inner.at..].to_vec(),
                }
            }
            kind => Attribute::Unknown {
                kind,
                bytes: bytes.to_vec(),
            },
        };
        attributes.push((name, value));
    }
    Ok(attributes)
}

fn count(n: u32, rule: &'static str, what: &str) -> Result<u32> {
    if n > MAX_COUNT {
        return Err(Error::corrupt(rule, format!("{n} {what}")));
    }
    Ok(n)
}

fn reserved(bytes: &[u8], rule: &'static str) -> Result<()> {
    if bytes.iter().any(|&b| b != 0) {
        return Err(Error::corrupt(rule, "reserved bytes are not zero"));
    }
    Ok(())
}

fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes).ok()
}

fn put_u32(value: u32, out: &mut Vec<u8>) {
    out.extend_from_slice(&value.to_le_bytes());
}

fn put_name(name: &str, out: &mut Vec<u8>) -> Result<()> {
    let length =
        u16::try_from(name.len()).map_err(|_| Error::input("a name of more than 255 bytes"))?;
    out.extend_from_slice(&length.to_le_bytes());
    out.extend_from_slice(name.as_bytes());
    Ok(())
}

fn short() -> Error {
    Error::corrupt("FOOTER-SHORT", "a record runs past the end of the footer")
}

/// A place in the footer; nothing is allocated before its bytes are known to be there.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8]> {
        let end = self.at.checked_add(n).ok_or_else(short)?;
        let taken = self.bytes.get(self.at..end).ok_or_else(short)?;
        self.at = end;
        Ok(taken)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(LE::read_u32(self.take(4)?))
    }

    fn name(&mut self, rule: &'static str) -> Result<String> {
        let length = usize::from(LE::read_u16(self.take(2)?));
        let bytes = self.take(length)?;
        match text(bytes) {
            Some(name)
                if (1..=255).contains(&length)
                    && !name.chars().any(|ch| ch < ' ' || ch == '\x7f') =>
            {
                Ok(name.into())
            }
            _ => Err(Error::corrupt(
                rule,
                "a name is empty, too long, not UTF-8, or has control characters",
            )),
        }
    }

    fn matrix(&mut self) -> Result<[f64; 16]> {
        let mut m = [0.0; 16];
        LE::read_f64_into(self.take(128)?, &mut m);
        Ok(m)
    }
}
