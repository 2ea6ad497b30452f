//! Projects points and footprints from world space into a map.

use super::query::Footprint;
use crate::{DepthKind, Error, MapHeader, Result};

/// The projection from world space into a map, as the map's header gives it (LV00, section 3.4,
/// "transform to light space").
///
/// All computation is in f64. Vectors are rows: p' = p M, divided by the fourth coordinate. (0,0)
/// of `worldToNDC` is the upper left corner of the display window, and (1,1) is its lower right
/// corner. A camera is *perspective* if the fourth coordinate of `worldToNDC` depends on the point,
/// otherwise
/// *orthographic*.
///
/// ```
/// use deepshadow::*;
/// # fn main() -> Result<()> {
/// // A light at the origin looks along +z, 90 degrees wide. x = z is the right border of the map,
/// // and y = z is the upper border.
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
/// // 3/4 of the way from the centre to the right border, half way down. The distance from the
/// // light is 5, because 3 * 3 + 4 * 4 = 5 * 5.
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
    /// Whether depth is the distance from the camera's origin, and not the third coordinate.
    distance: bool,
    /// Width and height of the display window in pixels.
    window: [f64; 2],
    /// Upper left corner of the map, from that of the display window.
    offset: [f64; 2],
    /// Width and height of the map in pixels.
    size: [f64; 2],
}

/// The projection of a point: its place and depth, and the terms that the derivative needs.
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
    /// `Input` if the depth kind is [`DepthKind::Unspecified`], if one of the two matrices is
    /// missing or holds a number that is not finite, or if the fourth coordinate of `worldToNDC` is
    /// 0 everywhere.
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
            return Err(need("a worldToNDC whose fourth coordinate is not 0"));
        }
        let [x0, y0, x1, y1] = map.display_window.map(f64::from);
        let [x, y] = map.data_origin.map(f64::from);
        Ok(LightSpace {
            camera_from_world,
            ndc_from_world,
            perspective,
            affine: [3, 7, 11, 15].map(|i| camera_from_world[i]) == [0.0, 0.0, 0.0, 1.0],
            // Parallel rays start in the plane of the camera, so their length is the third
            // coordinate.
            distance: distance && perspective,
            window: [x1 - x0 + 1.0, y1 - y0 + 1.0],
            offset: [x - x0, y - y0],
            size: [f64::from(map.width), f64::from(map.height)],
        })
    }

    /// Whether the rays start at one point, the camera's origin. If not, they are parallel.
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// Place and depth in the map of a point in world space: x, y and depth.
    ///
    /// x and y are in pixels of level 0 from the upper left corner, so that the centre of the first
    /// pixel is 0.5. They may lie outside the map. The depth is of the map's kind.
    ///
    /// `None` if the point has no place: it is not in front of a perspective camera (its third
    /// coordinate in camera space is 0 or less), or a coordinate is not finite before or after the
    /// projection. A point without a place is lit. The rays of an orthographic camera are parallel
    /// to its axis and start in the plane of its origin. Its depths of both kinds are the third
    /// coordinate in camera space, which may be negative.
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

    /// Whether a point lies in the map's frustum: its place is inside the map, borders included.
    pub fn holds(&self, point: [f64; 3]) -> bool {
        self.beyond(point) <= 0.0
    }

    /// Distance in pixels of a point from the map; 0 or less inside, infinite without a place.
    pub(super) fn beyond(&self, point: [f64; 3]) -> f64 {
        self.light_from_world(point)
            .map_or(f64::INFINITY, |[x, y, _]| {
                let [x, y] =
                    [(x, self.size[0]), (y, self.size[1])].map(|(c, side)| (-c).max(c - side));
                x.max(y)
            })
    }

    /// The elliptic footprint in the map for two small steps in world space.
    ///
    /// `dx` and `dy` are the moves of the shaded point from one pixel of the renderer's image to
    /// the next, in both directions. The footprint is their image under the derivative of the
    /// projection at `point`: exact for an orthographic camera, and the limit of short steps for a
    /// perspective camera. Coordinates are clamped to 2^39 pixels. `None` if the point has no
    /// place, as [`LightSpace::light_from_world`] says.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # let mut map = MapHeader::new("key light", 4, 4);
    /// # map.depth_kind = DepthKind::Planar;
    /// # map.camera.camera_from_world = Some([
    /// #     1.0, 0.0, 0.0, 0.0,
    /// #     0.0, 1.0, 0.0, 0.0,
    /// #     0.0, 0.0, 1.0, 0.0,
    /// #     0.0, 0.0, 0.0, 1.0,
    /// # ]);
    /// # map.camera.ndc_from_world = Some([
    /// #     0.5, 0.0, 0.0, 0.0,
    /// #     0.0, -0.5, 0.0, 0.0,
    /// #     0.5, 0.5, 0.0, 1.0,
    /// #     0.0, 0.0, 0.0, 0.0,
    /// # ]);
    /// # let light = LightSpace::of(&map).unwrap();
    /// // The light of the example above. At z = 4, each of 4 pixels is two units wide. A step of
    /// // 1 towards the light at x = 2 moves the point right by (2 / 4²) 2 = 0.25 pixels.
    /// let (dx, dy) = ([0.0, 2.0, 0.0], [0.0, 0.0, -1.0]);
    /// let footprint = light.footprint([2.0, 0.0, 4.0], dx, dy).unwrap();
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

    /// The round footprint in the map for a small ball of diameter `width` in world space.
    ///
    /// The ball projects to an ellipse. The result's width is the geometric mean of the axes, so
    /// that the lookup takes the fast path. Away from the axis of a perspective camera the ellipse
    /// is longer radially, by 1 / cosine of the angle. In the corner of a cube's face the round
    /// footprint is off by a factor of at most 1.32. `None` if the point has no place, as
    /// [`LightSpace::light_from_world`] says.
    ///
    /// ```
    /// # use deepshadow::*;
    /// # let mut map = MapHeader::new("key light", 4, 4);
    /// # map.depth_kind = DepthKind::Planar;
    /// # map.camera.camera_from_world = Some([
    /// #     1.0, 0.0, 0.0, 0.0,
    /// #     0.0, 1.0, 0.0, 0.0,
    /// #     0.0, 0.0, 1.0, 0.0,
    /// #     0.0, 0.0, 0.0, 1.0,
    /// # ]);
    /// # map.camera.ndc_from_world = Some([
    /// #     0.5, 0.0, 0.0, 0.0,
    /// #     0.0, -0.5, 0.0, 0.0,
    /// #     0.5, 0.5, 0.0, 1.0,
    /// #     0.0, 0.0, 0.0, 0.0,
    /// # ]);
    /// # let light = LightSpace::of(&map).unwrap();
    /// // The light of the example above: at z = 4, its 4 pixels are 8 units wide.
    /// assert_eq!(light.footprint_of_width([0.0, 0.0, 4.0], 3.0), Some(Footprint::Width(1.5)));
    /// ```
    pub fn footprint_of_width(&self, point: [f64; 3], width: f64) -> Option<Footprint> {
        self.round(&self.projected(point)?, width)
    }

    #[inline]
    pub(super) fn round(&self, projected: &Projected, width: f64) -> Option<Footprint> {
        let [a, b] = self.derivative(projected)?;
        // The product of the axes is the area of the parallelogram between the two rows.
        let area = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| a[i] * b[j] - a[j] * b[i]);
        let scale = area.iter().map(|v| v * v).sum::<f64>().sqrt().sqrt();
        Some(Footprint::Width((width * scale).min(LONGEST) as f32))
    }

    /// Derivatives of x and y in the map by the three coordinates in world space.
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

/// Clamp for the coordinates of footprints: well inside the limit of lookups.
const LONGEST: f64 = Footprint::LONGEST as f64 / 2.0;

/// (p, 1) M.
#[inline(always)]
fn transformed(m: &[f64; 16], p: [f64; 3]) -> [f64; 4] {
    [0, 1, 2, 3].map(|i| p[0] * m[i] + p[1] * m[4 + i] + p[2] * m[8 + i] + m[12 + i])
}
