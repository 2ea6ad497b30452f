//! Every fixed offset of the format, declared once. A gap or an overlap fails to compile; a test
//! compares these tables with those of `spec/format.md`.

/// One field of a fixed-size record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Byte offset in its record.
    pub offset: usize,
    /// Size in bytes.
    pub size: usize,
    /// Type, as the specification writes it.
    pub kind: &'static str,
    /// Name, as the specification writes it.
    pub name: &'static str,
}

const fn f(offset: usize, size: usize, kind: &'static str, name: &'static str) -> Field {
    Field {
        offset,
        size,
        kind,
        name,
    }
}

const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}

/// Size of a record whose fields follow one another without gap or overlap.
const fn size_of(fields: &[Field]) -> usize {
    let mut end = 0;
    let mut i = 0;
    while i < fields.len() {
        assert!(fields[i].offset == end, "a gap or an overlap in a record");
        end += fields[i].size;
        i += 1;
    }
    end
}

/// Byte range of a field.
const fn at(fields: &[Field], name: &str) -> usize {
    let mut i = 0;
    while i < fields.len() {
        if same(fields[i].name, name) {
            return fields[i].offset;
        }
        i += 1;
    }
    panic!("no field of that name")
}

/// First bytes of a file: a byte with its high bit set, the name, CR LF, control-Z, LF.
pub const MAGIC: [u8; 8] = [0x89, b'D', b'S', b'M', 0x0D, 0x0A, 0x1A, 0x0A];
/// The commit mark of the trailer: a file without it was never finished.
pub const COMMIT: [u8; 8] = *b"DSM-END\n";
/// Version of the format.
pub const VERSION: u16 = 1;
/// Entries of the tile directory that share a block.
pub const BLOCK_ENTRIES: u64 = 1024;
/// Largest width and height of a map.
pub use crate::map::MAX_SIDE;
/// Largest number of bytes that a tile may decode to.
pub const MAX_DECODED: u32 = 1 << 31;
/// Tiles, directory blocks and the footer start at multiples of this and are padded to it.
pub const ALIGN: usize = 8;

macro_rules! offsets {
    ($table:ident, $size:ident, $($name:ident = $field:literal),* $(,)?) => {
        #[doc = concat!("Bytes in a record of [`", stringify!($table), "`].")]
        pub const $size: usize = size_of($table);
        $(#[doc = concat!("Offset of `", $field, "`.")] pub const $name: usize = at($table, $field);)*
    };
}

/// The file header.
pub const HEADER: &[Field] = &[
    f(0, 8, "u8[8]", "magic"),
    f(8, 2, "u16", "version"),
    f(10, 2, "u16", "header_size"),
    f(12, 48, "u8[48]", "reserved"),
    f(60, 4, "u32", "header_crc"),
];
offsets!(
    HEADER,
    HEADER_SIZE,
    HEADER_VERSION = "version",
    HEADER_LENGTH = "header_size",
    HEADER_RESERVED = "reserved",
    HEADER_CRC = "header_crc",
);

/// The trailer, the last bytes of the file.
pub const TRAILER: &[Field] = &[
    f(0, 8, "u64", "file_length"),
    f(8, 8, "u64", "directory_offset"),
    f(16, 8, "u64", "footer_offset"),
    f(24, 8, "u64", "footer_size"),
    f(32, 4, "u32", "footer_crc"),
    f(36, 2, "u16", "version"),
    f(38, 14, "u8[14]", "reserved"),
    f(52, 8, "u8[8]", "commit_mark"),
    f(60, 4, "u32", "trailer_crc"),
];
offsets!(
    TRAILER,
    TRAILER_SIZE,
    TRAILER_LENGTH = "file_length",
    TRAILER_DIRECTORY = "directory_offset",
    TRAILER_FOOTER = "footer_offset",
    TRAILER_FOOTER_SIZE = "footer_size",
    TRAILER_FOOTER_CRC = "footer_crc",
    TRAILER_VERSION = "version",
    TRAILER_RESERVED = "reserved",
    TRAILER_COMMIT = "commit_mark",
    TRAILER_CRC = "trailer_crc",
);

/// The fixed start of the footer.
pub const FOOTER: &[Field] = &[
    f(0, 8, "u64", "required_features"),
    f(8, 8, "u64", "optional_features"),
    f(16, 4, "u32", "map_count"),
    f(20, 4, "u32", "group_count"),
    f(24, 4, "u32", "attribute_count"),
    f(28, 4, "u8[4]", "reserved"),
];
offsets!(
    FOOTER,
    FOOTER_SIZE,
    FOOTER_REQUIRED = "required_features",
    FOOTER_OPTIONAL = "optional_features",
    FOOTER_MAPS = "map_count",
    FOOTER_GROUPS = "group_count",
    FOOTER_ATTRIBUTES = "attribute_count",
    FOOTER_RESERVED = "reserved",
);

/// The fixed part of a map record, behind its name.
pub const MAP: &[Field] = &[
    f(0, 4, "u32", "width"),
    f(4, 4, "u32", "height"),
    f(8, 1, "u8", "channels"),
    f(9, 1, "u8", "tile_log2"),
    f(10, 1, "u8", "level_count"),
    f(11, 1, "u8", "depth_kind"),
    f(12, 1, "u8", "interpretation"),
    f(13, 1, "u8", "camera_flags"),
    f(14, 2, "u8[2]", "reserved"),
    f(16, 8, "f64", "depth_unit"),
    f(24, 8, "i32[2]", "data_origin"),
    f(32, 16, "i32[4]", "display_window"),
    f(48, 4, "u32", "attribute_count"),
];
offsets!(
    MAP,
    MAP_SIZE,
    MAP_WIDTH = "width",
    MAP_HEIGHT = "height",
    MAP_CHANNELS = "channels",
    MAP_TILE = "tile_log2",
    MAP_LEVELS = "level_count",
    MAP_DEPTH = "depth_kind",
    MAP_INTERPRETATION = "interpretation",
    MAP_CAMERA = "camera_flags",
    MAP_RESERVED = "reserved",
    MAP_UNIT = "depth_unit",
    MAP_ORIGIN = "data_origin",
    MAP_DISPLAY = "display_window",
    MAP_ATTRIBUTES = "attribute_count",
);

/// The fixed start of a level record.
pub const LEVEL: &[Field] = &[
    f(0, 8, "f64", "max_error"),
    f(8, 8, "u64", "vertices"),
    f(16, 8, "u64", "payload_bytes"),
];
offsets!(
    LEVEL,
    LEVEL_SIZE,
    LEVEL_ERROR = "max_error",
    LEVEL_VERTICES = "vertices",
    LEVEL_BYTES = "payload_bytes"
);

/// A reference to one block of the tile directory.
pub const BLOCK: &[Field] = &[
    f(0, 8, "u64", "offset"),
    f(8, 4, "u32", "stored_size"),
    f(12, 4, "u32", "block_crc"),
    f(16, 1, "u8", "codec"),
    f(17, 1, "u8", "padding"),
    f(18, 6, "u8[6]", "reserved"),
];
offsets!(
    BLOCK,
    BLOCK_SIZE,
    BLOCK_OFFSET = "offset",
    BLOCK_STORED = "stored_size",
    BLOCK_CRC = "block_crc",
    BLOCK_CODEC = "codec",
    BLOCK_PADDING = "padding",
    BLOCK_RESERVED = "reserved",
);

/// One entry of the tile directory.
pub const ENTRY: &[Field] = &[
    f(0, 8, "u64", "offset"),
    f(8, 4, "u32", "stored_size"),
    f(12, 4, "u32", "decoded_size"),
    f(16, 4, "u32", "vertices"),
    f(20, 4, "u32", "tile_crc"),
    f(24, 4, "f32", "z_min"),
    f(28, 4, "f32", "z_max"),
    f(32, 4, "f32", "end_min"),
    f(36, 4, "f32", "end_max"),
    f(40, 1, "u8", "kind"),
    f(41, 1, "u8", "codec"),
    f(42, 1, "u8", "transform"),
    f(43, 1, "u8", "padding"),
    f(44, 2, "u16", "lattice"),
    f(46, 2, "u16", "flags"),
];
offsets!(
    ENTRY,
    ENTRY_SIZE,
    ENTRY_OFFSET = "offset",
    ENTRY_STORED = "stored_size",
    ENTRY_DECODED = "decoded_size",
    ENTRY_VERTICES = "vertices",
    ENTRY_CRC = "tile_crc",
    ENTRY_Z_MIN = "z_min",
    ENTRY_Z_MAX = "z_max",
    ENTRY_END_MIN = "end_min",
    ENTRY_END_MAX = "end_max",
    ENTRY_KIND = "kind",
    ENTRY_CODEC = "codec",
    ENTRY_TRANSFORM = "transform",
    ENTRY_PADDING = "padding",
    ENTRY_LATTICE = "lattice",
    ENTRY_FLAGS = "flags",
);

#[cfg(test)]
mod tests {
    use super::*;

    /// The rows of the table that follows the line `<!-- layout NAME -->` in the specification.
    fn rows(spec: &str, name: &str) -> Vec<(usize, usize, String, String)> {
        let marker = format!("<!-- layout {name} -->");
        let start = spec
            .find(&marker)
            .unwrap_or_else(|| panic!("no table {name} in the specification"));
        spec[start..]
            .lines()
            .skip(1)
            .skip_while(|l| !l.starts_with('|'))
            .take_while(|l| l.starts_with('|'))
            .skip(2)
            .map(|line| {
                let cells: Vec<&str> = line
                    .split('|')
                    .map(|c| c.trim().trim_matches('`'))
                    .collect();
                (
                    cells[1].parse().unwrap(),
                    cells[2].parse().unwrap(),
                    cells[3].into(),
                    cells[4].into(),
                )
            })
            .collect()
    }

    #[test]
    fn the_specification_has_the_same_tables() {
        let spec = include_str!("../../spec/format.md");
        for (name, table) in [
            ("header", HEADER),
            ("trailer", TRAILER),
            ("footer", FOOTER),
            ("map", MAP),
            ("level", LEVEL),
            ("block", BLOCK),
            ("entry", ENTRY),
        ] {
            let ours: Vec<_> = table
                .iter()
                .map(|f| (f.offset, f.size, f.kind.to_string(), f.name.to_string()))
                .collect();
            assert_eq!(rows(spec, name), ours, "table {name}");
        }
    }
}
