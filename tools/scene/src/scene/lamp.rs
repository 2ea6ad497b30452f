//! Specification of a light in a scene file or on the command line, and its conversion to a light.

use deepshadow::{DepthKind, Filter};
use glam::DVec3;
use serde::Deserialize;

use crate::error::Result;

use super::light::{Light, LightKind};
use super::spec::{FAR, Numbers, fault, finite, named};

/// A light as specified.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampSpec {
    /// Name of the map; defaults to `light`.
    pub name: Option<String>,
    /// `spot`, `directional` or `point`; by default, the other keys decide.
    #[serde(rename = "type")]
    pub kind: Option<LampKind>,
    /// Position of a spot or point light.
    pub position: Option<[f64; 3]>,
    /// The point at the centre of a spot or directional light's map; defaults to the middle of the
    /// scene.
    pub target: Option<[f64; 3]>,
    /// The up direction of the map; defaults to y.
    pub up: Option<[f64; 3]>,
    /// Angle of view of the shorter side of a spot's map, in degrees.
    pub angle: Option<f64>,
    /// Direction in which a directional light travels.
    pub direction: Option<[f64; 3]>,
    /// Length of the shorter side of a directional light's map, in the world.
    pub size: Option<f64>,
    /// Intensity, for pictures: one number or three.
    pub color: Option<Numbers<3>>,
    /// Pixels: one number, or width and height.
    pub resolution: Option<Numbers<2>>,
    /// Rays per pixel.
    pub samples: Option<u32>,
    /// Weights of the rays around a pixel.
    #[serde(default, deserialize_with = "named")]
    pub filter: Option<Filter>,
    /// Width of the filter, in pixels.
    pub filter_width: Option<f64>,
    /// Largest error of a function; defaults to the rule of LV00, section 4.
    pub tolerance: Option<f64>,
    /// What depths measure.
    #[serde(default, deserialize_with = "named")]
    pub depth: Option<DepthKind>,
}

/// Types of lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LampKind {
    /// Light from a point, in a cone.
    Spot,
    /// Parallel rays.
    Directional,
    /// Light from a point, in all directions.
    Point,
}

/// Most pixels along a side of a map.
const MAX_SIDE: f64 = (1 << 20) as f64;
impl LampSpec {
    /// The specified light.
    ///
    /// # Errors
    /// An invalid key.
    pub fn light(&self) -> Result<Light> {
        let mut light = Light::new(self.name.as_deref().unwrap_or("light"), self.place()?);
        if !(1..=200).contains(&light.name.len()) {
            return fault("name", "it is not 1 to 200 bytes long");
        }
        if let Some(Numbers(color)) = self.color {
            light.color = finite("color", color, 0.0..=FAR)?.map(|v| v as f32);
        }
        self.settings(&mut light)?;
        Ok(light)
    }

    /// Applies the specified settings of the map and its rays to a light, and leaves the others
    /// unchanged.
    ///
    /// # Errors
    /// An invalid key.
    pub fn settings(&self, light: &mut Light) -> Result<()> {
        if let Some(Numbers(size)) = self.resolution {
            finite("resolution", size, 1.0..=MAX_SIDE)?;
            if size.iter().any(|s| s.fract() != 0.0) {
                return fault("resolution", "it is not a whole number of pixels");
            }
            if matches!(light.kind, LightKind::Point { .. }) && size[0] != size[1] {
                return fault("resolution", "the faces of a point light are square");
            }
            light.resolution = size.map(|s| s as u32);
        }
        if let Some(samples) = self.samples {
            if !(1..=4096).contains(&samples) {
                return fault("samples", format!("{samples} is not from 1 to 4096"));
            }
            light.samples = samples;
        }
        if let Some(filter) = self.filter {
            if filter == Filter::Nearest {
                return fault("filter", "nearest is not a filter of rays");
            }
            light.filter = filter;
        }
        if let Some(width) = self.filter_width {
            light.filter_width = finite("filter_width", [width], 1.0..=16.0)?[0] as f32;
        }
        if light.filter == Filter::CatmullRom && light.samples < 4 {
            return fault(
                "filter",
                "catmull-rom has negative lobes: it needs 4 samples or more",
            );
        }
        if let Some(tolerance) = self.tolerance {
            light.tolerance = Some(finite("tolerance", [tolerance], 0.0..=1.0)?[0]);
        }
        if let Some(depth) = self.depth {
            if depth == DepthKind::Unspecified {
                return fault("depth", "it is neither planar nor ray");
            }
            light.depth = depth;
        }
        Ok(())
    }

    fn place(&self) -> Result<LightKind> {
        let kind = match (self.kind, self.direction, self.position) {
            (Some(kind), ..) => kind,
            (None, Some(_), _) => LampKind::Directional,
            (None, None, Some(_)) => LampKind::Spot,
            (None, None, None) => return fault("type", "a light needs a direction or a position"),
        };
        let name = format!("{kind:?}").to_lowercase();
        let keys = [
            (
                "position",
                self.position.is_some(),
                kind != LampKind::Directional,
            ),
            ("target", self.target.is_some(), kind != LampKind::Point),
            ("up", self.up.is_some(), kind != LampKind::Point),
            ("angle", self.angle.is_some(), kind == LampKind::Spot),
            (
                "direction",
                self.direction.is_some(),
                kind == LampKind::Directional,
            ),
            ("size", self.size.is_some(), kind == LampKind::Directional),
        ];
        if let Some((key, ..)) = keys.into_iter().find(|(_, given, fits)| *given && !fits) {
            return fault(key, format!("a {name} light does not have this key"));
        }
        let point = |key, p: [f64; 3]| finite(key, p, -FAR..=FAR).map(DVec3::from_array);
        let maybe = |key, p: Option<[f64; 3]>| p.map(|p| point(key, p)).transpose();
        let need = |key: &'static str, p: Option<[f64; 3]>| match p {
            Some(p) => point(key, p),
            None => fault(key, format!("a {name} light needs this key")),
        };
        let up = maybe("up", self.up)?.unwrap_or(DVec3::Y);
        let target = maybe("target", self.target)?;
        Ok(match kind {
            LampKind::Spot => LightKind::Spot {
                position: need("position", self.position)?,
                target,
                up,
                angle: self
                    .angle
                    .map(|a| finite("angle", [a], 0.001..=179.0).map(|[a]| a))
                    .transpose()?,
            },
            LampKind::Directional => {
                let direction = need("direction", self.direction)?;
                if direction == DVec3::ZERO {
                    return fault("direction", "0, 0, 0 is not a direction");
                }
                LightKind::Directional {
                    direction,
                    up,
                    target,
                    size: self
                        .size
                        .map(|s| finite("size", [s], 1e-30..=FAR).map(|[s]| s))
                        .transpose()?,
                }
            }
            LampKind::Point => LightKind::Point {
                position: need("position", self.position)?,
            },
        })
    }
}
