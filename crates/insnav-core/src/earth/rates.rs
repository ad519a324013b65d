//! Earth rate and transport rate, and everything about one latitude that a step needs.

use super::ellipsoid::{EARTH_RATE, ECCENTRICITY_SQUARED, SEMI_MAJOR_AXIS};
use super::geodetic::Geodetic;
use super::gravity;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Vector3;

/// Rate of the Earth against inertial space, ω_ie resolved in n, rad/s ([Groves13] eq. 2.123).
pub fn earth_rate_n(latitude: f64) -> Vector3<f64> {
    let (s, c) = latitude.sin_cos();
    Vector3::new(EARTH_RATE * c, 0.0, -EARTH_RATE * s)
}

/// Turn rate of the navigation frame as the body moves over the Earth, ω_en resolved in n, rad/s ([Groves13] eq. 5.44).
///
/// Grows without bound towards the poles; callers stay below 89°.
pub fn transport_rate_n(at: &Geodetic, velocity_n: &Vector3<f64>) -> Vector3<f64> {
    LocalEarth::at(at).transport_rate_n(velocity_n)
}

/// The Earth at one position: computed once a step, used by the mechanization and by its error dynamics.
#[derive(Clone, Copy, Debug, PartialEq)]
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
