//! What an inertial unit at rest may show.

use crate::config::StationaryConfig;
use crate::imu::ImuNoise;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

/// Densities of the white noise at rest, and what biases leave.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RestNoise {
    /// White noise of the accelerometers, m/s/√s, per axis.
    pub accel_white: f64,
    /// Of the gyros, rad/√s.
    pub gyro_white: f64,
    /// Standard deviation of what the accelerometer bias adds to |f|, m/s².
    pub accel_bias: f64,
}

/// Gravity may differ so much from its standard value, m/s² (9.780 at the equator, 9.832 at the poles).
const GRAVITY: f64 = 0.03;

/// A foot on the ground rolls on: its specific force (m/s²) and rate (rad/s) of a sample, equal on all axes. With the
/// threshold of six or so these are the 1.7 m/s² and 0.3 rad/s that \[Nilsson12\] uses (0.01 m/s² and 0.1 °/s with γ = 3e4).
const STANCE_FORCE: f64 = 0.7;
const STANCE_RATE: f64 = 0.12;
/// Interval at which these are stated, s.
const STANCE_INTERVAL: f64 = 0.01;

impl RestNoise {
    /// The noise of the settings where they state it, else `noise`; for a `stance` no less than a foot on the ground shows.
    pub fn new(config: &StationaryConfig, stance: bool, noise: &ImuNoise) -> Self {
        let gyro_white = config
            .gyro_arw_deg_per_sqrt_hour
            .map_or(noise.gyro_white, |d| d.to_radians() / 60.0);
        let accel_white = config
            .accel_vrw_m_per_s_per_sqrt_hour
            .map_or(noise.accel_white, |d| d / 60.0);
        let (least_force, least_rate) = if stance {
            (STANCE_FORCE, STANCE_RATE)
        } else {
            // Far below any unit's: only a division by zero is kept out.
            (1e-9, 1e-12)
        };
        let per_root_second = STANCE_INTERVAL.sqrt();
        RestNoise {
            accel_white: accel_white.max(least_force * per_root_second),
            gyro_white: gyro_white.max(least_rate * per_root_second),
            accel_bias: noise.accel_bias_sigma.hypot(GRAVITY),
        }
    }

    /// Variance of one axis of the specific force in samples of this interval, m²/s⁴.
    pub fn force_variance(&self, dt: f64) -> f64 {
        self.accel_white * self.accel_white / dt.max(1e-6)
    }

    /// Of the rate, rad²/s².
    pub fn rate_variance(&self, dt: f64) -> f64 {
        self.gyro_white * self.gyro_white / dt.max(1e-6)
    }
}
