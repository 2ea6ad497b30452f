//! The conformance vectors in `spec/vectors`: reads the valid ones, and refuses each invalid one by
//! the rule in its name.
//!
//! `BLESS=1 cargo test --test all vectors::` rewrites them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::vectors_support::{invalid, text, valid};
use deepshadow::*;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("spec/vectors")
        .join(name)
}

/// Compares these files with a folder of vectors, or rewrites the folder.
fn check_folder(name: &str, files: BTreeMap<String, Vec<u8>>, pinned: impl Fn(&str) -> bool) {
    let folder = folder(name);
    if std::env::var_os("BLESS").is_some() {
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        for (file, bytes) in &files {
            std::fs::write(folder.join(file), bytes).unwrap();
        }
    }
    let there: BTreeSet<String> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    assert_eq!(
        there,
        files.keys().cloned().collect(),
        "files in {}",
        folder.display()
    );
    for (file, bytes) in &files {
        if pinned(file) {
            assert!(
                std::fs::read(folder.join(file)).unwrap() == *bytes,
                "the bytes of {name}/{file} have changed"
            );
        }
    }
}

#[test]
fn the_bytes_and_values_of_the_vectors_have_not_changed() {
    let vectors = valid::all();
    let golden: BTreeSet<String> = vectors
        .iter()
        .filter(|v| v.golden)
        .map(|v| format!("{}.dsm", v.name))
        .collect();
    let mut files = BTreeMap::new();
    for v in vectors {
        files.insert(
            format!("{}.txt", v.name),
            text::dump(&v.bytes)
                .unwrap_or_else(|e| panic!("{}: {e}", v.name))
                .into_bytes(),
        );
        let double = files.insert(format!("{}.dsm", v.name), v.bytes);
        assert!(double.is_none(), "two vectors have the name {}", v.name);
    }
    let lookups = valid::lookups().into_bytes();
    files.insert("at-steps.lookups".into(), lookups);
    // The bytes of lz4 and zstd may change with their libraries; the decoded values may not.
    check_folder("valid", files, |file| {
        !file.ends_with(".dsm") || golden.contains(file)
    });
    let broken = invalid::all();
    let count = broken.len();
    let files: BTreeMap<_, _> = broken
        .into_iter()
        .map(|(name, bytes)| (format!("{name}.dsm"), bytes))
        .collect();
    assert_eq!(files.len(), count, "two vectors have the same name");
    // Its directory has the codec lz4.
    check_folder("invalid", files, |file| file != "MAP-SIZE-large.dsm");
}

/// Names and bytes of the vectors in a folder.
fn files(name: &str) -> Vec<(String, Vec<u8>)> {
    let mut out: Vec<_> = std::fs::read_dir(folder(name))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "dsm"))
        .map(|p| {
            (
                p.file_stem().unwrap().to_str().unwrap().to_owned(),
                std::fs::read(&p).unwrap(),
            )
        })
        .collect();
    out.sort();
    assert!(!out.is_empty());
    out
}

#[test]
fn every_valid_file_holds_the_values_in_its_text() {
    for (name, bytes) in files("valid") {
        let text = std::fs::read_to_string(folder("valid").join(format!("{name}.txt"))).unwrap();
        let file = DsmFile::from_bytes(bytes.clone()).unwrap_or_else(|e| panic!("{name}: {e}"));
        file.verify(|_, _| true)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(text::dump(&bytes).unwrap(), text, "{name}");
    }
}

#[test]
fn lookups_at_steps_give_the_listed_values() {
    let path = folder("valid").join("at-steps.dsm");
    let file = DsmFile::open(path).unwrap();
    let list = std::fs::read_to_string(folder("valid").join("at-steps.lookups")).unwrap();
    let mut seen = BTreeSet::new();
    for line in list.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let [pixel, z, at, behind] = words[..] else {
            panic!("{line}");
        };
        let (x, y) = pixel.split_once(',').unwrap();
        let pixel = Pixel::new(x.parse().unwrap(), y.parse().unwrap());
        let f = file.function(MapId(0).level(0), pixel).unwrap();
        let z: f32 = z.parse().unwrap();
        let values = [f.visibility_rgb(z), f.visibility_behind_rgb(z)];
        for (text, value) in [at, behind].into_iter().zip(values) {
            let listed: Vec<f32> = text.split(',').map(|v| v.parse().unwrap()).collect();
            assert_eq!(listed, value[..f.channels()], "{line}");
        }
        seen.insert(line);
    }
    // By hand: in front of the step, at it, just behind it, and one float behind it.
    for line in [
        "0,0 1.9999999 0.75 0.75",
        "0,0 2 0.75 0.25",
        "1,0 2 1 0.5",
        "1,0 2.0000002 0.5 0.5",
        "2,0 2.0000002 0.5 0.25",
        "3,0 0 1 0.5",
        "3,0 1e-45 0.5 0.25",
        "4,0 2 0.75,1,0.5 0.75,0.25,0.5",
    ] {
        assert!(seen.contains(line), "{line} is not in the list");
    }
}

#[test]
fn every_invalid_file_breaks_the_rule_in_its_name() {
    let mut wrong = Vec::new();
    for (name, bytes) in files("invalid") {
        let error = match DsmFile::from_bytes(bytes).and_then(|file| file.verify(|_, _| true)) {
            Err(error) => error,
            Ok(_) => {
                wrong.push(format!("{name} is not refused"));
                continue;
            }
        };
        let right = match error.rule() {
            _ if name.starts_with("unsupported-") => error.kind() == ErrorKind::Unsupported,
            Some(rule) => error.kind() == ErrorKind::Corrupt && breaks_rule(&name, rule),
            None => false,
        };
        if !right {
            wrong.push(format!("{name}: {error}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Whether a vector of this name breaks `rule`.
///
/// The name is the rule, or the rule and a variant in lower case.
fn breaks_rule(name: &str, rule: &str) -> bool {
    let variant = |rest: &str| {
        rest.is_empty()
            || rest
                .strip_prefix('-')
                .is_some_and(|v| v.starts_with(|c: char| c.is_ascii_lowercase()))
    };
    name.strip_prefix(rule).is_some_and(variant)
}

/// The ids of rules in a text: two or more words in capitals, joined by hyphens, in backticks.
fn rule_ids(text: &str) -> BTreeSet<&str> {
    text.split('`')
        .skip(1)
        .step_by(2)
        .filter(|word| {
            let parts: Vec<&str> = word.split('-').collect();
            parts.len() >= 2
                && parts
                    .iter()
                    .all(|p| p.len() >= 3 && p.chars().all(|c| c.is_ascii_uppercase()))
        })
        .filter(|&word| word != "DSM-END")
        .collect()
}

#[test]
fn every_rule_has_an_invalid_file_and_a_row_in_the_table_and_is_in_the_code() {
    let format = include_str!("../spec/format.md");
    let semantics = include_str!("../spec/semantics.md");
    let (text, table) = format.split_once("## 12. Rules").expect("section 12");
    let rules: BTreeSet<&str> = rule_ids(text)
        .union(&rule_ids(semantics))
        .copied()
        .collect();
    let listed: Vec<&str> = table
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split('`').next())
        .collect();
    let set: BTreeSet<&str> = listed.iter().copied().collect();
    assert_eq!(set.len(), listed.len(), "section 12 lists a rule twice");
    assert_eq!(set, rules, "the rules of section 12 and of the text");
    let names = files("invalid");
    for rule in &rules {
        assert!(
            names.iter().any(|(name, _)| breaks_rule(name, rule)),
            "no file breaks {rule}"
        );
    }
    // The code names the rules of the text and no others.
    let mut source = String::new();
    for file in [
        "src/format/codec.rs",
        "src/format/directory.rs",
        "src/format/footer.rs",
        "src/format/header.rs",
        "src/format/laws.rs",
        "src/format/tile/decode.rs",
        "src/format/transform.rs",
        "src/io/file.rs",
        "src/io/verify.rs",
        "src/map/header.rs",
        "src/map/kinds.rs",
        "src/function/view.rs",
    ] {
        let text =
            std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
        source.push_str(text.split("#[cfg(test)]").next().unwrap());
    }
    let quoted = source.replace('"', "`");
    let known = rule_ids(&quoted);
    for rule in &rules {
        assert!(
            source.contains(&format!("\"{rule}\"")),
            "the code does not name {rule}"
        );
    }
    for id in known.iter().filter(|id| !id.starts_with("DSM-")) {
        assert!(
            rules.contains(id),
            "the code names {id}, the specification does not"
        );
    }
}
