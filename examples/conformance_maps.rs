//! Writes deep shadow maps of many kinds into a folder, as a test for other readers.
//!
//! `cargo run --example conformance_maps FOLDER`

use deepshadow::raw::Precision;
use deepshadow::*;

/// A deterministic source of numbers (splitmix64).
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: u32) -> u32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((x ^ (x >> 31)) >> 32) as u32 % n
    }

    fn unit(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }
}

fn ray(dice: &mut Dice, coloured: bool) -> Result<Ray> {
    let mut ray = Ray::new();
    for _ in 0..dice.below(12) {
        let z = dice.unit() * 100.0 - 20.0;
        let opacity = if dice.below(5) == 0 { 1.0 } else { dice.unit() };
        let tint = [opacity, opacity * 0.5, opacity * dice.unit()];
        match (dice.below(3), coloured && dice.below(2) == 0) {
            (0, false) => ray.thick(z, z + dice.unit() * 4.0, opacity)?,
            (0, true) => ray.thick(z, z + 1.0, tint)?,
            (_, false) => ray.surface(z, opacity)?,
            (_, true) => ray.surface(z, tint)?,
        }
    }
    Ok(ray)
}

fn add(writer: &mut Writer, header: MapHeader, encoding: Encoding, dice: &mut Dice) -> Result<()> {
    let (width, height, coloured) = (header.width, header.height, header.channels == 3);
    let tolerance = encoding.tolerance.max(Encoding::MIN_TOLERANCE);
    let map = writer.add_map(header, encoding)?;
    let mut curve = Curve::lit(1);
    for y in 0..height {
        for x in 0..width {
            // Empty, constant and full regions.
            match (x / 40, y / 40) {
                (0, 0) if width > 40 => continue,
                (1, 0) => curve = Curve::mono(vec![7.5], vec![0.0])?,
                _ => ray(dice, coloured)?.flatten(tolerance / 64.0, &mut curve),
            }
            writer.pixel(map, Pixel::new(x, y), &curve)?;
        }
    }
    Ok(())
}

fn main() -> Result<()> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).expect("a folder"));
    let codecs = [Codec::None, Codec::Lz4, Codec::Zstd(3)];
    let mut dice = Dice(1);
    for (i, (width, height)) in [(1, 1), (5, 7), (100, 90), (33, 64), (300, 8)]
        .into_iter()
        .enumerate()
    {
        for (c, codec) in codecs.into_iter().enumerate() {
            let mut writer = Writer::create(folder.join(format!("map-{width}x{height}-{c}.dsm")))?;
            let mut header = MapHeader::new("first", width, height);
            header.channels = if (i + c) % 2 == 0 { 1 } else { 3 };
            header.tile_size = 8 << ((i + c) % 4);
            header.depth_kind = DepthKind::Planar;
            header.depth_unit = 0.01;
            header.camera.camera_from_world = Some(std::array::from_fn(|i| f64::from(i % 5 == 0)));
            header.attributes.push(("comment".into(), "a test".into()));
            let tolerance = [0.01, 0.1, 0.0][c];
            let precision = (i == 3).then_some(Precision::F32);
            let encoding = Encoding::new(tolerance).codec(codec).precision(precision);
            add(&mut writer, header, encoding.clone(), &mut dice)?;
            if i == 1 {
                add(
                    &mut writer,
                    MapHeader::new("second", 9, 3),
                    encoding.mips(Mips::None),
                    &mut dice,
                )?;
                writer.add_group(Group::new(
                    "both",
                    GroupRole::Clusters,
                    vec![MapId(1), MapId(0)],
                ));
            }
            writer.add_attribute("n", Attribute::Integers(vec![-1, 2]));
            writer.finish()?;
        }
    }
    Ok(())
}
