//! What goes into a navigator: plain measurements in SI units, inside frames (NED, forward-right-down).

mod unfit;

pub use unfit::{Unfit, is_covariance};

use crate::{earth::Geodetic, time::Time};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// One inertial sample: rates at an instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImuSample {
    /// Stamp on the IMU's clock.
    pub time: Time,
    /// Angular rate of the body against inertial space, ω_ib resolved in b (forward-right-down), rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Specific force resolved in b, m/s²; (0, 0, −g) at rest and level.
    pub specific_force_b: Vector3<f64>,
}

/// One inertial sample of a unit that integrates itself: increments since its previous sample.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImuIncrement {
    /// End of the interval, on the IMU's clock.
    pub time: Time,
    /// ∫ω_ib dt over the interval, resolved in b as it turns, rad.
    pub angle_b: Vector3<f64>,
    /// ∫f dt over the interval, resolved in b as it turns, m/s.
    pub velocity_b: Vector3<f64>,
}

/// A position fix of the GNSS antenna.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssPosition {
    /// Instant at which the position is valid, on the GNSS clock.
    pub time: Time,
    /// Antenna position, ellipsoidal height.
    pub position: Geodetic,
    /// Covariance of the position in NED, m²; `None` when the receiver states none.
    pub covariance_n: Option<Matrix3<f64>>,
}

/// A velocity fix of the GNSS antenna.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssVelocity {
    /// Stamp of the velocity, on the GNSS clock (see `velocity_lag_s` in the configuration).
    pub time: Time,
    /// Antenna velocity over ground in NED, m/s; a NaN Down component means "horizontal only".
    pub velocity_n: Vector3<f64>,
    /// Covariance of the velocity in NED, m²/s²; `None` when the receiver states none.
    pub covariance_n: Option<Matrix3<f64>>,
}

/// A heading from outside: dual antenna, magnetometer, or the user.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heading {
    /// Instant at which the heading is valid.
    pub time: Time,
    /// Heading of the body's forward axis, rad clockwise from true north.
    pub heading: f64,
    /// Standard deviation, rad.
    pub sigma: f64,
}

/// Somebody says whether the body stands: a parking brake, a wheel sensor, the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Standstill {
    /// Instant from which it holds.
    pub time: Time,
    /// Whether the body stands.
    pub standing: bool,
}

/// Speed of the wheels, whichever way they turn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Speed {
    /// Instant at which the speed is valid.
    pub time: Time,
    /// Speed, m/s; its sign is of no importance.
    pub speed: f64,
}

/// The magnetic field around a magnetometer.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MagneticField {
    /// Stamp on the IMU's clock.
    pub time: Time,
    /// Field resolved in b (forward-right-down), T.
    pub field_b: Vector3<f64>,
}

/// Everything that a navigator takes, in one stream.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Sample {
    /// Angular rate and specific force at an instant.
    Imu(ImuSample),
    /// Angle and velocity increments over the interval since the previous one.
    ImuIncrement(ImuIncrement),
    /// GNSS position.
    GnssPosition(GnssPosition),
    /// GNSS velocity.
    GnssVelocity(GnssVelocity),
    /// Heading from outside.
    Heading(Heading),
    /// Whether the body stands.
    Standstill(Standstill),
    /// Speed of the wheels.
    Speed(Speed),
    /// Magnetic field: for the heading of a start only.
    Magnetic(MagneticField),
}

impl Sample {
    /// The sample's stamp, on its own source's clock.
    pub fn time(&self) -> Time {
        match self {
            Sample::Imu(s) => s.time,
            Sample::ImuIncrement(s) => s.time,
            Sample::GnssPosition(s) => s.time,
            Sample::GnssVelocity(s) => s.time,
            Sample::Heading(s) => s.time,
            Sample::Standstill(s) => s.time,
            Sample::Speed(s) => s.time,
            Sample::Magnetic(s) => s.time,
        }
    }

    /// The same sample stamped `seconds` later.
    #[must_use]
    pub fn delayed(self, seconds: f64) -> Self {
        let time = self.time().plus(seconds);
        self.at(time)
    }

    /// The same sample stamped `time`.
    #[must_use]
    pub fn at(mut self, time: Time) -> Self {
        let stamp = match &mut self {
            Sample::Imu(s) => &mut s.time,
            Sample::ImuIncrement(s) => &mut s.time,
            Sample::GnssPosition(s) => &mut s.time,
            Sample::GnssVelocity(s) => &mut s.time,
            Sample::Heading(s) => &mut s.time,
            Sample::Standstill(s) => &mut s.time,
            Sample::Speed(s) => &mut s.time,
            Sample::Magnetic(s) => &mut s.time,
        };
        *stamp = time;
        self
    }

    /// True for the two inertial kinds.
    pub fn is_inertial(&self) -> bool {
        matches!(self, Sample::Imu(_) | Sample::ImuIncrement(_))
    }
}
