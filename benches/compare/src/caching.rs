//! Rows about the cache: two threads, a cache of a tenth of the map, misses, wide footprints.

use std::path::Path;

use deepshadow::{Codec, DsmFile, MapId, Mips, TileId};

use crate::lookups::Main;
use crate::maps::TILE;
use crate::ours::{Shadows, Source};
use crate::queries::{Access, Lookup, Queries};
use crate::record::{Record, Row};
use crate::scene::{DEPTHS, Dice};
use crate::timing::{Candidate, cpu_seconds, interleaved, median};

/// A footprint of a quarter of the map against one pixel (LV00, Figure 9).
pub fn wide(main: &Main, rounds: usize, record: &mut Record) {
    let quarter = main.size.0 as f32 / 4.0;
    for (width, name) in [
        (quarter, "footprint of 1/4 of the map"),
        (0.75 * quarter, "footprint of 3/16 of the map (two levels)"),
    ] {
        for access in Access::ALL {
            let queries = main.queries(access);
            let error = main.check(Lookup::Trilinear, width, &queries, 4);
            let mut sampler = main.shadows.sampler(Lookup::Trilinear);
            let mut narrow = main.shadows.sampler(Lookup::Bilinear);
            let n = queries.len();
            let [ours, theirs] = interleaved(
                rounds,
                [
                    Candidate::new(n, || sampler.sum(width, &queries)),
                    Candidate::new(n, || narrow.sum(1.0, &queries)),
                ],
            );
            let row = Row::new(name, access.name()).error(error);
            record.row(
                row.times(ours, "footprint of one pixel", theirs)
                    .goal(1.2 * theirs),
            );
        }
    }
}

/// Processor time of a lookup with two threads against one.
pub fn threads(main: &Main, rounds: usize, record: &mut Record) {
    // All tiles fit, but two samplers may pin no more than a quarter of them each.
    let all: usize = (0..main.levels.sizes.len())
        .map(|l| main.levels.bytes(l))
        .sum();
    let shadows = Shadows::open(&main.path, Source::Read, all + all / 8);
    for lookup in [Lookup::Pixel, Lookup::Trilinear] {
        let queries = main.queries(Access::Random);
        // One thread has as few pins as one of two.
        let _other = shadows.sampler(lookup);
        let work = || {
            let mut sampler = shadows.sampler(lookup);
            std::hint::black_box(sampler.sum(lookup.width(), &queries)); // warm
            let start = cpu_seconds();
            std::hint::black_box(sampler.sum(lookup.width(), &queries));
            (cpu_seconds() - start) * 1e9 / queries.len() as f64
        };
        let (mut one, mut two) = (Vec::new(), Vec::new());
        for _ in 0..rounds {
            one.push(work());
            two.push(std::thread::scope(|s| {
                let other = s.spawn(work);
                let here = work();
                (here + other.join().expect("the other thread")) / 2.0
            }));
        }
        let (one, two) = (median(one), median(two));
        let row = Row::new(
            format!("two threads on hits: {}; processor time", lookup.name()),
            "random",
        );
        record.row(row.times(two, "one thread", one).goal(1.05 * one));
    }
}

/// Bilinear lookups of all pixels of one tile after the other: every tenth tile is a new one, the
/// others are among the latest.
fn walk(size: (u32, u32), visits: usize) -> Queries {
    let (nx, ny) = (size.0 / TILE, size.1 / TILE);
    let (mut dice, mut out, mut fresh) = (Dice::new(5), Queries::default(), 0u32);
    let recent = f64::from(nx * ny) / 20.0;
    for visit in 0..visits {
        let tile = if visit % 10 == 0 {
            fresh += 1;
            fresh - 1
        } else {
            fresh - 1 - dice.range(0.0, recent.min(f64::from(fresh))) as u32
        } % (nx * ny);
        let (x0, y0) = ((tile % nx * TILE) as f32, (tile / nx * TILE) as f32);
        // Points whose 2 x 2 pixels lie in the tile.
        for i in 0..TILE * TILE {
            let inner = (TILE - 1) as f32 / TILE as f32;
            out.x.push(x0 + 0.5 + (i % TILE) as f32 * inner);
            out.y.push(y0 + 0.5 + (i / TILE) as f32 * inner);
            out.z.push(
                DEPTHS.0 + (DEPTHS.1 - DEPTHS.0) * (0.3 + 0.4 * (i % TILE) as f32 / TILE as f32),
            );
        }
    }
    out
}

/// A cache of a tenth of the map against one that holds all of it.
pub fn tenth(main: &Main, rounds: usize, record: &mut Record) {
    let name = "cache of 1/10 of the map: bilinear";
    let budget = main.levels.bytes(0) / 10;
    let small = Shadows::open(&main.path, Source::Read, budget);
    // Three to four times as many new tiles as the cache holds, so that none is left from the walk
    // before.
    let visits = 2000;
    let queries = walk(main.size, visits);
    let n = queries.len();
    let (mut few, mut all) = (
        small.sampler(Lookup::Bilinear),
        main.shadows.sampler(Lookup::Bilinear),
    );
    assert_eq!(
        few.sum(1.0, &queries),
        all.sum(1.0, &queries),
        "a small cache changes no answer"
    );
    let before = small.stats().loads;
    few.sum(1.0, &queries);
    let stats = small.stats();
    let loads = stats.loads - before;
    assert!(loads > visits as u64 / 20, "many visits are misses");
    let [ours, theirs] = interleaved(
        rounds,
        [
            Candidate::new(n, || few.sum(1.0, &queries)),
            Candidate::new(n, || all.sum(1.0, &queries)),
        ],
    );
    let row = Row::new(name, "tile-coherent").error(0.0);
    record.row(row.times(ours, "all resident", theirs).goal(3.0 * theirs));
    record.say(format!(
        "Cache of 1/10: {} of {visits} visits of a tile (1,024 lookups each) loaded it; {} bytes \
         at the peak of a budget of {budget}.",
        loads, stats.peak,
    ));
}

/// What the first lookup in a tile costs, the file's pages being in memory.
pub fn misses(main: &Main, folder: &Path, rounds: usize, record: &mut Record) {
    let sources = [
        ("mapped in place", Source::Mapped, None, 10e3),
        ("`none` read", Source::Read, None, 30e3),
        ("zstd", Source::Read, Some(Codec::Zstd(3)), 200e3),
    ];
    let (nx, ny) = (main.size.0 / TILE, main.size.1 / TILE);
    let mut queries = Queries::default();
    for tile in 0..nx * ny {
        queries.x.push((tile % nx * TILE) as f32 + 13.5);
        queries.y.push((tile / nx * TILE) as f32 + 17.5);
        queries.z.push(7.0);
    }
    for (name, source, codec, goal) in sources {
        let path = match codec {
            None => main.path.clone(),
            Some(codec) => {
                let path = folder.join("miss.dsm");
                let bytes = main
                    .block
                    .write(main.size.0, main.size.1, Mips::None, codec);
                std::fs::write(&path, bytes).expect("room for a map");
                path
            }
        };
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        let n = queries.len() as f64;
        for _ in 0..=rounds {
            // Room for a few tiles: after a first round, tiles are loaded into the memory of
            // others, as in a cache that is full.
            let shadows = Shadows::open(&path, source, 4 << 20);
            let mut sampler = shadows.sampler(Lookup::Pixel);
            sampler.sum(1.0, &queries);
            if source == Source::Mapped {
                // These have no memory to hand on, and would all stay.
                shadows.clear();
                sampler = shadows.sampler(Lookup::Pixel);
            }
            let before = shadows.stats().loads;
            let start = std::time::Instant::now();
            std::hint::black_box(sampler.sum(1.0, &queries));
            ours.push(start.elapsed().as_secs_f64() * 1e9 / n);
            let loads = shadows.stats().loads - before;
            // A few tiles are still held when the second round comes to them.
            assert!(
                loads + 64 > queries.len() as u64,
                "nearly every lookup is a miss"
            );
            let file = DsmFile::open(&path).expect("our own file");
            let start = std::time::Instant::now();
            for tile in 0..nx * ny {
                let decoded = file.tile(MapId(0).level(0), TileId::new(tile % nx, tile / nx));
                std::hint::black_box(decoded.expect("our own file"));
            }
            theirs.push(start.elapsed().as_secs_f64() * 1e9 / n);
        }
        let row = Row::new(format!("miss: {name}"), "tile by tile").goal(goal);
        record.row(row.times(
            median(ours),
            "reading and decoding the tile",
            median(theirs),
        ));
    }
}
