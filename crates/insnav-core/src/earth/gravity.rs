//! Normal gravity of WGS-84.

use super::ellipsoid::{ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS};
use super::geodetic::Geodetic;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;

/// Normal gravity on the equator, m/s² ([WGS84] table 3.4).
const EQUATORIAL_GRAVITY: f64 = 9.780_325_335_9;
/// Somigliana's constant k ([WGS84] table 3.4).
const SOMIGLIANA: f64 = 1.931_852_652_41e-3;
/// m = ω² a² b / GM ([WGS84] table 3.4).
const CENTRIFUGAL_RATIO: f64 = 3.449_786_506_84e-3;

/// Magnitude of normal gravity (gravitation plus centrifugal acceleration, along Down), m/s².
///
/// Somigliana's closed formula on the ellipsoid and its second-order continuation in height ([WGS84] eq. 4-1 and 4-3).
/// The continuation is good to 1 µm/s² up to some 20 km; real gravity differs from normal gravity by up to about 1 mm/s².
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
