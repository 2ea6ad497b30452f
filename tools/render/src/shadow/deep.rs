//! Shadows from a deep shadow map, through the library's lookups.

use std::path::Path;
use std::sync::Arc;

use deepshadow::{
    CachedFile, DsmFile, Filter, GroupSampler, Limits, MapId, SamplerOptions, TileCache,
    WorldQuery, WorldSampler,
};
use deepshadow_frame::{Failure, InFile, Result};
use deepshadow_scene::scene::Light;

use crate::lamp::Asked;

/// A file with the maps of a scene's lights.
#[derive(Debug)]
pub struct Deep {
    cache: Arc<TileCache>,
    file: CachedFile,
    lamps: Vec<Source>,
    options: SamplerOptions,
}

/// Index of the map or group of a light.
#[derive(Clone, Copy, Debug)]
enum Source {
    Map(usize),
    Group(usize),
}

/// Looks up the shadows of one light.
#[derive(Debug)]
pub struct LampSampler {
    sampler: Sampling,
    coloured: bool,
}

#[derive(Debug)]
enum Sampling {
    Map(Box<WorldSampler>),
    Group(GroupSampler),
}

impl Deep {
    /// Opens the file at `path` with a cache of `budget` bytes.
    ///
    /// The file must have a map or a group with the name of each light.
    ///
    /// # Errors
    /// `Failed`, naming the file.
    pub fn open(path: &Path, lights: &[&Light], filter: Filter, budget: usize) -> Result<Self> {
        // The cache takes a quarter of the memory.
        let limits = Limits::default().memory((4 * budget as u64).max(64 << 20));
        let file = DsmFile::open_within(path, limits).in_file(path)?;
        let source = |light: &&Light| {
            let group = file.groups().iter().position(|g| g.name == light.name);
            let map = || file.maps().iter().position(|m| m.header.name == light.name);
            group
                .map(Source::Group)
                .or_else(|| map().map(Source::Map))
                .ok_or_else(|| missing(&file, &light.name))
        };
        let lamps = lights.iter().map(source).collect::<Result<_>>();
        let lamps = lamps.in_file(path)?;
        let cache = TileCache::new(budget);
        let deep = Deep {
            file: cache.add(file),
            cache,
            lamps,
            options: SamplerOptions::new(filter),
        };
        // Fail early if a map lacks what lookups need.
        deep.samplers().in_file(path)?;
        Ok(deep)
    }

    /// The cache that all lookups go through.
    pub fn cache(&self) -> &TileCache {
        &self.cache
    }

    /// The samplers of all lights, for one thread.
    ///
    /// # Errors
    /// As [`WorldSampler::with_options`].
    pub fn samplers(&self) -> Result<Vec<LampSampler>> {
        let maps = self.file.file().maps();
        let groups = self.file.file().groups();
        let sampler = |source: &Source| -> deepshadow::Result<LampSampler> {
            let coloured = |map: usize| maps[map].header.channels > 1;
            Ok(match *source {
                Source::Map(map) => LampSampler {
                    sampler: Sampling::Map(Box::new(WorldSampler::with_options(
                        &self.file,
                        MapId(map as u32),
                        self.options,
                    )?)),
                    coloured: coloured(map),
                },
                Source::Group(group) => LampSampler {
                    sampler: Sampling::Group(GroupSampler::with_options(
                        &self.file,
                        group,
                        self.options,
                    )?),
                    coloured: groups[group].maps.iter().any(|&m| coloured(m.index())),
                },
            })
        };
        let all = self.lamps.iter().map(sampler);
        Ok(all.collect::<deepshadow::Result<_>>()?)
    }
}

impl LampSampler {
    /// The fraction of light that reaches a point.
    ///
    /// # Errors
    /// As [`WorldSampler::visibility`].
    pub fn light(&mut self, asked: &Asked) -> Result<[f32; 3]> {
        let query = WorldQuery::new(asked.point.to_array())
            .width(asked.width)
            .bias(asked.bias as f32);
        let light = match (&mut self.sampler, self.coloured) {
            (Sampling::Map(map), false) => map.visibility(&query).map(|v| [v; 3]),
            (Sampling::Map(map), true) => map.visibility_rgb(&query),
            (Sampling::Group(group), false) => group.visibility(&query).map(|v| [v; 3]),
            (Sampling::Group(group), true) => group.visibility_rgb(&query),
        };
        Ok(light?)
    }
}

fn missing(file: &DsmFile, name: &str) -> Failure {
    let groups = file.groups().iter().map(|g| &g.name);
    let names: Vec<_> = groups
        .chain(file.maps().iter().map(|m| &m.header.name))
        .map(|n| format!("{n:?}"))
        .collect();
    Failure::Failed(format!(
        "no map or group is named after light {name:?}; there are {}",
        names.join(", ")
    ))
}
