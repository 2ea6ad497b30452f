//! What a map is made from: objects that stop light, lights that see them, and where a picture of it all is taken from.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@light`] | lights, and the views that their maps are of |
//! | [`mod@texture`] | opacity over a surface |
//! | [`mod@file`] | scene files |
//! | [`mod@object`], [`mod@lamp`] | what is said of objects and lights, in a file or on the command line |
//! | [`mod@spec`] | how things are said, and refused |

pub mod file;
pub mod lamp;
pub mod light;
pub mod object;
pub mod spec;
pub mod texture;

use crate::error::{Error, ErrorKind, Result};
use glam::{DAffine3, DVec3, Vec3};

use crate::geometry::{Curves, Grid, Mesh};
use crate::transfer::TransferFunction;
pub use light::{Light, LightKind, View};
pub use texture::Texture;

/// A scene, ready to be seen: all files are read, all numbers checked.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// What stops light.
    pub objects: Vec<Object>,
    /// What shines; each becomes a map, a point light six.
    pub lights: Vec<Light>,
    /// Where pictures of the scene are taken from, if it says so.
    pub camera: Option<PictureCamera>,
    /// All chance comes from it.
    pub seed: u64,
}

/// One thing in a scene.
#[derive(Clone, Debug)]
pub struct Object {
    /// What it is called, for people.
    pub name: String,
    /// Its form, in its own space.
    pub shape: Shape,
    /// From its space to the world's, at keys that divide the shutter evenly: one stands still. Between keys, points of meshes and curves move in straight
    /// lines. As many as the shape has sets of points, or either is one.
    pub motion: Vec<DAffine3>,
    /// The fraction of light that a surface stops, for red, green and blue, 0 to 1. Volumes have a transfer function instead.
    pub opacity: [f32; 3],
    /// What multiplies the opacity of a mesh that has texture coordinates.
    pub texture: Option<Texture>,
    /// The colour that it reflects or scatters, for pictures.
    pub color: [f32; 3],
    /// Whether it is in the maps.
    pub shadow: bool,
}

/// The form of an object.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Surfaces.
    Mesh(Mesh),
    /// Strands: ribbons that face whoever looks.
    Curves {
        /// The strands.
        curves: Curves,
        /// Their width where they have none of their own, in object space.
        width: f32,
    },
    /// A medium.
    Volume(Volume),
}

/// A medium that fills a grid.
#[derive(Clone, Debug)]
pub struct Volume {
    /// The values.
    pub grid: Grid,
    /// Extinction per unit of length in the world, of a value.
    pub transfer: TransferFunction,
    /// Distance between the samples of a ray, in cells of the grid.
    pub step: f64,
}

/// Where a picture is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureCamera {
    /// The eye.
    pub position: DVec3,
    /// The middle of the picture.
    pub target: DVec3,
    /// Upwards in the picture.
    pub up: DVec3,
    /// Field of view in degrees, over the height.
    pub angle: f64,
    /// Pixels: width and height.
    pub resolution: [u32; 2],
}

impl Object {
    /// An opaque white object that stands still where its points say.
    pub fn new(name: impl Into<String>, shape: Shape) -> Self {
        Object {
            name: name.into(),
            shape,
            motion: vec![DAffine3::IDENTITY],
            opacity: [1.0; 3],
            texture: None,
            color: [1.0; 3],
            shadow: true,
        }
    }

    /// Keys over the shutter; 1 for what stands still.
    pub fn keys(&self) -> usize {
        let sets = match &self.shape {
            Shape::Mesh(mesh) => mesh.positions.len(),
            Shape::Curves { curves, .. } => curves.points.len(),
            Shape::Volume(_) => 1,
        };
        sets.max(self.motion.len())
    }

    /// From its space to the world's at key `key`.
    pub fn world_from_object(&self, key: usize) -> DAffine3 {
        self.motion[key.min(self.motion.len() - 1)]
    }

    /// Visits every point that bounds it, in the world, at all keys of the shutter.
    pub fn points(&self, mut visit: impl FnMut(DVec3)) {
        for key in 0..self.keys() {
            let to_world = self.world_from_object(key);
            let mut set = |sets: &[Vec<Vec3>]| {
                let set = &sets[key.min(sets.len() - 1)];
                set.iter()
                    .for_each(|p| visit(to_world.transform_point3(p.as_dvec3())));
            };
            match &self.shape {
                Shape::Mesh(mesh) => set(&mesh.positions),
                Shape::Curves { curves, .. } => set(&curves.points),
                Shape::Volume(volume) => {
                    let ends = [volume.grid.origin, volume.grid.last()];
                    for corner in 0..8 {
                        let pick = |axis: usize| ends[corner >> axis & 1][axis];
                        let corner = Vec3::new(pick(0), pick(1), pick(2)).as_dvec3();
                        visit(to_world.transform_point3(corner));
                    }
                }
            }
        }
    }

    /// Whether its opacity or extinction differs between red, green and blue.
    pub fn is_coloured(&self) -> bool {
        match &self.shape {
            Shape::Volume(volume) => volume.transfer.is_coloured(),
            _ => {
                let [r, g, b] = self.opacity;
                r != g || g != b || self.texture.as_ref().is_some_and(Texture::is_coloured)
            }
        }
    }
}

impl Scene {
    /// The least box in the world that holds all that is in the maps.
    ///
    /// # Errors
    /// `Failed` if there is nothing.
    pub fn bounds(&self) -> Result<(DVec3, DVec3)> {
        self.extent(|p| p)
    }

    /// The least box that holds what `place` makes of all points in the maps.
    ///
    /// # Errors
    /// `Failed` if there is nothing.
    pub fn extent(&self, place: impl Fn(DVec3) -> DVec3) -> Result<(DVec3, DVec3)> {
        let mut all: Option<(DVec3, DVec3)> = None;
        for object in self.objects.iter().filter(|o| o.shadow) {
            object.points(|p| {
                let p = place(p);
                let (lo, hi) = all.unwrap_or((p, p));
                all = Some((lo.min(p), hi.max(p)));
            });
        }
        all.ok_or_else(|| Error::new(ErrorKind::Scene, "nothing in the scene casts a shadow"))
    }

    /// Whether anything that casts a shadow moves.
    pub fn moves(&self) -> bool {
        self.objects.iter().any(|o| o.shadow && o.keys() > 1)
    }
}
