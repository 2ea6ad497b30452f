//! The public names at the root of the library, and the names of its enums' values.

use std::collections::BTreeSet;
use std::fmt::{Debug, Display};
use std::fs;
use std::path::Path;
use std::str::FromStr;

use deepshadow::raw::directory::TileKind;
use deepshadow::*;

/// Every public name at the root of the crate: a change of the API has to change this list.
const ROOT: &[&str] = &[
    "Attribute",
    "Batch",
    "Border",
    "CachedFile",
    "Camera",
    "Codec",
    "Compressor",
    "Cursor",
    "Curve",
    "DepthKind",
    "DsmFile",
    "Encoding",
    "Error",
    "ErrorKind",
    "Filter",
    "Footprint",
    "FunctionRef",
    "Group",
    "GroupRole",
    "Interpretation",
    "Join",
    "LevelChoice",
    "LevelId",
    "LevelInfo",
    "LightSpace",
    "Limits",
    "MapHeader",
    "MapId",
    "MapInfo",
    "Mips",
    "OnError",
    "Pixel",
    "Pixels",
    "Query",
    "Ray",
    "ReadAt",
    "Result",
    "Sampler",
    "SamplerOptions",
    "Sweep",
    "Tile",
    "TileCache",
    "TileId",
    "Vertex",
    "Visibility",
    "WorldQuery",
    "WorldSampler",
    "Writer",
    "raw",
];

/// The public names in `src/lib.rs`: re-exports and modules.
fn root() -> BTreeSet<String> {
    let lib = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs");
    let lib = fs::read_to_string(lib).unwrap();
    let code = lib.lines().filter(|l| !l.trim_start().starts_with("//"));
    let code = code.collect::<Vec<_>>().join(" ");
    let mut names = BTreeSet::new();
    for item in code.split("pub ").skip(1) {
        let item = item.split(';').next().unwrap();
        let (kind, rest) = item.split_once(' ').unwrap();
        assert!(["use", "mod"].contains(&kind), "pub {item}");
        let list = match rest.split_once('{') {
            Some((_, list)) => list.trim_end_matches([' ', '}']),
            None => rest.rsplit("::").next().unwrap(),
        };
        let list = list.split(',').map(|n| n.trim().to_owned());
        names.extend(list.filter(|n| !n.is_empty()));
    }
    names
}

#[test]
fn the_root_exports_these_names_and_no_others() {
    let wanted = ROOT.iter().map(|n| n.to_string()).collect();
    assert_eq!(root(), wanted, "the list in tests/names.rs");
    println!("{} names", ROOT.len());
}

/// Checks that every value parses from its own name, and that errors list all names.
fn check_names<T>(all: &[T])
where
    T: Copy + Debug + Display + FromStr<Err = Error> + PartialEq,
{
    assert!(all.len() > 1);
    let mut seen = BTreeSet::new();
    for value in all {
        let name = value.to_string();
        assert_eq!(name.parse::<T>().unwrap(), *value, "{name}");
        assert!(seen.insert(name.clone()), "two values have the name {name}");
        assert_eq!(format!("{value:>20}").trim_start(), name);
        assert!(name.to_uppercase().parse::<T>().is_err(), "{name}");
    }
    for wrong in [
        "",
        " ",
        "no such word",
        "zstd:",
        "zstd:0",
        "zstd:23",
        "none:1",
        "\u{1b}[2J",
    ] {
        let error = wrong.parse::<T>().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        let text = error.to_string();
        assert!(!text.contains('\u{1b}'), "{text}");
        for value in all {
            let name = value.to_string();
            let word = name.split(':').next().unwrap();
            assert!(text.contains(word), "{text} does not name {word}");
        }
    }
}

#[test]
fn every_enum_parses_from_its_displayed_name() {
    check_names(Border::ALL);
    check_names(Codec::ALL);
    check_names(Compressor::ALL);
    check_names(DepthKind::ALL);
    check_names(Filter::ALL);
    check_names(GroupRole::ALL);
    check_names(Interpretation::ALL);
    check_names(LevelChoice::ALL);
    check_names(Mips::ALL);
    check_names(OnError::ALL);
    check_names(TileKind::ALL);
}

#[test]
fn the_name_of_a_codec_includes_its_level() {
    assert_eq!(Codec::Zstd(19).to_string(), "zstd:19");
    assert_eq!("zstd:19".parse::<Codec>().unwrap(), Codec::Zstd(19));
    assert_eq!("zstd".parse::<Codec>().unwrap(), Codec::Zstd(3));
    assert_eq!("ray".parse::<DepthKind>().unwrap(), DepthKind::RayDistance);
}
