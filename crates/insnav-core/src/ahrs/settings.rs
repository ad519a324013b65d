//! Settings of the orientation filter: one set for all records.

use crate::error::{Error, Result};
use crate::imu::{ImuGrade, ImuNoise};
use serde::{Deserialize, Serialize};

/// What the filter takes the unit, its carrier and the magnetic field for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AhrsSettings {
    /// White noise and bias processes of the inertial unit.
    pub noise: ImuNoise,
    /// Standard deviation of the gyro bias at the start, rad/s; the greater of this and the one of `noise` is taken.
    pub gyro_bias_at_start: f64,
    /// Standard deviation of the accelerometer bias, m/s².
    pub accel_bias_sigma: f64,
    /// Attitude noise that turning makes (scale factors, misalignment, stamps), per rate, √s: density (k |ω|)².
    pub rate_noise: f64,
    /// Velocity noise that acceleration makes, per acceleration, √s: density (k |a|)².
    pub force_noise: f64,
    /// Where the gyros saturate, rad/s; without it they do not.
    pub gyro_range: Option<f64>,
    /// Length of gravity, m/s².
    pub gravity: f64,
    /// The carrier's velocity about its mean, m/s: how far its acceleration may go without being a tilt.
    pub velocity_sigma: f64,
    /// Correlation time of that velocity, s.
    pub velocity_tau: f64,
    /// Time between corrections, s; attitude is given at every sample.
    pub update_interval: f64,
    /// Time that is levelled over before the first attitude, s.
    pub start_interval: f64,
    /// When the body rests, and what that says.
    pub rest: RestSettings,
    /// The magnetometer and the field about it.
    pub field: FieldSettings,
}

/// When the body rests.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RestSettings {
    /// Time for which it must be quiet before it rests, s.
    pub duration: f64,
    /// Largest scatter of a gyro about its mean of half a second, rad/s.
    pub gyro_scatter: f64,
    /// Likewise of an accelerometer, m/s².
    pub accel_scatter: f64,
    /// Greatest rate that may be a bias, rad/s.
    pub rate_limit: f64,
    /// What may be left of a rate over a second at rest, rad/s.
    pub rate_sigma: f64,
    /// Velocity at rest, m/s.
    pub velocity_sigma: f64,
}

/// The magnetometer and the field about it; fields are fractions of the length that the magnetometer shows at the start, so that its unit
/// is of no importance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FieldSettings {
    /// White noise of an independent sample.
    pub sigma: f64,
    /// Independent samples per second at most: what comes faster is correlated.
    pub rate_hz: f64,
    /// Noise by turning, s: what a moment's uncertainty of the field's stamp turns it by.
    pub stamp_sigma: f64,
    /// Delay of the magnetometer behind the gyros at the start, one sigma, s; it is estimated.
    pub delay_sigma: f64,
    /// Field that turns with the body (hard iron left by calibration), one sigma; it is estimated.
    pub offset_sigma: f64,
    /// Its wander, per √s.
    pub offset_wander: f64,
    /// Field of the surroundings beside the Earth's, one sigma.
    pub disturbance_sigma: f64,
    /// Its correlation time as the body moves about, s.
    pub disturbance_tau: f64,
    /// Error of the horizontal and vertical field as taken from the start, one sigma.
    pub length_sigma: f64,
    /// Mean square of normalised residuals over half a second above which the field is another one.
    pub change_ratio: f64,
    /// By how much the body's field may then have changed, one sigma.
    pub change_offset_sigma: f64,
    /// By how much that of the surroundings may have, one sigma.
    pub change_disturbance_sigma: f64,
}

impl Default for AhrsSettings {
    fn default() -> Self {
        AhrsSettings {
            noise: ImuGrade::Consumer.noise(),
            gyro_bias_at_start: 1.0_f64.to_radians(),
            accel_bias_sigma: 0.02,
            rate_noise: 0.003,
            force_noise: 0.02,
            gyro_range: None,
            gravity: crate::imu::STANDARD_GRAVITY,
            velocity_sigma: 1.0,
            velocity_tau: 0.5,
            update_interval: 0.05,
            start_interval: 0.3,
            rest: RestSettings::default(),
            field: FieldSettings::default(),
        }
    }
}

impl Default for RestSettings {
    fn default() -> Self {
        RestSettings {
            duration: 1.5,
            gyro_scatter: 0.5_f64.to_radians(),
            accel_scatter: 0.15,
            rate_limit: 1.5_f64.to_radians(),
            rate_sigma: 0.02_f64.to_radians(),
            velocity_sigma: 0.01,
        }
    }
}

impl Default for FieldSettings {
    fn default() -> Self {
        FieldSettings {
            sigma: 0.018,
            rate_hz: 100.0,
            stamp_sigma: 0.004,
            delay_sigma: 0.01,
            offset_sigma: 0.015,
            offset_wander: 1e-4,
            disturbance_sigma: 0.02,
            disturbance_tau: 1.0,
            length_sigma: 0.02,
            change_ratio: 4.0,
            change_offset_sigma: 0.3,
            change_disturbance_sigma: 0.05,
        }
    }
}

impl AhrsSettings {
    /// `Err` names the first setting that is outside its range.
    pub fn check(&self) -> Result<()> {
        let (rest, field) = (&self.rest, &self.field);
        let positive = [
            ("ahrs.gravity", self.gravity),
            ("ahrs.velocity_sigma", self.velocity_sigma),
            ("ahrs.velocity_tau", self.velocity_tau),
            ("ahrs.update_interval", self.update_interval),
            ("ahrs.start_interval", self.start_interval),
            ("ahrs.gyro_range", self.gyro_range.unwrap_or(1.0)),
            ("ahrs.noise.gyro_white", self.noise.gyro_white),
            ("ahrs.noise.accel_white", self.noise.accel_white),
            ("ahrs.noise.gyro_bias_tau", self.noise.gyro_bias_tau),
            ("ahrs.noise.accel_bias_tau", self.noise.accel_bias_tau),
            ("ahrs.rest.duration", rest.duration),
            ("ahrs.rest.rate_sigma", rest.rate_sigma),
            ("ahrs.rest.velocity_sigma", rest.velocity_sigma),
            ("ahrs.field.sigma", field.sigma),
            ("ahrs.field.rate_hz", field.rate_hz),
            ("ahrs.field.disturbance_tau", field.disturbance_tau),
            ("ahrs.field.change_ratio", field.change_ratio),
        ];
        let not_negative = [
            ("ahrs.gyro_bias_at_start", self.gyro_bias_at_start),
            ("ahrs.accel_bias_sigma", self.accel_bias_sigma),
            ("ahrs.rate_noise", self.rate_noise),
            ("ahrs.force_noise", self.force_noise),
            ("ahrs.noise.gyro_bias_sigma", self.noise.gyro_bias_sigma),
            ("ahrs.noise.accel_bias_sigma", self.noise.accel_bias_sigma),
            ("ahrs.rest.gyro_scatter", rest.gyro_scatter),
            ("ahrs.rest.accel_scatter", rest.accel_scatter),
            ("ahrs.rest.rate_limit", rest.rate_limit),
            ("ahrs.field.stamp_sigma", field.stamp_sigma),
            ("ahrs.field.delay_sigma", field.delay_sigma),
            ("ahrs.field.offset_sigma", field.offset_sigma),
            ("ahrs.field.offset_wander", field.offset_wander),
            ("ahrs.field.disturbance_sigma", field.disturbance_sigma),
            ("ahrs.field.length_sigma", field.length_sigma),
            ("ahrs.field.change_offset_sigma", field.change_offset_sigma),
            (
                "ahrs.field.change_disturbance_sigma",
                field.change_disturbance_sigma,
            ),
        ];
        let refuse = |key, value, expected| {
            Err(Error::Config {
                key,
                value,
                expected,
            })
        };
        for (key, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return refuse(key, value, "positive and finite");
            }
        }
        for (key, value) in not_negative {
            if !(value >= 0.0 && value.is_finite()) {
                return refuse(key, value, "zero or positive, and finite");
            }
        }
        Ok(())
    }

    /// Standard deviation of the gyro bias at the start, rad/s.
    pub(super) fn gyro_bias_sigma(&self) -> f64 {
        self.gyro_bias_at_start.max(self.noise.gyro_bias_sigma)
    }
}
