//! WGS-84 reference ellipsoid: constants and radii of curvature.

#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;

/// Semi-major axis a, m (\[WGS84\] table 3.1).
pub const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
/// Flattening f (\[WGS84\] table 3.1).
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Semi-minor axis b = a (1 − f), m.
pub const SEMI_MINOR_AXIS: f64 = SEMI_MAJOR_AXIS * (1.0 - FLATTENING);
/// First eccentricity squared e² = f (2 − f).
pub const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);
/// Rate of the Earth against inertial space ω_ie, rad/s (\[WGS84\] table 3.1).
pub const EARTH_RATE: f64 = 7.292_115e-5;

/// Radius of curvature in the meridian M at a geodetic latitude (rad), m (\[Groves13\] eq. 2.105).
pub fn meridian_radius(latitude: f64) -> f64 {
    let s = latitude.sin();
    let w2 = 1.0 - ECCENTRICITY_SQUARED * s * s;
    SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (w2 * w2.sqrt())
}

/// Radius of curvature in the prime vertical N at a geodetic latitude (rad), m (\[Groves13\] eq. 2.106).
pub fn transverse_radius(latitude: f64) -> f64 {
    let s = latitude.sin();
    SEMI_MAJOR_AXIS / (1.0 - ECCENTRICITY_SQUARED * s * s).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    #[test]
    fn radii_have_their_closed_forms_at_equator_and_pole() {
        let polar = SEMI_MAJOR_AXIS * SEMI_MAJOR_AXIS / SEMI_MINOR_AXIS;
        assert!(
            (meridian_radius(0.0) - SEMI_MINOR_AXIS * SEMI_MINOR_AXIS / SEMI_MAJOR_AXIS).abs()
                < 1e-8
        );
        assert!((transverse_radius(0.0) - SEMI_MAJOR_AXIS).abs() < 1e-8);
        assert!((meridian_radius(FRAC_PI_2) - polar).abs() < 1e-8);
        assert!((transverse_radius(FRAC_PI_2) - polar).abs() < 1e-8);
    }
}
