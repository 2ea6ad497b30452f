//! The names of the library: those at its root, and those of its enums.

use std::collections::BTreeSet;
use std::fmt::{Debug, Display};
use std::fs;
use std::path::Path;
use std::str::FromStr;

use deepshadow::raw::directory::TileKind;
use deepshadow::*;

/// Every name at the root of the crate. A change of this list is a decision, not an accident.
const ROOT: &[&str] = &[
    "Attribute",
    "Batch",
    "Border",
    "CacheStats",
    "CachedFile",
    "Camera",
    "Codec",
    "Compressor",
    "Cursor",
    "Curve",
    "DeepSample",
    "DepthKind",
    "Deviation",
    "DsmFile",
    "Encoding",
    "Error",
    "ErrorKind",
    "Filter",
    "Footprint",
    "FunctionRef",
    "Group",
    "GroupRole",
    "GroupSampler",
    "Interpretation",
    "LevelChoice",
    "LevelId",
    "LevelInfo",
    "LightSpace",
    "Limits",
    "MapHeader",
    "MapId",
    "MapInfo",
    "Merge",
    "Mips",
    "OnError",
    "Pixel",
    "Pixels",
    "Place",
    "Precision",
    "Progress",
    "Query",
    "Ray",
    "ReadAt",
    "Report",
    "Result",
    "Sampler",
    "SamplerOptions",
    "Stitch",
    "Summary",
    "Sweep",
    "Tap",
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

/// Public names of the root: re-exports and modules.
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
fn the_root_has_these_names_and_no_others() {
    let wanted = ROOT.iter().map(|n| n.to_string()).collect();
    assert_eq!(root(), wanted, "the list in tests/names.rs");
    println!("{} names", ROOT.len());
}

fn all_have_names<T>(all: &[T])
where
    T: Copy + Debug + Display + FromStr<Err = Error> + PartialEq,
{
    assert!(all.len() > 1);
    let mut seen = BTreeSet::new();
    for value in all {
        let name = value.to_string();
        assert_eq!(name.parse::<T>().unwrap(), *value, "{name}");
        assert!(seen.insert(name.clone()), "{name} stands for two values");
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
fn every_enum_is_read_by_the_name_that_it_is_written_with() {
    all_have_names(Border::ALL);
    all_have_names(Codec::ALL);
    all_have_names(Compressor::ALL);
    all_have_names(DepthKind::ALL);
    all_have_names(Filter::ALL);
    all_have_names(GroupRole::ALL);
    all_have_names(Interpretation::ALL);
    all_have_names(LevelChoice::ALL);
    all_have_names(Mips::ALL);
    all_have_names(OnError::ALL);
    all_have_names(TileKind::ALL);
}

#[test]
fn a_codec_is_written_with_its_level() {
    assert_eq!(Codec::Zstd(19).to_string(), "zstd:19");
    assert_eq!("zstd:19".parse::<Codec>().unwrap(), Codec::Zstd(19));
    assert_eq!("zstd".parse::<Codec>().unwrap(), Codec::Zstd(3));
    assert_eq!("ray".parse::<DepthKind>().unwrap(), DepthKind::RayDistance);
}
