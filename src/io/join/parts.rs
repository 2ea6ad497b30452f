//! The files to join, matched map by map.

use std::collections::HashMap;

use crate::io::{DsmFile, Writer};
use crate::map::{Attribute, Group, LevelId, MapHeader, MapId, MapInfo};
use crate::{Error, Result};

/// The files to join, and the maps of each that belong together.
#[derive(Debug)]
pub(super) struct Parts {
    /// Each with its name for messages.
    pub files: Vec<(String, DsmFile)>,
    /// For each map of the result, its id in each file.
    pub maps: Vec<Vec<MapId>>,
    /// Harmless differences between the files, a line for each.
    pub notes: Vec<String>,
}

impl Parts {
    /// Matches all maps of the files by name.
    pub fn by_name(files: Vec<(String, DsmFile)>) -> Result<Self> {
        let Some((first, file)) = files.first() else {
            return Err(Error::input("there is no file to join"));
        };
        let ids = (0..file.maps().len()).map(MapId::from_index);
        let mut maps: Vec<Vec<MapId>> = ids.map(|id| vec![id]).collect();
        let names = |file: &DsmFile| -> HashMap<String, MapId> {
            let ids = (0..).map(MapId);
            let names = file.maps().iter().map(|m| m.header.name.clone());
            names.zip(ids).collect()
        };
        let known = names(file);
        for (name, other) in &files[1..] {
            let found = names(other);
            let lacks = |map: &str, has: &str| {
                Error::input(format!("it has no map {map:?}, as {has} has")).in_file(name)
            };
            for map in &mut maps {
                let wanted = &file.maps()[map[0].index()].header.name;
                map.push(*found.get(wanted).ok_or_else(|| lacks(wanted, first))?);
            }
            let others = other.maps().iter().map(|m| &m.header.name);
            if let Some(more) = others.into_iter().find(|n| !known.contains_key(*n)) {
                let what = format!("it has a map {more:?}, which {first} has not");
                return Err(Error::input(what).in_file(name));
            }
        }
        Self::new(files, maps)
    }

    pub fn new(files: Vec<(String, DsmFile)>, maps: Vec<Vec<MapId>>) -> Result<Self> {
        let notes = Vec::new();
        let mut parts = Parts { files, maps, notes };
        if parts.differ(|p, f| p.attributes(f)) {
            parts.note("the attributes differ");
        }
        Ok(parts)
    }

    /// Notes a difference between the files; those of the first file count.
    pub fn note(&mut self, what: &str) {
        let first = &self.files[0].0;
        let note = format!("{what}: those of {first} are kept");
        self.notes.push(note);
    }

    /// Whether `of` differs between the first file and any other.
    pub fn differ<T: PartialEq>(&self, of: impl Fn(&Self, usize) -> T) -> bool {
        let first = of(self, 0);
        (1..self.files.len()).any(|f| of(self, f) != first)
    }

    /// The attributes of a file and of its maps.
    fn attributes(&self, file: usize) -> Vec<Vec<(String, Attribute)>> {
        let own = self.files[file].1.attributes().to_vec();
        let maps = (0..self.maps.len()).map(|m| self.header(m, file).attributes.clone());
        std::iter::once(own).chain(maps).collect()
    }

    /// The groups of a file whose maps are all joined, with the ids of the result.
    pub fn groups(&self, file: usize) -> Vec<Group> {
        let joined = (0..).map(MapId).zip(&self.maps);
        let new: HashMap<MapId, MapId> = joined.map(|(new, m)| (m[file], new)).collect();
        let renumber = |g: &Group| {
            let maps = g.maps.iter().map(|m| new.get(m).copied());
            let maps = maps.collect::<Option<_>>()?;
            Some(Group::new(&g.name, g.role, maps))
        };
        let groups = self.files[file].1.groups().iter();
        groups.filter_map(renumber).collect()
    }

    /// A map of the result, in `file`.
    fn info(&self, map: usize, file: usize) -> &MapInfo {
        &self.files[file].1.maps()[self.maps[map][file].index()]
    }

    pub fn header(&self, map: usize, file: usize) -> &MapHeader {
        &self.info(map, file).header
    }

    /// The base level of a map, in `file`.
    pub fn base(&self, map: usize, file: usize) -> LevelId {
        self.maps[map][file].level(0)
    }

    /// Largest error of the base level of a map, in `file`.
    pub fn max_error(&self, map: usize, file: usize) -> f64 {
        self.info(map, file).levels[0].max_error
    }

    /// [`Parts::max_error`] of all files.
    pub fn max_errors(&self, map: usize) -> impl Iterator<Item = f64> {
        (0..self.files.len()).map(move |file| self.max_error(map, file))
    }

    /// Checks that a map has the same camera and measures the same depths in all files, and the
    /// same `more`: properties of two headers, whether they are equal, and their names.
    pub fn check_same<const N: usize>(
        &self,
        map: usize,
        more: impl Fn(&MapHeader, &MapHeader) -> [(bool, &'static str); N],
    ) -> Result<()> {
        let first = self.header(map, 0);
        for (file, (name, _)) in self.files.iter().enumerate().skip(1) {
            let h = self.header(map, file);
            let view = [
                (h.camera == first.camera, "camera"),
                (h.display_window == first.display_window, "display window"),
                (h.depth_kind == first.depth_kind, "kind of depth"),
                (h.depth_unit == first.depth_unit, "unit of depth"),
            ];
            let mut all = view.into_iter().chain(more(first, h));
            if let Some((_, what)) = all.find(|(same, _)| !same) {
                let (map, first) = (&h.name, &self.files[0].0);
                let line = format!("map {map:?} has another {what} than in {first}");
                return Err(Error::input(line).in_file(name));
            }
        }
        Ok(())
    }

    /// Gives the attributes and groups to a writer. `added` are the joined maps there.
    pub fn describe(&self, writer: &mut Writer, added: &[MapId]) {
        for (name, value) in self.files[0].1.attributes() {
            writer.add_attribute(name, value.clone());
        }
        for mut group in self.groups(0) {
            group.maps.iter_mut().for_each(|m| *m = added[m.index()]);
            writer.add_group(group);
        }
    }
}
