//! Figures 1 and 6: hair.

use deepshadow::Filter;
use deepshadow_frame::Result;
use deepshadow_render::compare::Differences;
use deepshadow_render::render::{Settings, Source};

use crate::page::Page;
use crate::shots::{Studio, from_map, page_settings, seconds, size};

/// Writes figures 1 and 6a: hair with and without shadows.
pub fn with_and_without(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 1: hair with and without self-shadowing");
    let scene = studio.scene("fur")?;
    let map = studio.map(&scene, "fur")?;
    let (with, _) = studio.shot(&scene, &page_settings(from_map(&map)))?;
    let (without, _) = studio.shot(&scene, &page_settings(Source::None))?;
    page.pictures(
        "fur.png",
        "A patch of curly fur with and without shadows between its hairs",
        &[&with, &without],
    )?;
    page.paragraph(&format!(
        "A patch of curly fur with 40,000 hairs: left with the shadows that the hairs cast on each \
         other, right without. The map has 512 x 512 pixels and {} rays per pixel. It was built in \
         {} and takes {}.",
        scene.lights[0].samples,
        seconds(map.build_time),
        size(map.bytes[0]),
    ));
    page.section("Figure 6: the hair ball");
    let scene = studio.scene("hairball")?;
    let map = studio.map(&scene, "hairball")?;
    let (with, took) = studio.shot(&scene, &page_settings(from_map(&map)))?;
    let (without, plain) = studio.shot(&scene, &page_settings(Source::None))?;
    page.pictures(
        "hairball.png",
        "A ball with 50,000 hairs under three spotlights, with and without shadows",
        &[&with, &without],
    )?;
    page.paragraph(&format!(
        "50,000 hairs of 16 segments under three spotlights, each with a map of 512 x 512 pixels \
         and {} rays per pixel. All three maps were built in {} and take {} ({} with all levels). \
         The picture took {} with shadows and {} without.",
        scene.lights[0].samples,
        seconds(map.build_time),
        size(map.bytes[0]),
        size(map.bytes[1]),
        seconds(took.rendering),
        seconds(plain.rendering),
    ));
    Ok(())
}

/// Writes figure 6b to d: part of the shadow, magnified, by several methods.
pub fn magnified(studio: &Studio, page: &mut Page) -> Result<()> {
    let scene = studio.scene("hairball")?;
    let map = studio.map(&scene, "magnified")?;
    let settings = |shadows| Settings {
        shadows,
        spp: 64,
        // The crop shows light on the hair and on the ground next to it.
        resolution: Some([1440, 1080]),
        crop: Some([560, 560, 240, 240]),
        only_light: Some("key".into()),
        shadow_only: true,
        ..Settings::default()
    };
    let methods = [
        (
            "plain map 512 x 512, 16 taps",
            Source::Plain(512, 16),
            Filter::Triangle,
        ),
        (
            "plain map 4096 x 4096, 400 taps",
            Source::Plain(4096, 400),
            Filter::Triangle,
        ),
        (
            "deep map 512 x 512, 256 samples",
            from_map(&map),
            Filter::Triangle,
        ),
        (
            "the same deep map, nearest pixel only",
            from_map(&map),
            Filter::Nearest,
        ),
        (
            "256 shadow rays over the footprint",
            Source::Rays(256),
            Filter::Triangle,
        ),
        ("one shadow ray", Source::Rays(1), Filter::Triangle),
    ];
    let mut pictures = Vec::new();
    for (_, source, _) in [0, 1, 2, 5].map(|i| &methods[i]) {
        let (picture, _) = studio.shot(&scene, &settings(source.clone()))?;
        pictures.push(picture);
    }
    let pictures: Vec<_> = pictures.iter().collect();
    page.pictures(
        "magnified.png",
        "Part of the light on the hair ball: plain map of 512, plain map of 4096, deep map of 512, \
         shadow rays",
        &pictures,
    )?;
    page.paragraph(
        "The fraction of one spotlight's light that arrives at the lower part of the ball and at \
         the ground next to it, magnified. From the left: a plain shadow map of 512 x 512 pixels \
         with 16 taps, one of 4096 x 4096 with 400 taps, the deep shadow map of 512 x 512 with 256 \
         samples per pixel, and shadow rays. All four use the same 64 camera rays per pixel and \
         the same bias. The three maps use the same footprints. The coarse plain map breaks the \
         shadows on the hair into dark blotches, and streaks the ground at the lower left. The \
         fine plain map and the deep map can hardly be told apart. The shadow rays show the same \
         light with more noise: each of them finds its point either lit or dark, where a lookup \
         averages over a footprint.",
    );
    // The difference of each method from many shadow rays, where hair shadows hair, at the scale
    // of the picture.
    let close = |shadows, filter, spp| Settings {
        shadows,
        filter,
        spp,
        resolution: Some([640, 480]),
        crop: Some([278, 278, 32, 32]),
        only_light: Some("key".into()),
        shadow_only: true,
        ..Settings::default()
    };
    let many = if studio.quick { 64 } else { 8192 };
    let (exact, _) = studio.shot(&scene, &close(Source::Rays(1), Filter::Triangle, many))?;
    let mut rows = String::from(
        "| shadows | RMS difference from shadow rays | time | memory of the shadows |\n\
         |---|---|---|---|\n",
    );
    for (name, source, filter) in methods.into_iter().take(5) {
        let (picture, took) = studio.shot(&scene, &close(source, filter, 512))?;
        let found = Differences::between(&picture, &exact)?;
        rows += &format!(
            "| {name} | {:.4} | {} | {} |\n",
            found.rmse,
            seconds(took.rendering),
            size(took.bytes as u64)
        );
    }
    page.table(&rows);
    page.paragraph(
        "The same comparison in numbers, over 32 x 32 pixels of the picture where hair shadows \
         hair. Each pixel has 512 camera rays. The reference has 8192, with one shadow ray each. \
         The row of shadow rays over the footprint shows the error that any filter of that width \
         causes. It is nearly all of the error: the deep map and the plain map of 64 MB differ \
         from that row, and from each other, by a percent. The time is that of the picture, with \
         512 lookups and camera rays per pixel. It does not include building the maps.",
    );
    Ok(())
}
