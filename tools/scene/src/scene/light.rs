//! Lights and the views of their maps.

use crate::error::{Error, ErrorKind, Result};
use deepshadow::{Camera, DepthKind, Encoding, Filter, LightSpace, MapHeader};
use glam::DVec3;

use super::Scene;

/// A light and the settings of its map.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Name of the map, or of the group of six maps.
    pub name: String,
    /// Type and placement of the light.
    pub kind: LightKind,
    /// Intensity for pictures: red, green and blue.
    pub color: [f32; 3],
    /// Pixels of the map: width and height. The faces of a point light are square.
    pub resolution: [u32; 2],
    /// Rays per pixel, 1 to 4096, jittered in position and time.
    pub samples: u32,
    /// Weights of the rays around a pixel's centre.
    pub filter: Filter,
    /// Width of the filter, in pixels.
    pub filter_width: f32,
    /// Largest error of a function; `None` means [`Encoding::default_tolerance`] of the samples
    /// (LV00, section 4).
    pub tolerance: Option<f64>,
    /// What depths measure: [`DepthKind::Planar`] or [`DepthKind::RayDistance`].
    pub depth: DepthKind,
}

/// Type and placement of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Light from a point, in a cone.
    Spot {
        /// Position of the light.
        position: DVec3,
        /// The point at the centre of the map; the middle of the scene if `None`.
        target: Option<DVec3>,
        /// The up direction of the map.
        up: DVec3,
        /// Angle of view of the map's shorter side, in degrees; just covers the scene if `None`.
        angle: Option<f64>,
    },
    /// Parallel rays.
    Directional {
        /// Direction in which light travels.
        direction: DVec3,
        /// The up direction of the map.
        up: DVec3,
        /// The point at the centre of the map; the middle of the scene if `None`.
        target: Option<DVec3>,
        /// Length of the map's shorter side in the world; just covers the scene if `None`.
        size: Option<f64>,
    },
    /// Light from a point, in all directions: six maps.
    Point {
        /// Position of the light.
        position: DVec3,
    },
}

/// The view of one map: the light's rays, and the pixel of each ray.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of the map.
    pub name: String,
    /// The camera of the map's header.
    pub camera: Camera,
    /// The same camera, prepared to project points.
    pub space: LightSpace,
    /// What depths measure.
    pub depth: DepthKind,
    /// Pixels: width and height.
    pub size: [u32; 2],
    /// The origin of the view's rays.
    pub eye: Eye,
}

/// The origin and axes of a view's rays, in the world.
#[derive(Clone, Copy, Debug)]
pub struct Eye {
    position: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Size of a pixel, to the right and upwards; at depth 1 for perspective views.
    pixel: [f64; 2],
    /// The pixel at the centre of the view.
    middle: [f64; 2],
    perspective: bool,
}

/// A line: a point, and the displacement along the line per unit of depth.
pub type Line = (DVec3, DVec3);

impl Eye {
    fn new(camera: &Camera, perspective: bool, size: [u32; 2]) -> Option<Self> {
        let (c, n) = (camera.camera_from_world?, camera.ndc_from_world?);
        let column = |m: &[f64; 16], i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
        let [right, up, forward] = [0, 1, 2].map(|i| column(&c, i));
        let [width, height] = size.map(f64::from);
        // The camera's axes, oriented as the map.
        let [x, y] = [
            column(&n, 0).dot(right) * width,
            -column(&n, 1).dot(up) * height,
        ];
        Some(Eye {
            position: -(right * c[12] + up * c[13] + forward * c[14]),
            right,
            up,
            forward,
            pixel: [1.0 / x, 1.0 / y],
            middle: [width / 2.0, height / 2.0],
            perspective,
        })
    }

    /// The ray through a position in the view, in pixels. Its point has depth 0.
    pub fn line(&self, x: f64, y: f64) -> Line {
        let across = self.right * ((x - self.middle[0]) * self.pixel[0]);
        let across = across + self.up * ((self.middle[1] - y) * self.pixel[1]);
        match self.perspective {
            true => (self.position, self.forward + across),
            false => (self.position + across, self.forward),
        }
    }

    /// Coordinates of a point relative to the eye: right, up, forward.
    pub fn axes(&self, point: DVec3) -> DVec3 {
        let p = point - self.position;
        DVec3::new(p.dot(self.right), p.dot(self.up), p.dot(self.forward))
    }

    /// Direction of the light at a point.
    pub fn ray(&self, point: DVec3) -> DVec3 {
        match self.perspective {
            true => point - self.position,
            false => self.forward,
        }
    }
}

impl View {
    fn new(name: String, camera: Camera, depth: DepthKind, size: [u32; 2]) -> Result<Self> {
        let mut header = MapHeader::new(name.clone(), size[0], size[1]);
        header.camera = camera;
        header.depth_kind = depth;
        let space = LightSpace::of(&header)?;
        let eye = Eye::new(&camera, space.is_perspective(), size);
        Ok(View {
            eye: eye
                .ok_or_else(|| Error::new(ErrorKind::Scene, "a camera without its matrices"))?,
            space,
            name,
            camera,
            depth,
            size,
        })
    }
}

impl Light {
    /// A light with the default settings: 512 x 512 pixels of 64 rays each, a box filter one pixel
    /// wide, and planar depths.
    pub fn new(name: impl Into<String>, kind: LightKind) -> Self {
        Light {
            name: name.into(),
            kind,
            color: [1.0; 3],
            resolution: [512; 2],
            samples: 64,
            filter: Filter::Box,
            filter_width: 1.0,
            tolerance: None,
            depth: DepthKind::Planar,
        }
    }

    /// Largest error of the map's functions.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
            .unwrap_or_else(|| Encoding::default_tolerance(self.samples))
    }

    /// Reach of the filter beyond a pixel's border, in whole pixels.
    pub fn margin(&self) -> i32 {
        let reach = match self.filter {
            Filter::Nearest => 0.5,
            filter => filter.radius() * self.filter_width,
        };
        (reach - 0.5).max(0.0).ceil() as i32
    }

    /// The views of the light's maps: one, or six for a point light, which are named after it.
    /// Parameters that are `None` are chosen so that the map covers the scene.
    ///
    /// # Errors
    /// [`ErrorKind::Scene`] if nothing casts a shadow, or if a spot light without an angle does not
    /// have all objects in front of it; [`ErrorKind::Map`] if the camera is degenerate.
    pub fn views(&self, scene: &Scene) -> Result<Vec<View>> {
        let cameras = self
            .cameras(scene)
            .map_err(|e| e.about(format_args!("light {:?}", self.name)))?;
        let faces = ["+x", "-x", "+y", "-y", "+z", "-z"];
        let names = faces.map(|face| format!("{}.{face}", self.name));
        let named = cameras.iter().enumerate().map(|(i, &camera)| {
            let name = if cameras.len() == 1 {
                self.name.clone()
            } else {
                names[i].clone()
            };
            View::new(name, camera, self.depth, self.resolution)
        });
        named.collect()
    }

    fn cameras(&self, scene: &Scene) -> Result<Vec<Camera>> {
        match self.kind {
            LightKind::Spot {
                position,
                target,
                up,
                angle,
            } => {
                let camera = |target: DVec3, angles| {
                    Camera::perspective(
                        position.to_array(),
                        target.to_array(),
                        up.to_array(),
                        angles,
                    )
                };
                let target = match target {
                    Some(target) => target,
                    None => {
                        let (lo, hi) = scene.bounds()?;
                        (lo + hi) / 2.0
                    }
                };
                let tangent = match angle {
                    Some(angle) => (angle.to_radians() / 2.0).tan(),
                    None => {
                        let eye = self.eye(camera(target, [90.0; 2])?)?;
                        let (lo, hi) = scene.extent(|p| {
                            let p = eye.axes(p);
                            // A point that is not in front of the light is outside every angle.
                            if p.z > 0.0 {
                                DVec3::new(p.x / p.z, p.y / p.z, p.z)
                            } else {
                                DVec3::INFINITY
                            }
                        })?;
                        if !hi.is_finite() {
                            let line = "not all objects are in front of it: give it an angle";
                            return Err(Error::new(ErrorKind::Scene, line));
                        }
                        self.shorter(lo.abs().max(hi.abs()), 1e-12)
                    }
                };
                let angles = self.sides(tangent).map(|t| 2.0 * t.atan().to_degrees());
                Ok(vec![camera(target, angles)?])
            }
            LightKind::Directional {
                direction,
                up,
                target,
                size,
            } => {
                let camera = |position: DVec3, extent| {
                    let target =
                        position + direction.normalize_or_zero() * position.length().max(1.0);
                    Camera::orthographic(
                        position.to_array(),
                        target.to_array(),
                        up.to_array(),
                        extent,
                    )
                };
                let eye = self.eye(camera(DVec3::ZERO, [1.0; 2])?)?;
                let (lo, hi) = scene.extent(|p| eye.axes(p))?;
                let middle = target.map_or((lo + hi) / 2.0, |t| eye.axes(t));
                let half = match size {
                    Some(size) => size / 2.0,
                    None => {
                        let reach = (lo - middle).abs().max((hi - middle).abs());
                        self.shorter(reach, (1e-10 * reach.max_element()).max(1e-30))
                    }
                };
                // Depth 0 may be anywhere. A light with a target and a size has the same camera
                // whatever else is in the scene.
                let before = match (target, size) {
                    (Some(_), Some(size)) => middle.z - size,
                    _ => lo.z - 0.01 * (hi - lo).max_element().max(1e-30),
                };
                let position = eye.right * middle.x + eye.up * middle.y + eye.forward * before;
                Ok(vec![camera(position, self.sides(2.0 * half))?])
            }
            LightKind::Point { position } => Ok(Camera::faces(position.to_array())?.to_vec()),
        }
    }

    fn eye(&self, camera: Camera) -> Result<Eye> {
        Ok(View::new(self.name.clone(), camera, self.depth, self.resolution)?.eye)
    }

    /// Half of the shorter side of a map that contains everything up to `reach` from its middle, to
    /// the right and upwards; at least `least`.
    fn shorter(&self, reach: DVec3, least: f64) -> f64 {
        let [width, height] = self.sides(1.0);
        (reach.x / width).max(reach.y / height).max(least) * FRAME_MARGIN
    }

    /// Both sides of a map with this shorter side.
    fn sides(&self, shorter: f64) -> [f64; 2] {
        let [width, height] = self.resolution.map(f64::from);
        [width, height].map(|side| shorter * side / width.min(height))
    }
}

/// Relative size of the map: leaves a margin for filters and the width of strands.
const FRAME_MARGIN: f64 = 1.02;
