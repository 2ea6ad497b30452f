//! `Writer::add_finished_map`: stores the given tiles of every level unchanged, and refuses others.

use crate::support::file;
use deepshadow::raw::{Precision, TileBuilder};
use deepshadow::*;

fn tile(width: u32, height: u32, seed: u32, precision: Precision) -> Tile {
    let mut builder = TileBuilder::new(width, precision);
    for i in 0..width * height {
        let k = (i * 7 + seed) % 5;
        let v = f32::from(k as u8) / 4.0;
        builder.push(&Visibility::mono(vec![Vertex::new(1.0 + i as f32, v)]).unwrap());
    }
    builder.finish()
}

fn header() -> MapHeader {
    MapHeader::new("map", 11, 5).tile_size(8).channels(1)
}

#[test]
fn finished_tiles_are_stored_unchanged_in_any_order() {
    let max_errors = [0.25, 0.0, 0.5];
    let write = |codec, order: &[usize]| {
        file(|writer| {
            let map = writer
                .add_finished_map(header(), codec, &max_errors)
                .unwrap();
            let lattice = Precision::Lattice(4);
            for &i in order {
                let (level, tx, (w, h)) = [
                    (0, 0, (8, 5)),
                    (0, 1, (3, 5)),
                    (1, 0, (6, 3)),
                    (2, 0, (3, 2)),
                ][i];
                let tiles = vec![(TileId::new(tx, 0), tile(w, h, i as u32, lattice))];
                writer.finished_tiles(map.level(level), tiles).unwrap();
            }
        })
    };
    for codec in [Codec::None, Codec::Lz4] {
        for order in [[0, 1, 2, 3], [3, 1, 2, 0]] {
            let file = write(codec, &order);
            let levels = &file.maps()[0].levels;
            let kept: Vec<_> = levels.iter().map(|l| l.max_error).collect();
            assert_eq!(kept, max_errors);
            assert_eq!(
                file.tile(MapId(0).level(0), TileId::new(1, 0)).unwrap(),
                tile(3, 5, 1, Precision::Lattice(4))
            );
            assert_eq!(
                file.tile(MapId(0).level(2), TileId::new(0, 0)).unwrap(),
                tile(3, 2, 3, Precision::Lattice(4))
            );
        }
    }
    // Tiles that are not given are lit.
    let file = write(Codec::None, &[1]);
    assert!(
        file.function(MapId(0).level(2), Pixel::new(0, 0))
            .unwrap()
            .is_empty()
    );
}

#[test]
fn finished_tiles_that_do_not_fit_the_map_are_refused() {
    let mut writer = Writer::in_memory();
    for max_errors in [&[][..], &[0.0; 6], &[f64::NAN], &[-0.5], &[f64::INFINITY]] {
        let e = writer
            .add_finished_map(header(), Codec::None, max_errors)
            .unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
    }
    let map = writer
        .add_finished_map(header(), Codec::None, &[0.0, 0.0])
        .unwrap();
    let other = MapHeader::new("other", 8, 8);
    let open = writer.add_map(other, Encoding::default()).unwrap();
    let good = || tile(8, 5, 0, Precision::F32);
    let mut coloured = TileBuilder::new(3, Precision::F32);
    let red = Visibility::rgb(vec![Vertex::new(1.0, [0.5, 1.0, 1.0])]).unwrap();
    (0..15).for_each(|_| coloured.push(&red));
    let first = vec![(TileId::new(0, 0), good())];
    writer.finished_tiles(map.level(0), first).unwrap();
    for (map, level, tx, tile, says) in [
        (map, 0, 0, good(), "given before"),
        (map, 0, 1, good(), "40 functions"),
        (map, 0, 2, good(), "outside"),
        (map, 2, 0, good(), "no such level"),
        (map, 0, 1, coloured.finish(), "coloured"),
        (open, 0, 0, good(), "not added as finished"),
    ] {
        let e = writer
            .finished_tiles(map.level(level), vec![(TileId::new(tx, 0), tile)])
            .unwrap_err();
        assert_eq!(e.kind(), ErrorKind::Input);
        assert!(e.to_string().contains(says), "{e}");
    }
    let curve = Curve::lit(1);
    assert!(writer.pixel(map, Pixel::new(9, 0), &curve).is_err());
    let pixels = Pixels::Curves(vec![curve; 15]);
    let e = writer.tile(map, TileId::new(1, 0), pixels).unwrap_err();
    assert!(e.to_string().contains("finished_tiles"), "{e}");
}
