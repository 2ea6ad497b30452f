//! Assembles maps from parts, with the library's `Join`.

use deepshadow::{Join, MapId};
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
