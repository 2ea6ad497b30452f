//! Specification of an object in a scene file or on the command line, and its conversion to
//! objects.

use std::path::{Path, PathBuf};

use crate::error::{InFile, Result};
use glam::{DAffine3, DMat4, DQuat, DVec3, EulerRot};
use serde::Deserialize;

use super::spec::{FAR, Numbers, fault, finite};
use super::{Object, Shape, Texture, Volume};
use crate::demo;
use crate::geometry;
use crate::load::{self, Loaded, RawShape};
use crate::transfer::TransferFunction;

/// An object as specified. Exactly one of `file`, `frames` and `demo` is required.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSpec {
    /// A label for people; defaults to the name of the file or demo.
    pub name: Option<String>,
    /// A file with a mesh, curves or a volume.
    pub file: Option<PathBuf>,
    /// The name of a demo.
    pub demo: Option<String>,
    /// Files with the same mesh or curves at equal steps of the shutter, instead of `file`.
    pub frames: Option<Vec<PathBuf>>,
    /// Fraction of light that a surface blocks: one number or three, 0 to 1.
    pub opacity: Option<Numbers<3>>,
    /// Colour of reflected or scattered light, for pictures: one number or three.
    pub color: Option<Numbers<3>>,
    /// A PNG that multiplies the opacity of a mesh with texture coordinates.
    pub texture: Option<PathBuf>,
    /// Width of all strands in object space; replaces the widths of the file.
    pub width: Option<f64>,
    /// Whether the object is in the maps.
    pub shadow: Option<bool>,
    /// Distances along x, y and z.
    pub translate: Option<[f64; 3]>,
    /// Degrees about x, then y, then z.
    pub rotate: Option<[f64; 3]>,
    /// One factor or three.
    pub scale: Option<Numbers<3>>,
    /// The whole transform as a matrix, by rows, for row vectors.
    pub matrix: Option<[f64; 16]>,
    /// Transforms at equal steps of the shutter, each after the object's own.
    pub motion: Option<Vec<TransformSpec>>,
    /// Number of samples of a raw volume, as 64x64x93.
    pub shape: Option<String>,
    /// Type of the samples, as u16 or u16be.
    #[serde(rename = "type")]
    pub kind: Option<String>,
    /// A file with a transfer function.
    pub transfer: Option<PathBuf>,
    /// Factor of the transfer function, per unit of length in the world: one number or three.
    pub extinction: Option<Numbers<3>>,
    /// Distance between samples of a ray, in voxels.
    pub step: Option<f64>,
}

/// A transform: scales, then rotates, then translates; or a matrix.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformSpec {
    /// Distances along x, y and z.
    pub translate: Option<[f64; 3]>,
    /// Degrees about x, then y, then z.
    pub rotate: Option<[f64; 3]>,
    /// One factor or three.
    pub scale: Option<Numbers<3>>,
    /// The whole transform by rows, for row vectors: p' = p M.
    pub matrix: Option<[f64; 16]>,
}

impl TransformSpec {
    /// The transform from object space.
    ///
    /// # Errors
    /// Numbers that are not finite, a scale of 0, a matrix that flattens space or is not affine, or
    /// a matrix together with other keys.
    pub fn transform(&self) -> Result<DAffine3> {
        if let Some(m) = self.matrix {
            if self.translate.is_some() || self.rotate.is_some() || self.scale.is_some() {
                return fault(
                    "matrix",
                    "it replaces translate, rotate and scale: leave those out",
                );
            }
            // The rows of a matrix for row vectors are the columns of one for column vectors.
            let m = DMat4::from_cols_array(&finite("matrix", m, -FAR..=FAR)?);
            if m.row(3) != glam::DVec4::W {
                return fault("matrix", "its last column is not 0, 0, 0, 1");
            }
            let m = DAffine3::from_mat4(m);
            return match m.matrix3.determinant() {
                d if d == 0.0 || !d.is_finite() => fault("matrix", "it flattens space"),
                _ => Ok(m),
            };
        }
        let translate = finite("translate", self.translate.unwrap_or_default(), -FAR..=FAR)?;
        let [x, y, z] =
            finite("rotate", self.rotate.unwrap_or_default(), -1e6..=1e6)?.map(f64::to_radians);
        let scale = finite("scale", self.scale.map_or([1.0; 3], |s| s.0), -FAR..=FAR)?;
        if scale.contains(&0.0) {
            return fault("scale", "0 flattens the object");
        }
        // About x first: rotations of column vectors apply from right to left.
        let rotate = DQuat::from_euler(EulerRot::ZYX, z, y, x);
        Ok(DAffine3::from_scale_rotation_translation(
            DVec3::from_array(scale),
            rotate,
            DVec3::from_array(translate),
        ))
    }
}

impl ObjectSpec {
    /// The specified objects: one, or the parts of a demo. Paths are relative to `folder`.
    ///
    /// # Errors
    /// An invalid key, or an error in a file.
    pub fn objects(&self, folder: &Path, seed: u64) -> Result<Vec<Object>> {
        let parts = self.parts(folder, seed)?;
        let kinds = parts.iter().map(|p| &p.form).collect::<Vec<_>>();
        self.check_keys(&kinds)?;
        let motion = self.motion()?;
        parts
            .into_iter()
            .map(|part| self.object(part, folder, &motion))
            .collect()
    }

    fn parts(&self, folder: &Path, seed: u64) -> Result<Vec<Part>> {
        let raw = match (&self.shape, &self.kind) {
            (Some(shape), kind) => Some(RawShape::new(shape, kind.as_deref().unwrap_or("u8"))?),
            (None, Some(_)) => {
                return fault("type", "it needs a `shape`");
            }
            (None, None) => None,
        };
        let read = |file: &PathBuf| load::object(&folder.join(file), raw);
        let name = |file: &Path| {
            file.file_stem()
                .map_or_else(String::new, |s| s.to_string_lossy().into_owned())
        };
        match (&self.file, &self.demo, &self.frames) {
            (Some(file), None, None) => Ok(vec![Part {
                name: self.name.clone().unwrap_or_else(|| name(file)),
                form: read(file)?,
                opacity: None,
            }]),
            (None, None, Some(frames)) => {
                let Some(first) = frames.first() else {
                    return fault("frames", "the list is empty");
                };
                if frames.len() > MAX_KEYS {
                    return fault(
                        "frames",
                        format!("{} are more than {MAX_KEYS}", frames.len()),
                    );
                }
                let paths: Vec<_> = frames.iter().map(|f| folder.join(f)).collect();
                Ok(vec![Part {
                    name: self.name.clone().unwrap_or_else(|| name(first)),
                    form: load::frames(&paths, raw)?,
                    opacity: None,
                }])
            }
            (None, Some(demo), None) => {
                if raw.is_some() {
                    return fault("shape", "only a .raw file takes a shape");
                }
                let Some(made) = demo::by_name(demo, seed) else {
                    let names: Vec<_> = demo::names().map(|(name, _)| name).collect();
                    return fault(
                        "demo",
                        format!("{demo:?} is not one of {}", names.join(", ")),
                    );
                };
                let name = self.name.as_deref().unwrap_or(demo);
                let part = |part: demo::Part| Part {
                    name: format!("{name}.{}", part.name),
                    form: part.geometry,
                    opacity: Some(part.opacity),
                };
                Ok(made.parts.into_iter().map(part).collect())
            }
            (None, None, None) => fault("file", "an object needs a file, frames or a demo"),
            _ => fault("file", "an object is one of file, frames and demo"),
        }
    }

    /// Rejects keys that apply to none of the parts.
    fn check_keys(&self, kinds: &[&Loaded]) -> Result<()> {
        let any = |is: fn(&Loaded) -> bool| kinds.iter().any(|k| is(k));
        let volume = any(|k| matches!(k, Loaded::Volume(_)));
        let mesh = any(|k| matches!(k, Loaded::Mesh(_)));
        let curves = any(|k| matches!(k, Loaded::Curves(_)));
        let keys = [
            (
                "opacity",
                self.opacity.is_some(),
                mesh || curves,
                "a volume has a `transfer` function and `extinction`",
            ),
            (
                "texture",
                self.texture.is_some(),
                mesh,
                "only meshes have textures",
            ),
            (
                "width",
                self.width.is_some(),
                curves,
                "only curves have a width",
            ),
            (
                "transfer",
                self.transfer.is_some(),
                volume,
                "only volumes have a transfer function; surfaces have `opacity`",
            ),
            (
                "extinction",
                self.extinction.is_some(),
                volume,
                "only volumes have extinction; surfaces have `opacity`",
            ),
            (
                "step",
                self.step.is_some(),
                volume,
                "only volumes have a step",
            ),
        ];
        match keys.into_iter().find(|(_, given, fits, _)| *given && !fits) {
            Some((key, _, _, why)) => fault(key, why),
            None => Ok(()),
        }
    }

    fn motion(&self) -> Result<Vec<DAffine3>> {
        let own = TransformSpec {
            translate: self.translate,
            rotate: self.rotate,
            scale: self.scale,
            matrix: self.matrix,
        }
        .transform()?;
        let Some(motion) = &self.motion else {
            return Ok(vec![own]);
        };
        if !(2..=MAX_KEYS).contains(&motion.len()) {
            return fault(
                "motion",
                format!("{} transforms are not 2 to {MAX_KEYS}", motion.len()),
            );
        }
        let key = |t: &TransformSpec| match t.transform() {
            Ok(t) => Ok(t * own),
            Err(e) => Err(e.within("motion")),
        };
        motion.iter().map(key).collect()
    }

    fn object(&self, part: Part, folder: &Path, motion: &[DAffine3]) -> Result<Object> {
        let rgb = |n: [f64; 3]| n.map(|v| v as f32);
        let opacity = match &self.opacity {
            Some(Numbers(o)) => rgb(finite("opacity", *o, 0.0..=1.0)?),
            None => [part.opacity.unwrap_or(1.0); 3],
        };
        let color = match &self.color {
            Some(Numbers(c)) => rgb(finite("color", *c, 0.0..=1e6)?),
            None => [1.0; 3],
        };
        let shape = match part.form {
            Loaded::Mesh(mesh) => Shape::Mesh(mesh),
            Loaded::Curves(curves) => {
                let width = match self.width {
                    Some(width) => finite("width", [width], 1e-30..=FAR)?[0] as f32,
                    None => default_width(&curves),
                };
                Shape::Curves {
                    curves: geometry::Curves {
                        // The width in the scene replaces those in the file.
                        widths: if self.width.is_some() {
                            Vec::new()
                        } else {
                            curves.widths
                        },
                        ..curves
                    },
                    width,
                }
            }
            Loaded::Volume(grid) => {
                Shape::Volume(self.volume(grid, part.opacity, folder, motion)?)
            }
        };
        let texture = match (&self.texture, &shape) {
            (Some(file), Shape::Mesh(mesh)) if mesh.uvs.is_empty() => {
                let what = format!("{}: the mesh has no texture coordinates", file.display());
                return fault("texture", what);
            }
            (Some(file), Shape::Mesh(_)) => Some(Texture::read(&folder.join(file))?),
            _ => None,
        };
        let object = Object {
            name: part.name,
            shape,
            motion: motion.to_vec(),
            opacity,
            texture,
            color,
            shadow: self.shadow.unwrap_or(true),
        };
        let sets = match &object.shape {
            Shape::Mesh(mesh) => mesh.positions.len(),
            Shape::Curves { curves, .. } => curves.points.len(),
            Shape::Volume(_) => 1,
        };
        if sets > 1 && motion.len() > 1 && sets != motion.len() {
            let why = format!(
                "{} transforms and {sets} frames: the numbers must be equal, or one must be 1",
                motion.len()
            );
            return fault("motion", why);
        }
        Ok(object)
    }

    fn volume(
        &self,
        grid: geometry::Grid,
        density: Option<f32>,
        folder: &Path,
        motion: &[DAffine3],
    ) -> Result<Volume> {
        let step = finite("step", [self.step.unwrap_or(1.0)], 0.05..=100.0)?[0];
        let transfer = match (&self.transfer, density) {
            (Some(file), _) => transfer(&folder.join(file))?,
            (None, Some(_)) => TransferFunction::linear(0.0, 1.0),
            (None, None) => match grid.range() {
                (lo, hi) if lo < hi => TransferFunction::linear(lo, hi),
                // All samples are equal: all have the full extinction.
                (lo, _) => TransferFunction::linear(lo, lo),
            },
        };
        let extinction = match (&self.extinction, density) {
            (Some(Numbers(k)), _) => finite("extinction", *k, 0.0..=FAR)?,
            (None, Some(density)) => [f64::from(density); 3],
            (None, None) => {
                // The longest side in the world, along the volume's own axes.
                let (axes, size) = (motion[0].matrix3, (grid.last() - grid.origin).as_dvec3());
                let sides = [
                    axes.x_axis * size.x,
                    axes.y_axis * size.y,
                    axes.z_axis * size.z,
                ];
                let longest = sides.into_iter().map(DVec3::length).fold(0.0, f64::max);
                [DEFAULT_OPTICAL_DEPTH / longest; 3]
            }
        };
        let scaled = |&(value, k): &(f32, [f32; 3])| {
            (
                value,
                std::array::from_fn(|c| (f64::from(k[c]) * extinction[c]) as f32),
            )
        };
        let points = transfer.points().iter().map(scaled).collect();
        Ok(Volume {
            grid,
            transfer: TransferFunction::new(points)?,
            step,
        })
    }
}

fn transfer(file: &Path) -> Result<TransferFunction> {
    let bytes = std::fs::read(file).in_file(file)?;
    load::transfer::parse(&bytes).in_file(file)
}

/// Most keys of a motion.
const MAX_KEYS: usize = 64;
/// Default optical depth along the longest side of a volume, if all of it were as dense as its
/// densest sample.
const DEFAULT_OPTICAL_DEPTH: f64 = 8.0;

/// Geometry and name of an object to be.
struct Part {
    name: String,
    form: Loaded,
    /// For demos: the opacity of a surface, or the extinction at density 1.
    opacity: Option<f32>,
}

/// Default width of strands: a thousandth of the diagonal of their bounding box.
fn default_width(curves: &geometry::Curves) -> f32 {
    let bounds = curves.points.first().and_then(geometry::bounds);
    bounds.map_or(1.0, |(lo, hi)| {
        ((hi - lo).length() / 1000.0).max(f32::MIN_POSITIVE)
    })
}
