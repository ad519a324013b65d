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
    /// No sample is taken to be better than this, whatever its interval: specific force, m/s², and rate, rad/s.
    least_of_a_sample: [f64; 2],
    /// Standard deviation of what the accelerometer bias adds to |f|, m/s².
    pub accel_bias: f64,
    /// Standard deviation of a gyro bias of which nothing is known, rad/s.
    pub gyro_bias: f64,
}

/// Gravity may differ so much from its standard value, m/s² (9.780 at the equator, 9.832 at the poles).
const GRAVITY: f64 = 0.03;

/// A foot on the ground rolls on: its specific force (m/s²) and rate (rad/s) of a sample, equal on all axes and at any rate of
/// samples, since it is motion and no noise. With the threshold of twelve or so that 25 samples and the usual scale of 1.5 make,
/// these are the 1.7 m/s² and 0.3 rad/s that \[Nilsson12\] uses (0.01 m/s² and 0.1 °/s with γ = 3e4).
const STANCE_FORCE: f64 = 0.5;
const STANCE_RATE: f64 = 0.087;

impl RestNoise {
    /// The noise of the settings where they state it, else `noise`; for a `stance` no less than a foot on the ground shows.
    pub fn new(config: &StationaryConfig, stance: bool, noise: &ImuNoise) -> Self {
        let at_rest = config.noise_at_rest(noise);
        // Far below any unit's: only a division by zero is kept out.
        RestNoise {
            accel_white: at_rest.accel_white.max(1e-10),
            gyro_white: at_rest.gyro_white.max(1e-13),
            least_of_a_sample: if stance {
                [STANCE_FORCE, STANCE_RATE]
            } else {
                [0.0; 2]
            },
            accel_bias: noise.accel_bias_sigma.hypot(GRAVITY),
            gyro_bias: noise.gyro_bias_sigma,
        }
    }

    /// Variance of one axis of the specific force in samples of this interval, m²/s⁴.
    pub fn force_variance(&self, dt: f64) -> f64 {
        let least = self.least_of_a_sample[0];
        (self.accel_white * self.accel_white / dt.max(1e-6)).max(least * least)
    }

    /// Of the rate, rad²/s².
    pub fn rate_variance(&self, dt: f64) -> f64 {
        let least = self.least_of_a_sample[1];
        (self.gyro_white * self.gyro_white / dt.max(1e-6)).max(least * least)
    }
}
