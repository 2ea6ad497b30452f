//! Figures 1 and 6: hair.

use deepshadow::Filter;
use deepshadow_frame::Result;
use deepshadow_render::compare::Differences;
use deepshadow_render::render::{Settings, Source};

use crate::page::Page;
use crate::shots::{Studio, from_map, seconds, size, usual};

/// Figures 1 and 6a.
pub fn with_and_without(studio: &Studio, page: &mut Page) -> Result<()> {
    page.section("Figure 1: hair with and without self-shadowing");
    let scene = studio.scene("fur")?;
    let map = studio.map(&scene, "fur")?;
    let (with, _) = studio.shot(&scene, &usual(from_map(&map)))?;
    let (without, _) = studio.shot(&scene, &usual(Source::None))?;
    page.pictures(
        "fur.png",
        "A patch of curly fur, with the shadows of its hairs on each other and without",
        &[&with, &without],
    )?;
    page.text(&format!(
        "A patch of curly fur, 40,000 hairs. Left with the shadows that they throw on each other, right without. Map: 512 x 512, {} rays a pixel, made in {}, {}.",
        scene.lights[0].samples,
        seconds(map.time),
        size(map.bytes[0]),
    ));
    page.section("Figure 6: the hair ball");
    let scene = studio.scene("hairball")?;
    let map = studio.map(&scene, "hairball")?;
    let (with, took) = studio.shot(&scene, &usual(from_map(&map)))?;
    let (without, plain) = studio.shot(&scene, &usual(Source::None))?;
    page.pictures(
        "hairball.png",
        "A ball with 50,000 hairs under three spotlights, with and without shadows",
        &[&with, &without],
    )?;
    page.text(&format!(
        "50,000 hairs of 16 segments under three spotlights, each with a map of 512 x 512 pixels and {} rays a pixel: all three made in {}, {} ({} with all levels). \
         Picture: {} with shadows, {} without.",
        scene.lights[0].samples,
        seconds(map.time),
        size(map.bytes[0]),
        size(map.bytes[1]),
        seconds(took.rendering),
        seconds(plain.rendering),
    ));
    Ok(())
}

/// Figure 6b to d: a part of the shadow, by several methods.
pub fn magnified(studio: &Studio, page: &mut Page) -> Result<()> {
    let scene = studio.scene("hairball")?;
    let map = studio.map(&scene, "magnified")?;
    let settings = |shadows, spp| Settings {
        shadows,
        spp,
        // Light on the hair itself, and on the ground beside it.
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
            "the same, the nearest pixel alone",
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
    for (i, (_, source, _)) in methods.iter().enumerate() {
        if [0, 1, 2, 5].contains(&i) {
            let (picture, _) = studio.shot(
                &scene,
                &settings(source.clone(), if i == 5 { 64 } else { 4 }),
            )?;
            pictures.push(picture);
        }
    }
    let pictures: Vec<_> = pictures.iter().collect();
    page.pictures(
        "magnified.png",
        "A part of the light on the hair ball: plain map of 512, plain map of 4096, deep map of 512, shadow rays",
        &pictures,
    )?;
    page.text(
        "The light of one spot on the lower part of the ball and the ground beside it, magnified: nothing but the fraction that arrives. From the left: a plain shadow map of 512 x 512 pixels with 16 taps, \
         one of 4096 x 4096 with 400 taps, the deep shadow map of 512 x 512 with 256 samples in each pixel, and shadow rays. All have the same rays of the camera and the same bias, and all but the shadow rays the same footprints.",
    );
    // How far they are from what many shadow rays say, where hair shadows hair, at the scale of the picture.
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
        "| shadows | RMS difference from shadow rays | time | memory of the shadows |\n|---|---|---|---|\n",
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
    page.text(&rows);
    page.text(
        "The same in numbers: 32 x 32 pixels of the picture where hair shadows hair, 512 rays each, against 8192 rays that each ask one shadow ray. What is left in the row of shadow rays over the footprint is what any filter of that width costs, \
         and it is nearly all of it: the deep map and the plain map of 64 MB differ from it, and from each other, by a percent. The time is that of the picture, 512 lookups and rays of the camera in each pixel, the making of the maps not counted.",
    );
    Ok(())
}
