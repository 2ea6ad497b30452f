//! Reflection of light: Lambert's law for meshes, Kajiya and Kay's model for strands.

use glam::DVec3;

/// Fraction of its colour that a surface shows without any light.
pub const AMBIENT: f64 = 0.06;
/// Brightness of the highlight of a strand, white under white light.
const HIGHLIGHT: f64 = 0.3;
/// Exponent of the highlight. A greater one makes it narrower.
const SHARPNESS: f64 = 40.0;

/// Fractions of a light that a surface reflects towards the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflected {
    /// Fraction in the colour of the surface.
    pub own: f64,
    /// Fraction in the colour of the light.
    pub plain: f64,
}

/// Lambert's law: the cosine between normal and light, if light and eye are on the same side.
///
/// All directions have length 1. `to_light` and `to_eye` point away from the surface.
///
/// A surface that faces a light of brightness 1 is as bright as its colour.
pub fn lambert(normal: DVec3, to_light: DVec3, to_eye: DVec3) -> Reflected {
    let (light, eye) = (normal.dot(to_light), normal.dot(to_eye));
    Reflected {
        own: if light * eye > 0.0 { light.abs() } else { 0.0 },
        plain: 0.0,
    }
}

/// Kajiya and Kay 1989: the sine between strand and light, and a highlight.
///
/// The highlight is brightest on the cone into which a thin mirror reflects the light.
pub fn strand(along: DVec3, to_light: DVec3, to_eye: DVec3) -> Reflected {
    let sine = |cosine: f64| (1.0 - cosine * cosine).max(0.0).sqrt();
    let (light, eye) = (along.dot(to_light), along.dot(to_eye));
    // Cosine of the angle between the eye and the cone. The cone mirrors the angle of the light.
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
