//! What the orientation filter estimates, and where each error stands in its vector.

use crate::attitude::exp;
#[cfg(feature = "std")]
use crate::attitude::log;
use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Number of states.
pub(super) const SIZE: usize = 21;
/// Attitude θ, in the level frame: true = Exp(θ) ∘ estimate, rad.
pub(super) const ATTITUDE: usize = 0;
/// Gyro bias, body, rad/s.
pub(super) const GYRO_BIAS: usize = 3;
/// Velocity about its mean, level frame, m/s: its changes are what an accelerometer reads beside gravity.
pub(super) const VELOCITY: usize = 6;
/// Accelerometer bias, body, m/s².
pub(super) const ACCEL_BIAS: usize = 9;
/// Horizontal and downward field of the Earth; magnetic north is where it points.
pub(super) const FIELD: usize = 12;
/// Field that turns with the body.
pub(super) const OFFSET: usize = 14;
/// Field of the surroundings, level frame.
pub(super) const DISTURBANCE: usize = 17;
/// Delay of the magnetometer behind the gyros, s.
pub(super) const DELAY: usize = 20;

/// Errors of all states.
pub(super) type Errors = SVector<f64, SIZE>;
/// Their covariance.
pub(super) type Covariance = SMatrix<f64, SIZE, SIZE>;

/// Where the error of each estimate stands in the covariance: name, first row, rows.
///
/// Attitude (level frame: true = Exp(θ) ∘ estimate, rad), gyro bias (body, rad/s), velocity about its mean (level frame, m/s),
/// accelerometer bias (body, m/s²), horizontal and downward field of the Earth, field that turns with the body, field of the surroundings
/// (level frame; all three in the magnetometer's unit), delay of the magnetometer (s).
pub const AHRS_BLOCKS: [(&str, usize, usize); 8] = [
    ("attitude", ATTITUDE, 3),
    ("gyro_bias", GYRO_BIAS, 3),
    ("velocity", VELOCITY, 3),
    ("accel_bias", ACCEL_BIAS, 3),
    ("field", FIELD, 2),
    ("offset", OFFSET, 3),
    ("disturbance", DISTURBANCE, 3),
    ("delay", DELAY, 1),
];

/// Estimates of all states.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Body to level frame (magnetic north, east, down).
    pub attitude: UnitQuaternion<f64>,
    /// Gyro bias, body, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Velocity about its mean, level frame, m/s.
    pub velocity: Vector3<f64>,
    /// Accelerometer bias, body, m/s².
    pub accel_bias: Vector3<f64>,
    /// Field of the Earth, north and down, in the magnetometer's unit; zero as long as none was seen.
    pub field: Vector2<f64>,
    /// Field that turns with the body (hard iron).
    pub offset: Vector3<f64>,
    /// Field of the surroundings, level frame.
    pub disturbance: Vector3<f64>,
    /// Delay of the magnetometer behind the gyros, s.
    pub delay: f64,
}

impl State {
    pub(super) fn at(attitude: UnitQuaternion<f64>) -> Self {
        State {
            attitude,
            gyro_bias: Vector3::zeros(),
            velocity: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            field: Vector2::zeros(),
            offset: Vector3::zeros(),
            disturbance: Vector3::zeros(),
            delay: 0.0,
        }
    }

    /// Field in the level frame without the body's own.
    pub(super) fn outer_field(&self) -> Vector3<f64> {
        Vector3::new(self.field.x, 0.0, self.field.y) + self.disturbance
    }

    /// Estimate ⊞ errors.
    pub(super) fn corrected(&self, errors: &Errors) -> Self {
        let part = |at: usize| errors.fixed_rows::<3>(at).into_owned();
        let mut attitude = exp(&part(ATTITUDE)) * self.attitude;
        attitude.renormalize_fast();
        State {
            attitude,
            gyro_bias: self.gyro_bias + part(GYRO_BIAS),
            velocity: self.velocity + part(VELOCITY),
            accel_bias: self.accel_bias + part(ACCEL_BIAS),
            field: self.field + errors.fixed_rows::<2>(FIELD),
            offset: self.offset + part(OFFSET),
            disturbance: self.disturbance + part(DISTURBANCE),
            delay: self.delay + errors[DELAY],
        }
    }

    /// Errors of `other` if this is true: this ⊟ other.
    #[cfg(feature = "std")]
    pub(super) fn less(&self, other: &State) -> Errors {
        let mut errors = Errors::zeros();
        let mut put = |at: usize, part: Vector3<f64>| {
            errors.fixed_rows_mut::<3>(at).copy_from(&part);
        };
        put(ATTITUDE, log(&(self.attitude * other.attitude.conjugate())));
        put(GYRO_BIAS, self.gyro_bias - other.gyro_bias);
        put(VELOCITY, self.velocity - other.velocity);
        put(ACCEL_BIAS, self.accel_bias - other.accel_bias);
        put(OFFSET, self.offset - other.offset);
        put(DISTURBANCE, self.disturbance - other.disturbance);
        errors
            .fixed_rows_mut::<2>(FIELD)
            .copy_from(&(self.field - other.field));
        errors[DELAY] = self.delay - other.delay;
        errors
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_follow_one_another_and_fill_the_vector() {
        let mut next = 0;
        for (name, at, count) in AHRS_BLOCKS {
            assert_eq!(at, next, "{name}");
            next += count;
        }
        assert_eq!(next, SIZE);
    }

    #[test]
    fn less_undoes_corrected() {
        let state = State {
            field: Vector2::new(20.0, 40.0),
            ..State::at(exp(&Vector3::new(0.3, -1.0, 2.0)))
        };
        let errors =
            Errors::from_fn(|i, _| 0.01 * (i as f64 + 1.0) * if i % 2 == 0 { 1.0 } else { -1.0 });
        let back = state.corrected(&errors).less(&state);
        assert!((back - errors).amax() < 1e-12, "{back}");
    }
}
