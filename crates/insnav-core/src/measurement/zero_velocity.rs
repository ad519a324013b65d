//! The body stands: its velocity is zero.

use crate::config::{StationaryConfig, ZERO_VELOCITY};
use crate::error::Result;
use crate::filter::{
    Columns, Eskf, Gate, Layout, Linearized, Measurement, Nominal, Update, VELOCITY,
};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Zero velocity over ground: r = −v, m/s NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroVelocityModel {
    /// Standard deviation of each component, m/s.
    pub sigma: f64,
}

impl Measurement<3> for ZeroVelocityModel {
    fn name(&self) -> &'static str {
        "zero_velocity"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let mut h = Columns::default();
        h.put(layout, VELOCITY, &Matrix3::identity());
        Linearized {
            residual: -at.nav.velocity_n,
            h,
            r: Matrix3::from_diagonal_element(self.sigma * self.sigma),
        }
    }
}

/// When and how zero velocities are used: at every inertial sample of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ZeroVelocityAid {
    density: f64,
}

impl ZeroVelocityAid {
    /// From the settings.
    pub fn new(config: &StationaryConfig) -> Self {
        ZeroVelocityAid {
            density: config
                .zero_velocity_m_per_s_per_sqrt_hz
                .unwrap_or(ZERO_VELOCITY),
        }
    }

    /// The model for an interval of `dt` seconds: vibration averages out, so that half the interval is half the weight.
    pub fn model(&self, dt: f64) -> ZeroVelocityModel {
        ZeroVelocityModel {
            sigma: self.density / dt.sqrt(),
        }
    }

    /// The interval whose zero velocity is known to `sigma`, s.
    pub fn interval_for(&self, sigma: f64) -> f64 {
        let ratio = self.density / sigma;
        ratio * ratio
    }

    /// Tell the filter that the body stands. A stop that is believed is not argued about: what does not fit is widened.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(&self, dt: f64, filter: &mut Eskf) -> Result<Update> {
        let time = filter.nominal().nav.time;
        filter.update(&self.model(dt), time, &mut Gate::lenient())
    }
}
