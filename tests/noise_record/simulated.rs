//! Records of a unit that rests or turns, with noise of known size.

use insnav::attitude::exp;
use insnav::noise::NoiseReading;
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

/// A unit with white noise and constant biases.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unit {
    pub(crate) step_s: f64,
    /// rad/√s
    pub(crate) gyro_white: f64,
    /// m/s/√s
    pub(crate) accel_white: f64,
    /// T of one sample; 0 without a magnetometer.
    pub(crate) magnetometer: f64,
}

impl Unit {
    /// Like an ADIS16405 at 31 Hz: 2 °/√h, 0.2 m/s/√h, and 0.1 µT.
    pub(crate) fn adis() -> Self {
        Unit {
            step_s: 0.032,
            gyro_white: 2.0_f64.to_radians() / 60.0,
            accel_white: 0.2 / 60.0,
            magnetometer: 0.1e-6,
        }
    }
}

/// How the unit moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Motion {
    Rest,
    /// Turned to and fro about all axes, with rates of so many °/s at most.
    Turning(f64),
}

/// Horizontal accelerations that come and go: half a second of every two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bursts {
    /// m/s²
    pub(crate) size: f64,
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
}

const GYRO_BIAS: Vector3<f64> = Vector3::new(7e-3, -5e-3, 4e-3);
const ACCEL_BIAS: Vector3<f64> = Vector3::new(0.05, -0.03, 0.04);
/// Magnetic field in axes with z along the force at rest (up), T.
const FIELD: Vector3<f64> = Vector3::new(17e-6, 4e-6, -48e-6);
/// Attitude steps to a sample.
const FINE: usize = 4;

pub(crate) fn record(
    unit: &Unit,
    motion: Motion,
    bursts: Option<Bursts>,
    seconds: f64,
    seed: u64,
) -> Vec<NoiseReading> {
    let mut gyro = Source::new(seed, Stream::GyroWhite);
    let mut accel = Source::new(seed, Stream::AccelWhite);
    let mut field = Source::new(seed, Stream::PositionWhite);
    let rate = |t: f64| match motion {
        Motion::Rest => Vector3::zeros(),
        Motion::Turning(most) => {
            Vector3::new((0.9 * t).sin(), (0.7 * t).cos(), (0.5 * t + 1.0).sin())
                * most.to_radians()
        }
    };
    let dt = unit.step_s;
    let mut attitude = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
    (0..(seconds / dt) as usize)
        .map(|i| {
            let t = i as f64 * dt;
            if i > 0 {
                for k in 0..FINE {
                    let fine = dt / FINE as f64;
                    let middle = t - dt + (k as f64 + 0.5) * fine;
                    attitude *= exp(&(rate(middle) * fine));
                }
            }
            let push = match bursts {
                Some(b) if (b.from_s..b.to_s).contains(&t) && t % 2.0 < 0.5 => {
                    Vector3::new(b.size, 0.0, 0.0)
                }
                _ => Vector3::zeros(),
            };
            let body = |v: Vector3<f64>| attitude.inverse() * v;
            NoiseReading {
                time: Time::from_seconds(t),
                angular_rate_b: rate(t)
                    + GYRO_BIAS
                    + gyro.normal3() * (unit.gyro_white / dt.sqrt()),
                specific_force_b: body(Vector3::z() * 9.81 + push)
                    + ACCEL_BIAS
                    + accel.normal3() * (unit.accel_white / dt.sqrt()),
                magnetic_field_b: (unit.magnetometer > 0.0)
                    .then(|| body(FIELD) + field.normal3() * unit.magnetometer),
            }
        })
        .collect()
}
