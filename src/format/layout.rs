//! Every fixed offset of the format, declared once.
//!
//! A gap or an overlap between two fields fails to compile. The test `tests/hexdump.rs` compares
//! these tables with those of `spec/format.md`.

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

/// Size of a record whose fields follow one another without gap or overlap.
const fn record_size(fields: &[Field]) -> usize {
    let mut end = 0;
    let mut i = 0;
    while i < fields.len() {
        assert!(fields[i].offset == end, "a gap or an overlap in a record");
        end += fields[i].size;
        i += 1;
    }
    end
}

/// First bytes of a file: a byte with its high bit set, the name, CR LF, control-Z, LF.
pub const MAGIC: [u8; 8] = [0x89, b'D', b'S', b'M', 0x0D, 0x0A, 0x1A, 0x0A];
/// The commit mark of the trailer: a file without it was never finished.
pub const COMMIT: [u8; 8] = *b"DSM-END\n";
/// Version of the format.
pub const VERSION: u16 = 1;
/// Entries of the tile directory that share a block.
pub const BLOCK_ENTRIES: u64 = 1024;
pub use crate::map::MAX_SIDE;
/// Largest number of bytes that a tile may decode to.
pub const MAX_DECODED: u32 = 1 << 31;
/// Tiles, directory blocks and the footer start at multiples of this and are padded to it.
pub const ALIGN: usize = 8;

/// Declares a record: the table of its fields, its size, and the offset of each field.
///
/// A line is `OFFSET_NAME: offset, size, "type", "name";`.
macro_rules! record {
    ($(#[$doc:meta])* $table:ident, $record_size:ident {
        $($field:ident: $offset:literal, $size:literal, $kind:literal, $name:literal;)*
    }) => {
        $(#[$doc])*
        pub const $table: &[Field] = &[$(Field {
            offset: $offset,
            size: $size,
            kind: $kind,
            name: $name,
        }),*];
        #[doc = concat!("Bytes in a record of [`", stringify!($table), "`].")]
        pub const $record_size: usize = record_size($table);
        $(#[doc = concat!("Offset of `", $name, "`.")] pub const $field: usize = $offset;)*
    };
}

record! {
    /// The file header.
    HEADER, HEADER_SIZE {
        HEADER_MAGIC: 0, 8, "u8[8]", "magic";
        HEADER_VERSION: 8, 2, "u16", "version";
        HEADER_LENGTH: 10, 2, "u16", "header_size";
        HEADER_RESERVED: 12, 48, "u8[48]", "reserved";
        HEADER_CRC: 60, 4, "u32", "header_crc";
    }
}

record! {
    /// The trailer, the last bytes of the file.
    TRAILER, TRAILER_SIZE {
        TRAILER_LENGTH: 0, 8, "u64", "file_length";
        TRAILER_DIRECTORY: 8, 8, "u64", "directory_offset";
        TRAILER_FOOTER: 16, 8, "u64", "footer_offset";
        TRAILER_FOOTER_SIZE: 24, 8, "u64", "footer_size";
        TRAILER_FOOTER_CRC: 32, 4, "u32", "footer_crc";
        TRAILER_VERSION: 36, 2, "u16", "version";
        TRAILER_RESERVED: 38, 14, "u8[14]", "reserved";
        TRAILER_COMMIT: 52, 8, "u8[8]", "commit_mark";
        TRAILER_CRC: 60, 4, "u32", "trailer_crc";
    }
}

record! {
    /// The fixed start of the footer.
    FOOTER, FOOTER_SIZE {
        FOOTER_REQUIRED: 0, 8, "u64", "required_features";
        FOOTER_OPTIONAL: 8, 8, "u64", "optional_features";
        FOOTER_MAPS: 16, 4, "u32", "map_count";
        FOOTER_GROUPS: 20, 4, "u32", "group_count";
        FOOTER_ATTRIBUTES: 24, 4, "u32", "attribute_count";
        FOOTER_RESERVED: 28, 4, "u8[4]", "reserved";
    }
}

record! {
    /// The fixed part of a map record, which follows the name of the map.
    MAP, MAP_SIZE {
        MAP_WIDTH: 0, 4, "u32", "width";
        MAP_HEIGHT: 4, 4, "u32", "height";
        MAP_CHANNELS: 8, 1, "u8", "channels";
        MAP_TILE: 9, 1, "u8", "tile_log2";
        MAP_LEVELS: 10, 1, "u8", "level_count";
        MAP_DEPTH: 11, 1, "u8", "depth_kind";
        MAP_INTERPRETATION: 12, 1, "u8", "interpretation";
        MAP_CAMERA: 13, 1, "u8", "camera_flags";
        MAP_RESERVED: 14, 2, "u8[2]", "reserved";
        MAP_UNIT: 16, 8, "f64", "depth_unit";
        MAP_ORIGIN: 24, 8, "i32[2]", "data_origin";
        MAP_DISPLAY: 32, 16, "i32[4]", "display_window";
        MAP_ATTRIBUTES: 48, 4, "u32", "attribute_count";
    }
}

record! {
    /// The fixed start of a level record.
    LEVEL, LEVEL_SIZE {
        LEVEL_ERROR: 0, 8, "f64", "max_error";
        LEVEL_VERTICES: 8, 8, "u64", "vertices";
        LEVEL_BYTES: 16, 8, "u64", "payload_bytes";
    }
}

record! {
    /// A reference to one block of the tile directory.
    BLOCK, BLOCK_SIZE {
        BLOCK_OFFSET: 0, 8, "u64", "offset";
        BLOCK_STORED: 8, 4, "u32", "stored_size";
        BLOCK_CRC: 12, 4, "u32", "block_crc";
        BLOCK_CODEC: 16, 1, "u8", "codec";
        BLOCK_PADDING: 17, 1, "u8", "padding";
        BLOCK_RESERVED: 18, 6, "u8[6]", "reserved";
    }
}

record! {
    /// One entry of the tile directory.
    ENTRY, ENTRY_SIZE {
        ENTRY_OFFSET: 0, 8, "u64", "offset";
        ENTRY_STORED: 8, 4, "u32", "stored_size";
        ENTRY_DECODED: 12, 4, "u32", "decoded_size";
        ENTRY_VERTICES: 16, 4, "u32", "vertices";
        ENTRY_CRC: 20, 4, "u32", "tile_crc";
        ENTRY_Z_MIN: 24, 4, "f32", "z_min";
        ENTRY_Z_MAX: 28, 4, "f32", "z_max";
        ENTRY_END_MIN: 32, 4, "f32", "end_min";
        ENTRY_END_MAX: 36, 4, "f32", "end_max";
        ENTRY_KIND: 40, 1, "u8", "kind";
        ENTRY_CODEC: 41, 1, "u8", "codec";
        ENTRY_TRANSFORM: 42, 1, "u8", "transform";
        ENTRY_PADDING: 43, 1, "u8", "padding";
        ENTRY_LATTICE: 44, 2, "u16", "lattice";
        ENTRY_FLAGS: 46, 2, "u16", "flags";
    }
}
