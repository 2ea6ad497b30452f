//! From world space to a map: the light's camera.

use super::query::Footprint;
use crate::{DepthKind, Error, MapHeader, Result};

/// The way from world space to a map: what its header says of the light's camera, ready for use (LV00, section 3.4, "transform to light space").
///
/// All in f64. Vectors are rows, p' = p M, divided by their fourth coordinate; (0,0) of `worldToNDC` is the upper left corner of the display window and
/// (1,1) its lower right one. A camera is *perspective* if the fourth coordinate of `worldToNDC` depends on the point, else *orthographic*.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// // At the origin, looking along +z, 90 degrees wide: x = z is the right border, y = z the upper one.
/// let mut map = MapHeader::new("key light", 4, 4);
/// map.depth_kind = DepthKind::RayDistance;
/// map.camera.camera_from_world = Some([
///     1.0, 0.0, 0.0, 0.0,
///     0.0, 1.0, 0.0, 0.0,
///     0.0, 0.0, 1.0, 0.0,
///     0.0, 0.0, 0.0, 1.0,
/// ]);
/// map.camera.ndc_from_world = Some([
///     0.5, 0.0, 0.0, 0.0,
///     0.0, -0.5, 0.0, 0.0,
///     0.5, 0.5, 0.0, 1.0,
///     0.0, 0.0, 0.0, 0.0,
/// ]);
/// let light = LightSpace::of(&map)?;
/// // Three quarters of the way to the right, in the middle of the height; 5 from the light, for 3² + 4² = 5².
/// let at = light.light_from_world([3.0, 0.0, 4.0]).unwrap();
/// assert_eq!(at, [3.5, 2.0, 5.0]); // x, y, depth
/// assert_eq!(light.light_from_world([3.0, 0.0, -4.0]), None); // behind the light
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LightSpace {
    camera_from_world: [f64; 16],
    ndc_from_world: [f64; 16],
    perspective: bool,
    /// Whether the fourth coordinate in camera space is 1 everywhere.
    affine: bool,
    /// Whether depth is the distance from the camera's origin, not the third coordinate.
    distance: bool,
    /// Pixels of the display window.
    window: [f64; 2],
    /// What lies between its upper left corner and the map's.
    offset: [f64; 2],
    /// Pixels of the map.
    size: [f64; 2],
}

/// A point as a map sees it, and what the derivative needs of the way there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projected {
    pub at: [f64; 3],
    ndc: [f64; 2],
    w: f64,
}

impl LightSpace {
    /// The light space of a map.
    ///
    /// # Errors
    /// `Input` if the header does not say how: the depth kind is [`DepthKind::Unspecified`] or a matrix is missing, as both are needed; if a
    /// matrix holds a number that is not finite, or the fourth coordinate of `worldToNDC` is 0 everywhere.
    pub fn of(map: &MapHeader) -> Result<LightSpace> {
        map.check()
            .map_err(|(rule, what)| Error::input(format!("{what} ({rule})")))?;
        let need = |what: &str| {
            Error::input(format!(
                "world-space lookups need {what}, which map {:?} does not have",
                map.name
            ))
        };
        let distance = match map.depth_kind {
            DepthKind::Planar => false,
            DepthKind::RayDistance => true,
            DepthKind::Unspecified => return Err(need("a depth kind")),
        };
        let camera = map.camera;
        let camera_from_world = camera
            .camera_from_world
            .ok_or_else(|| need("worldToCamera"))?;
        let ndc_from_world = camera.ndc_from_world.ok_or_else(|| need("worldToNDC"))?;
        let perspective = [3, 7, 11].iter().any(|&i| ndc_from_world[i] != 0.0);
        if !perspective && ndc_from_world[15] == 0.0 {
            return Err(need("a worldToNDC that can be divided by"));
        }
        let [x0, y0, x1, y1] = map.display_window.map(f64::from);
        let [x, y] = map.data_origin.map(f64::from);
        Ok(LightSpace {
            camera_from_world,
            ndc_from_world,
            perspective,
            affine: [3, 7, 11, 15].map(|i| camera_from_world[i]) == [0.0, 0.0, 0.0, 1.0],
            // Parallel rays begin in the plane of the camera.
            distance: distance && perspective,
            window: [x1 - x0 + 1.0, y1 - y0 + 1.0],
            offset: [x - x0, y - y0],
            size: [f64::from(map.width), f64::from(map.height)],
        })
    }

    /// Whether rays meet in the camera's origin; if not, they are parallel.
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// The place of a point of world space in the map: x and y in pixels of level 0 from the upper
    /// left corner, where the centre of the first pixel is 0.5, and the depth, of the map's kind. x
    /// and y may lie outside the map.
    ///
    /// `None` if it has no place in it: it is not in front of a perspective camera (its third coordinate in camera space is 0 or less), or is not
    /// finite, in world space or after the projection. What has no place is not in shadow. The rays of an orthographic camera are parallel to its
    /// axis and begin in the plane of its origin: there both kinds of depth are the third coordinate in camera space, which may be negative.
    pub fn light_from_world(&self, point: [f64; 3]) -> Option<[f64; 3]> {
        self.projected(point).map(|projected| projected.at)
    }

    #[inline(always)]
    pub(super) fn projected(&self, point: [f64; 3]) -> Option<Projected> {
        let mut c = transformed(&self.camera_from_world, point);
        if !self.affine {
            c = c.map(|v| v / c[3]);
        }
        let ndc = transformed(&self.ndc_from_world, point);
        let depth = if self.distance {
            (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt()
        } else {
            c[2]
        };
        let w = ndc[3];
        let [u, v] = [ndc[0] / w, ndc[1] / w];
        let x = u * self.window[0] - self.offset[0];
        let y = v * self.window[1] - self.offset[1];
        let in_front = !self.perspective || c[2] > 0.0;
        let finite = x.is_finite() & y.is_finite() & depth.is_finite();
        (in_front & finite).then_some(Projected {
            at: [x, y, depth],
            ndc: [u, v],
            w,
        })
    }

    /// Whether a point lies in the map's frustum, borders included: it has a place, and that is inside the map's pixels.
    pub fn holds(&self, point: [f64; 3]) -> bool {
        self.beyond(point) <= 0.0
    }

    /// How many pixels a point lies outside the map; 0 or less inside, infinite if it has no place.
    pub(super) fn beyond(&self, point: [f64; 3]) -> f64 {
        self.light_from_world(point)
            .map_or(f64::INFINITY, |[x, y, _]| {
                let [x, y] =
                    [(x, self.size[0]), (y, self.size[1])].map(|(c, side)| (-c).max(c - side));
                x.max(y)
            })
    }

    /// The ellipse in the map of two small steps in world space, as a renderer has them: the change of the point from one pixel of its image
    /// to the next, in both directions. By the derivative of the projection at `point`: exact for an orthographic camera, for a perspective one
    /// in the limit of short steps. `None` where [`LightSpace::light_from_world`] is. Vectors longer than 2^39 pixels are cut there.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # let mut map = MapHeader::new("key light", 4, 4);
    /// # map.depth_kind = DepthKind::Planar;
    /// # map.camera.camera_from_world = Some([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    /// # map.camera.ndc_from_world = Some([0.5, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.5, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    /// # let light = LightSpace::of(&map).unwrap();
    /// // The light of the example above: at a distance of 4, two units are one of its 4 pixels. Nearer to the light by 1 at x = 2, the
    /// // point goes right by (2 / 4²) 2 = 0.25 pixels.
    /// let footprint = light.footprint([2.0, 0.0, 4.0], [0.0, 2.0, 0.0], [0.0, 0.0, -1.0]).unwrap();
    /// assert_eq!(footprint, Footprint::Ellipse { dx: [0.0, -1.0], dy: [0.25, 0.0] });
    /// ```
    pub fn footprint(&self, point: [f64; 3], dx: [f64; 3], dy: [f64; 3]) -> Option<Footprint> {
        self.ellipse(&self.projected(point)?, dx, dy)
    }

    pub(super) fn ellipse(
        &self,
        projected: &Projected,
        dx: [f64; 3],
        dy: [f64; 3],
    ) -> Option<Footprint> {
        let rows = self.derivative(projected)?;
        let [dx, dy] = [dx, dy].map(|step| {
            rows.map(|row| {
                let d = row[0] * step[0] + row[1] * step[1] + row[2] * step[2];
                d.clamp(-LONGEST, LONGEST) as f32
            })
        });
        Some(Footprint::Ellipse { dx, dy })
    }

    /// The width in the map of a small ball in world space, `width` across: of the ellipse that it covers, the geometric mean of the axes. Away
    /// from the axis of a perspective camera the ellipse is longer outwards, by 1 / cosine of the angle: what is lost by making it round is at most a factor
    /// of 1.32 in the corner of a cube's face, and the lookup is the fast one. `None` where [`LightSpace::light_from_world`] is.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # let mut map = MapHeader::new("key light", 4, 4);
    /// # map.depth_kind = DepthKind::Planar;
    /// # map.camera.camera_from_world = Some([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    /// # map.camera.ndc_from_world = Some([0.5, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.5, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    /// # let light = LightSpace::of(&map).unwrap();
    /// // The same light: at a distance of 4, its 4 pixels are 8 units wide.
    /// assert_eq!(light.footprint_of_width([0.0, 0.0, 4.0], 3.0), Some(Footprint::Width(1.5)));
    /// ```
    pub fn footprint_of_width(&self, point: [f64; 3], width: f64) -> Option<Footprint> {
        self.round(&self.projected(point)?, width)
    }

    #[inline]
    pub(super) fn round(&self, projected: &Projected, width: f64) -> Option<Footprint> {
        let [a, b] = self.derivative(projected)?;
        // The product of the axes is the area that the two rows span.
        let area = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i] * b[j] - a[j] * b[i]);
        let scale = area.iter().map(|v| v * v).sum::<f64>().sqrt().sqrt();
        Some(Footprint::Width((width * scale).min(LONGEST) as f32))
    }

    /// How x and y in the map change with the three coordinates of a point in world space.
    #[inline(always)]
    fn derivative(&self, projected: &Projected) -> Option<[[f64; 3]; 2]> {
        let m = &self.ndc_from_world;
        // The quotient rule: (X / W)' = (X' - (X / W) W') / W.
        let row = |i: usize| {
            let (at, scale) = (projected.ndc[i], self.window[i] / projected.w);
            [0, 4, 8].map(|k| (m[k + i] - at * m[k + 3]) * scale)
        };
        let rows = [row(0), row(1)];
        rows.iter().flatten().all(|v| v.is_finite()).then_some(rows)
    }
}

/// What is longer is cut: well inside what a lookup takes.
const LONGEST: f64 = Footprint::LONGEST as f64 / 2.0;

/// (p, 1) M.
#[inline(always)]
fn transformed(m: &[f64; 16], p: [f64; 3]) -> [f64; 4] {
    [0, 1, 2, 3].map(|i| p[0] * m[i] + p[1] * m[4 + i] + p[2] * m[8 + i] + m[12 + i])
}
