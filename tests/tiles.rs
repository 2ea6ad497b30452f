//! Stored tiles and directory blocks made by hand: laws, planes, delta planes and codecs.

use crate::fuzz_replay::naive;
use crate::random::Random;
use deepshadow::raw::directory::{Entry, TileKind, decode_block, encode_block};
use deepshadow::raw::{Precision, TileBuilder, TileValues};
use deepshadow::*;

/// Vertices that the reader checks together.
const CHUNK: usize = 2048;

/// The planes of a monochrome tile; visibilities are `k / one`.
struct Planes {
    table: Vec<u32>,
    depths: Vec<f32>,
    numerators: Vec<u32>,
    one: u16,
}

impl Planes {
    /// Planes of `pixels` functions whose numbers of vertices `count` gives, still without values.
    fn new(pixels: usize, one: u16, mut count: impl FnMut() -> u32) -> Self {
        let mut table = vec![0];
        for i in 0..pixels {
            table.push(table[i] + count());
        }
        let n = table[pixels] as usize;
        Planes {
            table,
            depths: vec![0.0; n],
            numerators: vec![0; n],
            one,
        }
    }

    /// The range of the vertices of each pixel.
    fn pixels(&self) -> Vec<std::ops::Range<usize>> {
        let pair = |w: &[u32]| w[0] as usize..w[1] as usize;
        self.table.windows(2).map(pair).collect()
    }

    /// Functions that need not be lawful, of few depths and visibilities, so that all cases meet.
    fn any(dice: &mut Random) -> Self {
        let pixels = 1 + dice.below(6) as usize;
        let mut planes = Planes::new(pixels, 4, || dice.below(5));
        for range in planes.pixels() {
            let (mut z, mut k) = (dice.below(3), 4 - dice.below(2));
            for i in range {
                planes.depths[i] = match (dice.below(60), z) {
                    (0, _) => -0.0,
                    (1, _) => f32::INFINITY,
                    (_, z) => z as f32,
                };
                planes.numerators[i] = k;
                z = (z + dice.below(3)).saturating_sub(u32::from(dice.below(40) == 0) * 2);
                k = k.saturating_sub(dice.below(3)) + u32::from(dice.below(40) == 0);
            }
        }
        planes
    }

    /// Lawful functions of several chunks, changed in at most two places, mostly near borders.
    fn large(dice: &mut Random) -> Self {
        let pixels = 1 + dice.below(1500) as usize;
        let mut planes = Planes::new(pixels, 60_000, || {
            let many = [0, 1, 4, 2 * CHUNK as u32][dice.below(300).saturating_sub(296) as usize];
            dice.below(8) + dice.below(1 + many)
        });
        let lowest = if dice.below(2) == 0 { 0 } else { -40 };
        let ranges = planes.pixels();
        let (depths, values) = (&mut planes.depths, &mut planes.numerators);
        for range in ranges {
            let (mut z, mut k) = (lowest + dice.below(60) as i32, 60_000 - 1 - dice.below(2));
            for i in range.clone() {
                let is_second = i > range.start + 1;
                let step = is_second && depths[i - 1] != depths[i - 2] && dice.below(3) == 0;
                z += i32::from(i > range.start && !step);
                // Some neighbours are equal, but no three, and not the last two.
                let flat = is_second
                    && i + 1 < range.end
                    && values[i - 1] != values[i - 2]
                    && dice.below(3) == 0;
                k -= u32::from(i > range.start && (step || !flat));
                (depths[i], values[i]) = (z as f32, k);
            }
        }
        let n = depths.len();
        for _ in 0..if n == 0 { 0 } else { dice.below(3) } {
            let near = match dice.below(3) {
                0 => dice.below(n as u32) as usize,
                1 => planes.table[dice.below(pixels as u32 + 1) as usize] as usize,
                _ => CHUNK * dice.below((n / CHUNK) as u32 + 1) as usize,
            };
            let i = (near + dice.below(5) as usize).saturating_sub(2).min(n - 1);
            let j = i.saturating_sub(1);
            match dice.below(9) {
                0 => depths[i] = depths[j],
                1 => depths[i] -= 1.0,
                2 => depths[i] = [-0.0, f32::INFINITY, f32::NEG_INFINITY][dice.below(3) as usize],
                3 => depths[i] = [f32::NAN, -f32::NAN][dice.below(2) as usize],
                4 => values[i] = values[j],
                5 => values[i] += 1,
                6 => values[i] = 60_000 + dice.below(2),
                7 => depths.swap(i, j),
                _ => values.swap(i, j),
            }
        }
        planes
    }

    /// The entry and the bytes of a tile without codec and transform. The ranges of the entry are
    /// missing.
    fn stored(&self, lattice: bool) -> (Entry, Vec<u8>) {
        let value = |k: u32| k as f32 / f32::from(self.one);
        let mut bytes: Vec<u8> = self.table.iter().flat_map(|i| i.to_le_bytes()).collect();
        bytes.extend(self.depths.iter().flat_map(|z| z.to_le_bytes()));
        for &k in &self.numerators {
            match lattice {
                true => bytes.extend((k as u16).to_le_bytes()),
                false => bytes.extend(value(k).to_le_bytes()),
            }
        }
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        let entry = Entry {
            kind: TileKind::Data,
            offset: 64,
            stored_size: bytes.len() as u32,
            decoded_size: bytes.len() as u32,
            vertices: self.depths.len() as u32,
            crc: crc32fast::hash(&bytes),
            lattice: if lattice { self.one } else { 0 },
            ..Entry::default()
        };
        (entry, bytes)
    }
}

/// Decodes the planes with both readers. Returns whether they are lawful.
fn check_laws(planes: &Planes, lattice: bool) -> bool {
    let (mut entry, stored) = planes.stored(lattice);
    let extent = (planes.table.len() as u32 - 1, 1);
    let lawful = naive::decode(&entry, &stored, extent);
    if let Some(functions) = lawful.as_ref().filter(|_| entry.vertices > 0) {
        (entry.depths, entry.ends) = naive::ranges(functions);
    }
    match (Tile::decode(&entry, &stored, extent, 1 << 30), &lawful) {
        (Ok(tile), Some(functions)) => {
            let same = functions.iter().map(|f| f.function());
            assert!(tile.functions().eq(same), "{tile:?}");
        }
        (Err(e), None) => {
            let rule = e.rule().unwrap();
            assert!(!["TILE-DEPTHS", "TILE-ENDS"].contains(&rule), "{e}");
        }
        (tile, _) => panic!("{:?} of {lawful:?}", tile.map(|t| t.vertices())),
    }
    lawful.is_some()
}

#[test]
fn the_check_of_planes_agrees_with_the_check_of_functions() {
    let mut dice = Random(1);
    let mut seen = [[0; 2]; 2];
    for i in 0..202_000 {
        let is_large = i % 101 == 0;
        let planes = match is_large {
            true => Planes::large(&mut dice),
            false => Planes::any(&mut dice),
        };
        // The library asserts in tests that a lawful tile does not need its slow check.
        let lawful = check_laws(&planes, i % 2 == 0);
        seen[usize::from(is_large)][usize::from(lawful)] += 1;
    }
    assert!(seen[0].iter().all(|&n| n > 10_000), "{seen:?}");
    assert!(seen[1].iter().all(|&n| n > 300), "{seen:?}");
}

#[test]
fn planes_of_every_kind_hold_the_vertices() {
    let (z, red) = (vec![2.0, 3.0, 5.0], vec![1.0, 0.5, 0.25]);
    let mono = Visibility::from_planes(z.clone(), vec![red.clone()]).unwrap();
    let rest = [vec![1.0, 0.75, 0.5], vec![1.0, 0.5, 0.0]];
    let all = vec![red.clone(), rest[0].clone(), rest[1].clone()];
    let rgb = Visibility::from_planes(z.clone(), all).unwrap();
    for precision in [Precision::F32, Precision::Lattice(8)] {
        for coloured in [false, true] {
            let mut builder = TileBuilder::new(2, precision);
            builder.push(&mono);
            builder.push(&Visibility::lit());
            builder.push(if coloured { &rgb } else { &mono });
            builder.push(&Visibility::lit());
            let tile = builder.finish();
            let planes = tile.planes();
            assert_eq!(planes.vertex_table, [0, 3, 3, 6, 6]);
            assert_eq!(planes.depths, [z.clone(), z.clone()].concat());
            let mut values = [red.clone(), red.clone()].concat();
            if coloured {
                assert_eq!(planes.colour_table, [0, 0, 0, 3, 3]);
                values.extend(rest.concat());
            } else {
                assert!(planes.colour_table.is_empty());
            }
            match (planes.values, precision) {
                (TileValues::F32(v), Precision::F32) => assert_eq!(v, values),
                (TileValues::Lattice { numerators, .. }, Precision::Lattice(8)) => {
                    let all = numerators.iter().map(|&k| f32::from(k) / 8.0);
                    assert!(all.eq(values), "{numerators:?}");
                }
                (other, _) => panic!("{other:?} at {precision:?}"),
            }
        }
    }
}

/// A tile of one column whose pixels have one vertex each, at these depths.
fn column(depths: &[f32]) -> Tile {
    let mut builder = TileBuilder::new(1, Precision::Lattice(4));
    for &z in depths {
        builder.push(&Visibility::mono(vec![Vertex::new(z, 0.5)]).unwrap());
    }
    builder.finish()
}

#[test]
fn delta_planes_keep_depths_of_any_sign_in_any_order() {
    let tiny = f32::from_bits(1);
    let up = 1.0f32.next_up();
    let mut depths = vec![f32::MIN, -1.0, -tiny, 0.0, tiny, 1.0, up, f32::MAX];
    for _ in 0..2 {
        for _ in 0..depths.len() {
            depths.rotate_left(1);
            let tile = column(&depths);
            let (entry, stored) = tile.encode(Codec::Lz4).unwrap();
            let back = Tile::decode(&entry, &stored, (1, 8), 1 << 20).unwrap();
            assert_eq!(back.planes(), tile.planes());
            let function = naive::decode(&entry, &stored, (1, 8)).unwrap();
            let read: Vec<f32> = function.iter().map(|f| f.depths()[0]).collect();
            assert_eq!(read, depths);
        }
        depths.reverse();
    }
}

#[test]
fn small_differences_of_depths_have_small_codes() {
    let below = |n: u32| f32::from_bits(1f32.to_bits() - n);
    let tile = column(&[1.0, below(1), 1.0, below(2), 1.0, 1.0]);
    let (entry, stored) = tile.encode(Codec::Lz4).unwrap();
    let frame = &stored[..stored.len() - usize::from(entry.padding)];
    let bytes = lz4_flex::block::decompress(frame, entry.decoded_size as usize).unwrap();
    let (counts, firsts) = bytes[..48].split_at(24);
    assert_eq!(counts[..6], [1; 6]);
    let plane = |k: usize| &firsts[6 * k..][1..6];
    assert_eq!(plane(0), [1, 2, 3, 4, 0]); // -1, 1, -2, 2 and 0 floats away
    assert!((1..4).all(|k| plane(k) == [0; 5]), "{firsts:?}");
}

#[test]
fn every_codec_decodes_to_the_bytes_that_it_encoded() {
    for codec in [Codec::None, Codec::Lz4, Codec::Zstd(3), Codec::Zstd(19)] {
        for n in [1, 2, 200] {
            let entries: Vec<Entry> = (0..n)
                .map(|i| Entry::constant(1 + ((i * i) >> 7), i as f32, 0.5))
                .collect();
            let Ok((mut block, mut stored)) = encode_block(&entries, codec) else {
                continue; // a build without zstd
            };
            let (_, plain) = encode_block(&entries, Codec::None).unwrap();
            let n = n as usize;
            assert_eq!(decode_block(&block, &stored, n).unwrap(), plain);
            let refused = decode_block(&block, &stored, n + 1).unwrap_err();
            assert_eq!(refused.rule(), Some("BLOCK-SIZE"), "{codec:?}");
            stored.insert(stored.len() - usize::from(block.padding), 0);
            block.crc = crc32fast::hash(&stored);
            let refused = decode_block(&block, &stored, n).unwrap_err();
            assert_eq!(
                refused.rule(),
                Some("BLOCK-SIZE"),
                "{codec:?}: an extra byte"
            );
        }
    }
}

#[test]
fn a_forged_size_is_refused_before_it_is_allocated() {
    for codec in [Codec::Lz4, Codec::default()] {
        let (mut block, _) = encode_block(&[Entry::default()], codec).unwrap();
        let stored = [0x28, 0xB5, 0x2F, 0xFD, 0, 0, 0, 0];
        (block.crc, block.padding) = (crc32fast::hash(&stored), 0);
        let refused = decode_block(&block, &stored, usize::MAX >> 7).unwrap_err();
        assert_eq!(refused.rule(), Some("BLOCK-SIZE"), "{codec:?}");
    }
}
