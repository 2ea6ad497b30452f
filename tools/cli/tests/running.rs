//! Options that every program takes: they mean the same everywhere.

use crate::convert_support::{Look, image, run_program};

const PROGRAMS: [&str; 3] = ["dsm-info", "dsm-convert", "dsm-join"];

#[test]
fn every_program_takes_threads_quiet_and_verbose() {
    for program in PROGRAMS {
        let subcommands = match program {
            "dsm-join" => &["stitch", "merge", "collect"][..],
            _ => &[""],
        };
        for subcommand in subcommands {
            let mut help = vec![*subcommand, "--help"];
            help.retain(|word| !word.is_empty());
            let (code, text, _) = run_program(program, &help);
            assert_eq!(code, 0);
            for option in [
                "-j, --threads <N>",
                "--memory <MIB>",
                "-q, --quiet",
                "-v, --verbose",
                "Running:",
            ] {
                assert!(text.contains(option), "{program} {subcommand}: {text}");
            }
        }
    }
}

#[test]
fn quiet_leaves_only_errors_and_verbose_says_more() {
    let folder = tempfile::tempdir().unwrap();
    let path = |n: &str| folder.path().join(n).to_str().unwrap().to_owned();
    let [exr, dsm, half, out] = ["in.exr", "map.dsm", "half.dsm", "out.dsm"].map(path);
    image(exr.as_ref(), Look::default());
    let said = |program: &str, arguments: &[&str], more: &str| {
        let arguments: Vec<_> = arguments.iter().copied().chain([more]).collect();
        let (code, _, err) = run_program(program, &arguments);
        assert_eq!(code, 0, "{err}");
        assert!(
            err.lines().all(|l| l.starts_with(&format!("{program}: "))),
            "{err}"
        );
        err
    };
    let convert = |from: &str, to: &str, more: &str| {
        said("dsm-convert", &[from, to, "--tile", "8", "-j", "2"], more)
    };
    assert!(convert(&exr, &dsm, "-v").contains("channels A Z"));
    assert_eq!(convert(&exr, &dsm, "-q"), "");
    let region = ["--region", "0,0,16,16"];
    let cut = ["dsm-convert", &dsm, &half, region[0], region[1]];
    assert!(said(cut[0], &cut[1..], "-j1").contains("recomputed"));
    assert_eq!(said(cut[0], &cut[1..], "-q"), "");
    let right = ["--region", "24,0,16,16"];
    said("dsm-convert", &[&dsm, &out, right[0], right[1]], "-q");
    let stitch = ["stitch", &half, &out, &out];
    assert_eq!(said("dsm-join", &stitch, "-q"), "");
    let stitch = ["stitch", &half, &out];
    assert!(said("dsm-join", &stitch, "-v").contains("base within"));
    assert!(said("dsm-info", &[&dsm, "-j", "1"], "-v").contains("1 maps"));
    assert_eq!(said("dsm-info", &[&dsm, "--verify"], "--quiet"), "");
    for program in PROGRAMS {
        let subcommand = if program == "dsm-join" {
            &["collect"][..]
        } else {
            &[]
        };
        let wrong = [subcommand, &[&dsm, &out, "-q", "-v"]].concat();
        let (code, _, err) = run_program(program, &wrong);
        assert_eq!((code, err.lines().count()), (2, 1), "{err}");
    }
}
