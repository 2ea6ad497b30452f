//! Multiplies maps of one camera, with the library's `Join`.

use std::path::Path;

use deepshadow::{Join, MapId};
use deepshadow_frame::console::Console;
use deepshadow_frame::storage::small_lattice;
use deepshadow_frame::{Failure, InFile, Result};

use super::args::MergeArgs;
use super::{name_output, open, usual, write};
use crate::info::text::short;
use crate::inputs::find_map;

/// Joins the files.
///
/// # Errors
/// `Usage` for options that contradict each other; `Failed` for everything else.
pub fn merge(args: &MergeArgs, console: Console) -> Result<()> {
    if args.inputs.len() < 2 {
        return Err(Failure::Usage("merge needs at least two inputs".into()));
    }
    let output = args.output.as_path();
    let encoding = args.storage.encoding(usual())?;
    let (tolerance, tile) = (args.base.tolerance, args.base.tile);
    let files = open(&args.inputs, &args.common.running)?;
    let merge = match &args.map {
        Some(map) => {
            let found = files
                .iter()
                .map(|(name, file)| find_map(file, Some(map)).in_file(Path::new(name)));
            let maps = found.collect::<Result<_>>()?;
            Join::merge_maps(files, maps)
        }
        None => Join::merge(files),
    };
    let mut merge = name_output(merge, output)?;
    if args.label.name.is_some() && merge.headers().len() > 1 {
        let line = "--name needs --map: the files have several maps";
        return Err(Failure::Failed(line.into()));
    }
    for header in merge.headers_mut() {
        args.label.describe(header);
        header.tile_size = tile.unwrap_or(header.tile_size);
    }
    merge.notes().iter().for_each(|n| console.note(n));
    let mut encodings = Vec::new();
    for (map, header) in merge.headers().iter().enumerate() {
        let map = MapId(map as u32);
        let source_error = merge.source_error(map);
        let tolerance = tolerance.unwrap_or_else(|| merge.default_tolerance(map));
        let left = tolerance.min(encoding.mip_tolerance.unwrap_or(1.0)) - source_error;
        let name = &header.name;
        if left <= 0.0 && (source_error > 0.0 || left < 0.0) {
            return Err(Failure::Failed(format!(
                "the errors of map {name:?} in the inputs add up to {source_error}: \
                 --tolerance and --mip-tolerance must be above that"
            )))
            .in_file(output);
        }
        let precision = args.lattice.precision(left)?.or(Some(small_lattice(left)));
        let (within, sum) = (short(tolerance), short(source_error));
        console.note(format_args!(
            "map {name:?}: the result is within {within} of the exact functions; the errors of the \
             inputs add up to {sum}"
        ));
        encodings.push(encoding.clone().tolerance(tolerance).precision(precision));
    }
    write("merging", output, console, |writer| {
        merge.write(writer, &encodings)
    })
}
