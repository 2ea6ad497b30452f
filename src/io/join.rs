//! Several files become one: parts of a map beside each other, or things before one camera behind one another.

mod merge;
mod stitch;

pub use merge::Merge;
pub use stitch::Stitch;

use super::{DsmFile, Writer};
use crate::map::{Attribute, Group, LevelId, MapHeader, MapId};
use crate::{Error, Result};

/// The files that are joined, and which of their maps belong together.
#[derive(Debug)]
struct Parts {
    /// Each with what messages call it.
    files: Vec<(String, DsmFile)>,
    /// For each map of the result, its id in every file.
    maps: Vec<Vec<MapId>>,
    /// What the user should know of.
    notes: Vec<String>,
}

impl Parts {
    /// All maps, by their names.
    fn by_name(files: Vec<(String, DsmFile)>) -> Result<Self> {
        let Some((first, file)) = files.first() else {
            return Err(Error::input("there is no file to join"));
        };
        let ids = (0..file.maps().len()).map(MapId::from_index);
        let mut maps: Vec<Vec<MapId>> = ids.map(|id| vec![id]).collect();
        for (name, other) in &files[1..] {
            let lacks = |map: &str, has: &str| {
                Error::input(format!("it has no map {map:?}, as {has} has")).in_file(name)
            };
            for map in &mut maps {
                let wanted = &file.maps()[map[0].index()].header.name;
                map.push(other.find(wanted).ok_or_else(|| lacks(wanted, first))?);
            }
            let others = other.maps().iter().map(|m| &m.header.name);
            if let Some(more) = others.into_iter().find(|n| file.find(n).is_none()) {
                let what = format!("it has a map {more:?}, which {first} has not");
                return Err(Error::input(what).in_file(name));
            }
        }
        Self::new(files, maps)
    }

    fn new(files: Vec<(String, DsmFile)>, maps: Vec<Vec<MapId>>) -> Result<Self> {
        let mut parts = Parts {
            files,
            maps,
            notes: Vec::new(),
        };
        if parts.differ(|p, f| p.attributes(f)) {
            parts.note("the attributes differ");
        }
        Ok(parts)
    }

    /// Says that the files differ in something, and what becomes of it.
    fn note(&mut self, what: &str) {
        let first = &self.files[0].0;
        self.notes
            .push(format!("{what}: those of {first} are kept"));
    }

    /// Whether any file differs from the first one in what `of` says.
    fn differ<T: PartialEq>(&self, of: impl Fn(&Self, usize) -> T) -> bool {
        let first = of(self, 0);
        (1..self.files.len()).any(|f| of(self, f) != first)
    }

    /// Attributes of a file and of its maps.
    fn attributes(&self, file: usize) -> Vec<Vec<(String, Attribute)>> {
        let own = self.files[file].1.attributes().to_vec();
        let maps = (0..self.maps.len()).map(|m| self.header(m, file).attributes.clone());
        std::iter::once(own).chain(maps).collect()
    }

    /// The groups of a file whose maps are all joined, with their numbers in the result.
    fn groups(&self, file: usize) -> Vec<Group> {
        let new = |old: &MapId| {
            let at = self.maps.iter().position(|m| m[file] == *old);
            at.map(MapId::from_index)
        };
        let renumber = |g: &Group| {
            let maps = g.maps.iter().map(new).collect::<Option<_>>()?;
            Some(Group::new(&g.name, g.role, maps))
        };
        let groups = self.files[file].1.groups().iter();
        groups.filter_map(renumber).collect()
    }

    /// Header of what `file` has of a map.
    fn header(&self, map: usize, file: usize) -> &MapHeader {
        &self.files[file].1.maps()[self.maps[map][file].index()].header
    }

    /// The base level of what `file` has of a map.
    fn base(&self, map: usize, file: usize) -> LevelId {
        self.maps[map][file].level(0)
    }

    /// Largest error of the base level of what `file` has of a map.
    fn max_error(&self, map: usize, file: usize) -> f64 {
        self.files[file].1.maps()[self.maps[map][file].index()].levels[0].max_error
    }

    /// An error of `file`: something of a map is not as in the first one.
    fn other(&self, map: usize, file: usize, what: &str) -> Error {
        let (first, name) = (&self.files[0].0, &self.header(map, file).name);
        let line = format!("map {name:?} has another {what} than in {first}");
        Error::input(line).in_file(&self.files[file].0)
    }

    /// Whether all files see a map through the same camera, and measure depths alike.
    fn check_view(&self, map: usize) -> Result<()> {
        let first = self.header(map, 0);
        for file in 1..self.files.len() {
            let h = self.header(map, file);
            let same = [
                (h.camera == first.camera, "camera"),
                (h.display_window == first.display_window, "display window"),
                (h.depth_kind == first.depth_kind, "kind of depth"),
                (h.depth_unit == first.depth_unit, "unit of depth"),
            ];
            self.check_same(map, file, &same)?;
        }
        Ok(())
    }

    fn check_same(&self, map: usize, file: usize, same: &[(bool, &str)]) -> Result<()> {
        match same.iter().find(|(same, _)| !same) {
            Some((_, what)) => Err(self.other(map, file, what)),
            None => Ok(()),
        }
    }

    /// Gives attributes and groups to a writer in which the joined maps are `added`.
    fn describe(&self, writer: &mut Writer, added: &[MapId]) {
        for (name, value) in self.files[0].1.attributes() {
            writer.add_attribute(name, value.clone());
        }
        for mut group in self.groups(0) {
            group.maps.iter_mut().for_each(|m| *m = added[m.index()]);
            writer.add_group(group);
        }
    }
}
