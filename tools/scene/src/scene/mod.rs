//! Scenes: objects that block light, lights, and the camera of a picture.
//!
//! | module | content |
//! |---|---|
//! | [`mod@light`] | lights and the views of their maps |
//! | [`mod@texture`] | textures of opacity |
//! | [`mod@file`] | scene files |
//! | [`mod@object`], [`mod@lamp`] | specifications of objects and lights, from a file or the
//! command line |
//! | [`mod@spec`] | shared parsing and validation |

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

/// A scene with all files read and all values validated.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Objects.
    pub objects: Vec<Object>,
    /// Lights. Each becomes a map, a point light six.
    pub lights: Vec<Light>,
    /// The camera of pictures, if the scene has one.
    pub camera: Option<PictureCamera>,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// An object of a scene.
#[derive(Clone, Debug)]
pub struct Object {
    /// A label for people.
    pub name: String,
    /// The shape, in object space.
    pub shape: Shape,
    /// Transforms from object space to the world at keys that divide the shutter evenly; a static
    /// object has one. Between keys, points of meshes and curves move in straight lines. If the
    /// shape has several sets of points, there is one transform or as many as sets.
    pub motion: Vec<DAffine3>,
    /// The fraction of light that a surface blocks, for red, green and blue, 0 to 1. Volumes have a
    /// transfer function instead.
    pub opacity: [f32; 3],
    /// Multiplies the opacity of a mesh with texture coordinates.
    pub texture: Option<Texture>,
    /// Colour of reflected or scattered light, for pictures.
    pub color: [f32; 3],
    /// Whether the object is in the maps.
    pub shadow: bool,
}

/// The shape of an object.
#[derive(Clone, Debug)]
pub enum Shape {
    /// Surfaces.
    Mesh(Mesh),
    /// Strands: ribbons that face the light or the camera.
    Curves {
        /// The strands.
        curves: Curves,
        /// Width of strands without their own widths, in object space.
        width: f32,
    },
    /// A participating medium.
    Volume(Volume),
}

/// A participating medium on a grid.
#[derive(Clone, Debug)]
pub struct Volume {
    /// The samples.
    pub grid: Grid,
    /// Maps a sample to extinction per unit of length in the world.
    pub transfer: TransferFunction,
    /// Distance between samples along a ray, in cells of the grid.
    pub step: f64,
}

/// The camera of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureCamera {
    /// Position of the camera.
    pub position: DVec3,
    /// The point at the centre of the picture.
    pub target: DVec3,
    /// The up direction of the picture.
    pub up: DVec3,
    /// Angle of view of the picture's height, in degrees.
    pub angle: f64,
    /// Pixels: width and height.
    pub resolution: [u32; 2],
}

impl Object {
    /// An opaque white static object, with its points in world space.
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

    /// Number of keys over the shutter; 1 for a static object.
    pub fn keys(&self) -> usize {
        let sets = match &self.shape {
            Shape::Mesh(mesh) => mesh.positions.len(),
            Shape::Curves { curves, .. } => curves.points.len(),
            Shape::Volume(_) => 1,
        };
        sets.max(self.motion.len())
    }

    /// Transform from object space to the world at key `key`.
    pub fn world_from_object(&self, key: usize) -> DAffine3 {
        self.motion[key.min(self.motion.len() - 1)]
    }

    /// Visits all points that bound the object, in world space, at all keys of the shutter.
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

    /// Whether the opacity or extinction differs between red, green and blue.
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
    /// Bounding box in the world of all objects that cast shadows.
    ///
    /// # Errors
    /// [`ErrorKind::Scene`] if there are none.
    pub fn bounds(&self) -> Result<(DVec3, DVec3)> {
        self.extent(|p| p)
    }

    /// Bounding box of all points that cast shadows, each mapped by `place`.
    ///
    /// # Errors
    /// [`ErrorKind::Scene`] if there are none.
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

    /// Whether any object that casts a shadow moves.
    pub fn moves(&self) -> bool {
        self.objects.iter().any(|o| o.shadow && o.keys() > 1)
    }
}
