//! Files whose bytes were changed.

use deepshadow::{DsmFile, MapId, TileId};
use serde_json::Value;

use super::files::{Fixture, info, rich, run};

/// The rule that `--verify` names after `change`.
fn rule_after(f: &Fixture, change: impl FnOnce(&mut Vec<u8>)) -> (i32, String, String) {
    let mut bytes = std::fs::read(&f.path).unwrap();
    change(&mut bytes);
    let bad = f.beside("bad.dsm");
    std::fs::write(&bad, bytes).unwrap();
    let result = run(info().arg("--verify").arg(&bad));
    assert!(
        result
            .2
            .starts_with(&format!("dsm-info: {}: ", bad.display())),
        "{}",
        result.2
    );
    result
}

#[test]
fn every_kind_of_damage_is_called_by_its_rule() {
    let f = rich();
    let file = DsmFile::open(&f.path).unwrap();
    let tile = (0..6).map(|i| {
        file.entry(MapId(0).level(0), TileId::new(i % 3, i / 3))
            .unwrap()
    });
    let tile = tile.map(|e| e.offset).find(|&o| o > 0).unwrap() as usize;
    let n = file.length() as usize;
    let footer = u64::from_le_bytes(
        std::fs::read(&f.path).unwrap()[n - 48..n - 40]
            .try_into()
            .unwrap(),
    );
    for (at, rule) in [
        (tile, "TILE-CRC"),
        (20, "HEADER-CRC"),
        (footer as usize - 1, "BLOCK-CRC"),
        (footer as usize + 3, "FOOTER-CRC"),
        (n - 20, "TRAILER-CRC"),
        (n - 10, "TRAILER-COMMIT"),
    ] {
        let (code, stdout, stderr) = rule_after(&f, |b| b[at] ^= 4);
        assert_eq!((code, stdout.as_str()), (1, ""), "{rule}");
        assert!(stderr.contains(&format!("rule {rule}")), "{rule}: {stderr}");
    }
    let (_, _, stderr) = rule_after(&f, |b| b.truncate(n - 1));
    assert!(stderr.contains("TRAILER-COMMIT"), "{stderr}");
    let (_, _, stderr) = rule_after(&f, |b| b.truncate(100));
    assert!(stderr.contains("FILE-SHORT"), "{stderr}");
}

#[test]
fn any_flipped_byte_is_found() {
    let f = rich();
    let n = std::fs::metadata(&f.path).unwrap().len() as usize;
    for at in (0..n).step_by(n / 40) {
        let (code, ..) = rule_after(&f, |b| b[at] ^= 0x10);
        assert_eq!(code, 1, "byte {at}");
    }
}

#[test]
fn json_carries_the_rule_of_what_failed() {
    let f = rich();
    let file = DsmFile::open(&f.path).unwrap();
    let tile = (0..6).map(|i| {
        file.entry(MapId(0).level(0), TileId::new(i % 3, i / 3))
            .unwrap()
    });
    let tile = tile.map(|e| e.offset).find(|&o| o > 0).unwrap() as usize;
    let mut bytes = std::fs::read(&f.path).unwrap();
    bytes[tile] ^= 1;
    std::fs::write(&f.path, bytes).unwrap();
    let (code, stdout, stderr) = run(info().args(["--json", "--verify"]).arg(&f.path));
    let j: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(code, 1);
    assert_eq!(j["verify"]["ok"], false);
    assert_eq!(j["verify"]["rule"], "TILE-CRC");
    assert!(stderr.contains(j["error"].as_str().unwrap()), "{stderr}");
    // What does not touch the tile still works, what does says why not.
    assert_eq!(run(info().arg(&f.path)).0, 0);
    let (code, _, stderr) = run(info().arg("--stats").arg(&f.path));
    assert_eq!(code, 1);
    assert!(stderr.contains("TILE-CRC"), "{stderr}");
}

#[test]
fn a_later_version_is_unsupported_not_damaged() {
    let f = rich();
    let (code, _, stderr) = rule_after(&f, |b| b[8] = 2);
    assert_eq!(code, 1);
    assert!(stderr.contains("unsupported: version 2"), "{stderr}");
}
