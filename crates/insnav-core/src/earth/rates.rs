//! Earth rate and transport rate, and everything about one latitude that a step needs.

use super::ellipsoid::{EARTH_RATE, ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS};
use super::geodetic::Geodetic;
use super::gravity;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Rate of the Earth against inertial space, ω_ie resolved in n, rad/s (\[Groves13\] eq. 2.123).
pub fn earth_rate_n(latitude: f64) -> Vector3<f64> {
    let (s, c) = latitude.sin_cos();
    Vector3::new(EARTH_RATE * c, 0.0, -EARTH_RATE * s)
}

/// Turn rate of the navigation frame as the body moves over the Earth, ω_en resolved in n, rad/s (\[Groves13\] eq. 5.44).
///
/// Grows without bound towards the poles; callers stay below 89°.
pub fn transport_rate_n(at: &Geodetic, velocity_n: &Vector3<f64>) -> Vector3<f64> {
    LocalEarth::at(at).transport_rate_n(velocity_n)
}

/// The Earth at one position: computed once a step, used by the mechanization and by its error dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalEarth {
    /// sin L.
    pub sin_latitude: f64,
    /// cos L.
    pub cos_latitude: f64,
    /// Height, m.
    pub height: f64,
    /// Radius of curvature in the meridian at this height, M + h, m.
    pub meridian: f64,
    /// Radius of curvature in the prime vertical at this height, N + h, m.
    pub transverse: f64,
}

impl LocalEarth {
    /// At a position.
    pub fn at(position: &Geodetic) -> Self {
        let (s, c) = position.latitude.sin_cos();
        let w2 = 1.0 - ECCENTRICITY_SQUARED * s * s;
        let n = SEMI_MAJOR_AXIS / w2.sqrt();
        LocalEarth {
            sin_latitude: s,
            cos_latitude: c,
            height: position.height,
            meridian: n * (1.0 - ECCENTRICITY_SQUARED) / w2 + position.height,
            transverse: n + position.height,
        }
    }

    /// ω_ie resolved in n, rad/s.
    pub fn earth_rate_n(&self) -> Vector3<f64> {
        Vector3::new(
            EARTH_RATE * self.cos_latitude,
            0.0,
            -EARTH_RATE * self.sin_latitude,
        )
    }

    /// ω_en resolved in n at a velocity (NED, m/s), rad/s.
    pub fn transport_rate_n(&self, velocity_n: &Vector3<f64>) -> Vector3<f64> {
        let east = velocity_n.y / self.transverse;
        Vector3::new(
            east,
            -velocity_n.x / self.meridian,
            -east * self.sin_latitude / self.cos_latitude,
        )
    }

    /// Normal gravity along Down, m/s².
    pub fn gravity(&self) -> f64 {
        gravity::at_sin_latitude(self.sin_latitude, self.height)
    }

    /// Derivatives of gravity: per rad of latitude and per metre of height.
    pub fn gravity_gradient(&self) -> (f64, f64) {
        gravity::gradient_at(self.sin_latitude, self.cos_latitude, self.height)
    }

    /// The Earth a short way on (metres NED): first order in the way, radii of curvature kept.
    ///
    /// Over the half step for which the mechanization uses it, the neglected change of the radii is below 1e-9 of them.
    #[must_use]
    pub fn moved(&self, by_n: &Vector3<f64>) -> Self {
        let d = by_n.x / self.meridian;
        LocalEarth {
            sin_latitude: self.sin_latitude + d * self.cos_latitude,
            cos_latitude: self.cos_latitude - d * self.sin_latitude,
            height: self.height - by_n.z,
            meridian: self.meridian - by_n.z,
            transverse: self.transverse - by_n.z,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::log;
    use nalgebra::{Rotation3, UnitQuaternion};
    use proptest::prelude::*;

    proptest! {
        /// The NED axes themselves, moved a centimetre either way: C' = −[ω_en ×] C for C = C_e^n.
        #[test]
        fn transport_rate_turns_the_navigation_frame(
            latitude_deg in -85.0..85.0f64, longitude_deg in -179.0..179.0f64, height in -1e3..2e4f64,
            n in -300.0..300.0f64, e in -300.0..300.0f64, d in -50.0..50.0f64,
        ) {
            let at = Geodetic::from_degrees(latitude_deg, longitude_deg, height);
            let v = Vector3::new(n, e, d);
            let axes = |dt: f64| {
                let c = at.offset(&(v * dt)).ned_to_ecef();
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(c))
            };
            let h = 0.01;
            let turned = log(&(axes(-h).inverse() * axes(h))) / (2.0 * h);
            let found = transport_rate_n(&at, &v);
            // Rounding of a rotation over 0.02 s; the curve's third derivative is of the size rate³.
            prop_assert!((turned - found).norm() < 1e-13, "{turned} {found}");
        }

        #[test]
        fn moved_is_the_earth_a_little_further(
            latitude_deg in -85.0..85.0f64, height in -1e3..2e4f64,
            n in -1.0..1.0f64, e in -1.0..1.0f64, d in -1.0..1.0f64,
        ) {
            let at = Geodetic::from_degrees(latitude_deg, 0.0, height);
            let by = Vector3::new(n, e, d);
            let (found, exact) = (LocalEarth::at(&at).moved(&by), LocalEarth::at(&at.offset(&by)));
            // A metre is 1.6e-7 rad: its square is left out of sine and cosine, and 1e-9 of the radii.
            prop_assert!((found.sin_latitude - exact.sin_latitude).abs() < 2e-14);
            prop_assert!((found.cos_latitude - exact.cos_latitude).abs() < 2e-14);
            prop_assert!((found.meridian - exact.meridian).abs() < 2e-2);
            prop_assert!((found.transverse - exact.transverse).abs() < 1e-2);
            prop_assert!((found.height - exact.height).abs() < 1e-9);
        }
    }

    #[test]
    fn earth_rate_is_the_earths_axis_in_local_components() {
        for (latitude_deg, longitude_deg) in [(0.0, 0.0), (52.0, 13.0), (-80.0, -170.0)] {
            let at = Geodetic::from_degrees(latitude_deg, longitude_deg, 0.0);
            let axis = at.ned_to_ecef() * earth_rate_n(at.latitude);
            assert!(
                (axis - Vector3::new(0.0, 0.0, EARTH_RATE)).norm() < 1e-19,
                "{axis}"
            );
            assert_eq!(
                LocalEarth::at(&at).earth_rate_n(),
                earth_rate_n(at.latitude)
            );
        }
    }
}
