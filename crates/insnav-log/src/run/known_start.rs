//! A start that the user knows, in place of one found in the data.

use insnav_core::config::Config;
use insnav_core::earth::Geodetic;
use insnav_core::error::Result;
use insnav_core::filter::InitialSigma;
use insnav_core::imu::{ImuErrors, ImuNoise};
use insnav_core::mechanization::NavState;
use insnav_core::navigator::Navigator;
use insnav_core::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

/// Position, velocity and attitude at one instant, with standard deviations: a simulation's, or the end of another run.
///
/// Biases start at zero with the sigmas of the unit's noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownStart {
    /// Seconds after the run's zero; `None`: at the first inertial sample.
    pub time_s: Option<f64>,
    /// Position of the IMU.
    pub position: Geodetic,
    /// Velocity over ground, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// Rotation from body (forward-right-down) to NED.
    pub q_nb: UnitQuaternion<f64>,
    /// Standard deviation of the position, NED, m.
    pub position_sigma: Vector3<f64>,
    /// Standard deviation of the velocity, NED, m/s.
    pub velocity_sigma: Vector3<f64>,
    /// Standard deviation of the attitude as a small rotation about north, east, down, rad.
    pub attitude_sigma: Vector3<f64>,
}

impl KnownStart {
    /// A navigator that begins here at `time`.
    pub(super) fn navigator(
        &self,
        config: &Config,
        noise: ImuNoise,
        time: Time,
    ) -> Result<Navigator> {
        let nav = NavState {
            time,
            position: self.position,
            velocity_n: self.velocity_n,
            q_nb: self.q_nb,
        };
        let sigma = InitialSigma {
            position: self.position_sigma,
            velocity: self.velocity_sigma,
            attitude: self.attitude_sigma,
            gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
            accel_bias: Vector3::repeat(noise.accel_bias_sigma),
        };
        Navigator::aligned(config, noise, nav, ImuErrors::default(), &sigma)
    }
}
