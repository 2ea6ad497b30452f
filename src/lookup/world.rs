//! Lookups of points in world space: in one map, in the faces around a light, or in the clusters of
//! a scene.

use super::camera::LightSpace;
use super::query::{Border, Footprint, Query, SamplerOptions};
use super::sampler::Sampler;
use crate::cache::CachedFile;
use crate::map::{Group, GroupRole, MapId};
use crate::{Error, Result};

/// The area that a lookup averages, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WorldFootprint {
    Width(f64),
    Ellipse { dx: [f64; 3], dy: [f64; 3] },
}

/// One lookup of a point in world space: the point, a depth bias and a footprint.
///
/// ```
/// use deepshadow::WorldQuery;
/// let q = WorldQuery::new([1.0, 2.0, 3.0]).width(0.5).bias(0.01);
/// assert_eq!((q.point, q.bias), ([1.0, 2.0, 3.0], 0.01));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct WorldQuery {
    /// The point in world space.
    pub point: [f64; 3],
    /// Subtracted from the point's depth before the lookup, in units of depth, as [`Query::bias`].
    pub bias: f32,
    footprint: WorldFootprint,
}

impl WorldQuery {
    /// A lookup of a point, one pixel of the map wide, without bias.
    pub fn new(point: [f64; 3]) -> Self {
        WorldQuery {
            point,
            bias: 0.0,
            footprint: WorldFootprint::Width(0.0),
        }
    }

    /// Sets a round footprint: the projection of a ball of this width. Widths below one pixel of
    /// the map count as one pixel. See [`LightSpace::footprint_of_width`].
    pub fn width(mut self, width: f64) -> Self {
        self.footprint = WorldFootprint::Width(width);
        self
    }

    /// Sets an elliptic footprint: `dx` and `dy` are the moves of the point for one step along each
    /// of the renderer's two directions. See [`LightSpace::footprint`].
    pub fn steps(mut self, dx: [f64; 3], dy: [f64; 3]) -> Self {
        self.footprint = WorldFootprint::Ellipse { dx, dy };
        self
    }

    /// Sets the depth bias.
    pub fn bias(mut self, bias: f32) -> Self {
        self.bias = bias;
        self
    }

    /// # Errors
    /// `Input` for a number that is not finite, and for a width below 0.
    #[inline(always)]
    fn check(&self) -> Result<()> {
        let finite = |v: &[f64; 3]| v.iter().all(|v| v.is_finite());
        let sound = finite(&self.point)
            && self.bias.is_finite()
            && match &self.footprint {
                WorldFootprint::Width(w) => *w >= 0.0 && w.is_finite(),
                WorldFootprint::Ellipse { dx, dy } => finite(dx) && finite(dy),
            };
        if sound { Ok(()) } else { Err(unsound(self)) }
    }
}

#[cold]
fn unsound(query: &WorldQuery) -> Error {
    Error::input(format!("a lookup that is not finite: {query:?}"))
}

impl LightSpace {
    /// The query in the map for a point in world space, for use in a [`Batch`](crate::Batch) or
    /// with a [`Cursor`](crate::Cursor).
    ///
    /// Place, depth and footprint are computed in f64 and rounded to the nearest f32. A renderer
    /// rounds a stored depth in the same way, so a surface at that depth does not shadow the point.
    ///
    /// `None` if the point has no place in the map, as [`LightSpace::light_from_world`] says. Its
    /// visibility is then 1.
    ///
    /// # Errors
    /// `Input` for a point, a footprint or a bias that is not finite, and for a width below 0.
    pub fn query_from_world(&self, query: &WorldQuery) -> Result<Option<Query>> {
        query.check()?;
        Ok(self.map_query(query))
    }

    /// [`LightSpace::query_from_world`] of a query that passed the check.
    #[inline(always)]
    fn map_query(&self, query: &WorldQuery) -> Option<Query> {
        let projected = self.projected(query.point)?;
        let footprint = match query.footprint {
            WorldFootprint::Width(0.0) => Footprint::Width(0.0),
            WorldFootprint::Width(width) => self.round(&projected, width)?,
            WorldFootprint::Ellipse { dx, dy } => self.ellipse(&projected, dx, dy)?,
        };
        Some(Query {
            x: projected.at[0].clamp(-FAR, FAR) as f32,
            y: projected.at[1].clamp(-FAR, FAR) as f32,
            depth: projected.at[2] as f32,
            bias: query.bias,
            footprint,
        })
    }
}

/// A point in no face belongs to a face within this many pixels, so that rounded matrices leave no
/// gap between faces.
const SEAM: f64 = 1.0 / 64.0;

/// All places beyond this many pixels give the same answer: a map has at most 2^20 pixels in a row,
/// and a kernel reaches a few times as far.
const FAR: f64 = (1u64 << 40) as f64;

/// Answers lookups of world-space points in a map, or in a group of maps as its [`GroupRole`] says.
///
/// *One map*: points behind the light are lit. [`Border`] gives the values of points outside the
/// map. For many points at once, use [`LightSpace::query_from_world`] and
/// [`Sampler::visibility_batch`].
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// // A light at the origin looks along +z, 90 degrees wide. In pixel (3, 2), glass at depth 5 lets
/// // a quarter of the light through.
/// let mut light = MapHeader::new("key light", 4, 4);
/// light.depth_kind = DepthKind::Planar;
/// light.camera.camera_from_world = Some([
///     1.0, 0.0, 0.0, 0.0,
///     0.0, 1.0, 0.0, 0.0,
///     0.0, 0.0, 1.0, 0.0,
///     0.0, 0.0, 0.0, 1.0,
/// ]);
/// light.camera.ndc_from_world = Some([
///     0.5, 0.0, 0.0, 0.0,
///     0.0, -0.5, 0.0, 0.0,
///     0.5, 0.5, 0.0, 1.0,
///     0.0, 0.0, 0.0, 0.0,
/// ]);
/// # let mut writer = Writer::in_memory();
/// # let map = writer.add_map(light, Encoding::default())?;
/// # writer.pixel(map, Pixel::new(3, 2), &Curve::mono(vec![5.0], vec![0.25])?)?;
/// # let file = DsmFile::from_bytes(writer.into_bytes()?)?;
/// let light = TileCache::new(64 << 20).add(file);
/// let mut sampler = WorldSampler::new(&light, MapId(0))?;
/// // At a depth of 8 the map is 16 units wide, so a pixel is 4 wide. The centre of pixel (3, 2) is
/// // 1.5 pixels right of the middle and 0.5 pixels below it.
/// let behind = WorldQuery::new([6.0, -2.0, 8.0]);
/// assert_eq!(sampler.visibility(&behind)?, 0.25);
/// // 8 - 3 is the depth of the glass, which does not shadow itself.
/// assert_eq!(sampler.visibility(&behind.bias(3.0))?, 1.0);
/// let behind_the_light = WorldQuery::new([6.0, -2.0, -8.0]);
/// assert_eq!(sampler.visibility(&behind_the_light)?, 1.0);
/// # Ok(()) }
/// ```
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
/// let group = light.file().find_group("trees").unwrap();
/// let mut trees = WorldSampler::of_group(&light, group, SamplerOptions::default())?;
/// assert_eq!(trees.visibility(&WorldQuery::new([1.0, 0.0, 1.0]))?, 0.375); // 0.5 x 0.75
/// assert_eq!(trees.visibility(&WorldQuery::new([1.0, 6.0, 1.0]))?, 1.0); // above both
/// assert_eq!(trees.visibility(&WorldQuery::new([9.0, 0.0, 1.0]))?, 1.0); // outside both
/// # Ok(()) }
/// ```
#[derive(Debug)]
pub struct WorldSampler {
    /// How the maps work together. A single map is a group of one cluster.
    role: GroupRole,
    maps: Box<[(Sampler, LightSpace)]>,
}

impl WorldSampler {
    /// A sampler of a map of a file, with the default options.
    ///
    /// # Errors
    /// As [`WorldSampler::with_options`].
    pub fn new(file: &CachedFile, map: MapId) -> Result<Self> {
        Self::with_options(file, map, SamplerOptions::default())
    }

    /// A sampler of a map with these options.
    ///
    /// # Errors
    /// `Input` as [`Sampler::with_options`], and as [`LightSpace::of`] if the map's header does not
    /// describe the projection.
    pub fn with_options(file: &CachedFile, map: MapId, options: SamplerOptions) -> Result<Self> {
        Self::of_maps(file, GroupRole::Clusters, &[map], options)
    }

    /// A sampler of a group of maps, with these options. The group's role replaces the option
    /// [`Border`].
    ///
    /// # Errors
    /// For each of its maps as [`WorldSampler::with_options`].
    pub fn of_group(file: &CachedFile, group: &Group, options: SamplerOptions) -> Result<Self> {
        let border = match group.role {
            GroupRole::Faces => Border::Clamp,
            GroupRole::Clusters => Border::Lit,
        };
        Self::of_maps(file, group.role, &group.maps, options.border(border))
    }

    fn of_maps(
        file: &CachedFile,
        role: GroupRole,
        maps: &[MapId],
        options: SamplerOptions,
    ) -> Result<Self> {
        let map = |&map: &MapId| {
            let sampler = Sampler::with_options(file, map, options)?;
            let space = LightSpace::of(&file.file().map(map)?.header).map_err(|e| e.at(map))?;
            Ok((sampler, space))
        };
        let maps = maps.iter().map(map).collect::<Result<_>>()?;
        Ok(WorldSampler { role, maps })
    }

    /// The sampler of each map, and the projection of world space into it, in the group's order.
    pub fn maps(&mut self) -> &mut [(Sampler, LightSpace)] {
        &mut self.maps
    }

    /// Index in the group of the first map that holds a point; `None` if no map holds it. For
    /// clusters, later maps may hold it too.
    pub fn face_of(&self, point: [f64; 3]) -> Option<usize> {
        let mut nearby = None;
        for (i, (_, space)) in self.maps.iter().enumerate() {
            let beyond = space.beyond(point);
            if beyond <= 0.0 {
                return Some(i);
            }
            if beyond <= SEAM && nearby.is_none() {
                nearby = Some(i);
            }
        }
        nearby
    }

    /// Fraction of light, 0 to 1, that reaches the query's point; in a coloured map the red
    /// channel.
    ///
    /// Cost: that of [`Sampler::visibility`] and of two products with a matrix; a footprint other
    /// than a point doubles the cost of the products. For faces, also a projection for each face up
    /// to the one that answers; for clusters, a lookup in each map up to the first dark one.
    ///
    /// # Errors
    /// `Input` for a point, a footprint or a bias that is not finite, also where the point has no
    /// place in the map, and for a width below 0; otherwise as [`Sampler::visibility`].
    #[inline]
    pub fn visibility(&mut self, query: &WorldQuery) -> Result<f32> {
        self.answer(query).map(|[v]| v)
    }

    /// [`WorldSampler::visibility`] for red, green and blue.
    ///
    /// # Errors
    /// As [`WorldSampler::visibility`].
    pub fn visibility_rgb(&mut self, query: &WorldQuery) -> Result<[f32; 3]> {
        self.answer(query)
    }

    #[inline(always)]
    fn answer<const C: usize>(&mut self, query: &WorldQuery) -> Result<[f32; C]> {
        query.check()?;
        let maps = match self.role {
            GroupRole::Clusters => &mut *self.maps,
            GroupRole::Faces => match self.face_of(query.point) {
                Some(face) => &mut self.maps[face..=face],
                None => &mut [],
            },
        };
        let mut product = [1.0f64; C];
        for (sampler, space) in maps {
            let Some(query) = space.map_query(query) else {
                continue;
            };
            let v = sampler.answer::<C>(&query)?;
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
