//! The footer: features, maps, levels, groups, attributes and the positions of directory blocks.

use std::collections::HashSet;

use super::directory::{BlockRef, check_padding, is_aligned};
use super::ensure;
use super::layout::*;
use super::record::{Number, Record};
use crate::error::Place;
use crate::map::*;
use crate::{Error, Result};

/// The largest number of maps, of groups, and of the attributes of one owner.
pub const MAX_COUNT: u32 = 65536;

/// The footer, decoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Footer {
    /// Bits of the optional features of the file.
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
    /// The properties of the map: name, size, camera and so on.
    pub header: MapHeader,
    /// Its levels.
    pub levels: Vec<LevelRecord>,
}

/// One level of the footer.
#[derive(Clone, Debug, Default, PartialEq)]
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

impl Footer {
    /// The bytes of the footer, padded.
    ///
    /// # Errors
    /// `Input` for names, attributes, groups and maps that the format does not allow.
    pub fn encode(&self) -> Result<Vec<u8>> {
        let mut out = vec![0; FOOTER_SIZE];
        self.optional_features.write(&mut out[FOOTER_OPTIONAL..]);
        (self.maps.len() as u32).write(&mut out[FOOTER_MAPS..]);
        (self.groups.len() as u32).write(&mut out[FOOTER_GROUPS..]);
        (self.attributes.len() as u32).write(&mut out[FOOTER_ATTRIBUTES..]);
        for map in &self.maps {
            encode_map(map, &mut out)?;
        }
        for group in &self.groups {
            encode_name(&group.name, &mut out)?;
            out.push(group.role.byte());
            (group.maps.len() as u32).append(&mut out);
            group.maps.iter().for_each(|map| map.0.append(&mut out));
        }
        for attribute in &self.attributes {
            encode_attribute(attribute, &mut out)?;
        }
        out.resize(out.len().next_multiple_of(ALIGN), 0);
        // Parsing finds everything that the format does not allow. It is the caller's error.
        Footer::parse(&out, 0, u64::MAX).map_err(Error::of_caller)?;
        Ok(out)
    }

    /// The footer in `bytes`, which lie at `offset` in the file.
    ///
    /// The caller has checked the CRC. `directory` is the number of bytes in front of the footer:
    /// no block is larger.
    ///
    /// # Errors
    /// `Corrupt` by the rules of section 5, `Unsupported` for a required feature.
    pub fn parse(bytes: &[u8], offset: u64, directory: u64) -> Result<Footer> {
        let mut c = Cursor { bytes, at: 0 };
        let mut footer = Footer::default();
        let parsed = footer.parse_records(&mut c, directory);
        parsed.map_err(|e| e.at(Place::byte(offset + c.at as u64)))?;
        Ok(footer)
    }

    fn parse_records(&mut self, c: &mut Cursor<'_>, directory: u64) -> Result<()> {
        let fixed = c.take(FOOTER_SIZE)?;
        let required = u64::read(&fixed[FOOTER_REQUIRED..]);
        if required != 0 {
            return Err(Error::unsupported(format!(
                "required features {required:#x}"
            )));
        }
        self.optional_features = u64::read(&fixed[FOOTER_OPTIONAL..]);
        let maps = u32::read(&fixed[FOOTER_MAPS..]);
        let groups = u32::read(&fixed[FOOTER_GROUPS..]);
        let attributes = u32::read(&fixed[FOOTER_ATTRIBUTES..]);
        check_count(maps, "MAP-COUNT", "maps")?;
        ensure(maps > 0, "MAP-COUNT", || "no map")?;
        check_count(groups, "GROUP-COUNT", "groups")?;
        check_reserved(&fixed[FOOTER_RESERVED..], "FOOTER-RESERVED")?;
        let mut names = HashSet::new();
        for m in 0..maps {
            let map = parse_map(c, MapId(m), directory).map_err(|e| e.at(MapId(m)))?;
            check_new(&mut names, &map.header.name, "MAP-NAME", "maps")?;
            self.maps.push(map);
        }
        let mut names = HashSet::new();
        for _ in 0..groups {
            let group = parse_group(c, maps)?;
            check_new(&mut names, &group.name, "GROUP-NAME", "groups")?;
            self.groups.push(group);
        }
        self.attributes = parse_attributes(c, attributes)?;
        let rest = &c.bytes[c.at..];
        let is_padding = rest.len() < ALIGN && rest.iter().all(|&b| b == 0);
        ensure(
            is_padding,
            "FOOTER-PADDING",
            || "bytes behind the last record",
        )
    }
}

/// The fixed part of a map record. `bytes` are its fields of one byte, in order.
fn map_fields(mut r: Record<'_>, h: &mut MapHeader, bytes: &mut [u8; 6], attributes: &mut u32) {
    r.field(MAP_WIDTH, &mut h.width);
    r.field(MAP_HEIGHT, &mut h.height);
    r.field(MAP_CHANNELS, bytes);
    r.field(MAP_UNIT, &mut h.depth_unit);
    r.field(MAP_ORIGIN, &mut h.data_origin);
    r.field(MAP_DISPLAY, &mut h.display_window);
    r.field(MAP_ATTRIBUTES, attributes);
}

impl LevelRecord {
    fn fields(&mut self, mut r: Record<'_>) {
        r.field(LEVEL_ERROR, &mut self.max_error);
        r.field(LEVEL_VERTICES, &mut self.vertices);
        r.field(LEVEL_BYTES, &mut self.payload_bytes);
    }
}

impl BlockRef {
    fn fields(&mut self, mut r: Record<'_>) {
        r.field(BLOCK_OFFSET, &mut self.offset);
        r.field(BLOCK_STORED, &mut self.stored_size);
        r.field(BLOCK_CRC, &mut self.crc);
        r.field(BLOCK_CODEC, &mut self.codec);
        r.field(BLOCK_PADDING, &mut self.padding);
    }
}

fn encode_map(map: &MapRecord, out: &mut Vec<u8>) -> Result<()> {
    let mut h = map.header.clone();
    h.check()
        .map_err(|(rule, what)| Error::input(format!("{what} ({rule})")))?;
    encode_name(&h.name, out)?;
    let matrices = [h.camera.camera_from_world, h.camera.ndc_from_world];
    let mut bytes = [
        h.channels as u8,
        h.tile_size.trailing_zeros() as u8,
        map.levels.len() as u8,
        h.depth_kind.byte(),
        h.interpretation.byte(),
        u8::from(matrices[0].is_some()) | u8::from(matrices[1].is_some()) << 1,
    ];
    let mut attributes = h.attributes.len() as u32;
    let mut r = [0; MAP_SIZE];
    map_fields(Record::Write(&mut r), &mut h, &mut bytes, &mut attributes);
    r.append(out);
    matrices.iter().flatten().for_each(|m| m.append(out));
    for level in &map.levels {
        let mut r = [0; LEVEL_SIZE];
        level.clone().fields(Record::Write(&mut r));
        r.append(out);
        for mut block in level.blocks.iter().copied() {
            let mut r = [0; BLOCK_SIZE];
            block.fields(Record::Write(&mut r));
            r.append(out);
        }
    }
    h.attributes
        .iter()
        .try_for_each(|a| encode_attribute(a, out))
}

fn parse_map(c: &mut Cursor<'_>, id: MapId, directory: u64) -> Result<MapRecord> {
    let mut header = MapHeader::new(c.name("MAP-NAME")?, 0, 0);
    let (mut bytes, mut attributes) = ([0; 6], 0);
    let r = c.take(MAP_SIZE)?;
    map_fields(Record::Read(r), &mut header, &mut bytes, &mut attributes);
    let [
        channels,
        tile_log2,
        levels,
        depth_kind,
        interpretation,
        camera,
    ] = bytes;
    ensure((3..=8).contains(&tile_log2), "MAP-TILE", || {
        format!("tiles of 2^{tile_log2} pixels")
    })?;
    header.channels = usize::from(channels);
    header.tile_size = 1 << tile_log2;
    header.depth_kind = DepthKind::from_byte(depth_kind)?;
    header.interpretation = Interpretation::from_byte(interpretation)?;
    check_reserved(&r[MAP_RESERVED..MAP_UNIT], "MAP-RESERVED")?;
    ensure(camera <= 3, "MAP-CAMERA", || {
        format!("camera flags {camera:#x}")
    })?;
    if camera & 1 != 0 {
        header.camera.camera_from_world = Some(c.number()?);
    }
    if camera & 2 != 0 {
        header.camera.ndc_from_world = Some(c.number()?);
    }
    header
        .check()
        .map_err(|(rule, what)| Error::corrupt(rule, what))?;
    let level_count = u32::from(levels);
    let possible = 1..=header.full_level_count();
    ensure(possible.contains(&level_count), "MAP-LEVELS", || {
        format!(
            "{level_count} levels over {} x {}",
            header.width, header.height
        )
    })?;
    let mut levels = Vec::new();
    for l in 0..level_count {
        let shape = LevelShape::of(&header, l);
        levels.push(parse_level(c, shape, directory).map_err(|e| e.at(id.level(l)))?);
    }
    header.attributes = parse_attributes(c, attributes)?;
    Ok(MapRecord { header, levels })
}

fn parse_level(c: &mut Cursor<'_>, shape: LevelShape, directory: u64) -> Result<LevelRecord> {
    let mut level = LevelRecord::default();
    level.fields(Record::Read(c.take(LEVEL_SIZE)?));
    let error = level.max_error;
    let is_error = (0.0..=1.0).contains(&error) && !error.is_sign_negative();
    ensure(is_error, "LEVEL-ERROR", || format!("a promise of {error}"))?;
    let count = shape.tiles().div_ceil(BLOCK_ENTRIES);
    let size = count
        .checked_mul(BLOCK_SIZE as u64)
        .and_then(|n| usize::try_from(n).ok());
    let records = c.take(size.ok_or_else(short)?)?.chunks_exact(BLOCK_SIZE);
    let blocks = records.map(|r| parse_block(r, directory));
    level.blocks = blocks.collect::<Result<_>>()?;
    Ok(level)
}

fn parse_block(r: &[u8], directory: u64) -> Result<BlockRef> {
    check_reserved(&r[BLOCK_RESERVED..], "BLOCK-RESERVED")?;
    let mut block = BlockRef::default();
    block.fields(Record::Read(r));
    let (offset, size) = (block.offset, block.stored_size);
    check_padding(block.padding, size, "BLOCK-PADDING")?;
    let holds = is_aligned(offset, size) && u64::from(size) <= directory;
    ensure(holds, "BLOCK-RANGE", || {
        format!("a block of {size} bytes at byte {offset}")
    })?;
    Ok(block)
}

fn parse_group(c: &mut Cursor<'_>, maps: u32) -> Result<Group> {
    let name = c.name("GROUP-NAME")?;
    let role = GroupRole::from_byte(c.number()?)?;
    let count: u32 = c.number()?;
    ensure((1..=maps).contains(&count), "GROUP-MAPS", || {
        format!("a group of {count} maps in a file of {maps}")
    })?;
    let ids = c.take(4 * count as usize)?.chunks_exact(4);
    let ids: Vec<MapId> = ids.map(|id| MapId(u32::read(id))).collect();
    let mut seen = HashSet::new();
    for m in &ids {
        ensure(m.0 < maps && seen.insert(m.0), "GROUP-MAPS", || {
            format!("map {m} is not there, or there twice")
        })?;
    }
    Ok(Group::new(name, role, ids))
}

fn encode_attribute((name, value): &(String, Attribute), out: &mut Vec<u8>) -> Result<()> {
    let (kind, mut bytes) = match value {
        Attribute::Text(text) => (0, text.as_bytes().to_vec()),
        Attribute::Integers(values) => (1, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        Attribute::Numbers(values) => (2, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        Attribute::Opaque { type_name, bytes } => {
            let mut all = Vec::new();
            encode_name(type_name, &mut all)?;
            all.extend(bytes);
            (3, all)
        }
        Attribute::Unknown { kind, bytes } => (*kind, bytes.clone()),
    };
    encode_name(name, out)?;
    out.push(kind);
    let length =
        u32::try_from(bytes.len()).map_err(|_| Error::input("an attribute of more than 4 GiB"))?;
    length.append(out);
    out.append(&mut bytes);
    Ok(())
}

fn parse_attributes(c: &mut Cursor<'_>, n: u32) -> Result<Vec<(String, Attribute)>> {
    check_count(n, "ATTRIBUTE-COUNT", "attributes")?;
    let mut names = HashSet::new();
    let mut attributes = Vec::new();
    for _ in 0..n {
        let name = c.name("ATTRIBUTE-NAME")?;
        check_new(&mut names, &name, "ATTRIBUTE-NAME", "attributes")?;
        let kind = c.number()?;
        let length: u32 = c.number()?;
        let value = parse_value(kind, c.take(length as usize)?).map_err(|what| {
            Error::corrupt("ATTRIBUTE-VALUE", format!("attribute {name:?}: {what}"))
        })?;
        attributes.push((name, value));
    }
    Ok(attributes)
}

/// The value of an attribute, or the reason why its bytes are invalid.
fn parse_value(kind: u8, bytes: &[u8]) -> std::result::Result<Attribute, &'static str> {
    if matches!(kind, 1 | 2) && (bytes.is_empty() || !bytes.len().is_multiple_of(8)) {
        return Err("not one or more numbers of 8 bytes");
    }
    Ok(match kind {
        0 => Attribute::Text(str::from_utf8(bytes).map_err(|_| "not UTF-8")?.into()),
        1 => Attribute::Integers(bytes.chunks_exact(8).map(i64::read).collect()),
        2 => Attribute::Numbers(bytes.chunks_exact(8).map(f64::read).collect()),
        3 => {
            let mut c = Cursor { bytes, at: 0 };
            let type_name = c.name("ATTRIBUTE-VALUE");
            Attribute::Opaque {
                type_name: type_name.map_err(|_| "no name of a type")?,
                bytes: bytes[c.at..].to_vec(),
            }
        }
        kind => Attribute::Unknown {
            kind,
            bytes: bytes.to_vec(),
        },
    })
}

fn check_count(n: u32, rule: &'static str, what: &str) -> Result<()> {
    ensure(n <= MAX_COUNT, rule, || format!("{n} {what}"))
}

fn check_reserved(bytes: &[u8], rule: &'static str) -> Result<()> {
    let is_zero = bytes.iter().all(|&b| b == 0);
    ensure(is_zero, rule, || "reserved bytes are not zero")
}

fn encode_name(name: &str, out: &mut Vec<u8>) -> Result<()> {
    let length =
        u16::try_from(name.len()).map_err(|_| Error::input("a name of more than 255 bytes"))?;
    length.append(out);
    out.extend_from_slice(name.as_bytes());
    Ok(())
}

fn short() -> Error {
    Error::corrupt("FOOTER-SHORT", "a record runs past the end of the footer")
}

/// Adds a name, which must differ from those of the other `owners`.
fn check_new(
    names: &mut HashSet<String>,
    name: &str,
    rule: &'static str,
    owners: &str,
) -> Result<()> {
    let is_new = names.insert(name.to_owned());
    ensure(is_new, rule, || format!("two {owners} are called {name:?}"))
}

/// A position in the footer. Allocates nothing before it knows that the bytes are there.
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

    fn number<T: Number>(&mut self) -> Result<T> {
        self.take(size_of::<T>()).map(T::read)
    }

    fn name(&mut self, rule: &'static str) -> Result<String> {
        let length: u16 = self.number()?;
        let name = str::from_utf8(self.take(length.into())?).unwrap_or_default();
        let is_control = |ch: char| ch < ' ' || ch == '\x7f';
        let holds = (1..=255).contains(&name.len()) && !name.contains(is_control);
        ensure(
            holds,
            rule,
            || "a name is empty, too long, not UTF-8, or has control characters",
        )?;
        Ok(name.into())
    }
}
