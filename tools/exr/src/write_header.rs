//! Checks a part and builds its header attributes.

use crate::attribute::Attribute;
use crate::error::{Error, Result};
use crate::header::{LevelMode, LineOrder, Part, Rect};
use std::collections::BTreeMap;

/// Checks that `part` can be written.
pub(crate) fn check_part(part: &Part, multipart: bool) -> Result<()> {
    let invalid = |message: String| Err(Error::input(message));
    if !part.deep {
        return invalid("only deep parts can be written".into());
    }
    if !part.compression.supports_deep() {
        return invalid(format!(
            "deep parts do not allow compression {:?}",
            part.compression
        ));
    }
    part.check_geometry()
        .map_err(|e| Error::input(format!("the part cannot be written: {e}")))?;
    for w in [&part.data_window, &part.display_window] {
        let max_coordinate = i64::from(i32::MAX / 2);
        let ends = [w.x.into(), w.y.into(), w.x_end() - 1, w.y_end() - 1];
        if w.pixels() == 0
            || ends
                .iter()
                .any(|v| !(-max_coordinate..=max_coordinate).contains(v))
        {
            return invalid(format!("{w:?} is empty or beyond 2^30"));
        }
    }
    if part.tiles.is_some_and(|t| t.levels != LevelMode::One) {
        return invalid("only tiles without smaller levels can be written".into());
    }
    if part
        .tiles
        .is_some_and(|t| u64::from(t.width) * u64::from(t.height) > 1 << 28)
    {
        return invalid("a tile has more than 2^28 pixels".into());
    }
    if part.tiles.is_none() && part.line_order == LineOrder::Random {
        return invalid("line order Random is for tiled parts only".into());
    }
    if i32::try_from(part.block_count()).is_err() {
        return invalid("the part has 2^31 blocks or more".into());
    }
    if part.channels.is_empty() {
        return invalid("a part needs at least one channel".into());
    }
    if !part.channels.is_sorted_by(|a, b| a.name < b.name) {
        return invalid("channels must be sorted by name, and names must be unique".into());
    }
    for name in part.header_names() {
        if name.is_empty() || name.len() > 255 || name.contains('\0') {
            return invalid(format!(
                "invalid name {name:?}: names have 1 to 255 bytes, none of them 0"
            ));
        }
    }
    if multipart && part.name.as_ref().is_none_or(|n| n.is_empty()) {
        return invalid("each of several parts needs a name".into());
    }
    if let Some(a) = part
        .attributes
        .iter()
        .find(|a| i32::try_from(a.value.len()).is_err())
    {
        return invalid(format!("attribute {:?} has 2^31 bytes or more", a.name));
    }
    Ok(())
}

/// All header attributes, sorted by name: those of the fields, the defaults, and the others
/// unchanged.
pub(crate) fn header_attributes(part: &Part) -> impl Iterator<Item = Attribute> {
    let window = |r: &Rect| {
        let ends = [r.x, r.y, (r.x_end() - 1) as i32, (r.y_end() - 1) as i32];
        ends.iter().flat_map(|v| v.to_le_bytes()).collect()
    };
    let mut channels = Vec::new();
    for c in &part.channels {
        channels.extend_from_slice(c.name.as_bytes());
        channels.push(0);
        for v in [
            c.sample_type.code(),
            i32::from(c.linear),
            c.sampling.0,
            c.sampling.1,
        ] {
            channels.extend_from_slice(&v.to_le_bytes());
        }
    }
    channels.push(0);
    let kind = if part.tiles.is_some() {
        "deeptile"
    } else {
        "deepscanline"
    };
    let mut all: BTreeMap<String, Attribute> = BTreeMap::new();
    let mut set = |a: Attribute| all.insert(a.name.clone(), a);
    set(Attribute::float("pixelAspectRatio", 1.0));
    set(Attribute::v2f("screenWindowCenter", [0.0, 0.0]));
    set(Attribute::float("screenWindowWidth", 1.0));
    part.attributes
        .iter()
        .filter(|a| a.name != "name" && a.name != "tiles")
        .for_each(|a| {
            set(a.clone());
        });
    set(Attribute::new("channels", "chlist", channels));
    set(Attribute::new(
        "compression",
        "compression",
        vec![part.compression.code()],
    ));
    set(Attribute::new(
        "dataWindow",
        "box2i",
        window(&part.data_window),
    ));
    set(Attribute::new(
        "displayWindow",
        "box2i",
        window(&part.display_window),
    ));
    set(Attribute::new(
        "lineOrder",
        "lineOrder",
        vec![part.line_order.code()],
    ));
    if let Some(name) = &part.name {
        set(Attribute::text("name", name));
    }
    if let Some(t) = &part.tiles {
        let mut tiles = [t.width, t.height]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<_>>();
        tiles.push(0);
        set(Attribute::new("tiles", "tiledesc", tiles));
    }
    set(Attribute::text("type", kind));
    set(Attribute::int("version", 1));
    set(Attribute::int("chunkCount", part.block_count() as i32));
    set(Attribute::int("maxSamplesPerPixel", -1));
    all.into_values()
}
