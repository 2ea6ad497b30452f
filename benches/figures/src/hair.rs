//! Figures 1 and 6: hair.

use deepshadow_cli::Result;
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

/// Figure 6b to d: a part of the shadow, by several methods, against shadow rays.
pub fn magnified(studio: &Studio, page: &mut Page) -> Result<()> {
    let scene = studio.scene("hairball")?;
    let map = studio.map(&scene, "magnified")?;
    // Light on the hair itself, and on the ground beside it.
    let crop = [560, 560, 240, 240];
    let settings = |shadows, spp| Settings {
        shadows,
        spp,
        resolution: Some([1440, 1080]),
        crop: Some(crop),
        only_light: Some("key".into()),
        shadow_only: true,
        ..Settings::default()
    };
    // Every ray of the camera asks for itself, over the footprint that the maps filter over.
    let (exact, slow) = studio.shot(
        &scene,
        &settings(Source::Rays(if studio.quick { 16 } else { 256 }), 16),
    )?;
    let methods = [
        ("plain map 512 x 512, 16 taps", Source::Plain(512, 16)),
        ("plain map 4096 x 4096, 400 taps", Source::Plain(4096, 400)),
        ("deep map 512 x 512, 256 samples", from_map(&map)),
    ];
    let mut pictures = Vec::new();
    let mut rows = String::from(
        "| shadows | RMS difference from shadow rays | time of the picture | memory of the shadows |\n|---|---|---|---|\n",
    );
    for (name, source) in methods {
        let (picture, took) = studio.shot(&scene, &settings(source, 16))?;
        let found = Differences::between(&picture, &exact)?;
        rows += &format!(
            "| {name} | {:.4} | {} | {} |\n",
            found.rmse,
            seconds(took.rendering),
            size(took.bytes as u64)
        );
        pictures.push(picture);
    }
    rows += &format!(
        "| shadow rays, 256 over each footprint | | {} | {} |\n",
        seconds(slow.rendering),
        size(slow.bytes as u64)
    );
    pictures.push(exact);
    let pictures: Vec<_> = pictures.iter().collect();
    page.pictures("magnified.png", "A part of the light on the hair ball: plain map of 512, plain map of 4096, deep map of 512, shadow rays", &pictures)?;
    page.text(
        "The light of one spot on the lower part of the ball and the ground beside it, magnified, nothing but the fraction that arrives. From the left: a plain shadow map of 512 x 512 pixels with 16 taps, \
         one of 4096 x 4096 with 400 taps, the deep shadow map of 512 x 512, and shadow rays over the same footprints. All have the same rays of the camera, the same footprints and the same bias.",
    );
    page.text(&rows);
    Ok(())
}
