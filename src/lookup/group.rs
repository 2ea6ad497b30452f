//! Lookups in a group of maps of one file: the faces around a light, or the clusters of a scene.

use super::query::{Border, SamplerOptions};
use super::world::{WorldQuery, WorldSampler};
use crate::cache::CachedFile;
use crate::{Error, Group, GroupRole, Result};

/// A point in no face belongs to a face within this many pixels, so that rounded matrices leave no
/// gap between faces.
const SEAM: f64 = 1.0 / 64.0;

/// Answers lookups of world-space points in a group of maps, as its [`GroupRole`] says.
///
/// *Faces*: only the map whose frustum holds the point answers. If several hold it, as on an edge
/// of a cube, the first in the group's order answers. A point in no face is lit. Rounded matrices
/// leave gaps between faces; a point in a gap belongs to the first face within 1/64 pixel. The
/// option [`Border`] is always `Clamp`, because lit borders would leak light at the edges of faces.
///
/// *Clusters*: every map answers, and the answers are multiplied. A map's answer is 1 where the
/// point is behind its light or outside its pixels: the option [`Border`] is always `Lit`. A filter
/// at a map's border averages with light. The maximum errors of the maps add up.
///
/// Each thread needs its own. It holds one [`Sampler`](crate::Sampler) for each map.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// # let mut writer = Writer::in_memory();
/// // Two clusters, seen from above the origin. Leaves let half of the light through, and smoke
/// // lets three quarters through.
/// for (name, light) in [("leaves", 0.5), ("smoke", 0.75)] {
///     let mut cluster = MapHeader::new(name, 8, 8);
///     cluster.depth_kind = DepthKind::Planar; // from y = 10 downwards
///     cluster.camera.camera_from_world = Some([
///         1.0, 0.0, 0.0, 0.0,
///         0.0, 0.0, -1.0, 0.0,
///         0.0, 1.0, 0.0, 0.0,
///         0.0, 0.0, 10.0, 1.0,
///     ]);
///     cluster.camera.ndc_from_world = Some([
///         0.125, 0.0, 0.0, 0.0, // 8 units are 8 pixels
///         0.0, 0.0, 0.0, 0.0,
///         0.0, -0.125, 0.0, 0.0,
///         0.5, 0.5, 0.0, 1.0,
///     ]);
///     let map = writer.add_map(cluster, Encoding::default())?;
///     for (x, y) in (0..64).map(|i| (i % 8, i / 8)) {
///         writer.pixel(map, Pixel::new(x, y), &Curve::mono(vec![5.0], vec![light])?)?;
///     }
/// }
/// writer.add_group(Group::new("trees", GroupRole::Clusters, vec![MapId(0), MapId(1)]));
/// # let file = DsmFile::from_bytes(writer.into_bytes()?)?;
/// let light = TileCache::new(64 << 20).add(file);
/// let mut trees = GroupSampler::named(&light, "trees", SamplerOptions::default())?;
/// assert_eq!(trees.visibility(&WorldQuery::new([1.0, 0.0, 1.0]))?, 0.375); // 0.5 x 0.75
/// assert_eq!(trees.visibility(&WorldQuery::new([1.0, 6.0, 1.0]))?, 1.0); // above both
/// assert_eq!(trees.visibility(&WorldQuery::new([9.0, 0.0, 1.0]))?, 1.0); // outside both
/// # Ok(()) }
/// ```
#[derive(Debug)]
pub struct GroupSampler {
    group: Group,
    samplers: Box<[WorldSampler]>,
}

impl GroupSampler {
    /// A sampler of the group with index `group` in a file, with the default options.
    ///
    /// # Errors
    /// As [`GroupSampler::with_options`].
    pub fn new(file: &CachedFile, group: usize) -> Result<Self> {
        Self::with_options(file, group, SamplerOptions::default())
    }

    /// A sampler of the group with this name.
    ///
    /// # Errors
    /// `Input` if the file has no group with this name; otherwise as
    /// [`GroupSampler::with_options`].
    pub fn named(file: &CachedFile, name: &str, options: SamplerOptions) -> Result<Self> {
        let mut groups = file.file().groups().iter();
        let group = groups
            .position(|g| g.name == name)
            .ok_or_else(|| Error::input(format!("the file has no group {name:?}")))?;
        Self::with_options(file, group, options)
    }

    /// A sampler with these options. The group's role replaces the option [`Border`].
    ///
    /// # Errors
    /// `Input` if there is no such group; for each of its maps as [`WorldSampler::with_options`].
    pub fn with_options(file: &CachedFile, group: usize, options: SamplerOptions) -> Result<Self> {
        let groups = file.file().groups();
        let group = groups.get(group).cloned().ok_or_else(|| {
            Error::input(format!(
                "there is no group {group} in a file of {} groups",
                groups.len()
            ))
        })?;
        let border = match group.role {
            GroupRole::Faces => Border::Clamp,
            GroupRole::Clusters => Border::Lit,
        };
        let options = SamplerOptions { border, ..options };
        let samplers = group
            .maps
            .iter()
            .map(|&map| WorldSampler::with_options(file, map, options))
            .collect::<Result<_>>()?;
        Ok(GroupSampler { group, samplers })
    }

    /// The group.
    pub fn group(&self) -> &Group {
        &self.group
    }

    /// The samplers of the maps, in the group's order.
    pub fn samplers(&mut self) -> &mut [WorldSampler] {
        &mut self.samplers
    }

    /// Index into [`Group::maps`] of the first map that holds a point; `None` if no map holds it.
    /// For clusters, later maps may hold it too.
    pub fn face_of(&self, point: [f64; 3]) -> Option<usize> {
        let mut nearby = None;
        for (i, sampler) in self.samplers.iter().enumerate() {
            let beyond = sampler.light_space().beyond(point);
            if beyond <= 0.0 {
                return Some(i);
            }
            if beyond <= SEAM && nearby.is_none() {
                nearby = Some(i);
            }
        }
        nearby
    }

    /// Fraction of light, 0 to 1, that reaches the query's point; in coloured maps the red channel.
    ///
    /// Cost: for faces, a projection for each face up to the one that answers, and one lookup; for
    /// clusters, a lookup in each map up to the first dark one.
    ///
    /// # Errors
    /// As [`WorldSampler::visibility`].
    pub fn visibility(&mut self, query: &WorldQuery) -> Result<f32> {
        let one = |sampler: &mut WorldSampler| Ok([sampler.visibility(query)?]);
        self.answer(query, one).map(|[v]| v)
    }

    /// [`GroupSampler::visibility`] for red, green and blue.
    ///
    /// # Errors
    /// As [`WorldSampler::visibility`].
    pub fn visibility_rgb(&mut self, query: &WorldQuery) -> Result<[f32; 3]> {
        self.answer(query, |sampler| sampler.visibility_rgb(query))
    }

    fn answer<const C: usize>(
        &mut self,
        query: &WorldQuery,
        mut one: impl FnMut(&mut WorldSampler) -> Result<[f32; C]>,
    ) -> Result<[f32; C]> {
        query.check()?;
        if self.group.role == GroupRole::Faces {
            return match self.face_of(query.point) {
                Some(face) => one(&mut self.samplers[face]),
                None => Ok([1.0; C]),
            };
        }
        let mut product = [1.0f64; C];
        for sampler in &mut self.samplers {
            let v = one(sampler)?;
            for (product, v) in product.iter_mut().zip(v) {
                *product *= f64::from(v);
            }
            if product == [0.0; C] {
                break; // more factors change nothing
            }
        }
        Ok(product.map(|v| v as f32))
    }
}
