//! Draws a slice of a map: the light that reaches one depth, pixel by pixel.
//!
//! `cargo run --release --example slice light.dsm 6 slice.pgm`

use deepshadow::*;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or("light.dsm".into());
    let depth = arguments
        .next()
        .map_or(6.0, |d| d.parse().expect("a depth"));
    let picture = arguments.next().unwrap_or("slice.pgm".into());

    // Each tile is read once, so a cache would not help.
    let file = DsmFile::open(path)?;
    let base = MapId(0).level(0);
    let shape = file.level(base)?.shape;
    let side = file.map(base.map)?.header.tile_size;
    let (width, height) = (shape.width as usize, shape.height as usize);
    let mut pixels = vec![0; width * height];
    for ty in 0..shape.tiles_y() {
        for tx in 0..shape.tiles_x() {
            let tile = file.tile(base, TileId::new(tx, ty))?;
            let (columns, rows) = shape.tile_extent(TileId::new(tx, ty));
            for i in 0..columns * rows {
                let (x, y) = (tx * side + i % columns, ty * side + i / columns);
                let visibility = tile.function(i as usize).visibility(depth);
                pixels[y as usize * width + x as usize] = (255.0 * visibility).round() as u8;
            }
        }
    }

    let header = format!("P5 {width} {height} 255\n");
    Ok(std::fs::write(
        picture,
        [header.as_bytes(), &pixels].concat(),
    )?)
}
