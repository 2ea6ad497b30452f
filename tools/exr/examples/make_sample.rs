//! Makes `docs/sample.exr`, the small deep image of the README.
//!
//! It shows a hair ball, a puff of smoke and a pane of tinted glass over tilted ground, seen from
//! the light.
//!
//! `cargo run -p deepshadow-exr --example make_sample docs/sample.exr`

use std::fs::File;

use deepshadow_exr::*;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

/// A sample of a deep pixel.
struct Sample {
    z: f32,
    z_back: f32,
    opacity: [f32; 3],
}

/// A random number generator (splitmix64).
struct Random(u64);

impl Random {
    /// A number from 0 to 1.
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((x ^ (x >> 31)) >> 40) as f32 / (1u32 << 24) as f32
    }
}

/// Adds strands that curl away from a ball, as samples along their length.
fn hair(pixels: &mut [Vec<Sample>]) {
    let mut random = Random(7);
    let (cx, cy, cz, radius) = (58.0, 62.0, 10.0, 26.0);
    for _ in 0..900 {
        let (height, turn) = (
            2.0 * random.unit() - 1.0,
            std::f32::consts::TAU * random.unit(),
        );
        let ring = (1.0 - height * height).sqrt();
        let out = [ring * turn.cos(), ring * turn.sin(), height];
        let (curl, length) = (3.0 * random.unit(), 0.6 + 0.7 * random.unit());
        let steps = 60;
        for s in 0..steps {
            let t = s as f32 / steps as f32;
            let r = radius * (0.75 + length * t);
            let x = cx + r * out[0] + curl * (9.0 * t + turn).sin();
            let y = cy + r * out[1] + curl * (9.0 * t + turn).cos() + 12.0 * t * t;
            let z = cz + 0.1 * r * out[2];
            let inside = (0.0..WIDTH as f32).contains(&x) && (0.0..HEIGHT as f32).contains(&y);
            if inside && random.unit() < 0.35 {
                let opacity = 0.12 + 0.2 * random.unit();
                pixels[y as usize * WIDTH as usize + x as usize].push(Sample {
                    z,
                    z_back: z,
                    opacity: [opacity; 3],
                });
            }
        }
    }
}

/// Adds the samples of one pixel from all objects but the hair.
fn pixel(x: u32, y: u32, out: &mut Vec<Sample>) {
    let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
    // The skin of the ball.
    let skin = ((px - 58.0).powi(2) + (py - 62.0).powi(2)) / (20.0f32 * 20.0);
    if skin < 1.0 {
        let z = 10.0 - 2.0 * (1.0 - skin).sqrt();
        out.push(Sample {
            z,
            z_back: z,
            opacity: [1.0; 3],
        });
    }
    // Smoke: three layers, thick, overlapping.
    let puff = ((px - 112.0).powi(2) + (py - 42.0).powi(2)) / (34.0f32 * 34.0);
    if puff < 1.0 {
        let wave = 0.5 + 0.5 * (0.31 * px).sin() * (0.27 * py + 0.1 * px).cos();
        for layer in 0..3 {
            let z = 6.0 + 1.5 * layer as f32 + 1.2 * puff;
            let opacity = (1.0 - puff) * (0.25 + 0.4 * wave);
            out.push(Sample {
                z,
                z_back: z + 1.8,
                opacity: [opacity; 3],
            });
        }
    }
    // A pane of glass that lets red through.
    if (96..150).contains(&x) && (78..110).contains(&y) {
        let z = 5.0 + 0.01 * px;
        out.push(Sample {
            z,
            z_back: z,
            opacity: [0.15, 0.6, 0.7],
        });
    }
    // The tilted ground behind all other objects; the upper edge of the view misses it.
    if py > 8.0 {
        let z = 15.0 - 0.03 * py;
        out.push(Sample {
            z,
            z_back: z,
            opacity: [1.0; 3],
        });
    }
}

fn main() -> Result<()> {
    let path = std::env::args().nth(1).expect("the file to write");
    let mut pixels: Vec<Vec<Sample>> = (0..WIDTH * HEIGHT).map(|_| Vec::new()).collect();
    hair(&mut pixels);
    let names = ["AB", "AG", "AR"];
    let mut channels: Vec<_> = names
        .iter()
        .map(|n| Channel::new(*n, SampleType::Half))
        .collect();
    channels.extend(["Z", "ZBack"].map(|n| Channel::new(n, SampleType::Float)));
    let window = Rect {
        x: 0,
        y: 0,
        width: WIDTH,
        height: HEIGHT,
    };
    let mut part = Part::deep_scanline(window, channels.clone());
    part.attributes.push(Attribute::text(
        "comments",
        "made by deepshadow: hair, smoke and glass from the light",
    ));
    #[rustfmt::skip]
    let world_to_camera = [
        1.0, 0.0, 0.0, 0.0,
        0.0, 1.0, 0.0, 0.0,
        0.0, 0.0, 1.0, 0.0,
        0.0, 0.0, 0.0, 1.0,
    ];
    part.attributes
        .push(Attribute::m44f("worldToCamera", world_to_camera));
    let file = File::create(path).map_err(|e| Error::io("cannot create the file", e))?;
    let mut writer = DeepWriter::new(file, vec![part])?;
    for y in 0..HEIGHT {
        let mut block = DeepBlock::with_channels(
            Rect {
                x: 0,
                y: y as i32,
                width: WIDTH,
                height: 1,
            },
            &channels,
        );
        for x in 0..WIDTH {
            let samples = &mut pixels[(y * WIDTH + x) as usize];
            pixel(x, y, samples);
            samples.sort_by(|a, b| a.z.total_cmp(&b.z));
            // Drop the samples behind an opaque one.
            if let Some(opaque) = samples.iter().position(|s| s.opacity == [1.0; 3]) {
                samples.truncate(opaque + 1);
            }
            for s in samples.iter() {
                for (channel, value) in [s.opacity[2], s.opacity[1], s.opacity[0], s.z, s.z_back]
                    .into_iter()
                    .enumerate()
                {
                    block.channels[channel].push(value);
                }
            }
            block.push_pixel();
        }
        writer.write(0, &block)?;
    }
    writer.finish().map(|_| ())
}
