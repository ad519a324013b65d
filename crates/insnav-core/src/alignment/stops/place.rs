//! The Earth at the place where the body stands.

use crate::earth::{Geodetic, LocalEarth};
use nalgebra::{Matrix3, Vector3};

/// Rates, gravity and radii at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    /// ω_ie in n, rad/s.
    pub(super) earth_n: Vector3<f64>,
    /// m/s².
    pub(super) gravity: f64,
    /// tan L.
    pub(super) tan_latitude: f64,
    earth: LocalEarth,
}

impl Place {
    pub(super) fn new(position: &Geodetic) -> Self {
        let earth = LocalEarth::at(position);
        Place {
            earth_n: earth.earth_rate_n(),
            gravity: earth.gravity(),
            tan_latitude: earth.sin_latitude / earth.cos_latitude,
            earth,
        }
    }

    /// Ω cos L, rad/s.
    pub(super) fn horizontal_rate(&self) -> f64 {
        self.earth_n.x
    }

    pub(super) fn transport_rate_n(&self, velocity_n: &Vector3<f64>) -> Vector3<f64> {
        self.earth.transport_rate_n(velocity_n)
    }

    /// Derivative of the transport rate by the velocity.
    pub(super) fn transport_by_velocity(&self) -> Matrix3<f64> {
        let (east, north) = (1.0 / self.earth.transverse, -1.0 / self.earth.meridian);
        Matrix3::new(
            0.0,
            east,
            0.0,
            north,
            0.0,
            0.0,
            0.0,
            -east * self.tan_latitude,
            0.0,
        )
    }
}
