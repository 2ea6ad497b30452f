//! Lights, and the views that their maps are of.

use crate::error::{Error, ErrorKind, Result};
use deepshadow::{Camera, DepthKind, Encoding, Filter, LightSpace, MapHeader};
use glam::DVec3;

use super::Scene;

/// A light and how its map is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// The name of its map, or of the group of its six maps.
    pub name: String,
    /// Where it stands.
    pub kind: LightKind,
    /// How bright it is, for pictures: red, green and blue.
    pub color: [f32; 3],
    /// Pixels of the map: width and height. A point light's faces are as wide as high.
    pub resolution: [u32; 2],
    /// Rays in each pixel, 1 to 4096, jittered in place and time.
    pub samples: u32,
    /// The filter that weighs the rays around a pixel's centre.
    pub filter: Filter,
    /// Its width, in pixels.
    pub filter_width: f32,
    /// The largest error of a function; `None` is the rule of LV00, section 4, [`Encoding::default_tolerance`](deepshadow::Encoding::default_tolerance) of the samples.
    pub tolerance: Option<f64>,
    /// What depths measure: [`DepthKind::Planar`] or [`DepthKind::RayDistance`].
    pub depth: DepthKind,
}

/// Where a light stands and what it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// All from one point, in a cone.
    Spot {
        /// The point.
        position: DVec3,
        /// The middle of what it sees; the middle of the scene if absent.
        target: Option<DVec3>,
        /// Upwards in its map.
        up: DVec3,
        /// Degrees that the shorter side of its map spans; as many as the scene needs if absent.
        angle: Option<f64>,
    },
    /// Parallel rays.
    Directional {
        /// Where the light goes.
        direction: DVec3,
        /// Upwards in its map.
        up: DVec3,
        /// The middle of what it sees; the middle of the scene if absent.
        target: Option<DVec3>,
        /// Length of the shorter side of its map in the world; as long as the scene needs if absent.
        size: Option<f64>,
    },
    /// All from one point, in all directions: six maps.
    Point {
        /// The point.
        position: DVec3,
    },
}

/// What one map is of: where the light's rays go, and which pixel they belong to.
#[derive(Clone, Debug)]
pub struct View {
    /// Name of the map.
    pub name: String,
    /// The camera, as the map's header has it.
    pub camera: Camera,
    /// The same, ready for points.
    pub space: LightSpace,
    /// What depths measure.
    pub depth: DepthKind,
    /// Pixels: width and height.
    pub size: [u32; 2],
    /// Where its rays come from.
    pub eye: Eye,
}

/// Where the rays of a view come from, in the world.
#[derive(Clone, Copy, Debug)]
pub struct Eye {
    position: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// What one pixel is, to the right and upwards: at a depth of one for perspective views.
    pixel: [f64; 2],
    /// The pixel straight ahead.
    middle: [f64; 2],
    perspective: bool,
}

/// A ray: a point, and the way that it goes for one of depth.
pub type Line = (DVec3, DVec3);

impl Eye {
    fn new(camera: &Camera, perspective: bool, size: [u32; 2]) -> Option<Self> {
        let (c, n) = (camera.camera_from_world?, camera.ndc_from_world?);
        let column = |m: &[f64; 16], i: usize| DVec3::new(m[i], m[4 + i], m[8 + i]);
        let [right, up, forward] = [0, 1, 2].map(|i| column(&c, i));
        let [width, height] = size.map(f64::from);
        // The camera's own axes, in the directions of the picture.
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

    /// The ray through a place in the view, in pixels; its point has depth 0.
    pub fn line(&self, x: f64, y: f64) -> Line {
        let across = self.right * ((x - self.middle[0]) * self.pixel[0]);
        let across = across + self.up * ((self.middle[1] - y) * self.pixel[1]);
        match self.perspective {
            true => (self.position, self.forward + across),
            false => (self.position + across, self.forward),
        }
    }

    /// Where a point of the world lies from it: to the right, upwards, forward.
    pub fn axes(&self, point: DVec3) -> DVec3 {
        let p = point - self.position;
        DVec3::new(p.dot(self.right), p.dot(self.up), p.dot(self.forward))
    }

    /// The direction in which light reaches a point.
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
    /// A directional or spot light with the usual settings: 512 x 512 pixels of 64 rays each, a box filter of one pixel, planar depths.
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

    /// The largest error of a function of its map.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
            .unwrap_or_else(|| Encoding::default_tolerance(self.samples))
    }

    /// How far its filter reaches beyond a pixel's border, in whole pixels.
    pub fn margin(&self) -> i32 {
        let reach = match self.filter {
            Filter::Nearest => 0.5,
            filter => filter.radius() * self.filter_width,
        };
        (reach - 0.5).max(0.0).ceil() as i32
    }

    /// The views of its maps: one, or six for a point light, named after it. What the light leaves open becomes what shows the scene whole.
    ///
    /// # Errors
    /// `Failed` if the light looks nowhere, if nothing in the scene casts a shadow, or if a spot without an angle does not stand in front of the scene.
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
                            // What is not in front is beyond all angles.
                            if p.z > 0.0 {
                                DVec3::new(p.x / p.z, p.y / p.z, p.z)
                            } else {
                                DVec3::INFINITY
                            }
                        })?;
                        if !hi.is_finite() {
                            let line = "it does not stand in front of the scene: give it an angle";
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
                // Depths may begin anywhere. A light that says what it sees has the same camera whatever else is in the scene.
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

    /// Half of the shorter side of a map that holds what reaches so far from its middle, to the right and upwards; `least` where nothing does.
    fn shorter(&self, reach: DVec3, least: f64) -> f64 {
        let [width, height] = self.sides(1.0);
        (reach.x / width).max(reach.y / height).max(least) * AROUND
    }

    /// Both sides of a map whose shorter one is so long.
    fn sides(&self, shorter: f64) -> [f64; 2] {
        let [width, height] = self.resolution.map(f64::from);
        [width, height].map(|side| shorter * side / width.min(height))
    }
}

/// A border around the scene, in which filters and the width of strands have room.
const AROUND: f64 = 1.02;
