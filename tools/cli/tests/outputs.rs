//! Where the programs write to: standard output and error that are closed or full, links, pipes,
//! and names from files that a terminal would obey.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use deepshadow::*;
use deepshadow_frame::output::is_control;

use crate::convert_support::{Look, image};

/// A folder with the files `in.exr` and `in.dsm`.
struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let files = Files { folder };
        image(&files.at("in.exr"), Look::default());
        let made = files.program("dsm-convert", &["in.exr", "in.dsm"]).output();
        assert!(made.unwrap().status.success());
        files
    }

    /// A program that runs in the folder of the files.
    fn program(&self, name: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin(name));
        command.args(arguments).current_dir(self.folder.path());
        command
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// Every kind of output, and the arguments that make it.
const OUTPUTS: [(&str, &[&str]); 9] = [
    ("dsm-convert", &["in.exr", "out.dsm"]),
    ("dsm-convert", &["in.dsm", "out.dsm", "-z", "none"]),
    ("dsm-convert", &["in.dsm", "out.exr", "--float"]),
    ("dsm-convert", &["in.dsm", "out.exr", "--opacity"]),
    ("dsm-convert", &["in.dsm", "out.png", "--opacity"]),
    ("dsm-convert", &["in.dsm", "out.npz"]),
    ("dsm-join", &["stitch", "in.dsm", "out.dsm"]),
    ("dsm-join", &["collect", "in.dsm", "out.dsm"]),
    ("dsm-info", &["in.dsm", "--plot", "3,3", "-o", "out.svg"]),
];

fn output_of(arguments: &[&str]) -> String {
    let out = arguments.iter().find(|a| a.starts_with("out."));
    (*out.unwrap()).into()
}

fn error(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[test]
fn a_link_stays_and_its_target_is_replaced() {
    let files = Files::new();
    for (program, arguments) in OUTPUTS {
        let name = output_of(arguments);
        let plain = files.program(program, arguments).output().unwrap();
        assert!(plain.status.success(), "{arguments:?}: {}", error(&plain));
        let whole = fs::read(files.at(&name)).unwrap();
        fs::remove_file(files.at(&name)).unwrap();
        fs::write(files.at("target"), "old").unwrap();
        std::os::unix::fs::symlink("target", files.at(&name)).unwrap();
        let linked = files.program(program, arguments).output().unwrap();
        assert!(linked.status.success(), "{arguments:?}: {}", error(&linked));
        assert!(fs::symlink_metadata(files.at(&name)).unwrap().is_symlink());
        assert_eq!(
            fs::read(files.at("target")).unwrap(),
            whole,
            "{arguments:?}"
        );
        fs::remove_file(files.at(&name)).unwrap();
    }
}

#[test]
fn a_pipe_a_device_and_a_folder_are_refused() {
    let files = Files::new();
    for (program, arguments) in OUTPUTS {
        let name = output_of(arguments);
        let out = files.at(&name);
        for what in ["a device, a pipe", "a device, a pipe", "a folder"] {
            // dsm-convert writes into a folder.
            if what == "a folder" && program == "dsm-convert" {
                continue;
            }
            match (what, out.exists()) {
                ("a folder", _) => fs::create_dir(&out).unwrap(),
                (_, true) => unreachable!("it was removed"),
                _ => {
                    let made = Command::new("mkfifo").arg(&out).status().unwrap();
                    assert!(made.success());
                }
            }
            let refused = files.program(program, arguments).output().unwrap();
            let line = error(&refused);
            assert_eq!(refused.status.code(), Some(1), "{arguments:?}: {line}");
            assert_eq!(line.lines().count(), 1, "{line}");
            assert!(line.contains(what) && line.contains(&name), "{line}");
            match what {
                "a folder" => fs::remove_dir(&out).unwrap(),
                _ => fs::remove_file(&out).unwrap(),
            }
        }
    }
}

#[test]
fn a_missing_folder_is_an_error_that_names_the_output() {
    let files = Files::new();
    for (program, arguments) in OUTPUTS {
        let name = output_of(arguments);
        let missing = format!("missing/{name}");
        let arguments: Vec<&str> = arguments
            .iter()
            .map(|a| if *a == name { &missing } else { *a })
            .collect();
        let failed = files.program(program, &arguments).output().unwrap();
        let line = error(&failed);
        assert_eq!(failed.status.code(), Some(1), "{arguments:?}: {line}");
        assert!(line.contains(&missing) && !line.contains(".part"), "{line}");
    }
}

/// Commands that print, and the file that they write.
const PRINTING: [(&str, &[&str], &str); 8] = [
    ("dsm-info", &["in.dsm"], ""),
    ("dsm-info", &["in.dsm", "--json", "--tiles"], ""),
    ("dsm-info", &["in.dsm", "--plot", "3,3"], ""),
    ("dsm-info", &["--help"], ""),
    ("dsm-convert", &["--version"], ""),
    (
        "dsm-convert",
        &["in.exr", "out.dsm", "--runstats"],
        "out.dsm",
    ),
    ("dsm-convert", &["in.dsm", "out.png", "--count"], "out.png"),
    (
        "dsm-join",
        &["merge", "in.dsm", "in.dsm", "out.dsm", "--runstats"],
        "out.dsm",
    ),
];

#[test]
fn a_full_standard_output_is_an_error_and_the_work_is_not_lost() {
    let files = Files::new();
    for (program, arguments, output) in PRINTING {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let mut command = files.program(program, arguments);
        let ended = command.stdout(full).output().unwrap();
        let line = error(&ended);
        assert_eq!(ended.status.code(), Some(1), "{arguments:?}: {line}");
        // dsm-join adds a note on the error of a merge.
        let failures = line.matches("cannot write to standard output").count();
        assert_eq!(failures, 1, "{line}");
        if !output.is_empty() {
            fs::remove_file(files.at(output)).expect(output);
        }
    }
}

#[test]
fn a_closed_standard_output_ends_a_program_quietly_and_the_work_is_not_lost() {
    let files = Files::new();
    for (program, arguments, output) in PRINTING {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = files.program(program, arguments);
        let ended = command.arg("-q").stdout(writer).output().unwrap();
        assert_eq!(error(&ended), "", "{arguments:?}");
        assert_eq!(ended.status.code(), Some(0), "{arguments:?}");
        if !output.is_empty() {
            fs::remove_file(files.at(output)).expect(output);
        }
    }
    let closed = Command::new("sh")
        .arg("-c")
        .arg("\"$0\" in.dsm >&- && \"$1\" in.exr out.dsm -v --runstats >&- 2>&-")
        .args(["dsm-info", "dsm-convert"].map(assert_cmd::cargo::cargo_bin))
        .current_dir(files.folder.path())
        .status();
    assert_eq!(closed.unwrap().code(), Some(0));
    DsmFile::open(files.at("out.dsm")).unwrap();
}

#[test]
fn a_closed_or_full_standard_error_stops_nothing() {
    let files = Files::new();
    for full in [true, false] {
        let stderr = || match full {
            true => Stdio::from(File::options().write(true).open("/dev/full").unwrap()),
            false => Stdio::from(std::io::pipe().unwrap().1),
        };
        let run = |arguments: &[&str]| {
            let mut command = files.program("dsm-convert", arguments);
            command.stderr(stderr()).status().unwrap().code()
        };
        assert_eq!(run(&["in.exr", "out.dsm", "-v", "--runstats"]), Some(0));
        fs::remove_file(files.at("out.dsm")).unwrap();
        assert_eq!(run(&["missing.exr", "out.dsm"]), Some(1));
        assert_eq!(run(&["in.exr", "out.dsm", "--nonsense"]), Some(2));
    }
}

/// Text that clears the screen with C1 codes and turns itself around.
const HOSTILE: &str = "a\u{9b}2J\u{85}\u{202e}b\u{2066}";

fn hostile(path: &Path, name: &str) {
    let mut writer = Writer::create(path).unwrap();
    let mut header = MapHeader::new(format!("{HOSTILE}{name}"), 16, 16).tile_size(8);
    for value in [HOSTILE.into(), Attribute::Numbers(vec![1.0])] {
        let name = format!("{HOSTILE}{}", header.attributes.len());
        header = header.attribute(name, value);
    }
    let opaque = Attribute::Opaque {
        type_name: HOSTILE.into(),
        bytes: vec![1, 2],
    };
    let encoding = Encoding::new(0.01);
    let map = writer
        .add_map(header.attribute("opaque", opaque), encoding)
        .unwrap();
    let curve = Curve::mono(vec![1.0], vec![0.5]).unwrap();
    writer.pixel(map, Pixel::new(3, 3), &curve).unwrap();
    writer.add_attribute(HOSTILE, HOSTILE);
    writer.add_group(Group::new(HOSTILE, GroupRole::Clusters, vec![map]));
    writer.finish().unwrap();
}

#[test]
fn text_of_a_file_never_reaches_a_terminal_raw() {
    let files = Files::new();
    hostile(&files.at("evil.dsm"), "");
    hostile(&files.at("other.dsm"), "other");
    let name: &str = &format!("{HOSTILE}.dsm");
    fs::copy(files.at("evil.dsm"), files.at(name)).unwrap();
    let mut kept = 0;
    for (program, arguments) in [
        ("dsm-info", &["evil.dsm"][..]),
        ("dsm-info", &["evil.dsm", "-a", "--tiles", "--stats"]),
        (
            "dsm-info",
            &["evil.dsm", "--json", "-a", "--stats", "--tiles"],
        ),
        (
            "dsm-info",
            &["evil.dsm", "--json", "--pixel", "3,3", "--hash"],
        ),
        (
            "dsm-info",
            &["evil.dsm", "--lookup", "3.5,3.5,2", "--pixel", "3,3"],
        ),
        ("dsm-info", &["evil.dsm", "--plot", "3,3"]),
        ("dsm-info", &["evil.dsm", "--compare", "other.dsm"]),
        (
            "dsm-info",
            &["evil.dsm", "--compare", "other.dsm", "--json"],
        ),
        ("dsm-info", &["evil.dsm", "--against", "in.exr"]),
        (
            "dsm-info",
            &["evil.dsm", "--map", HOSTILE, "--level", "9", "--stats"],
        ),
        ("dsm-info", &[name, "--hash"]),
        ("dsm-info", &[name, "--verify", "-v"]),
        ("dsm-info", &[HOSTILE]),
        ("dsm-convert", &["evil.dsm", "out.dsm", "--runstats", "-v"]),
        ("dsm-convert", &["evil.dsm", "out.exr", "--float", "-v"]),
        (
            "dsm-convert",
            &["evil.dsm", "out.dsm", "--region", "0,0,99,99"],
        ),
        ("dsm-convert", &["evil.dsm", "out.dsm", "--map", "none"]),
        ("dsm-convert", &["evil.dsm", "out.png", "--count"]),
        ("dsm-join", &["stitch", "evil.dsm", "other.dsm", "out.dsm"]),
        ("dsm-join", &["stitch", "evil.dsm", "evil.dsm", "out.dsm"]),
        (
            "dsm-join",
            &[
                "merge",
                "evil.dsm",
                "evil.dsm",
                "out.dsm",
                "--tolerance",
                "0.001",
            ],
        ),
        ("dsm-join", &["collect", "evil.dsm", "evil.dsm", "out.dsm"]),
        (
            "dsm-join",
            &[
                "collect",
                "evil.dsm",
                "other.dsm",
                "out.dsm",
                "-v",
                "--runstats",
            ],
        ),
    ] {
        let ended = files.program(program, arguments).output().unwrap();
        assert!(
            ended.status.code().is_some_and(|code| code < 3),
            "{ended:?}"
        );
        for text in [&ended.stdout, &ended.stderr] {
            let text = std::str::from_utf8(text).unwrap();
            let raw = text.chars().find(|c| is_control(*c) && *c != '\n');
            assert_eq!(raw, None, "{program} {arguments:?}: {text:?}");
            kept += usize::from(text.contains("202e"));
        }
        if arguments.contains(&"--json") {
            let json: serde_json::Value = serde_json::from_slice(&ended.stdout).unwrap();
            assert_eq!(json["maps"][0]["name"], HOSTILE, "{json}");
        }
    }
    assert!(kept >= 15, "only {kept} texts show an escape");
}
