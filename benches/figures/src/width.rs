//! Figure 9: lookup time by filter width.

use deepshadow::{DsmFile, Query};
use deepshadow_compare::plot;
use deepshadow_frame::{InFile, Result};

use crate::growth::{LookupPoints, SIDE, cached, sampler, time_lookups};
use crate::page::Page;
use crate::plain::{PlainMap, jittered_taps};
use crate::shots::Studio;

/// Writes figure 9: its table and its plot.
pub fn table(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 9: lookup time by filter width");
    let mut scene = studio.scene("growth")?;
    scene.lights[0].samples = 64;
    let map = studio.map(&scene, "width")?;
    let file = cached(&map)?;
    let points = LookupPoints::of(&DsmFile::open(&map.path).in_file(&map.path)?)?;
    let side = SIDE * 8;
    let plain = PlainMap::new(&scene, side)?;
    let sets = jittered_taps(64, 64);
    let mut rows = String::from(
        "| filter width / map width | plain 2048 x 2048, 64 taps | deep 256 x 256, 64 samples |\n\
         |---|---|---|\n",
    );
    let (mut plains, mut deeps) = (Vec::new(), Vec::new());
    for part in [256, 128, 64, 32, 16, 8, 4] {
        let width = 1.0 / part as f32;
        let (_, plain_ns) = time_lookups(&points, 7, |i, [x, y, z]| {
            plain.light(
                [x * 8.0, y * 8.0],
                *z,
                width * side as f32,
                &sets[i % sets.len()],
            )
        });
        let mut sampler = sampler(&file)?;
        let mut failed = None;
        let (_, deep_ns) = time_lookups(&points, 7, |_, [x, y, z]| {
            sampler
                .visibility(&Query::new(*x, *y, *z).width(width * SIDE as f32))
                .unwrap_or_else(|e| {
                    failed = Some(e);
                    0.0
                })
        });
        if let Some(e) = failed {
            return Err(e.into());
        }
        rows += &format!("| 1/{part} | {plain_ns:.0} ns | {deep_ns:.0} ns |\n");
        plains.push((f64::from(width), plain_ns));
        deeps.push((f64::from(width), deep_ns));
    }
    page.table(&rows);
    let path = page.embed("width.svg", "Nanoseconds per lookup by filter width");
    plot::lines(
        &path,
        "One lookup, scanline order",
        "filter width, fraction of the map",
        "ns",
        &[("plain, 64 taps", plains), ("deep", deeps)],
    );
    page.paragraph(
        "The maps are the same for all widths, and fine enough for the narrowest filter. The plain \
         map always compares 64 depths, spread over the filter. The deep map reads a few pixels of \
         the level that fits the filter. benches/record/compare.md repeats this with larger maps \
         and with a plain map filtered by vector instructions.",
    );
    Ok(())
}
