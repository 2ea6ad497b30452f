//! Assembles maps from parts, with the library's `Join`.

use deepshadow::{Join, MapHeader, MapId};
use deepshadow_frame::Result;
use deepshadow_frame::console::Console;

use super::args::StitchArgs;
use super::{name_output, open, usual, write};

/// Joins the files.
///
/// # Errors
/// `Usage` for numbers outside their domains; `Failed` for everything else.
pub fn stitch(args: &StitchArgs, console: Console) -> Result<()> {
    let output = args.output.as_path();
    let encoding = args.storage.encoding(usual())?;
    let stitch = name_output(
        Join::stitch(open(&args.inputs, &args.common.running)?),
        output,
    )?;
    stitch.notes().iter().for_each(|n| console.note(n));
    for (map, header) in stitch.headers().iter().enumerate() {
        let map = MapId(map as u32);
        let (w, h, lit) = (header.width, header.height, stitch.lit_pixels(map));
        if lit > 0 {
            console.note(format_args!(
                "{}: {lit} of the {w} x {h} pixels of map {:?} are in no part and are lit",
                output.display(),
                header.name
            ));
        }
        if let Some(missing) = missing(header) {
            console.note(format_args!(
                "{}: map {:?} covers {missing}; is a part missing?",
                output.display(),
                header.name
            ));
        }
        console.detail(format_args!(
            "{:?}: {w} x {h} pixels, base within {}",
            header.name,
            stitch.source_error(map)
        ));
    }
    write("stitching", output, console, |writer| {
        stitch.write(writer, &[encoding])
    })
}

/// Describes a map that covers only a part of its display window, from a corner of it on: then an
/// outer part is likely to be missing. The data window of an image may well lie inside.
fn missing(header: &MapHeader) -> Option<String> {
    let [x, y] = header.data_origin.map(i64::from);
    let [width, height] = [header.width, header.height].map(i64::from);
    let [x0, y0, x1, y1] = header.display_window.map(i64::from);
    let [wide, high] = [x1 - x0 + 1, y1 - y0 + 1];
    let at_corner = (x == x0 || x + width == x1 + 1) && (y == y0 || y + height == y1 + 1);
    (at_corner && (width < wide || height < high)).then(|| {
        format!(
            "{width} x {height} pixels from {x},{y} on of a display window of {wide} x {high} from \
             {x0},{y0} on"
        )
    })
}
