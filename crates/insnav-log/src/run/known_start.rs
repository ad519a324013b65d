//! A start that the user knows, in place of one found in the data.

use insnav_core::attitude::exp_level;
use insnav_core::config::Config;
use insnav_core::earth::Geodetic;
use insnav_core::error::Result;
use insnav_core::filter::InitialSigma;
use insnav_core::imu::{ImuErrors, ImuNoise};
use insnav_core::mechanization::NavState;
use insnav_core::navigator::Navigator;
use insnav_core::sim::{Source, Stream};
use insnav_core::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

/// Position, velocity and attitude at one instant, with standard deviations: a simulation's, or the end of another run.
///
/// Biases start at zero with the sigmas of the unit's noise, and all errors are independent: what is known was not found with this
/// unit. An attitude that was levelled by its own accelerometers is wrong by what they are; given as a known start, the level would grow
/// too sure by a factor of √2 as soon as the filter sees gravity again.
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
    /// The same start, wrong by errors that are drawn from its sigmas: from the truth, what a filter may honestly be started with.
    ///
    /// true = start ⊞ dx, dx normal with the sigmas; every random number follows from the seed.
    #[must_use]
    pub fn drawn(self, seed: u64) -> Self {
        let mut source = Source::new(seed, Stream::Initial);
        let mut draw = |sigma: &Vector3<f64>| source.normal3().component_mul(sigma);
        let position_error = draw(&self.position_sigma);
        let velocity_error = draw(&self.velocity_sigma);
        let rotation_error = draw(&self.attitude_sigma);
        KnownStart {
            position: self.position.offset(&-position_error),
            velocity_n: self.velocity_n - velocity_error,
            q_nb: exp_level(&rotation_error).inverse() * self.q_nb,
            ..self
        }
    }

    /// A navigator that begins here at `time`.
    ///
    /// # Errors
    /// `Config` for a setting outside its range.
    pub fn navigator(&self, config: &Config, noise: ImuNoise, time: Time) -> Result<Navigator> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::attitude::{Euler, log_level};

    /// 3000 drawn starts: NEES 1 per component in position, velocity and attitude, and one start for one seed.
    #[test]
    fn drawn_errors_have_the_sigmas_that_are_stated() {
        let truth = KnownStart {
            time_s: None,
            position: Geodetic::from_degrees(50.0, 14.0, 300.0),
            velocity_n: Vector3::new(3.0, -4.0, 0.5),
            q_nb: Euler::from_degrees(3.0, -2.0, 120.0).to_quaternion(),
            position_sigma: Vector3::new(1.0, 2.0, 4.0),
            velocity_sigma: Vector3::new(0.1, 0.2, 0.4),
            attitude_sigma: Vector3::new(0.01, 0.02, 0.04),
        };
        assert_eq!(truth.drawn(7), truth.drawn(7));
        assert_ne!(truth.drawn(7), truth.drawn(8));
        let runs = 3000;
        let mut sums = [0.0; 3];
        for seed in 0..runs {
            let start = truth.drawn(seed);
            let square =
                |e: Vector3<f64>, s: &Vector3<f64>| e.component_div(s).norm_squared() / 3.0;
            sums[0] += square(
                start.position.offset_to(&truth.position),
                &truth.position_sigma,
            );
            sums[1] += square(truth.velocity_n - start.velocity_n, &truth.velocity_sigma);
            sums[2] += square(
                log_level(&(truth.q_nb * start.q_nb.inverse())),
                &truth.attitude_sigma,
            );
        }
        for sum in sums {
            // The mean of 9000 squares is 1 ± √(2/9000); four of those.
            assert!(
                (sum / runs as f64 - 1.0).abs() < 4.0 * (2.0f64 / 9000.0).sqrt(),
                "{sums:?}"
            );
        }
    }
}
