//! Every mode of every program stays within its budget, over hostile files and all test vectors.
//!
//! The system limits the address space of the programs: an allocation beyond it ends them with a
//! signal.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[path = "../../../tests/vectors_support/attacks.rs"]
mod attacks;

/// The budget in MiB, what may be needed besides, and the address space of code, stacks and files.
const BUDGET: u64 = 64;
const BESIDES: u64 = 64;
const EMPTY: u64 = 80;

/// The arguments of every mode. IN is the file, and OUT a path without its extension.
const MODES: &[&str] = &[
    "dsm-info IN",
    "dsm-info IN --json -a",
    "dsm-info IN --stats",
    "dsm-info IN --tiles",
    "dsm-info IN --tiles --json",
    "dsm-info IN --pixel 0,0",
    "dsm-info IN --pixel 0,0 --json",
    "dsm-info IN --plot 0,0",
    "dsm-info IN --lookup 0.5,0.5,1",
    "dsm-info IN --verify",
    "dsm-info IN --hash",
    "dsm-info IN --compare IN",
    "dsm-convert IN OUT.dsm",
    "dsm-convert IN OUT.dsm -z none",
    "dsm-convert IN OUT.dsm --tile 16 --map 0",
    "dsm-convert IN OUT.dsm --remip",
    "dsm-convert IN OUT.dsm --tolerance 0.5",
    "dsm-convert IN OUT.exr",
    "dsm-convert IN OUT.exr --tiled",
    "dsm-convert IN OUT.exr --opacity",
    "dsm-convert IN OUT.png --count",
    "dsm-convert IN OUT.png --depth 1",
    "dsm-convert IN OUT.png --depth 1 --width 3",
    "dsm-convert IN OUT.npz",
    "dsm-join stitch IN OUT.dsm",
    "dsm-join merge IN IN OUT.dsm",
    "dsm-join collect IN OUT.dsm",
];

/// Runs a mode. Fails if the program is ended by a signal or takes too long. Returns its exit code.
fn run(mode: &str, file: &Path, seconds: u64) -> i32 {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let words: Vec<String> = mode
        .replace("IN", file.to_str().unwrap())
        .replace("OUT", out.to_str().unwrap())
        .split(' ')
        .map(str::to_owned)
        .collect();
    let program = assert_cmd::cargo::cargo_bin(&words[0]);
    let space = (BUDGET + BESIDES + EMPTY) << 10;
    let mut child = Command::new("sh")
        .arg("-c")
        .arg(format!("ulimit -v {space}; exec \"$@\""))
        .arg("sh")
        .arg(program)
        .args(&words[1..])
        .args(["-j", "2", "--memory", &BUDGET.to_string()])
        .env("MALLOC_ARENA_MAX", "1")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            let code = status.code().unwrap_or(-1);
            assert!(
                (0..=1).contains(&code),
                "{mode}, {}: {status}",
                file.display()
            );
            return code;
        }
        let late = start.elapsed() > Duration::from_secs(seconds);
        if late {
            let _ = child.kill();
        }
        assert!(!late, "{mode}, {}: over {seconds} s", file.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
#[ignore = "takes many minutes; tests/attacks.rs checks the library within the same budget"]
fn every_mode_stays_within_the_budget_for_every_hostile_file() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        ("shared", attacks::shared_row(1024)),
        ("constants", attacks::constant(1 << 13, 256)),
        ("plane", attacks::constant(1 << 13, 1 << 20)),
        ("function", attacks::huge_function(1 << 20)),
        ("tile", attacks::huge_function(1 << 22)),
        ("empty", attacks::empty(1 << 9)),
        ("maps", attacks::many_maps(1 << 12)),
        ("broken", attacks::broken(1 << 10)),
    ];
    for (name, bytes) in files {
        let path = folder.path().join(format!("{name}.dsm"));
        std::fs::write(&path, bytes).unwrap();
        for mode in MODES {
            let start = Instant::now();
            let code = run(mode, &path, 300);
            println!("{name:10} {mode:45} {code} {:?}", start.elapsed());
        }
    }
}

#[test]
fn every_mode_stays_within_the_budget_for_every_vector() {
    let folder = |name| Path::new("../../spec/vectors").join(name);
    let mut files: Vec<PathBuf> = Vec::new();
    for name in ["valid", "invalid"] {
        let entries = std::fs::read_dir(folder(name)).unwrap();
        let paths = entries.map(|e| e.unwrap().path());
        files.extend(paths.filter(|p| p.extension().is_some_and(|e| e == "dsm")));
    }
    assert!(files.len() > 100, "{} vectors", files.len());
    files.sort();
    for file in files {
        for mode in MODES {
            run(mode, &file, 60);
        }
    }
}
