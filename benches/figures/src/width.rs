//! Figure 9: time by filter width.

use deepshadow::{DsmFile, Query};
use deepshadow_compare::plot;
use deepshadow_frame::{InFile, Result};

use crate::growth::{Places, SIDE, cached, sampler, timed};
use crate::page::Page;
use crate::plain::{Plain, taps};
use crate::shots::Studio;

/// Figure 9.
pub fn table(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 9: time of a lookup by filter width");
    let mut scene = studio.scene("growth")?;
    scene.lights[0].samples = 64;
    let map = studio.map(&scene, "width")?;
    let file = cached(&map)?;
    let places = Places::of(&DsmFile::open(&map.path).in_file(&map.path)?)?;
    let side = SIDE * 8;
    let plain = Plain::new(&scene, side)?;
    let sets = taps(64, 64);
    let mut rows = String::from(
        "| width, of the map | plain 2048 x 2048, 64 taps | deep 256 x 256, 64 samples |\n|---|---|---|\n",
    );
    let (mut plains, mut deeps) = (Vec::new(), Vec::new());
    for part in [256, 128, 64, 32, 16, 8, 4] {
        let width = 1.0 / part as f32;
        let (_, plain_ns) = timed(&places, 7, |i, [x, y, z]| {
            plain.light(
                [x * 8.0, y * 8.0],
                *z,
                width * side as f32,
                &sets[i % sets.len()],
            )
        });
        let mut sampler = sampler(&file)?;
        let mut failed = None;
        let (_, deep_ns) = timed(&places, 7, |_, [x, y, z]| {
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
    page.text(&rows);
    let path = page.show("width.svg", "Nanoseconds a lookup by filter width");
    plot::lines(
        &path,
        "One lookup, scanline order",
        "filter width, fraction of the map",
        "ns",
        &[("plain, 64 taps", plains), ("deep", deeps)],
    );
    page.text("Both maps are fine enough for the narrowest filter, and stay; the plain map always compares 64 depths, spread wider and wider. The deep map reads a few pixels of the level that fits. benches/record/compare.md has the same with larger maps and a plain map that is filtered with vector instructions.");
    Ok(())
}
