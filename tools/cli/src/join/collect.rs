//! Copies maps of any files: tiles byte for byte, levels, errors and attributes.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use deepshadow::raw::Run;
use deepshadow::raw::directory::TileKind;
use deepshadow::raw::layout::BLOCK_ENTRIES;
use deepshadow::{Attribute, DsmFile, Group, Limits, MapHeader, MapId, Writer};
use deepshadow_frame::console::Console;
use deepshadow_frame::{Failure, InFile, Result};
use rayon::prelude::*;

use super::args::{CollectArgs, NewGroup};
use super::{shares, usual, write};
use crate::inputs::find_map;
use deepshadow_frame::stream::open_dsm;

/// Tiles in memory at once.
const TILES: usize = 1024;

/// Joins the files.
///
/// # Errors
/// `Failed`, naming the file: for a missing input, for an unknown map, and for two maps or two
/// groups of one name. `Usage` for a new group with an unknown map.
pub fn collect(args: &CollectArgs, console: Console) -> Result<()> {
    let output = args.output.as_path();
    let mut chosen = Collection {
        limits: shares(&args.common.running, args.inputs.len()),
        ..Collection::default()
    };
    for input in &args.inputs {
        chosen.add(input)?;
    }
    chosen.check_names()?;
    let groups = chosen.groups(&args.groups, console)?;
    let attributes = chosen.attributes(console);
    write("collecting", output, console, |writer| {
        for (name, value) in attributes {
            writer.add_attribute(name, value);
        }
        groups.into_iter().for_each(|g| writer.add_group(g));
        chosen.write(writer)
    })
}

/// The maps of the new file, in order.
#[derive(Default)]
struct Collection {
    limits: Limits,
    files: Vec<(PathBuf, DsmFile)>,
    maps: Vec<Chosen>,
}

/// A map of a file.
struct Chosen {
    file: usize,
    map: MapId,
    header: MapHeader,
}

impl Collection {
    /// Adds the maps of `FILE[:MAP][=NAME]`.
    fn add(&mut self, input: &OsStr) -> Result<()> {
        let (path, map, name) = parts(input);
        let file = self.open(path)?;
        let opened = &self.files[file].1;
        let maps = match map {
            Some(map) => vec![find_map(opened, Some(map)).in_file(path)?],
            None => (0..opened.maps().len() as u32).map(MapId).collect(),
        };
        if let Some(name) = name.filter(|_| maps.len() != 1) {
            let line = format!(
                "the file has {} maps: choose the one to name {name:?}, as in {}:MAP={name}",
                maps.len(),
                path.display()
            );
            return Err(Failure::Failed(line)).in_file(path);
        }
        for map in maps {
            let mut header = opened.map(map)?.header.clone();
            if let Some(name) = name {
                header.name = name.into();
            }
            self.maps.push(Chosen { file, map, header });
        }
        Ok(())
    }

    /// Returns the index of a file. Opens each file once.
    fn open(&mut self, path: &Path) -> Result<usize> {
        match self.files.iter().position(|(known, _)| known == path) {
            Some(file) => Ok(file),
            None => {
                self.files
                    .push((path.to_owned(), open_dsm(path, self.limits)?));
                Ok(self.files.len() - 1)
            }
        }
    }

    fn path(&self, file: usize) -> std::path::Display<'_> {
        self.files[file].0.display()
    }

    fn check_names(&self) -> Result<()> {
        let mut first = HashMap::new();
        for chosen in &self.maps {
            let name = &chosen.header.name;
            if let Some(other) = first.insert(name, chosen.file) {
                let (one, two) = (self.path(other), self.path(chosen.file));
                let old = &self.files[chosen.file].1.map(chosen.map)?.header.name;
                return Err(Failure::Failed(format!(
                    "two maps are called {name:?}, in {one} and {two}: rename one, as in \
                     {two}:{old}=NAME"
                )));
            }
        }
        Ok(())
    }

    /// Returns the groups of the files whose maps are all chosen, and the new groups.
    fn groups(&self, new: &[NewGroup], console: Console) -> Result<Vec<Group>> {
        let mut groups: Vec<(Group, Option<usize>)> = Vec::new();
        for (number, (path, file)) in self.files.iter().enumerate() {
            let mut places = HashMap::new();
            for (id, c) in (0..).map(MapId).zip(&self.maps) {
                if c.file == number {
                    places.entry(c.map).or_insert(id);
                }
            }
            let place = |map: &MapId| places.get(map).copied();
            for group in file.groups() {
                if new.iter().any(|n| n.name == group.name) {
                    continue;
                }
                let Some(maps) = group.maps.iter().map(place).collect::<Option<_>>() else {
                    console.detail(format_args!(
                        "{}: group {:?} is dropped: not all its maps are copied",
                        path.display(),
                        group.name
                    ));
                    continue;
                };
                if let Some((_, other)) = groups.iter().find(|(g, _)| g.name == group.name) {
                    let one = self.path(other.unwrap_or(number));
                    return Err(Failure::Failed(format!(
                        "two groups are called {:?}, in {one} and {}: choose the maps, as in \
                         --group {}={}:MAP,MAP",
                        group.name,
                        path.display(),
                        group.name,
                        group.role,
                    )));
                }
                let group = Group::new(&group.name, group.role, maps);
                groups.push((group, Some(number)));
            }
        }
        for group in new {
            if groups.iter().any(|(g, _)| g.name == group.name) {
                let line = format!("--group {0} is given twice", group.name);
                return Err(Failure::Usage(line));
            }
            let maps = group.maps.iter().map(|map| self.find(&group.name, map));
            let made = Group::new(&group.name, group.role, maps.collect::<Result<_>>()?);
            groups.push((made, None));
        }
        Ok(groups.into_iter().map(|(g, _)| g).collect())
    }

    /// Returns the index in the new file of a map of a new group.
    fn find(&self, group: &str, map: &str) -> Result<MapId> {
        let named = self.maps.iter().position(|c| c.header.name == map);
        let numbered = || map.parse().ok().filter(|&n: &usize| n < self.maps.len());
        let found = named.or_else(numbered).map(|n| MapId(n as u32));
        found.ok_or_else(|| {
            let names: Vec<_> = self.maps.iter().map(|c| &*c.header.name).collect();
            Failure::Usage(format!(
                "--group {group}: no map {map:?} is collected; the maps are {}",
                names.join(", ")
            ))
        })
    }

    /// Returns the attributes of all files. For attributes of one name, the first file wins.
    fn attributes(&self, console: Console) -> Vec<(String, Attribute)> {
        let mut all: Vec<((String, Attribute), usize)> = Vec::new();
        for (number, (path, file)) in self.files.iter().enumerate() {
            for attribute in file.attributes() {
                match all.iter().find(|(a, _)| a.0 == attribute.0) {
                    None => all.push((attribute.clone(), number)),
                    Some((kept, _)) if kept == attribute => {}
                    Some((kept, first)) => console.note(format_args!(
                        "{}: attribute {:?} differs; the value in {} is kept",
                        path.display(),
                        kept.0,
                        self.path(*first)
                    )),
                }
            }
        }
        all.into_iter().map(|(a, _)| a).collect()
    }

    fn write(&self, writer: &mut Writer) -> deepshadow::Result<()> {
        let mut added = Vec::new();
        for chosen in &self.maps {
            let levels = &self.files[chosen.file].1.map(chosen.map)?.levels;
            let errors: Vec<f64> = levels.iter().map(|l| l.max_error).collect();
            added.push(writer.add_finished_map(chosen.header.clone(), usual().codec, &errors)?);
        }
        for (to, chosen) in added.into_iter().zip(&self.maps) {
            let (path, file) = &self.files[chosen.file];
            for (level, info) in (0..).zip(&file.map(chosen.map)?.levels) {
                let from = chosen.map.level(level);
                let in_file = |e: deepshadow::Error| e.in_file(&path.display().to_string());
                for batch in file.batches(from).map_err(in_file)? {
                    // Whole blocks of empty tiles need not be given.
                    let is_empty =
                        |run: &Run| run.entry.kind == TileKind::Empty && run.tiles == BLOCK_ENTRIES;
                    let runs = batch.map_err(in_file)?;
                    let runs = runs.into_iter().filter(|run| !is_empty(run));
                    let tiles = runs.flat_map(|run| run.first..run.first + run.tiles);
                    let mut tiles = tiles.map(|tile| info.shape.tile_at(tile)).peekable();
                    while tiles.peek().is_some() {
                        let tiles: Vec<_> = tiles.by_ref().take(TILES).collect();
                        let read = |tile| Ok((tile, file.stored_tile(from, tile)?));
                        let read: deepshadow::Result<_> = tiles.into_par_iter().map(read).collect();
                        writer.stored_tiles(to.level(level), read.map_err(in_file)?)?;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Splits `FILE[:MAP][=NAME]` into file, map and new name. The name of an existing file may contain
/// colons and equals signs.
fn parts(input: &OsStr) -> (&Path, Option<&str>, Option<&str>) {
    let whole = Path::new(input);
    let Some(text) = input.to_str().filter(|_| !whole.exists()) else {
        return (whole, None, None);
    };
    let (file, name) = match text.rsplit_once('=') {
        Some((file, name)) => (file, Some(name)),
        None => (text, None),
    };
    match file.rsplit_once(':').filter(|_| !Path::new(file).exists()) {
        Some((file, map)) => (Path::new(file), Some(map), name),
        None => (Path::new(file), None, name),
    }
}
