//! Shadows from a deep shadow map, through the library's lookups.

use std::path::Path;
use std::sync::Arc;

use deepshadow::{
    CachedFile, Camera, DsmFile, Filter, Limits, MapId, SamplerOptions, TileCache, WorldQuery,
    WorldSampler,
};
use deepshadow_frame::stream::open_dsm;
use deepshadow_frame::{Failure, InFile, Result};
use deepshadow_scene::scene::Light;

use crate::lamp::{Asked, Lamp};

/// A file with the maps of a scene's lights.
#[derive(Debug)]
pub struct Deep {
    cache: Arc<TileCache>,
    file: CachedFile,
    /// The names of the lights.
    lamps: Vec<String>,
    options: SamplerOptions,
}

/// Looks up the shadows of one light.
#[derive(Debug)]
pub struct LampSampler {
    sampler: WorldSampler,
    coloured: bool,
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
        let file = open_dsm(path, limits)?;
        let cache = TileCache::new(budget);
        let deep = Deep {
            file: cache.add(file),
            cache,
            lamps: lights.iter().map(|light| light.name.clone()).collect(),
            options: SamplerOptions::new(filter),
        };
        // Fail early if a light has no map, or the map lacks what lookups need.
        deep.samplers().in_file(path)?;
        Ok(deep)
    }

    /// The maps whose cameras are not those of their lights: the scene or the map has changed. Each
    /// is the name of the light and a sentence.
    pub fn unlike(&self, lamps: &[Lamp<'_>]) -> Vec<String> {
        let file = self.file.file();
        let mut lines = Vec::new();
        for lamp in lamps {
            let name = &lamp.light.name;
            let maps = match file.find_group(name) {
                Some(group) => group.maps.clone(),
                None => file.find(name).into_iter().collect(),
            };
            let cameras = maps.iter().map(|m| file.maps()[m.index()].header.camera);
            let own = lamp.views.iter().map(|v| v.camera);
            if maps.len() != lamp.views.len() || cameras.zip(own).any(|(a, b)| !is_near(a, b)) {
                lines.push(format!(
                    "light {:?}: its map has another camera than the scene; build the map again if \
                     the light or the objects have moved",
                    name
                ));
            }
        }
        lines
    }

    /// The cache that all lookups go through.
    pub fn cache(&self) -> &TileCache {
        &self.cache
    }

    /// The samplers of all lights, for one thread.
    ///
    /// # Errors
    /// As [`WorldSampler::with_options`]; `Failed` for a light without a map or a group.
    pub fn samplers(&self) -> Result<Vec<LampSampler>> {
        let file = self.file.file();
        let sampler = |name: &String| {
            let (sampler, maps) = if let Some(group) = file.find_group(name) {
                let sampler = WorldSampler::of_group(&self.file, group, self.options)?;
                (sampler, group.maps.clone())
            } else if let Some(map) = file.find(name) {
                let sampler = WorldSampler::with_options(&self.file, map, self.options)?;
                (sampler, vec![map])
            } else {
                return Err(missing(file, name));
            };
            let coloured = |map: &MapId| file.maps()[map.index()].header.channels > 1;
            let coloured = maps.iter().any(coloured);
            Ok(LampSampler { sampler, coloured })
        };
        self.lamps.iter().map(sampler).collect()
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
        let light = match self.coloured {
            false => self.sampler.visibility(&query).map(|v| [v; 3]),
            true => self.sampler.visibility_rgb(&query),
        };
        Ok(light?)
    }
}

/// Whether two cameras are equal but for rounding.
fn is_near(a: Camera, b: Camera) -> bool {
    let matrices = [
        (a.camera_from_world, b.camera_from_world),
        (a.ndc_from_world, b.ndc_from_world),
    ];
    matrices.into_iter().all(|pair| match pair {
        (Some(a), Some(b)) => {
            let largest = a.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            a.iter()
                .zip(&b)
                .all(|(a, b)| (a - b).abs() <= 1e-6 * largest)
        }
        pair => pair == (None, None),
    })
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
