//! `dsm-info`: shows the contents of files.
//!
//! | module | contents |
//! |---|---|
//! | [`args`] | the command line |
//! | [`text`] | numbers, names and tables for people |
//! | [`document`] | JSON documents whose long lists are written item by item |
//! | [`select`] | the maps and levels that `--map` and `--level` select |
//! | [`summary`] | the summary, which reads no tile, as text and as JSON |
//! | [`stats`] | statistics over all pixels |
//! | [`tiles`] | the tile directory, one line per tile |
//! | [`pixel`] | one visibility function as a table |
//! | [`lookup`] | one filtered lookup, and the pixels that it used |
//! | [`plot`] | one visibility function as a plot |
//! | [`canvas`] | lines, areas and text as SVG or PNG |
//! | [`verify`] | every rule of the format, and the true error against the source |
//! | [`compare`] | the differences between two files |
//! | [`difference`] | the largest difference of two levels |

pub mod args;
pub mod canvas;
pub mod compare;
pub mod difference;
pub mod document;
pub mod lookup;
pub mod pixel;
pub mod plot;
pub mod select;
pub mod stats;
pub mod summary;
pub mod text;
pub mod tiles;
pub mod verify;

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use deepshadow::Pixel;
use serde_json::{Value, json};

use self::args::Args;
use self::document::Part;
use deepshadow_frame::args::{from_matches, matches};
use deepshadow_frame::console::Console;
use deepshadow_frame::output::{Output, write_file};
use deepshadow_frame::progress::Bar;
use deepshadow_frame::stream::{is_standard_output, open_dsm};
use deepshadow_frame::{Failure, InFile, Result, exit};

/// Runs the program with these arguments; the first is its name. The exit code is 0 for success, 1
/// if a file or the operation failed, and 2 for wrong arguments.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let parsed = matches(Args::command(), arguments)
        .and_then(|m| from_matches::<Args>(&m))
        .and_then(|args| {
            args.check()?;
            let console = args.running.start("dsm-info")?;
            Ok((args, console))
        });
    let (args, console) = match parsed {
        Ok(parsed) => parsed,
        Err(failure) => return exit("dsm-info", Err(failure)),
    };
    let mut out = Output::standard();
    let good = process_all(&args, console, &mut out);
    if let Err(e) = out.flush() {
        return exit("dsm-info", Err(e));
    }
    ExitCode::from(u8::from(!good))
}

fn print_failure(failure: &Failure) {
    let _ = writeln!(std::io::stderr(), "dsm-info: {failure}");
}

/// Processes every file. Returns whether all succeeded.
fn process_all(args: &Args, console: Console, out: &mut Output) -> bool {
    let mut good = true;
    let several = args.files.len() > 1;
    for (i, path) in args.files.iter().enumerate() {
        let mut document = vec![("file".to_owned(), json!(path.to_string_lossy()).into())];
        if let Err(failure) = process(args, console, path, out, &mut document).in_file(path) {
            out.settle();
            print_failure(&failure);
            document.push(("error".into(), json!(failure.to_string()).into()));
            good = false;
        }
        if args.json {
            out.text(match (several, i) {
                (false, _) => "",
                (true, 0) => "[\n  ",
                _ => ",\n  ",
            });
            Part::Object(document).write(out, several);
        }
        if out.is_closed() {
            break;
        }
    }
    if args.json {
        out.line(if several { "\n]" } else { "" });
    }
    good
}

/// Prints the results that `args` ask for, for one file. Checks that can fail come last, so that
/// they hide no other result.
fn process(
    args: &Args,
    console: Console,
    path: &Path,
    out: &mut Output,
    document: &mut Vec<(String, Part)>,
) -> Result<()> {
    let limits = args.running.limits(1 + usize::from(args.compare.is_some()));
    let file = Arc::new(open_dsm(path, limits)?);
    console.detail(format_args!(
        "{}: {} bytes, {} maps",
        path.display(),
        file.length(),
        file.maps().len()
    ));
    let map = args.map.as_deref();
    let mut put = |key: &str, part: Part| document.push((key.into(), part));
    if args.json {
        for (key, part) in summary::json(&file, args.all_metadata) {
            put(key, part);
        }
    } else if args.wants_summary() {
        out.section();
        summary::print(&file, path, args.all_metadata, out)?;
    }
    if args.stats {
        let stats = stats::Stats::of(&file, path, map, args.level, console)?;
        if args.json {
            put("stats", stats.json().into());
        } else {
            out.section();
            stats.print(path, out);
        }
    }
    if args.tiles {
        if args.json {
            put("tiles", tiles::json(&file, map, args.level)?);
        } else {
            out.section();
            tiles::print(&file, map, args.level, out)?;
        }
    }
    if let Some(at) = args.pixel {
        let pixel = pixel::PixelFunction::of(&file, map, args.level, at)?;
        if args.json {
            put("pixel", pixel.json());
        } else {
            out.section();
            pixel.print(path, out);
        }
    }
    if let Some(at) = args.plot {
        let drawn = plot::draw(&pixel::PixelFunction::of(&file, map, args.level, at)?);
        match &args.output {
            Some(path) if is_png(path) => write_file(path, &drawn.png()?)?,
            Some(path) if !is_standard_output(path) => write_file(path, drawn.svg().as_bytes())?,
            _ => out.text(&drawn.svg()),
        }
    }
    if let Some(at) = args.lookup {
        let lookup = lookup::Lookup::of(&file, map, args.lookup_how, at)?;
        if args.json {
            put("lookup", lookup.json().into());
        } else {
            out.section();
            lookup.print(path, out);
        }
    }
    if args.hash {
        let mut bar = console.bar("hashing");
        let hash = file.content_hash(|done, total| watch(&mut bar, done, total))?;
        let hex = text::hex(&hash);
        if args.json {
            put("hash", json!(hex).into());
        } else if args.files.len() == 1 {
            out.section();
            out.line(hex);
        } else {
            out.line(format_args!("{hex}  {}", path.display()));
        }
    }
    if args.verify {
        let report = verify::verify(&file, console);
        if args.json {
            put("verify", verify::json(&report).into());
        }
        let report = report?;
        if !args.json {
            out.line(format_args!(
                "{}: {}",
                path.display(),
                verify::line(&report)
            ));
        }
    }
    if let Some(source) = &args.against {
        let measured = verify::Measured::of(&file, map, source, &args.source, console)?;
        if args.json {
            put("against", measured.json(source).into());
        } else {
            measured.print(source, out);
        }
        measured.verdict()?;
    }
    if let Some(other) = &args.compare {
        let there = open_dsm(other, limits)?;
        let comparison = compare::Comparison::of(&file, &there, map, console)?;
        if args.json {
            put("compare", comparison.json(other).into());
        } else {
            out.section();
            comparison.print(path, other, out);
        }
        comparison.verdict(other, args.fail)?;
    }
    Ok(())
}

/// Whether the extension of a plot is that of PNG; [`Args::check`] leaves SVG as the only other.
fn is_png(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("png"))
}

/// Shows the progress on `bar`. Returns `true` to continue.
fn watch(bar: &mut Bar, done: u64, total: u64) -> bool {
    bar.set(done, total);
    true
}

/// Returns a pixel as a JSON array.
fn point(Pixel { x, y }: Pixel) -> Value {
    json!([x, y])
}
