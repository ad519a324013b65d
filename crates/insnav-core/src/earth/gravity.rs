//! Normal gravity of WGS-84.

use super::ellipsoid::{ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS};
use super::geodetic::Geodetic;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;

/// Normal gravity on the equator, m/s² (\[WGS84\] table 3.4).
const EQUATORIAL_GRAVITY: f64 = 9.780_325_335_9;
/// Somigliana's constant k (\[WGS84\] table 3.4).
const SOMIGLIANA: f64 = 1.931_852_652_41e-3;
/// m = ω² a² b / GM (\[WGS84\] table 3.4).
const CENTRIFUGAL_RATIO: f64 = 3.449_786_506_84e-3;

/// Magnitude of normal gravity (gravitation plus centrifugal acceleration, along Down), m/s².
///
/// Somigliana's closed formula on the ellipsoid and its second-order continuation in height (\[WGS84\] eq. 4-1 and 4-3).
/// Against the closed form of the normal field the continuation is off by 0.7 µm/s² at 10 km and 1.5 µm/s² at 20 km; real
/// gravity differs from normal gravity by up to about 1 mm/s².
pub fn gravity(at: &Geodetic) -> f64 {
    at_sin_latitude(at.latitude.sin(), at.height)
}

pub(super) fn at_sin_latitude(sin_latitude: f64, height: f64) -> f64 {
    let s2 = sin_latitude * sin_latitude;
    let surface =
        EQUATORIAL_GRAVITY * (1.0 + SOMIGLIANA * s2) / (1.0 - ECCENTRICITY_SQUARED * s2).sqrt();
    let x = height / SEMI_MAJOR_AXIS;
    surface
        * (1.0 - 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s2) * x
            + 3.0 * x * x)
}

/// Derivatives of [`gravity`]: (per rad of latitude, per metre of height), m/s²/rad and 1/s².
pub fn gravity_gradient(at: &Geodetic) -> (f64, f64) {
    let (s, c) = at.latitude.sin_cos();
    gradient_at(s, c, at.height)
}

pub(super) fn gradient_at(s: f64, c: f64, height: f64) -> (f64, f64) {
    let s2 = s * s;
    let w2 = 1.0 - ECCENTRICITY_SQUARED * s2;
    let surface = EQUATORIAL_GRAVITY * (1.0 + SOMIGLIANA * s2) / w2.sqrt();
    // d(surface)/dL and d(continuation)/dL share the factor 2 sin L cos L = d(sin² L)/dL.
    let by_s2 =
        EQUATORIAL_GRAVITY * SOMIGLIANA / w2.sqrt() + 0.5 * ECCENTRICITY_SQUARED * surface / w2;
    let x = height / SEMI_MAJOR_AXIS;
    let slope = 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s2);
    let continuation = 1.0 - slope * x + 3.0 * x * x;
    let by_latitude = 2.0 * s * c * (by_s2 * continuation + surface * 4.0 * FLATTENING * x);
    let by_height = surface * (6.0 * x - slope) / SEMI_MAJOR_AXIS;
    (by_latitude, by_height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn gradient_is_the_derivative(latitude_deg in -89.0..89.0f64, height in -1e3..2e4f64) {
            let at = Geodetic::from_degrees(latitude_deg, 0.0, height);
            let (by_latitude, by_height) = gravity_gradient(&at);
            let near = |dl: f64, dh: f64| gravity(&Geodetic { latitude: at.latitude + dl, height: height + dh, ..at });
            let (l, h) = (1e-4, 100.0);
            // Rounding of 9.8 m/s² over the step, and l² / 6 of the third derivative, 0.2 m/s²/rad³.
            prop_assert!(((near(l, 0.0) - near(-l, 0.0)) / (2.0 * l) - by_latitude).abs() < 1e-9);
            prop_assert!(((near(0.0, h) - near(0.0, -h)) / (2.0 * h) - by_height).abs() < 1e-16);
        }
    }

    #[test]
    fn poles_have_the_published_gravity() {
        // [WGS84] table 3.4: 9.832 184 937 8 m/s².
        let pole = gravity(&Geodetic::from_degrees(90.0, 0.0, 0.0));
        assert!((pole - 9.832_184_937_8).abs() < 1e-10, "{pole}");
    }
}
