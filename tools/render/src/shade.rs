//! What surfaces make of light: Lambert's law, and Kajiya and Kay's for strands.

use glam::DVec3;

/// The part of its colour that everything has without any light.
pub const AMBIENT: f64 = 0.06;
/// How bright the highlight of a strand is, white under white light.
const HIGHLIGHT: f64 = 0.3;
/// How narrow it is.
const SHARPNESS: f64 = 40.0;

/// What a surface reflects of light from a direction: a part of its own colour, and a part of the light's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflected {
    /// Times the colour of the surface.
    pub own: f64,
    /// As it came.
    pub plain: f64,
}

/// Lambert: the cosine between normal and light, where light and eye are on the same side. `to_light` and `to_eye` lead away from the surface; all have length 1.
///
/// A surface that faces a light of brightness 1 is as bright as its colour.
pub fn lambert(normal: DVec3, to_light: DVec3, to_eye: DVec3) -> Reflected {
    let (light, eye) = (normal.dot(to_light), normal.dot(to_eye));
    Reflected {
        own: if light * eye > 0.0 { light.abs() } else { 0.0 },
        plain: 0.0,
    }
}

/// Kajiya and Kay 1989: the sine between strand and light, and a highlight where the eye is on the cone that a thin mirror reflects light to.
pub fn strand(along: DVec3, to_light: DVec3, to_eye: DVec3) -> Reflected {
    let sine = |cosine: f64| (1.0 - cosine * cosine).max(0.0).sqrt();
    let (light, eye) = (along.dot(to_light), along.dot(to_eye));
    // The cosine of the angle between the eye and the cone; the cone has the angle of the light, on the other side.
    let cone = (sine(light) * sine(eye) - light * eye).max(0.0);
    Reflected {
        own: sine(light),
        plain: HIGHLIGHT * cone.powf(SHARPNESS),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_as_bright_as_the_cosine_and_dark_from_behind() {
        let slant = DVec3::new(0.0, 0.6, 0.8);
        assert_eq!(lambert(DVec3::Z, slant, DVec3::Z).own, 0.8);
        assert_eq!(lambert(-DVec3::Z, slant, DVec3::Z).own, 0.8); // normals have no side
        assert_eq!(lambert(DVec3::Z, slant, -DVec3::Z).own, 0.0);
    }

    #[test]
    fn a_strand_shines_where_a_thin_mirror_would() {
        let light = DVec3::new(0.6, 0.8, 0.0);
        for eye in [DVec3::new(-0.6, 0.8, 0.0), DVec3::new(-0.6, 0.0, 0.8)] {
            let found = strand(DVec3::X, light, eye);
            assert!((found.own - 0.8).abs() < 1e-12 && (found.plain - HIGHLIGHT).abs() < 1e-12);
        }
        assert!(strand(DVec3::X, light, light).plain < 1e-6);
        assert_eq!(strand(DVec3::X, DVec3::X, DVec3::Y).own, 0.0); // along the strand
    }
}
