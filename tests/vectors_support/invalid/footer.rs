//! Records of the footer: maps, levels, groups and attributes.

use super::*;

pub fn add(add: &mut Add<'_>) {
    let small = small();
    let (f, t, m) = (small.footer(), small.trailer(), small.map());
    let footer = |at: usize, bytes: &[u8]| small.clone().put(f + at, bytes).signed();
    let map = |at: usize, bytes: &[u8]| small.clone().put(m + at, bytes).signed();
    let records = |change: &dyn Fn(&mut Vec<u8>)| small.clone().records(change).signed();
    add("unsupported-feature", footer(0, &[1]));
    add("unsupported-feature-high", footer(7, &[0x80]));
    add("MAP-COUNT", bare(vec![0; 32]).signed());
    add("MAP-COUNT-huge", footer(16, &[1, 0, 1]));
    add("GROUP-COUNT", footer(20, &[1, 0, 1]));
    add("ATTRIBUTE-COUNT", footer(24, &[1, 0, 1]));
    add("ATTRIBUTE-COUNT-of-map", map(48, &[255; 4]));
    add("FOOTER-RESERVED", footer(31, &[1]));
    // The missing bytes are zeros: of a value, of a block reference, of the last name's attribute.
    add(
        "FOOTER-SHORT",
        records(&|f| {
            attribute(f, "a", 200, 15, &[0; 15]);
            f.truncate(f.len() - 8);
        }),
    );
    add("FOOTER-SHORT-block", records(&|f| f.truncate(136)));
    add(
        "FOOTER-SHORT-name",
        records(&|f| {
            attribute(f, "abcde", 0, 0, b"");
            f.truncate(144);
            f[137] = 9;
        }),
    );
    add(
        "FOOTER-SHORT-attribute",
        records(&|f| attribute(f, "a", 0, u32::MAX, b"")),
    );
    let side = (1u32 << 20).to_le_bytes();
    add("FOOTER-SHORT-directory", map(0, &[side, side].concat()));
    add("FOOTER-SHORT-fixed-part", records(&|f| f.truncate(24)));
    add("FOOTER-PADDING", small.clone().put(t - 1, &[1]).signed());
    add("FOOTER-PADDING-too-long", records(&|f| f.extend([0; 8])));

    add("MAP-NAME", footer(34, b"\n"));
    add("MAP-NAME-delete", footer(35, b"\x7f"));
    add("MAP-NAME-utf-8", footer(34, &[0xFF]));
    let renamed = |name: &[u8]| {
        records(&|f| {
            f.truncate(f.len() - 7); // its padding
            let length = (name.len() as u16).to_le_bytes();
            f.splice(32..37, length.into_iter().chain(name.iter().copied()));
            f.resize(f.len().next_multiple_of(8), 0);
        })
    };
    add("MAP-NAME-empty", renamed(b""));
    add("MAP-NAME-long", renamed(&[b'n'; 256]));

    // Maps without pixels and without levels: the records end where they must.
    let record = &small.0[f..m + 52];
    let level = [&0.25f64.to_le_bytes()[..], &[0; 16]].concat();
    let flat = |at: usize| bare([record, &level].concat()).at(|p| p.map() + at, &[0; 4]);
    add("MAP-SIZE", flat(0).signed());
    add("MAP-SIZE-height", flat(4).signed());
    let bare = bare(record.to_vec()).at(|p| p.map() + 10, &[0]);
    add("MAP-LEVELS", bare.signed());
    // Both sizes have 4097 tiles, all empty.
    let wide = header("map", 17 * 256, 241 * 256, 1).tile_size(256);
    let wide = RawLevel {
        max_error: 0.25,
        tiles: vec![(Entry::default(), vec![]); 4097],
        directory: Codec::Lz4,
    }
    .of(wide);
    let large = [(1u32 << 20) + 1, 1].map(u32::to_le_bytes).concat();
    add("MAP-SIZE-large", wide.at(Patch::map, &large).signed());
    let empty = || vec![(Entry::default(), vec![])];
    let four = levels_of(header("map", 5, 2, 1), [empty(), empty(), empty(), empty()]);
    add("MAP-LEVELS-many", four.at(Patch::map, &[3]).signed());

    add("MAP-CHANNELS", map(8, &[2]));
    add("MAP-TILE", map(9, &[2]));
    add("MAP-TILE-large", map(9, &[9]));
    add("MAP-DEPTH", map(11, &[3]));
    add("MAP-INTERPRETATION", map(12, &[3]));
    add("MAP-CAMERA", map(13, &[4]));
    add("MAP-RESERVED", map(15, &[1]));
    let numbers = |add: &mut Add<'_>, rule: &str, at: usize, values: &[(&str, f64)]| {
        for (name, value) in values {
            add(&format!("{rule}{name}"), map(at, &value.to_le_bytes()));
        }
    };
    let (nan, zero) = (("-nan", f64::NAN), ("-minus-zero", -0.0));
    let units = [("", -1.0), ("-infinite", f64::INFINITY), nan, zero];
    numbers(add, "MAP-UNIT", 16, &units);
    numbers(
        add,
        "LEVEL-ERROR",
        52,
        &[("", -0.5), ("-large", 1.5), nan, zero],
    );
    add("MAP-WINDOW", map(40, &(-1i32).to_le_bytes()));
    add("MAP-WINDOW-height", map(44, &(-1i32).to_le_bytes()));
    let mut seen = header("map", 3, 2, 1);
    seen.camera.ndc_from_world = Some([1.0; 16]);
    let last = f64::INFINITY.to_le_bytes();
    let infinite = one(seen, valid::mixed_mono).at(|p| p.map() + 52 + 120, &last);
    add("MAP-CAMERA-infinite", infinite.signed());
    add("LEVEL-VERTICES", small.clone().plus(m + 60, 1).signed());
    add("LEVEL-BYTES", small.clone().plus(m + 68, 8).signed());

    groups(add);
    for (name, kind, value) in [
        ("", 0, &b"\xC0\xAF"[..]),
        ("-integers", 1, &[0; 7]),
        ("-no-integers", 1, &[]),
        ("-numbers", 2, &[0; 12]),
        ("-no-numbers", 2, &[]),
        ("-no-type", 3, &[]),
        ("-half-a-length", 3, &[1]),
        ("-empty-type", 3, &[0, 0, 1]),
        ("-type-too-long", 3, &[9, 0, b't']),
        ("-type-control", 3, &[1, 0, 7]),
        ("-type-utf-8", 3, &[1, 0, 0xFF]),
    ] {
        let bytes = records(&|f| attribute(f, "a", kind, value.len() as u32, value));
        add(&format!("ATTRIBUTE-VALUE{name}"), bytes);
    }
}

impl RawLevel {
    fn of(self, h: MapHeader) -> Patch {
        Patch(RawFile::of(h, vec![self]).assemble())
    }
}

/// Two maps, two groups and two attributes, whose names differ in one letter.
fn groups(add: &mut Add<'_>) {
    let mut two = RawFile::default();
    for name in ["aa", "ab"] {
        let level = RawLevel {
            max_error: 0.0,
            tiles: vec![(Entry::default(), vec![])],
            directory: Codec::None,
        };
        two.maps.push((header(name, 1, 1, 1), vec![level]));
    }
    let group = |name: &str| Group::new(name, GroupRole::Faces, vec![MapId(0), MapId(1)]);
    two.groups = vec![group("ga"), group("gb")];
    two.attributes = vec![("ta".into(), "".into()), ("tb".into(), "".into())];
    let two = Patch(two.assemble());
    let replace = |text: &[u8], at: usize, bytes: &[u8]| {
        let place = two.find(text) + at;
        two.clone().put(place, bytes).signed()
    };
    add("MAP-NAME-twice", replace(b"ab", 1, b"a"));
    add("GROUP-NAME", replace(b"gb", 0, b"\t"));
    add("GROUP-NAME-twice", replace(b"gb", 1, b"a"));
    add("GROUP-ROLE", replace(b"ga", 2, &[0]));
    add("GROUP-ROLE-unknown", replace(b"ga", 2, &[3]));
    add("GROUP-MAPS", replace(b"ga", 7, &[2]));
    add("GROUP-MAPS-twice", replace(b"ga", 7, &[1]));
    add("GROUP-MAPS-huge", replace(b"ga", 3, &[255; 4]));
    let count = two.find(b"ga") + 3 - two.footer();
    let none = two.clone().records(|f| {
        f[count] = 0;
        f.drain(count + 4..count + 12);
    });
    add("GROUP-MAPS-none", none.signed());
    add("ATTRIBUTE-NAME", replace(b"tb", 0, &[0]));
    add("ATTRIBUTE-NAME-twice", replace(b"tb", 1, b"a"));
}
