//! Lookups of deepshadow beside what else a renderer could use, in one process and one run.
//!
//! `cargo run --profile dist -p deepshadow-compare -- --quick --csv` prints the main table as CSV
//! in under two minutes. Without `--quick` all comparisons run; tables, CSV and plots go to
//! `benches/record/`. Answers are checked against f64 before any time counts.

mod caching;
mod figures;
mod flat;
mod lookups;
mod maps;
mod noise;
mod ours;
mod pcf;
mod queries;
mod record;
mod reference;
mod scene;
mod tables;
mod texture;
mod timing;
mod walk;

use std::path::PathBuf;

use record::{COLUMNS, Record};

fn main() {
    let (mut quick, mut csv) = (false, false);
    for arg in std::env::args().skip(1) {
        match arg.as_str() {
            "--quick" => quick = true,
            "--csv" => csv = true,
            _ => {
                eprintln!("usage: deepshadow-compare [--quick] [--csv]");
                std::process::exit(2);
            }
        }
    }
    let mut record = Record::default();
    record.folder =
        (!quick).then(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../record")));
    record.csv = csv;
    if csv {
        println!("{COLUMNS}");
    }
    record.say("# Lookups beside what else a renderer could use");
    record.say(format!(
        "Written by `cargo run --profile dist -p deepshadow-compare`. Lookups of: {}. \
         Processor: {}. Medians of {} rounds in which the candidates take turns; one thread unless \
         said; ns a lookup, queries read from arrays. \
         Answers were checked against f64 before the clock ran. \"Goal\" is what the row aims at.",
        ours::Shadows::NAME,
        processor(),
        rounds(quick),
    ));
    let start = std::time::Instant::now();
    let note = |what: &str| eprintln!("{:6.1} s  {what}", start.elapsed().as_secs_f64());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let compiling = texture::Compiling::start(folder.path());
    let rounds = rounds(quick);

    note("the main map");
    let main = lookups::Main::new(folder.path(), &mut record);
    note("lookups");
    lookups::rows(&main, rounds, &mut record);
    note("texture");
    let texture = compiling.texture(lookups::TEXTURE, queries::Lookup::Trilinear.width());
    lookups::texture(&main, texture, rounds, &mut record);
    note("wide footprints, the cache");
    caching::wide(&main, rounds, &mut record);
    caching::threads(&main, rounds, &mut record);
    caching::tenth(&main, rounds, &mut record);
    caching::misses(&main, folder.path(), rounds, &mut record);
    record.heading("The main table");
    record.flush_rows();
    drop(main);

    note("colour, a large map");
    lookups::colour(rounds, &mut record);
    lookups::large(rounds, &mut record);
    record.flush_rows();

    note("noise");
    let (side, points) = if quick { (64, 1000) } else { (256, 4000) };
    let truth = noise::Truth::new(side, points);
    noise::rows(
        folder.path(),
        &truth,
        if quick { 3 } else { rounds },
        &mut record,
    );
    record.flush_rows();
    if !quick {
        note("figure 7");
        figures::seven(folder.path(), &truth, rounds, &mut record);
        note("figure 9");
        figures::nine(folder.path(), &truth, rounds, &mut record);
        note("plain maps");
        tables::plain(rounds, &mut record);
        note("deep samples");
        tables::walk(folder.path(), rounds, &mut record);
        note("maps of all sizes");
        tables::maps(folder.path(), rounds, &mut record);
    }
    note("done");
    record.finish();
}

/// Rounds of each measurement.
fn rounds(quick: bool) -> usize {
    if quick { 5 } else { 11 }
}

/// The processor's name for itself.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("model name"));
    line.map_or("unknown".into(), |l| {
        l.trim_matches([' ', '\t', ':']).into()
    })
}
